"""STEP and IGES files: solids and surfaces, tessellated by Open CASCADE within a stated distance."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tdcr_planner.collision.mesh_files.gltf import GLTF
from tdcr_planner.collision.mesh_files.source import MeshFormat, RawMesh, read_bytes
from tdcr_planner.errors import FormatError, MissingLibraryError

CHORD_M = 1e-5
"""Largest distance between a triangle and the curved surface that it stands for, as it is given to Open CASCADE."""
CHORD_RAD = 0.2
SURFACE_ERROR_M = 2.0 * CHORD_M
"""What is kept for it: Open CASCADE tests the distance at points of a triangle, not everywhere."""


@contextmanager
def _silenced() -> Iterator[None]:
    """Keeps what Open CASCADE writes to the terminal away: what is wrong is said by an error."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(1), os.dup(2)]
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
            yield
    finally:
        for number, descriptor in enumerate(kept, 1):
            os.dup2(descriptor, number)
            os.close(descriptor)


def _cascadio(path: Path) -> Any:
    try:
        import cascadio
    except ImportError as error:
        raise MissingLibraryError(
            "cascadio", f"to read {path}", "Linux, macOS and Windows (pip install 'tdcr-planner[cad]')"
        ) from error
    return cascadio


def _reader(kind: str) -> Callable[[Path], RawMesh]:
    def read(path: Path) -> RawMesh:
        data = read_bytes(path)
        cascadio = _cascadio(path)
        with _silenced():
            try:
                content = cascadio.load(data, file_type=kind, tol_linear=1e3 * CHORD_M, tol_angular=CHORD_RAD)
            except (RuntimeError, ValueError) as error:
                raise FormatError(path, f"cannot be read as {kind.upper()}: {error}") from error
        if not content:
            raise FormatError(
                path, f"cannot be read as {kind.upper()}: cut off, damaged, or without a solid or surface"
            )
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "tessellated.glb"
            file.write_bytes(content)
            try:
                raw = GLTF.read(file)
            except FormatError as error:
                raise FormatError(path, f"holds no solid or surface that can be used: {error.problem}") from error
        return RawMesh(raw.vertices, raw.faces, "meter")

    return read


STEP = MeshFormat("STEP", (".step", ".stp"), _reader("step"), surface_error=SURFACE_ERROR_M, in_metres=True)
IGES = MeshFormat("IGES", (".iges", ".igs"), _reader("iges"), surface_error=SURFACE_ERROR_M, in_metres=True)
