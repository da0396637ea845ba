"""How the statics are compiled.

Arrays are copied number by number in compiled code: numba compiles the assignment of whole arrays to code that checks
and words mismatches of their shapes, which takes longer to compile than the functions themselves.
"""

from __future__ import annotations

from typing import Any

OPTIONS: dict[str, Any] = {
    "nogil": True,
    "cache": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "arcp", "nsz"},
}

INLINED: dict[str, Any] = OPTIONS | {"forceinline": True}
