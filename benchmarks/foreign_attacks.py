"""Modules that do more than to compute shapes: each forbidden operation in each place of a TorchScript archive."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable, Iterator

OPERATIONS: dict[str, str] = {
    # files
    "save": 'torch.save(x, "WRITTEN")',
    "from_file": 'y = torch.from_file("WRITTEN", True, 64, dtype=0)',
    "from_file by aten": 'y = ops.aten.from_file("WRITTEN", True, 64, dtype=0)',
    "save by aten": 'ops.aten.save(x, "WRITTEN")',
    "open": 'y = open("WRITTEN")',
    "load": 'y = torch.load("WRITTEN")',
    "ivalue of pickle": "y = torch.__torch__(x)",
    "load a library": 'torch.ops.load_library("WRITTEN")',
    "library of classes": 'torch.classes.load_library("WRITTEN")',
    # output
    "print": "print(x)",
    "print of a text": 'print("text")',
    "Print": "ops.prim.Print(x)",
    "record a function": 'y = ops.profiler._record_function_enter("name")',
    "record a new function": 'y = ops.profiler._record_function_enter_new("name")',
    "time point": "y = ops.prim.TimePoint()",
    # processes, threads and networks
    "fork": "y = fork(__torch__.Root.forward, x)",
    "wait": "y = torch.wait(x)",
    "awaitable": "y = ops.prim.awaitable_wait(x)",
    "rpc": 'y = rpc_async("worker", x)',
    "rpc sync": 'y = ops.prim.rpc_sync("worker", x)',
    "rpc remote": 'y = ops.prim.rpc_remote("worker", x)',
    "collective": "y = ops.c10d.allreduce_([x], x)",
    "functional collective": 'y = ops._c10d_functional.broadcast(x, 0, "0")',
    "symmetric memory": 'y = ops.symm_mem.one_shot_all_reduce(x, "sum", "0")',
    "python": "y = ops.prim.PythonOp(x)",
    "ignored python": "y = ops.prim.IgnoredPythonOp(x)",
    "python call": "y = ^Function(x)",
    "eval": 'y = eval("1")',
    "exec": 'exec("1")',
    "import": 'y = __import__("os")',
    "system": 'y = os.system("touch WRITTEN")',
    # memory
    "huge zeros": "y = torch.zeros([1000000, 1000000])",
    "huge ones": "y = torch.ones([100000000])",
    "huge full": "y = torch.full([30000, 30000], 1)",
    "huge arange": "y = torch.arange(10000000000)",
    "huge repeat": "y = torch.repeat(x, [100000, 100000])",
    "huge tile": "y = torch.tile(x, [100000, 100000])",
    "huge eye": "y = torch.eye(100000, 100000)",
    "empty": "y = torch.empty([4], dtype=6)",
    "empty by strides": "y = torch.empty_strided([4], [1])",
    "new empty": "y = torch.new_empty(x, [4])",
    "set": "y = torch.set_(x, x)",
    "set data": "torch.set_data(x, x)",
    "set source": "y = torch.set_(x, x, 0, [1000000], [1])",
    "resize": "y = torch.resize_(x, [1000000])",
    "resize as": "y = torch.resize_as_(x, x)",
    "as strided": "y = torch.as_strided(x, [1000000], [1], 0)",
    "as strided in place": "y = torch.as_strided_(x, [1000000], [1], 0)",
    "pin memory": "y = torch.pin_memory(x)",
    "record stream": "torch.record_stream(x, x)",
    "unsafe view": "y = torch._unsafe_view(x, [4])",
    "debug write": "y = torch._debug_has_internal_overlap(x)",
    "from memory": "y = ops.inductor._reinterpret_tensor(x, [1000000], [1], 0)",
    "alloc from pool": "y = ops.inductor._alloc_from_pool(x, 0, 6, [4], [1])",
    "endless loop": "while True:\n      y = torch.cat([x, x], 0)",
    "loop of a condition": "while torch.eq(1, 1):\n      y = x",
    "long loop": "for i in range(1000000000000):\n      y = torch.add(x, x)",
    # state of the process
    "manual seed": "y = torch.manual_seed(3)",
    "seed": "y = torch.seed(x)",
    "random": "y = torch.rand([4])",
    "normal": "y = torch.randn_like(x)",
    "bernoulli": "y = torch.bernoulli(x, 0.5)",
    "grad mode": "torch.set_grad_enabled(True)",
    "autograd": "y = torch.grad([x], [x])",
    "backward": "torch.backward(x)",
    "set device": "y = ops.cuda.set_device(0)",
    "synchronise": "ops.cuda.synchronize(0)",
    # foreign operators and classes
    "custom operator": "y = ops.mine.write(x)",
    "quantized": "y = ops.quantized.linear_prepack(x, x)",
    "sparse": "y = ops.sparse.qlinear_prepack(x, x)",
    "prepacked": "y = ops.mkldnn_prepacked.linear_prepack(x, x)",
    "static runtime": "y = ops.static_runtime.dict_unpack(x)",
    "custom class": "y = __torch__.torch.classes.quantized.LinearPackedParamsBase(x)",
    "class that is not there": "y = __torch__.Missing(x)",
    "attribute of a class": "y = x.__class__",
    "globals": "y = x.__globals__",
    "delete": "del x",
    "global": "global y",
    "lambda": "y = lambda z: z",
    "comprehension": "y = [z for z in range(3)]",
    "with": "with x:\n      pass",
    "try": "try:\n      y = x\n    except:\n      pass",
    "yield": "y = (yield x)",
    "method of a file": 'y = (x).save("WRITTEN")',
    "method that maps a file": 'y = (x).from_file("WRITTEN", True, 64)',
    "storage": "y = (x).storage()",
    "numpy": "y = (x).numpy()",
    "apply": "y = (x).apply_(x)",
    "share memory": "y = (x).share_memory_()",
    "nonsense": "y = = x",
}
"""Statements that are refused, each with a tensor `x` at hand."""

_ROOT = """class Root(Module):
  __parameters__ = []
  __buffers__ = []
