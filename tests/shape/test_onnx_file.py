"""ONNX files: numbers beside the file alone, standard operators alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.shape.onnx_file import check_onnx, onnx_session

onnx = pytest.importorskip("onnx")


def model(domain: str = "", operator: str = "Add", location: str | None = None) -> Any:
    weight = onnx.numpy_helper.from_array(np.arange(3, dtype=np.float32), "w")
    if location is not None:
        weight.ClearField("raw_data")
        weight.data_location = onnx.TensorProto.EXTERNAL
        for key, value in (("location", location), ("offset", "4"), ("length", "12")):
            entry = weight.external_data.add()
            entry.key, entry.value = key, value
    vector = onnx.helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, ["n", 3])
    answer = onnx.helper.make_tensor_value_info("y", onnx.TensorProto.FLOAT, ["n", 3])
    node = onnx.helper.make_node(operator, ["x", "w"], ["y"], domain=domain)
    graph = onnx.helper.make_graph([node], "g", [vector], [answer], [weight])
    opsets = [onnx.helper.make_opsetid("", 18)] + ([onnx.helper.make_opsetid(domain, 1)] if domain else [])
    return onnx.helper.make_model(graph, opset_imports=opsets, ir_version=9)


def write(path: Path, content: Any) -> Path:
    path.write_bytes(content.SerializeToString())
    return path


def test_numbers_beside_the_file_are_taken_in(tmp_path: Path) -> None:
    (tmp_path / "w.bin").write_bytes(bytes(4) + np.array([1, 2, 3], dtype=np.float32).tobytes())
    path = write(tmp_path / "m.onnx", model(location="w.bin"))
    content = check_onnx(path)
    (tmp_path / "w.bin").unlink()
    answer = onnx_session(path, content).run(None, {"x": np.zeros((2, 3), dtype=np.float32)})[0]
    np.testing.assert_array_equal(answer, [[1, 2, 3], [1, 2, 3]])


@pytest.mark.parametrize("location", ["../w.bin", "/etc/passwd", "sub/w.bin", "..", "", "missing.bin", "link.bin"])
def test_numbers_in_other_places_are_refused(tmp_path: Path, location: str) -> None:
    (tmp_path / "w.bin").write_bytes(bytes(64))
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/w.bin").write_bytes(bytes(64))
    (tmp_path / "link.bin").symlink_to("/etc/passwd")
    path = write(tmp_path / "sub/m.onnx" if location == "../w.bin" else tmp_path / "m.onnx", model(location=location))
    with pytest.raises(FormatError, match=r"m\.onnx.*(beside|tensor)"):
        check_onnx(path)


def test_numbers_beyond_the_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "w.bin").write_bytes(bytes(8))
    with pytest.raises(FormatError, match="beyond the 8 bytes"):
        check_onnx(write(tmp_path / "m.onnx", model(location="w.bin")))


def test_numbers_outside_of_a_model_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "w.bin").write_bytes(bytes(64))
    with pytest.raises(FormatError, match="beside"):
        check_onnx(tmp_path / "model.pt", model(location="w.bin").SerializeToString())


@pytest.mark.parametrize(
    ("domain", "operator"), [("mine", "Write"), ("", "RandomNormalLike"), ("com.microsoft", "Gelu")]
)
def test_other_operators_are_refused(tmp_path: Path, domain: str, operator: str) -> None:
    with pytest.raises(FormatError, match="operator"):
        check_onnx(write(tmp_path / "m.onnx", model(domain, operator)))


def test_what_is_no_model_is_refused(tmp_path: Path) -> None:
    (tmp_path / "m.onnx").write_bytes(b"\x00\x01nothing")
    with pytest.raises(FormatError, match="no ONNX file"):
        check_onnx(tmp_path / "m.onnx")
