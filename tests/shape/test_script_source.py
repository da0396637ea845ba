"""The text of a module: what is loaded is written from what was checked."""

from __future__ import annotations

from pathlib import Path

import pytest

from tdcr_planner.errors import FormatError
from tdcr_planner.shape.script_source import check_source

HEAD = "class M(Module):\n  __parameters__ = []\n  __buffers__ = []\n  training : bool\n"


def check(body: str, head: str = HEAD) -> str:
    text = f"{head}  def forward(self: __torch__.M,\n    x: Tensor) -> Tensor:\n    {body}\n    return x\n"
    return check_source(Path("mine.pt"), {"__torch__.py": text}).files["__torch__.py"]


def test_comments_and_warnings_are_left_out() -> None:
    text = check('torch.warn("careful")  # a comment')
    assert "warn" not in text
    assert "comment" not in text
    assert "pass" in text


def test_texts_keep_modes_and_lose_what_parsers_may_differ_about() -> None:
    text = check('y = torch.div(x, 2, rounding_mode="trunc")\n    z = torch.format("it\\\'s {}\\n", x)')
    assert "'trunc'" in text
    assert "it_s {}_" in text


def test_arguments_are_those_of_forward() -> None:
    text = HEAD + "  def forward(self: __torch__.M,\n    tau: Tensor,\n    g: Tensor) -> Tensor:\n    return tau\n"
    assert check_source(Path("m.pt"), {"__torch__.py": text}).arguments == {"__torch__.M": ("tau", "g")}


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("y = torch.save(x)", "operator `torch.save`"),
        ("while True:\n      pass", "While"),
        ("y = torch.zeros([100000, 100000])", "10,000,000,000 numbers"),
        ("for i in range(10000000):\n      pass", "10,000,000 steps"),
        ("y = " + "(" * 150 + "x" + ",)" * 150, "nested"),
        ("y = -" * 1 + "-" * 150 + "x", "nested"),
    ],
)
def test_messages_name_the_code(body: str, words: str) -> None:
    with pytest.raises(FormatError) as caught:
        check(body)
    assert words in str(caught.value)
    assert "code/__torch__.py" in str(caught.value)


def test_sizes_within_reason_pass() -> None:
    assert "torch.full([3, 3], 1000000000)" in check("y = torch.full([3, 3], 1000000000)")
    assert "9223372036854775807" in check("y = torch.slice(x, 0, 0, 9223372036854775807)")
