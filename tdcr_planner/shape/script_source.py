"""The code of a foreign TorchScript module, read as text: what it may say, and the text that is loaded in its place."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from tdcr_planner.errors import FormatError
from tdcr_planner.shape.script_rules import (
    BUILT_IN_CALLS,
    CREATING,
    LONGEST_LOOP,
    MOST_NUMBERS,
    OPERATORS,
    PRIMITIVES,
    REMOVED,
    TYPE_NAMES,
    names_in,
)

LONGEST_SOURCE = 4_000_000
_DEEPEST = 100  # levels of a statement or expression
_UNSAFE_IN_TEXT = re.compile(r"[^A-Za-z0-9_ .,:;()\[\]{}=+*/<>!?%&|@#^~>-]")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_CLASS_TABLES = names_in(
    """
    __parameters__ __buffers__ __forward_pre_hooks__ __forward_hooks__ __annotations__ __constants__
    """
)
# The few methods of classes with underscores that containers of layers have; none is called by itself.
_DUNDERS = frozenset(["__len__", "__contains__", "__getitem__"])
_EXPRESSIONS = (
    ast.Constant, ast.Name, ast.Tuple, ast.List, ast.Dict, ast.UnaryOp, ast.Attribute, ast.Subscript, ast.Call,
    ast.keyword, ast.Load, ast.Store, ast.USub, ast.Slice,
)  # fmt: skip


class _RefusedError(ValueError):
    """Code that is not let through, and why."""


@dataclass(frozen=True)
class ScriptSource:
    """Code that was checked.

    Attributes:
        files: The text of each file, written anew from what was checked, by the file's name below `code/`.
        arguments: The names of the arguments of each class's `forward`, without the module itself, by class name.
    """

    files: dict[str, str]
    arguments: dict[str, tuple[str, ...]]


def check_source(path: Path, files: dict[str, str]) -> ScriptSource:
    """Returns code that does nothing but compute, or refuses it.

    Every function of every class is read, whether it is ever called or not. The text that comes back is written from
    the tree that was checked, so that torch reads what was checked here, whatever its own parser makes of a text.

    Args:
        path: The module's file, for messages.
        files: The text of each file by its name below `code/`, such as "__torch__/torch/nn/functional.py".

    Raises:
        FormatError: The code holds something else than the operations of `script_rules`.
    """
    trees = {name: _parse(path, name, text) for name, text in files.items()}
    defined = _defined_names(path, trees)
    arguments: dict[str, tuple[str, ...]] = {}
    checked = {}
    for name, tree in trees.items():
        package = _package(name)
        checker = _Checker(defined)
        try:
            tree.body = [checker.top_level(statement) for statement in tree.body]
        except (_RefusedError, RecursionError) as error:
            raise FormatError(path, f"holds code that this program does not run: {error}", f"code/{name}") from error
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                for item in node.body:
                    if isinstance(item, ast.FunctionDef) and item.name == "forward":
                        names = tuple(argument.arg for argument in item.args.args[1:])
                        arguments[f"{package}.{node.name}"] = names
        checked[name] = ast.unparse(ast.fix_missing_locations(tree)) + "\n"
    return ScriptSource(checked, arguments)


def _package(name: str) -> str:
    return name.removesuffix(".py").replace("/", ".")


def _parse(path: Path, name: str, text: str) -> ast.Module:
    place = f"code/{name}"
    if len(text) > LONGEST_SOURCE:
        raise FormatError(path, f"expected at most {LONGEST_SOURCE:,} characters", place)
    if not all(character in "\n\t" or " " <= character <= "~" for character in text):
        raise FormatError(path, "expected code of printable ASCII characters", place)
    try:
        return ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise FormatError(path, f"holds code that this program does not read ({error})", place) from error


@dataclass(frozen=True)
class _Defined:
    """What the archive's own code defines.

    Attributes:
        qualified: Full names of its classes and functions, as "__torch__.package.name".
        methods: Names of the methods of its classes.
    """

    qualified: frozenset[str]
    methods: frozenset[str]


def _defined_names(path: Path, trees: dict[str, ast.Module]) -> _Defined:
    qualified, methods = set(), set()
    for name, tree in trees.items():
        package = _package(name)
        parts = package.split(".")
        if (
            parts[0] != "__torch__"
            or parts[:3] == ["__torch__", "torch", "classes"]
            or not all(map(_NAME.match, parts))
        ):
            raise FormatError(path, "holds code outside of a module's own classes", f"code/{name}")
        for node in tree.body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef):
                qualified.add(f"{package}.{node.name}")
            if isinstance(node, ast.ClassDef):
                methods |= {item.name for item in node.body if isinstance(item, ast.FunctionDef)}
    return _Defined(frozenset(qualified), frozenset(methods - _operator_names(methods)))


def _operator_names(names: Iterable[str]) -> set[str]:
    """Returns those of some names that torch has an operator of: called on a tensor, they would mean that."""
    import torch

    schemas = torch._C._jit_get_schemas_for_operator
    return {name for name in names if schemas(f"aten::{name}") or schemas(f"prim::{name}")}


class _Checker:
    """Walks the statements of a file and refuses the first that is not let through."""

    def __init__(self, defined: _Defined) -> None:
        self._defined = defined
        self._functions: set[str] = set()
        self._depth = 0

    def top_level(self, node: ast.stmt) -> ast.stmt:
        """Checks a class, a function or the version of the operators."""
        if isinstance(node, ast.FunctionDef):
            return self._function(node)
        if isinstance(node, ast.ClassDef):
            return self._class(node)
        if isinstance(node, ast.Assign) and _is_name(node.targets[0], "op_version_set"):
            self._expression(node.value)
            return node
        if isinstance(node, ast.Import) and all(alias.name.startswith("__torch__") for alias in node.names):
            return node
        raise _RefusedError(f"{_describe(node)} outside of a class or function")

    def _class(self, node: ast.ClassDef) -> ast.ClassDef:
        bases = [base.id for base in node.bases if isinstance(base, ast.Name)]
        if bases not in (["Module"], ["NamedTuple"]) or len(node.bases) != 1 or node.keywords or node.decorator_list:
            raise _RefusedError(f"class {node.name} of another kind than Module or NamedTuple")
        for item in node.body:
            if isinstance(item, ast.FunctionDef):
                if item.name.startswith("__") and item.name not in _DUNDERS:
                    raise _RefusedError(f"class {node.name} has a method {item.name}")
                self._function(item)
            elif isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
                self._type(item.annotation)
                if item.value is not None:
                    self._expression(item.value)
            elif isinstance(item, ast.Assign):
                self._class_table(node, item)
            elif not isinstance(item, ast.Pass):
                raise _RefusedError(f"{_describe(item)} in class {node.name}")
        return node

    def _class_table(self, node: ast.ClassDef, item: ast.Assign) -> None:
        """Checks one of the tables of a class: names of parameters and hooks, annotations of numbered layers."""
        target = item.targets[0]
        numbered = isinstance(target, ast.Subscript) and _is_name(target.value, "__annotations__")
        if len(item.targets) == 1 and numbered:
            self._type(item.value)
        elif len(item.targets) == 1 and isinstance(target, ast.Name) and target.id in _CLASS_TABLES:
            self._expression(item.value)
        else:
            raise _RefusedError(f"{_describe(item)} in class {node.name}")

    def _function(self, node: ast.FunctionDef) -> ast.FunctionDef:
        arguments = node.args
        if node.decorator_list or arguments.vararg or arguments.kwarg or arguments.posonlyargs:
            raise _RefusedError(f"function {node.name} with a decorator or arguments of any number")
        for argument in (*arguments.args, *arguments.kwonlyargs):
            if argument.annotation is not None:
                self._type(argument.annotation)
        for default in (*arguments.defaults, *arguments.kw_defaults):
            if default is not None:
                self._expression(default)
        if node.returns is not None:
            self._type(node.returns)
        self._functions = set()
        node.body = self._block(node.body)
        return node

    def _block(self, statements: list[ast.stmt]) -> list[ast.stmt]:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise _RefusedError(f"statements nested more than {_DEEPEST} levels deep")
        kept = [self._statement(statement) for statement in statements]
        self._depth -= 1
        return kept

    def _statement(self, node: ast.stmt) -> ast.stmt:
        if isinstance(node, ast.Pass):
            return node
        if isinstance(node, ast.Return):
            if node.value is not None:
                self._expression(node.value)
            return node
        if isinstance(node, ast.Expr):
            return self._alone(node)
        if isinstance(node, ast.Assign):
            return self._assign(node)
        if isinstance(node, ast.AnnAssign):
            self._target(node.target)
            self._type(node.annotation)
            if node.value is not None:
                self._expression(node.value)
            return node
        if isinstance(node, ast.If):
            self._expression(node.test)
            node.body, node.orelse = self._block(node.body), self._block(node.orelse)
            return node
        if isinstance(node, ast.For):
            self._target(node.target)
            self._loop_range(node.iter)
            node.body = self._block(node.body)
            if node.orelse:
                raise _RefusedError("a loop with an `else`")
            return node
        raise _RefusedError(_describe(node))

    def _alone(self, node: ast.Expr) -> ast.stmt:
        """Checks a call whose value nobody takes; warnings are left out."""
        call = node.value
        named = (
            isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and _is_name(call.func.value, "torch")
        )
        if named and call.func.attr in REMOVED:  # type: ignore[attr-defined]
            for argument in call.args:  # type: ignore[attr-defined]
                self._expression(argument)
            return ast.copy_location(ast.Pass(), node)
        self._expression(node.value)
        return node

    def _assign(self, node: ast.Assign) -> ast.Assign:
        for target in node.targets:
            self._target(target)
        name = _dotted(node.value)
        if name in self._defined.qualified:
            if len(node.targets) != 1 or not isinstance(node.targets[0], ast.Name):
                raise _RefusedError("a function of the archive given more than one name")
            self._functions.add(node.targets[0].id)
            return node
        for target in node.targets:
            for part in target.elts if isinstance(target, ast.Tuple) else (target,):
                if isinstance(part, ast.Name):
                    self._functions.discard(part.id)
        self._expression(node.value)
        return node

    def _target(self, node: ast.expr) -> None:
        parts = node.elts if isinstance(node, ast.Tuple) else [node]
        for part in parts:
            plain = isinstance(part, ast.Name) and part.id not in ("torch", "ops", "CONSTANTS", "__torch__")
            own = isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name) and _NAME.match(part.attr)
            if isinstance(part, ast.Tuple):
                self._target(part)
            elif not (plain or own):
                raise _RefusedError(f"an assignment to `{ast.unparse(part)[:60]}`")

    def _loop_range(self, node: ast.expr) -> None:
        self._expression(node)
        if isinstance(node, ast.Call) and _is_name(node.func, "range"):
            for argument in node.args:
                steps = argument.value if isinstance(argument, ast.Constant) else 0
                if isinstance(steps, int) and steps > LONGEST_LOOP:
                    raise _RefusedError(f"a loop of {steps:,} steps, at most {LONGEST_LOOP:,} are let through")

    def _expression(self, node: ast.expr | ast.keyword) -> None:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise _RefusedError(f"an expression nested more than {_DEEPEST} levels deep")
        if not isinstance(node, _EXPRESSIONS):
            raise _RefusedError(_describe(node))
        if isinstance(node, ast.Constant):
            if isinstance(node.value, str):
                # Texts name modes and word messages; what a parser may read in another way is left out of them.
                node.value = _UNSAFE_IN_TEXT.sub("_", node.value)
            elif not isinstance(node.value, int | float | None):
                raise _RefusedError(f"a constant of type {type(node.value).__name__}")
        elif isinstance(node, ast.Name):
            if node.id in ("torch", "ops", "CONSTANTS", "__torch__") or (
                node.id.startswith("__") and node.id not in _DUNDERS
            ):
                raise _RefusedError(f"`{node.id}` by itself")
        elif isinstance(node, ast.Attribute):
            self._attribute(node)
        elif isinstance(node, ast.Call):
            self._call(node)
        else:
            for child in ast.iter_child_nodes(node):
                if isinstance(child, ast.expr | ast.keyword):
                    self._expression(child)
        self._depth -= 1

    def _attribute(self, node: ast.Attribute) -> None:
        name = _dotted(node)
        if name is not None and name.split(".")[0] in ("torch", "ops", "__torch__"):
            raise _RefusedError(f"`{name}`")
        if node.attr.startswith("__"):
            raise _RefusedError(f"attribute `{node.attr}`")
        if name is not None and name.startswith("CONSTANTS."):
            return
        self._expression(node.value)

    def _call(self, node: ast.Call) -> None:
        name = _dotted(node.func)
        types_first = name in ("annotate", "uninitialized", "unchecked_cast", "isinstance")
        if name is not None and name.startswith("torch."):
            self._operator(node, name.removeprefix("torch."))
        elif name is not None and name.startswith("ops."):
            space, _, operator = name.removeprefix("ops.").partition(".")
            known = PRIMITIVES if space == "prim" else OPERATORS if space == "aten" else frozenset()
            if operator not in known:
                raise _RefusedError(f"operator `{name}`")
        elif name is not None and name.startswith("__torch__"):
            if name not in self._defined.qualified:
                raise _RefusedError(f"`{name}`, which the archive does not define")
        elif isinstance(node.func, ast.Name):
            if node.func.id not in BUILT_IN_CALLS and node.func.id not in self._functions:
                raise _RefusedError(f"a call of `{node.func.id}`")
        elif isinstance(node.func, ast.Attribute):
            if node.func.attr not in self._defined.methods and node.func.attr not in OPERATORS:
                raise _RefusedError(f"a call of `{node.func.attr}`")
            self._expression(node.func.value)
        else:
            raise _RefusedError(f"a call of `{ast.unparse(node.func)[:60]}`")
        for index, argument in enumerate(node.args):
            if types_first and index == (1 if name == "isinstance" else 0):
                self._type(argument)
            else:
                self._expression(argument)
        for keyword in node.keywords:
            if keyword.arg is None:
                raise _RefusedError("arguments of any number")
            self._expression(keyword.value)

    def _operator(self, node: ast.Call, name: str) -> None:
        if name == "device":
            if len(node.args) != 1 or not isinstance(node.args[0], ast.Constant):
                raise _RefusedError("a device that is no constant")
            return
        if name not in OPERATORS:
            raise _RefusedError(f"operator `torch.{name}`")
        if name in CREATING:
            # The sizes are a list, or the arguments one by one; what is filled in is none of them.
            sizes = node.args[:1] if name == "full" else node.args
            product = 1
            for argument in sizes:
                for number in argument.elts if isinstance(argument, ast.List | ast.Tuple) else [argument]:
                    if isinstance(number, ast.Constant) and isinstance(number.value, int):
                        product *= max(abs(number.value), 1)
            if product > MOST_NUMBERS:
                raise _RefusedError(f"`torch.{name}` of {product:,} numbers, at most {MOST_NUMBERS:,} are let through")

    def _type(self, node: ast.expr) -> None:
        name = _dotted(node)
        if name is not None:
            if name not in TYPE_NAMES and name not in self._defined.qualified:
                raise _RefusedError(f"type `{name}`")
        elif isinstance(node, ast.Subscript):
            self._type(node.value)
            for part in node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]:
                self._type(part)
        elif isinstance(node, ast.List | ast.Tuple):
            for part in node.elts:
                self._type(part)
        elif not (isinstance(node, ast.Constant) and (node.value is None or isinstance(node.value, int))):
            raise _RefusedError(f"type `{ast.unparse(node)[:60]}`")


def _is_name(node: ast.expr, name: str) -> bool:
    return isinstance(node, ast.Name) and node.id == name


def _dotted(node: ast.expr) -> str | None:
    """Returns a name with dots as text; None for anything else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        before = _dotted(node.value)
        return None if before is None else f"{before}.{node.attr}"
    return None


def _describe(node: ast.AST) -> str:
    return f"{type(node).__name__} `{ast.unparse(node)[:60]}`" if isinstance(node, ast.stmt | ast.expr) else str(node)