TABLE  training : bool
  _is_full_backward_hook : Optional[bool]
  layer : __torch__.sub.Layer
  def forward(self: __torch__.Root,
    x: Tensor) -> Tensor:
    layer = self.layer
FORWARD    if torch.eq(1, 2):
BRANCH      pass
    else:
      pass
    return (layer).forward(x, )
METHOD"""
_SUB = """class Layer(Module):
  __parameters__ = ["weight", ]
  __buffers__ = []
  weight : Tensor
  training : bool
  def forward(self: __torch__.sub.Layer,
    x: Tensor) -> Tensor:
SUB    return torch.mul(x, self.weight)
SETSTATEdef function(x: Tensor) -> Tensor:
FUNCTION  return x
"""
_HOOK = '  __forward_pre_hooks__ = ["hook", ]\n'
PLACES = ("load", "forward", "submodule", "hook", "branch", "method", "function")


def _indented(statement: str, spaces: int) -> str:
    """Returns a statement written for four spaces with others."""
    lines = statement.split("\n")
    return "".join(" " * (spaces + len(line) - len(line.lstrip()) - (4 if index else 0)) + line.lstrip() + "\n"
                   for index, line in enumerate(lines))  # fmt: skip


def _method(name: str, statement: str, owner: str) -> str:
    return f"  def {name}(self: __torch__.{owner},\n    x: Tensor) -> Tensor:\n{_indented(statement, 4)}    return x\n"


def code(place: str = "", statement: str = "pass") -> dict[str, str]:
    """Returns the code of a small module with a statement in one place; by default it does nothing but compute."""
    root, sub = _ROOT, _SUB
    method = ""
    if place == "hook":
        method = "  def hook(self: __torch__.Root,\n    x: Tuple[Tensor]) -> Tuple[Tensor]:\n    x0 = (x)[0]\n" + (
            re.sub(r"\bx\b", "x0", _indented(statement, 4)) + "    return x\n"
        )
    elif place == "method":
        method = _method("never_called", statement, "Root")
    setstate = ""
    if place == "load":
        setstate = (
            "  def __setstate__(self: __torch__.sub.Layer,\n    x: Tensor) -> NoneType:\n"
            f"{_indented(statement, 4)}    self.weight = x\n    self.training = False\n    return None\n"
        )
    texts = {
        "TABLE": _HOOK if place == "hook" else "",
        "FORWARD": _indented(statement, 4) if place == "forward" else "",
        "BRANCH": _indented(statement, 6) if place == "branch" else "",
        "METHOD": method,
        "SUB": _indented(statement, 4) if place == "submodule" else "",
        "SETSTATE": setstate,
        "FUNCTION": _indented(statement, 2) if place == "function" else "",
    }
    for key, text in texts.items():
        root, sub = root.replace(key, text), sub.replace(key, text)
    return {"__torch__.py": root, "__torch__/sub.py": sub}


def archive(
    files: dict[str, str], data: bytes | None = None, constants: bytes = b"\x80\x02)." + b"", records: bytes = b""
) -> bytes:
    """Returns a TorchScript archive.

    Args:
        files: Its code by name below `code/`.
        data: The pickle of the module; None for that of the small module.
        constants: The pickle of its constants.
        records: The numbers of its one tensor; empty for four of single precision.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as target:
        target.writestr("archive/version", "3\n")
        target.writestr("archive/byteorder", "little")
        target.writestr("archive/data.pkl", module_pickle() if data is None else data)
        target.writestr("archive/constants.pkl", constants)
        target.writestr("archive/data/0", records or bytes(16))
        for name, text in files.items():
            target.writestr(f"archive/code/{name}", text)
    return buffer.getvalue()


