"""A bound on the memory that a foreign module may take while it is called."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

CALL_BYTES = 4 * 1024**3
"""What a call may take beyond what the process has: thousands of times what a batch of shapes needs."""

_PAGES = Path("/proc/self/statm")


@contextmanager
def bounded_memory(most_bytes: int = CALL_BYTES) -> Iterator[None]:
    """Lets the process take at most so much more address space inside of the `with` block.

    What asks for more gets the allocator's error. The bound is the operating system's, for the whole process; where the
    system has none (other than Linux), nothing is bounded.
    """
    if not _PAGES.exists():
        yield
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    allowed = int(_PAGES.read_text().split(maxsplit=1)[0]) * resource.getpagesize() + most_bytes
    for limit in (soft, hard):
        if limit != resource.RLIM_INFINITY:
            allowed = min(allowed, limit)
    resource.setrlimit(resource.RLIMIT_AS, (allowed, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
