"""Foreign TorchScript: honest networks are let through and answer the same, nothing else is loaded."""

from __future__ import annotations

import io
import warnings
import zipfile
from pathlib import Path
from typing import Any

import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.robot import RobotSpec
from tdcr_planner.shape.script_archive import check_script

MINE = Path("mine.pt")


def load(content: bytes) -> Any:
    import torch

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return torch.jit.load(io.BytesIO(content))


def tensors(answer: Any) -> list[Any]:
    return list(answer.values()) if isinstance(answer, dict) else list(answer)


def test_honest_networks_are_let_through_and_answer_the_same(networks: Any, paper_robot: RobotSpec) -> None:
    kinds = networks.honest_modules(paper_robot)
    assert len(kinds) >= 20
    for name, make in kinds.items():
        content = make()
        checked = check_script(MINE, content)
        inputs = networks.example()[: len(checked.arguments)]
        if name == "single precision":
            inputs = tuple(array.float() for array in inputs)
        given, ours = tensors(load(content)(*inputs)), tensors(load(checked.content)(*inputs))
        assert checked.arguments[0] == "tensions", name
        for one, other in zip(given, ours, strict=True):
            assert (one == other).all(), name


def test_no_module_that_does_more_is_loaded(attacks: Any) -> None:
    found = attacks.attacks()
    assert len(found) >= 300
    for name, content in found.items():
        with pytest.raises(FormatError) as caught:
            check_script(MINE, content)
        assert "mine.pt" in str(caught.value), name


def test_the_module_of_the_attacks_is_loaded_without_them(attacks: Any) -> None:
    import torch

    module = load(check_script(MINE, attacks.archive(attacks.code())).content)
    assert (module(torch.ones(4)) == 0.0).all()


def test_records_that_nothing_names_are_left_out(attacks: Any) -> None:
    buffer = io.BytesIO(attacks.archive(attacks.code()))
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr("archive/code/__torch__.py.debug_pkl", b"cos\nsystem\n.")
        archive.writestr("archive/extra/anything", b"1")
    with zipfile.ZipFile(io.BytesIO(check_script(MINE, buffer.getvalue()).content)) as archive:
        assert all(name.endswith((".py", ".pkl", "/0", "/version", "/byteorder")) for name in archive.namelist())


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"PK\x03\x04 not an archive", "damaged"),
        (b"", "damaged"),
        (b"\x80\x02]q\x00.", "damaged"),
    ],
)
def test_files_that_are_none_are_refused(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "mine.pt"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=words):
        check_script(path)


def test_a_module_without_forward_is_refused(attacks: Any) -> None:
    files = attacks.code()
    files["__torch__.py"] = files["__torch__.py"].replace("def forward(", "def backward_pass(")
    with pytest.raises(FormatError, match="no function `forward`"):
        check_script(MINE, attacks.archive(files))