TENSOR = (
    b"ctorch._utils\n_rebuild_tensor_v2\n((X\x07\x00\x00\x00storagectorch\nFloatStorage\nX\x01\x00\x00\x000"
    b"X\x03\x00\x00\x00cpuK\x04tQK\x00K\x04\x85K\x01\x85\x89ccollections\nOrderedDict\n)RtR"
)


def module_pickle(weight: bytes = TENSOR, root: bytes = b"c__torch__\nRoot\n", extra: bytes = b"") -> bytes:
    """Returns the pickle of the small module, with a weight and more attributes as pickled."""
    name = b"X\x08\x00\x00\x00training"
    layer = b"c__torch__.sub\nLayer\n)\x81}(X\x06\x00\x00\x00weight" + weight + name + b"\x89ub"
    hook = b"X\x16\x00\x00\x00_is_full_backward_hookN"
    return b"\x80\x02" + root + b")\x81}(" + name + b"\x89" + hook + b"X\x05\x00\x00\x00layer" + layer + extra + b"ub."


def _pickles() -> Iterator[tuple[str, bytes, bytes]]:
    """Yields pickles that do more than to list numbers: a name, the module's and the constants'."""
    call = b"cos\nsystem\n(X\x0d\x00\x00\x00touch WRITTENtR"
    plain = b"\x80\x02)."
    attribute = b"X\x01\x00\x00\x00a"
    attacks = {
        "a call of os.system": call,
        "a call by INST": b"(X\x0d\x00\x00\x00touch WRITTENios\nsystem\n",
        "a call by OBJ": b"(cos\nsystem\nX\x0d\x00\x00\x00touch WRITTENo",
        "a call by NEWOBJ": b"cos\nsystem\n(X\x0d\x00\x00\x00touch WRITTENt\x81",
        "a call by NEWOBJ_EX": b"cos\nsystem\n(X\x0d\x00\x00\x00touch WRITTENt}\x92",
        "a name on the stack": b"X\x02\x00\x00\x00osX\x06\x00\x00\x00system\x93X\x0d\x00\x00\x00touch WRITTEN\x85R",
        "eval": b"cbuiltins\neval\n(X\x01\x00\x00\x001tR",
        "an extension": b"\x82\x01",
        "a persistent text": b"Psomething\n",
        "a custom class": b"c__torch__.torch.classes.mine\nWriter\n)\x81}b",
        "a class that is not there": b"c__torch__\nMissing\n)\x81}(ub",
        "a state that restores itself": b"c__torch__.sub\nLayer\n)\x81(K\x01tb",
        "an enumeration": b"ctorch.jit._pickle\nsomething\n(K\x01tR",
        "a device": b"ctorch\ndevice\n(X\x03\x00\x00\x00cpatR",
        "a tag of a custom class": (
            b"ctorch.jit._pickle\nrestore_type_tag\n(]X\x1f\x00\x00\x00List[__torch__.torch.classes.a]tR"
        ),
        "quantized numbers": TENSOR.replace(b"FloatStorage", b"QInt8Storage"),
        "a tensor beyond its numbers": TENSOR.replace(b"K\x04\x85K\x01\x85", b"M\xff\x00\x85K\x01\x85"),
        "a tensor of negative stride": TENSOR.replace(b"K\x01\x85\x89", b"J\xff\xff\xff\xff\x85\x89"),
        "a tensor before its numbers": TENSOR.replace(b"QK\x00", b"QJ\xff\xff\xff\xff"),
        "a record of another folder": TENSOR.replace(b"X\x01\x00\x00\x000", b"X\x0a\x00\x00\x00../../etc0"),
        "a sparse tensor": TENSOR.replace(b"_rebuild_tensor_v2", b"_rebuild_sparse_tensor"),
        "a tensor of a subclass": TENSOR.replace(b"_rebuild_tensor_v2", b"_rebuild_from_type_v2"),
    }
    for name, attack in attacks.items():
        yield f"{name}, in the module", module_pickle(extra=attribute + attack), plain
        yield f"{name}, in the constants", module_pickle(), b"\x80\x02(" + attack + b"t."
        yield f"{name}, as a weight", module_pickle(weight=attack), plain


