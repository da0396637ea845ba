"""Pictures on the command line: drawn last, so that neither a fault nor Ctrl-C costs what was asked for."""

from __future__ import annotations

import sys
from collections.abc import Callable


def draw_after(written: str, draw: Callable[[], list[str]]) -> list[str]:
    """Draws pictures of what is already written and returns the names of those drawn; Ctrl-C ends the drawing alone.

    Args:
        written: What stands whatever happens, for a person.
        draw: Draws the pictures and returns their names.
    """
    try:
        return draw()
    except KeyboardInterrupt:
        print(f"interrupted while drawing: {written} stands, pictures are missing", file=sys.stderr)
        return []
