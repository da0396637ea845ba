"""Model files as data: what they hold is checked, and nothing in them is run."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.shape.learned import load_shape_model
from tdcr_planner.shape.model_file import read_model_file

MODELS = Path(__file__).resolve().parents[2] / "models/shape"
SHOOTING, PAPER = MODELS / "inspection/model.pt", MODELS / "paper/published.pt"


def rewrite(source: Path, target: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """Copies a model file record by record; None leaves a record out."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = change(name, old.read(name))
            if content is not None:
                new.writestr(name, content)
    return target


def change_record(end: str, change: Callable[[bytes], bytes | None]) -> Callable[[str, bytes], bytes | None]:
    return lambda name, content: change(content) if name.endswith(end) else content


def change_card(**changes: Any) -> Callable[[str, bytes], bytes | None]:
    return change_record("card.json", lambda content: json.dumps({**json.loads(content), **changes}).encode())


def change_weights(change: Callable[[dict[str, Any]], None]) -> Callable[[str, bytes], bytes | None]:
    def replace(content: bytes) -> bytes:
        with np.load(io.BytesIO(content)) as archive:
            arrays = dict(archive)
        change(arrays)
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
        return buffer.getvalue()

    return change_record("weights.npz", replace)


def drop(*names: str) -> Callable[[dict[str, Any]], None]:
    return lambda arrays: [arrays.pop(name) for name in names] and None


def scale_of_seven(arrays: dict[str, Any]) -> None:
    arrays["load_scale"] = np.ones(7, dtype=np.float32)


def complex_bias(arrays: dict[str, Any]) -> None:
    arrays["bias_1"] = arrays["bias_1"].astype(np.complex64)


def other_robot(arrays: dict[str, Any]) -> None:
    arrays["features"] = np.zeros((12, 13), dtype=np.float32)


def not_finite(arrays: dict[str, Any]) -> None:
    arrays["matrix_0"][0, 0] = np.nan


def wider(arrays: dict[str, Any]) -> None:
    arrays["bias_0"] = np.zeros(len(arrays["bias_0"]) + 1, dtype=np.float32)


def more_corrections(arrays: dict[str, Any]) -> None:
    arrays["corrections"] = np.array(10**9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (scale_of_seven, ["load_scale", "(6)", "(7,)"]),
        (complex_bias, ["bias_1", "float32", "complex64"]),
        (other_robot, ["features", "(12, 13)"]),
        (not_finite, ["matrix_0", "finite", "nan"]),
        (wider, ["bias_0", "65"]),
        (more_corrections, ["corrections", "at most 5"]),
        (drop("bias_2"), ["layers, each with a matrix and a bias"]),
        (drop("layers"), ["layers", "missing"]),
    ],
)
def test_weights_that_do_not_fit_are_refused(tmp_path: Path, change: Any, words: list[str]) -> None:
    path = rewrite(SHOOTING, tmp_path / "model.pt", change_weights(change))
    with pytest.raises(FormatError) as caught:
        read_model_file(path)
    for word in ["model.pt", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("source", "change", "words"),
    [
        (SHOOTING, change_card(network="paper"), ["its card is of network 'paper'"]),
        (PAPER, change_card(network="shooting"), ["its card is of network 'shooting'"]),
        (SHOOTING, change_card(network="mine"), ["network", "'mine'"]),
        (
            SHOOTING,
            change_card(domain={"max_tension_n": [1.0], "gravity_m_s2": 1.0, "tip_force_n": 0.0}),
            ["3 tendons"],
        ),
        (SHOOTING, change_card(disk_arc_lengths_m=[0.0, 0.1]), ["arc length"]),
        (SHOOTING, change_record("card.json", lambda content: b"[" * 100_000), ["card.json", "not valid JSON"]),
        (SHOOTING, change_record("card.json", lambda content: b"[]"), ["card.json", "JSON object"]),
        (SHOOTING, change_record("weights.npz", lambda content: None), ["no weights.npz"]),
        (SHOOTING, change_record("weights.npz", lambda content: content[:500]), ["damaged"]),
        (SHOOTING, change_record("data.pkl", lambda content: None), ["no module"]),
    ],
)
def test_parts_that_do_not_belong_together_are_refused(
    tmp_path: Path, source: Path, change: Any, words: list[str]
) -> None:
    path = rewrite(source, tmp_path / "model.pt", change)
    with pytest.raises(FormatError) as caught:
        load_shape_model(path)
    for word in ["model.pt", *words]:
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("end", "change", "words"),
    [
        ("data/2", lambda content: content[:-4], ["damaged", "data/2"]),
        ("data/0", lambda content: bytes(len(content)), ["directions", "robot in the card"]),
        ("data/4", lambda content: b"\0\0\xc0\x7f" + content[4:], ["layers.1.weight", "nan"]),
    ],
)
def test_tensors_that_do_not_fit_are_refused(tmp_path: Path, end: str, change: Any, words: list[str]) -> None:
    path = rewrite(PAPER, tmp_path / "model.pt", change_record(end, change))
    with pytest.raises(FormatError) as caught:
        load_shape_model(path).disk_poses([[1.0, 0.5, 0.0]])
    for word in words:
        assert word in str(caught.value)