def _structures() -> Iterator[tuple[str, dict[str, str]]]:
    """Yields code whose classes and files are not those of a module."""
    honest = code()
    root = honest["__torch__.py"]
    changes: dict[str, Callable[[str], str]] = {
        "an interface": lambda text: text.replace("class Root(Module)", "class Root(Interface)"),
        "an enumeration": lambda text: text.replace("class Root(Module)", "class Root(Enum)"),
        "two bases": lambda text: text.replace("class Root(Module)", "class Root(Module, Other)"),
        "a decorator": lambda text: "@torch.jit.export\n" + text,
        "a getstate": lambda text: text + "  def __getstate__(self: __torch__.Root) -> int:\n    return 1\n",
        "a call of itself": lambda text: text + "  def __call__(self: __torch__.Root) -> int:\n    return 1\n",
        "a destructor": lambda text: text + "  def __del__(self: __torch__.Root) -> int:\n    return 1\n",
        "a statement outside": lambda text: text + 'print("text")\n',
        "an import": lambda text: "import os\n" + text,
        "an import from": lambda text: "from os import system\n" + text,
        "a type of a custom class": lambda text: text.replace(": bool", ": __torch__.torch.classes.mine.Writer"),
        "a type of a future": lambda text: text.replace("x: Tensor", "x: Future[Tensor]"),
        "a remote reference": lambda text: text.replace("x: Tensor", "x: RRef[Tensor]"),
        "a default that calls": lambda text: text.replace("x: Tensor)", "x: Tensor=torch.load(1))"),
        "arguments of any number": lambda text: text.replace("x: Tensor)", "*x)"),
        "a renamed torch": lambda text: text.replace("    layer =", "    torch = 3\n    layer ="),
        "a function by another name": lambda text: text.replace("    layer =", "    f = torch.save\n    layer ="),
        "a method named save": lambda text: text + _method("save", 'y = (x).save("WRITTEN")', "Root"),
        "a method named from_file": lambda text: text + _method("from_file", "y = (x).from_file(x)", "Root"),
        "letters beyond ASCII": lambda text: text.replace("layer =", "l\N{LATIN SMALL LETTER A WITH ACUTE}yer ="),
        "a carriage return": lambda text: text.replace("    layer =", "    # \r    layer ="),
        "deep nesting": lambda text: text.replace("(x, )", "(" * 300 + "x" + ")" * 300).replace("x, )", "x, )"),
    }
    for name, change in changes.items():
        yield name, honest | {"__torch__.py": change(root)}
    yield "a file of torch's classes", honest | {"__torch__/torch/classes/mine.py": "class Writer(Module):\n  pass\n"}
    yield "a file outside of a module", honest | {"os.py": "class A(Module):\n  pass\n"}


def attacks() -> dict[str, bytes]:
    """Returns all archives by name; not one may be loaded."""
    found = {
        f"{name}, in {place}": archive(code(place, statement))
        for name, statement in OPERATIONS.items()
        for place in PLACES
    }
    found |= {name: archive(code(), data, constants) for name, data, constants in _pickles()}
    found |= {name: archive(files) for name, files in _structures()}
    return found
