"""The decorator of compiled functions: what numba's does, with a cache that is never stale and never in the way."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numba

from tdcr_planner.linked import LinkedCompiler
from tdcr_planner.machine_code import MachineCodeCache


def njit(function: Callable[..., Any] | None = None, *, cache: bool = True, **options: Any) -> Any:
    """Compiles a function as `numba.njit` does, and keeps its machine code for later processes.

    The machine code is found by the function's own code, that of every function it calls, the constants they use, the
    argument types and the processor; see `fingerprint`. So functions may stand in any file.

    Args:
        function: The function, or None where the decorator is written with options.
        cache: Whether to keep the machine code. False for functions that only other compiled functions call: they
            become part of their callers' code, and keeping them by themselves only takes time.
        **options: Options of `numba.njit`.
    """
    if function is None:
        return functools.partial(njit, cache=cache, **options)
    dispatcher = numba.njit(**options)(function)
    # With NUMBA_DISABLE_JIT the function comes back as it is.
    if not hasattr(dispatcher, "overloads"):
        return dispatcher
    if cache:
        dispatcher._cache = MachineCodeCache(dispatcher)
    # Called from compiled code it needs none of what unpacks Python objects, which takes longer to compile than most
    # functions themselves. That form is part of its callers' machine code and not kept by itself.
    without_wrappers = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    linked = numba.njit(**options, **without_wrappers, pipeline_class=LinkedCompiler)(function)
    dispatcher.get_call_template = _without_literals(linked.get_call_template)
    dispatcher.get_overload = linked.get_overload
    return dispatcher


def _without_literals(get_call_template: Callable[..., Any]) -> Callable[..., Any]:
    """Returns how numba resolves a call, with constants as arguments of their types: else each is compiled anew."""

    def resolve(args: Any, kws: Any) -> Any:
        return get_call_template(
            tuple(numba.types.unliteral(argument) for argument in args),
            {name: numba.types.unliteral(argument) for name, argument in kws.items()},
        )

    return resolve
