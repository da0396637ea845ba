"""Writers of every mesh format, byte by byte, and meshes with defects made from formulas."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
RELATIONSHIPS = (
    '<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)


class Writers:
    """Files from (vertices, faces)."""

    KINDS = ("stl", "ascii.stl", "obj", "ply", "big.ply", "ascii.ply", "off", "glb", "gltf", "3mf")

    def write(self, path: Path, kind: str, vertices, faces) -> Path:
        """Writes a mesh as one of KINDS and returns its file; a glTF's buffer goes beside it."""
        vertices, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
        if kind == "gltf":
            document, data = self.gltf(vertices, faces)
            document["buffers"][0]["uri"] = path.with_suffix(".bin").name
            path.with_suffix(".bin").write_bytes(data)
            path.write_text(json.dumps(document))
            return path
        content = {
            "stl": self.stl,
            "ascii.stl": self.ascii_stl,
            "obj": self.obj,
            "ply": self.ply,
            "big.ply": lambda v, f: self.ply(v, f, ">"),
            "ascii.ply": self.ascii_ply,
            "off": self.off,
            "glb": lambda v, f: self.glb(*self.gltf(v, f)),
            "3mf": lambda v, f: self.three_mf(self.model(v, f)),
        }[kind](vertices, faces)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    @staticmethod
    def stl(vertices, faces, header=b"") -> bytes:
        corners = vertices[faces].astype("<f4")
        rows = b"".join(bytes(12) + triangle.tobytes() + bytes(2) for triangle in corners)
        return header.ljust(80, b"\0") + struct.pack("<I", len(faces)) + rows

    @staticmethod
    def ascii_stl(vertices, faces, name="part") -> str:
        facets = "".join(
            "facet normal 0 0 0\nouter loop\n"
            + "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in vertices[face].tolist())
            + "endloop\nendfacet\n"
            for face in faces
        )
        return f"solid {name}\n{facets}endsolid {name}\n"

    @staticmethod
    def obj(vertices, faces) -> str:
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
        return "\n".join(lines + [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]) + "\n"

    @staticmethod
    def ply_header(order, vertices, faces) -> str:
        return (
            f"ply\nformat {order} 1.0\ncomment made\nelement vertex {vertices}\nproperty float x\nproperty float y\n"
            f"property float z\nelement face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
        )

    def ply(self, vertices, faces, order="<") -> bytes:
        name = "binary_little_endian" if order == "<" else "binary_big_endian"
        rows = b"".join(struct.pack(f"{order}B3i", 3, *face) for face in faces.tolist())
        header = self.ply_header(name, len(vertices), len(faces)).encode()
        return header + vertices.astype(f"{order}f4").tobytes() + rows

    def ascii_ply(self, vertices, faces) -> str:
        rows = [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
        rows += [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
        return self.ply_header("ascii", len(vertices), len(faces)) + "\n".join(rows) + "\n"

    @staticmethod
    def off(vertices, faces) -> str:
        rows = [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
        rows += [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
        return f"OFF\n{len(vertices)} {len(faces)} 0\n" + "\n".join(rows) + "\n"

    @staticmethod
    def gltf(vertices, faces):
        """Returns a document and its buffer."""
        points, indices = vertices.astype("<f4"), faces.astype("<u4")
        data = points.tobytes() + indices.tobytes()
        document = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "accessors": [
                {
                    "bufferView": 0,
                    "componentType": 5126,
                    "count": len(points),
                    "type": "VEC3",
                    "min": points.min(axis=0).tolist(),
                    "max": points.max(axis=0).tolist(),
                },
                {"bufferView": 1, "componentType": 5125, "count": indices.size, "type": "SCALAR"},
            ],
            "bufferViews": [
                {"buffer": 0, "byteLength": points.nbytes},
                {"buffer": 0, "byteOffset": points.nbytes, "byteLength": indices.nbytes},
            ],
            "buffers": [{"byteLength": len(data)}],
        }
        return document, data

    @staticmethod
    def glb(document, data) -> bytes:
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        data += bytes(-len(data) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    @staticmethod
    def mesh_xml(vertices, faces) -> str:
        points = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in vertices.tolist())
        rows = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces.tolist())
        return f"<mesh><vertices>{points}</vertices><triangles>{rows}</triangles></mesh>"

    def model(self, vertices, faces, transform="", attributes="") -> str:
        placed = f' transform="{transform}"' if transform else ""
        return (
            f'<?xml version="1.0"?><model xmlns="{CORE}" {attributes}><resources><object id="1" type="model">'
            f"{self.mesh_xml(vertices, faces)}</object></resources>"
            f'<build><item objectid="1"{placed}/></build></model>'
        )

    @staticmethod
    def three_mf(model: str | bytes, compression=zipfile.ZIP_DEFLATED) -> bytes:
        content = io.BytesIO()
        with zipfile.ZipFile(content, "w", compression) as archive:
            archive.writestr("[Content_Types].xml", "<Types/>")
            archive.writestr("_rels/.rels", RELATIONSHIPS)
            archive.writestr("3D/3dmodel.model", model)
        return content.getvalue()


@pytest.fixture(scope="session")
def writers():
    return Writers()


def _join(*parts):
    vertices, faces, count = [], [], 0
    for points, triangles in parts:
        vertices.append(points)
        faces.append(triangles + count)
        count += len(points)
    return np.concatenate(vertices), np.concatenate(faces)


def _defects():
    """Meshes by the name of what is wrong with them; all coordinates are multiples of 1/64."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)
    faces = np.array(
        [
            [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
            [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
        ]
    )  # fmt: skip
    inner = 0.25 + 0.5 * corners
    return {
        "nothing": (corners, faces),
        "a hole": (corners, faces[:-2]),
        "faces turned": (corners, np.where(np.arange(12)[:, None] % 3 == 0, faces[:, ::-1], faces)),
        "repeated faces": (corners, np.concatenate([faces, faces[:3], faces[4:5, ::-1]])),
        "collapsed faces": (corners, np.concatenate([faces, [[0, 0, 1], [2, 2, 2]]])),
        "corners of their own": (corners[faces].reshape(-1, 3), np.arange(36).reshape(-1, 3)),
        "a fin": (np.concatenate([corners, [[2.0, 2.0, 0.5]]]), np.concatenate([faces, [[0, 1, 8]]])),
        "a hollow": _join((corners, faces), (inner, faces[:, ::-1])),
        "crumbs": _join((corners, faces), *((corners / 64 + k, faces) for k in (2, 3, 4))),
        "crossing pieces": _join((corners, faces), (corners + 0.5, faces)),
        "stray vertices": (np.concatenate([corners, [[9.0, 9.0, 9.0]]]), faces),
        "a wall inside": (corners, np.concatenate([faces, [[0, 1, 7], [0, 7, 6]]])),
    }


DEFECTS = _defects()


@pytest.fixture(params=sorted(DEFECTS))
def defect(request):
    return DEFECTS[request.param]


@pytest.fixture(scope="session")
def box():
    return DEFECTS["nothing"]
