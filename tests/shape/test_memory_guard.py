"""The bound on memory of a call."""

from __future__ import annotations

import resource

import numpy as np
import pytest

from tdcr_planner.shape.memory_guard import bounded_memory

GIGABYTE = 1024**3


def test_what_asks_for_more_gets_an_error_and_the_limit_is_as_before() -> None:
    before = resource.getrlimit(resource.RLIMIT_AS)
    with bounded_memory(GIGABYTE):
        assert np.zeros(1000).sum() == 0.0
        with pytest.raises(MemoryError):
            np.ones(GIGABYTE)  # 8 GB
    assert resource.getrlimit(resource.RLIMIT_AS) == before


def test_the_limit_is_lifted_after_an_error() -> None:
    before = resource.getrlimit(resource.RLIMIT_AS)
    with pytest.raises(ValueError, match="inside"), bounded_memory(GIGABYTE):
        raise ValueError("inside")
    assert resource.getrlimit(resource.RLIMIT_AS) == before
