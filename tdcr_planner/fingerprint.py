"""A hash of everything that decides a compiled function's machine code: its own code and that of all it calls."""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Iterator
from enum import Enum
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np

from tdcr_planner.errors import TdcrError

_PACKAGE = __name__.partition(".")[0]
# Settings of numba, from its environment variables, that change the code it makes.
_SETTINGS = ("OPT", "BOUNDSCHECK", "LOOP_VECTORIZE", "SLP_VECTORIZE", "DEBUGINFO_DEFAULT", "CPU_NAME", "CPU_FEATURES")


class UnknownValueError(TdcrError, TypeError):
    """A compiled function uses a value that has no fingerprint."""


def fingerprint(function: Any) -> str:
    """Returns the SHA-256 of a compiled function, of the functions and constants it uses, and of what compiles it.

    Two processes that get the same fingerprint would make the same machine code for the same argument types and
    processor. File names, line numbers and docstrings do not count.

    Args:
        function: What `tdcr_planner.compiled.njit` returned, or a plain function that compiled code uses.

    Raises:
        UnknownValueError: It uses a global that is neither a function, a number, a string, an array, an enum nor a
            collection of those.
    """
    text = hashlib.sha256(_toolchain().encode())
    seen: dict[Any, int] = {}
    waiting = [function]
    while waiting:
        current = waiting.pop()
        if current in seen:
            continue
        seen[current] = len(seen)
        for part in _parts(current, waiting):
            text.update(part.encode())
            text.update(b"\0")
    return text.hexdigest()


@cache
def _toolchain() -> str:
    settings = {name: getattr(numba.config, name, None) for name in _SETTINGS}
    return f"{sys.implementation.cache_tag} {sys.version_info[:3]} {numba.__version__} {np.__version__} {settings}"


def _parts(function: Any, waiting: list[Any]) -> Iterator[str]:
    """Yields the text of one function, and appends the functions that it uses to `waiting`."""
    plain = getattr(function, "py_func", function)
    if plain is not function:
        yield _value(function.targetoptions, waiting)
    yield f"{plain.__module__}.{plain.__qualname__}"
    yield _value(plain.__defaults__, waiting)
    yield _value(plain.__kwdefaults__, waiting)
    for cell in plain.__closure__ or ():
        yield _value(cell.cell_contents, waiting)
    for code in _code_objects(plain.__code__):
        yield _code_text(code, plain.__doc__)
        for name in code.co_names:
            if name not in plain.__globals__:
                continue
            value = plain.__globals__[name]
            yield f"{name}={_value(value, waiting)}"
            if isinstance(value, ModuleType) and value.__name__.partition(".")[0] == _PACKAGE:
                for attribute in code.co_names:
                    if hasattr(value, attribute):
                        yield f"{attribute}={_value(getattr(value, attribute), waiting)}"


def _code_objects(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code_objects(constant)


def _code_text(code: CodeType, docstring: str | None) -> str:
    constants = [
        _value(constant, [])
        for constant in code.co_consts
        if not isinstance(constant, CodeType) and not (docstring is not None and constant == docstring)
    ]
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    return f"{code.co_code.hex()} {constants} {names} {code.co_argcount} {code.co_kwonlyargcount} {code.co_flags}"


def _value(value: Any, waiting: list[Any]) -> str:
    """Returns the text of a value; functions found in it are appended to `waiting` and stand by name."""
    if value is None or value is Ellipsis or isinstance(value, bool | int | float | complex | str | bytes | np.generic):
        # repr of a float is exact; an enum member is its name and number.
        return f"{type(value).__name__}:{value!r}"
    if isinstance(value, tuple | list):
        return f"{type(value).__name__}({', '.join(_value(item, waiting) for item in value)})"
    if isinstance(value, set | frozenset):
        return f"set({', '.join(sorted(_value(item, waiting) for item in value))})"
    if isinstance(value, dict):
        return f"dict({', '.join(sorted(f'{_value(k, waiting)}:{_value(v, waiting)}' for k, v in value.items()))})"
    if isinstance(value, np.ndarray):
        return f"array({value.dtype.str}, {value.shape}, {hashlib.sha256(value.tobytes()).hexdigest()})"
    if isinstance(value, ModuleType):
        return f"module:{value.__name__} {getattr(value, '__version__', '')}"
    if isinstance(value, Enum):
        return repr(value)
    if inspect.isclass(value):
        members = [repr(member) for member in value] if issubclass(value, Enum) else getattr(value, "_fields", ())
        return f"class:{value.__module__}.{value.__qualname__} {members}"
    if isinstance(value, FunctionType) or hasattr(value, "py_func"):
        waiting.append(value)
        return f"function:{value.__module__}.{value.__qualname__}"
    if isinstance(value, np.ufunc | numba.types.Type) or inspect.isbuiltin(value):
        return repr(value)
    raise UnknownValueError(f"no fingerprint for a value of type {type(value).__name__}: {value!r}")
