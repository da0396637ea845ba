"""What a compiled function's fingerprint depends on, and what it does not."""

from __future__ import annotations

import importlib
import subprocess
import sys
from enum import IntEnum
from types import FunctionType
from typing import Any

import numpy as np
import pytest

from tdcr_planner.compiled import njit
from tdcr_planner.fingerprint import UnknownValueError, fingerprint

MODULES = [
    "tdcr_planner.statics.batch",
    "tdcr_planner.shape.shooting",
    "tdcr_planner.collision.settle",
    "tdcr_planner.collision.clearance",
    "tdcr_planner.planning.kernels",
    "tdcr_planner.report.raster",
]
PRINT = "import sys; sys.path.insert(0, sys.argv[1]); import test_fingerprint; print(test_fingerprint.all_of_them())"


def kernels(module: str) -> dict[str, Any]:
    found = vars(importlib.import_module(module))
    return {name: value for name, value in found.items() if hasattr(value, "py_func")}


def all_of_them() -> list[str]:
    return [fingerprint(kernel) for module in MODULES for kernel in kernels(module).values()]


class Colour(IntEnum):
    RED = 1


def with_global(value: object) -> Any:
    """Returns a function whose only global is `value`."""

    def function(x):  # type: ignore[no-untyped-def]
        return x + CONSTANT  # type: ignore[name-defined] # noqa: F821

    return FunctionType(function.__code__, {"CONSTANT": value, "__name__": __name__}, "function")


def test_every_kernel_has_its_own() -> None:
    for module in MODULES:
        found = [fingerprint(kernel) for kernel in set(kernels(module).values())]
        assert len(found) >= 3 or module.endswith("raster")
        assert len(set(found)) == len(found)


def test_another_process_finds_the_same() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PRINT, __file__.rpartition("/")[0]],
        env={"PYTHONPATH": ":".join(path for path in sys.path if path), "PYTHONHASHSEED": "3"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == str(all_of_them())


VALUES = [
    1, 1.0, True, "1", b"1", None, (1,), [1], (1, 1), {1: 1.0}, frozenset({1}), np.float32(1.0), np.array([1.0]),
    np.array([2.0]), np.array([1]), np.array([[1.0]]), Colour, Colour.RED, np, np.int64, abs, np.sin,
]  # fmt: skip


def test_each_value_of_a_global_counts() -> None:
    found = [fingerprint(with_global(value)) for value in VALUES]
    assert len(set(found)) == len(found)
    assert found == [fingerprint(with_global(value)) for value in VALUES]


def test_options_count() -> None:
    plain = with_global(1.0)
    found = [fingerprint(njit(plain, **options)) for options in ({}, {"fastmath": True}, {"error_model": "numpy"})]
    assert len(set(found)) == 3


def test_a_function_that_calls_itself_has_one() -> None:
    def function(x):  # type: ignore[no-untyped-def]
        return x if x < 1.0 else function(x - 1.0)

    assert fingerprint(function) == fingerprint(function)


def test_what_has_no_text_has_no_fingerprint() -> None:
    with pytest.raises(UnknownValueError, match="type object"):
        fingerprint(with_global(object()))
