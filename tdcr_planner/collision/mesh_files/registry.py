"""The mesh formats that are read, and reading a file by its name's ending."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from tdcr_planner.collision.mesh_files.cad import IGES, STEP
from tdcr_planner.collision.mesh_files.gltf import GLTF
from tdcr_planner.collision.mesh_files.obj import OBJ
from tdcr_planner.collision.mesh_files.off import OFF
from tdcr_planner.collision.mesh_files.ply import PLY
from tdcr_planner.collision.mesh_files.source import MeshFormat, RawMesh, check_file, read_bytes
from tdcr_planner.collision.mesh_files.stl import STL
from tdcr_planner.collision.mesh_files.threemf import THREE_MF
from tdcr_planner.errors import FormatError

FORMATS = (STL, OBJ, PLY, OFF, GLTF, THREE_MF, STEP, IGES)


def find_format(path: Path) -> MeshFormat:
    """Returns the format that a file's name says, or raises FormatError where there is none or no regular file."""
    check_file(path)
    for candidate in FORMATS:
        if path.suffix.lower() in candidate.suffixes:
            return candidate
    valid = ", ".join(suffix for candidate in FORMATS for suffix in candidate.suffixes)
    raise FormatError(path, f"cannot be read as a mesh: unknown ending {path.suffix!r}; valid: {valid}")


def read_mesh_file(path: Path) -> RawMesh:
    """Returns the triangles of a file, in its unit of length; a file that is not understood whole is refused."""
    with np.errstate(all="ignore"):  # what is not finite is refused by whoever uses the vertices
        return find_format(path).read(path)


def mesh_sha256(path: Path) -> str:
    """Returns the SHA-256 of all that a file's geometry lies in: of itself, or of it and the files that it names."""
    digests = [hashlib.sha256(read_bytes(part)).digest() for part in find_format(path).parts(path)]
    return digests[0].hex() if len(digests) == 1 else hashlib.sha256(b"".join(digests)).hexdigest()