def test_modules_are_those_that_the_files_store() -> None:
    import torch

    generator = np.random.default_rng(3)
    for path in (SHOOTING, PAPER):
        model = load_shape_model(path)
        stored = torch.jit.load(path)
        inputs = [torch.as_tensor(generator.uniform(0.0, 1.0, (20, 3))) for _ in range(3)]
        with torch.inference_mode():
            for mine, theirs in zip(model.torch_module(*inputs), stored(*inputs), strict=True):
                # Both do the same sums of the rod's constants, which the file rounds where its training stood.
                torch.testing.assert_close(mine, theirs, rtol=0.0, atol=1e-14)


def write_foreign_model(path: Path, written: Path, kind: str) -> None:
    """Writes a model file whose program writes another file, when it is loaded or asked for a shape."""
    import torch

    class OnCall(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.written = str(written)

        def forward(self, tensions: torch.Tensor, gravity: torch.Tensor, tip_force: torch.Tensor) -> torch.Tensor:
            page = torch.from_file(self.written, shared=True, size=64, dtype=torch.uint8)
            return tensions + page.sum()

    class OnLoad(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.weight, self.written = torch.zeros(2), str(written)

        @torch.jit.export
        def __getstate__(self):
            return (self.weight, self.written, self.training)

        @torch.jit.export
        def __setstate__(self, state: tuple[torch.Tensor, str, bool]):
            self.weight, self.written, self.training = state[0], state[1], state[2]
            torch.save(self.weight, self.written)

        def forward(self, tensions: torch.Tensor) -> torch.Tensor:
            return tensions

    with zipfile.ZipFile(PAPER) as archive:
        extra = {"card.json": archive.read("archive/extra/card.json")}
    torch.jit.save(torch.jit.script(OnCall() if kind == "call" else OnLoad()), path, _extra_files=extra)
    written.unlink(missing_ok=True)


@pytest.mark.parametrize("kind", ["call", "load"])
def test_programs_of_others_are_refused_and_not_run(tmp_path: Path, kind: str) -> None:
    path, written = tmp_path / "model.pt", tmp_path / "written"
    write_foreign_model(path, written, kind)
    with pytest.raises(FormatError, match="code that this program does not run"):
        load_shape_model(path).disk_poses([[1.0, 0.5, 0.0]])
    assert not written.exists()


def test_a_program_put_into_a_model_of_ours_is_not_run(tmp_path: Path) -> None:
    written = tmp_path / "written"
    evil = f"""class PaperNetwork(Module):
  def forward(self, tensions: Tensor, gravity: Tensor, tip_force: Tensor) -> Tensor:
    page = torch.from_file("{written}", True, 64, dtype=0)
    return tensions
""".encode()
    path = rewrite(PAPER, tmp_path / "model.pt", change_record("paper_network.py", lambda _: evil))
    mine, whole = load_shape_model(path), load_shape_model(PAPER)
    tensions = [[1.0, 0.5, 0.0], [0.0, 2.0, 0.1]]
    np.testing.assert_array_equal(mine.disk_poses(tensions).positions, whole.disk_poses(tensions).positions)
    assert not written.exists()


@pytest.mark.parametrize("source", [SHOOTING, PAPER])
def test_three_hundred_damaged_files_are_refused_or_read_as_the_whole(
    tmp_path: Path, source: Path, random: np.random.Generator
) -> None:
    whole = source.read_bytes()
    expected = read_model_file(source)
    path = tmp_path / "model.pt"
    for index in range(300):
        content = bytearray(whole)
        if index % 2:
            content[random.integers(len(whole))] ^= 1 << random.integers(8)
        else:
            del content[random.integers(len(whole)) :]
        path.write_bytes(content)
        try:
            read = read_model_file(path)
        except FormatError:
            continue
        assert read.card == expected.card
        for name, array in expected.tensors.items():
            np.testing.assert_array_equal(read.tensors[name], array)
        if expected.weights is not None and read.weights is not None:
            for mine, theirs in zip(read.weights.matrices, expected.weights.matrices, strict=True):
                np.testing.assert_array_equal(mine, theirs)
