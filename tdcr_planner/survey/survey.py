"""What files of a place hold, where a robot fits in, and the scenario that plans there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from tdcr_planner.arrays import FloatArray, IntArray
from tdcr_planner.collision.clouds.formats import FORMATS as CLOUDS
from tdcr_planner.collision.clouds.formats import read_cloud
from tdcr_planner.collision.mesh_files.registry import find_format, read_mesh_file
from tdcr_planner.collision.meshes import METRES_PER_UNIT, Entry, SceneMesh
from tdcr_planner.collision.volumes.formats import FORMATS as VOLUMES
from tdcr_planner.collision.volumes.formats import find_volume_format, read_volume
from tdcr_planner.collision.volumes.surface import Region, region_surface
from tdcr_planner.errors import FormatError, InputError
from tdcr_planner.survey.centreline import Centreline, find_centreline
from tdcr_planner.survey.proposal import entry_at, quoted, vector
from tdcr_planner.survey.surface import SurfaceReport, guess_unit, survey_surface

# A body of this diameter, in fractions of the longest side, stands for a robot where none is given.
_ASSUMED_DIAMETER, _ASSUMED_LENGTH = 0.02, 0.5


@dataclass(frozen=True)
class Place:
    """A file of a place.

    Attributes:
        file: The file.
        kind: "mesh", "volume" or "cloud".
        unit: Unit of length of a mesh or cloud; None where the file states its own.
        unit_reason: Why it is taken to be that.
        vertices: Shape (v, 3), m; of a cloud its points.
        faces: Shape (f, 3); empty for a cloud.
        report: What the surface is; None for a cloud.
        region: What of a volume is inside.
        error: Distance between the surface as it is tested and the true one, m.
    """

    file: Path
    kind: str
    unit: str | None
    unit_reason: str
    vertices: FloatArray
    faces: IntArray
    report: SurfaceReport | None = None
    region: Region | None = None
    error: float = 0.0

    def opening_entry(self, diameter: float) -> Entry | None:
        """Returns the entry plane at the widest opening in which a body of a diameter, m, fits, or None."""
        loops = () if self.report is None else self.report.openings(diameter)
        return entry_at(self.vertices, loops[0]) if loops else None

    def to_toml(self, name: str, entry: Entry | None) -> str:
        """Returns the surface's table of a scenario: a cavity with its entry plane, or an obstacle.

        Args:
            name: The file as the scenario names it.
            entry: The entry plane of a cavity; None for an obstacle.
        """
        table = {"mesh": "meshes", "volume": "volumes", "cloud": "clouds"}[self.kind]
        lines = [f"[[{table}]]", f"file = {quoted(name)}"]
        if self.unit is not None:
            lines.append(f'unit = "{self.unit}"')
        if self.region is not None:
            low, high = self.region.threshold or (None, None)
            lines.append(
                f"label = {self.region.label}" if self.region.label is not None else f"threshold = [{low}, {high}]"
            )
        if self.kind == "cloud":
            lines.append(f"point_radius_m = {self.error:.4g}")
        else:
            lines.append(f'role = "{"obstacle" if entry is None else "cavity"}"')
        if entry is not None:
            lines.append(f"entry = {{ point_m = {vector(entry.point)}, normal = {vector(entry.normal)} }}")
        return "\n".join(lines) + "\n"


def survey_place(
    file: Path,
    unit: str | None = None,
    region: Region | None = None,
    length: float | None = None,
    diameter: float | None = None,
) -> Place:
    """Returns what a file of a place holds.

    Args:
        file: A mesh, a volume or a point cloud.
        unit: Its unit of length; None to guess it.
        region: What of a volume is inside.
        length: The robot's length, m; None where there is no robot yet.
        diameter: Its diameter, m; None where there is no robot yet.

    Raises:
        InputError: A volume without a region.
        FormatError: The file cannot be read.
    """
    if file.is_dir() or file.name.lower().endswith(tuple(suffix for kind in VOLUMES for suffix in kind.suffixes)):
        return _survey_volume(file, region)
    if file.suffix.lower() in {suffix for kind in CLOUDS for suffix in kind.suffixes} and not _has_faces(file):
        return _survey_cloud(file, unit)
    found = find_format(file)
    raw = read_mesh_file(file)
    if not len(raw.faces):
        raise FormatError(file, "holds no triangles")
    if found.in_metres:
        return _mesh_place(file, None, "its unit stands in the file", raw.vertices, raw.faces, found.surface_error)
    reason = "as it was given"
    if unit is None:
        extent = float(np.ptp(raw.vertices, axis=0).max())
        loops = survey_surface(raw.vertices, raw.faces).loops
        opening = loops[0].diameter if loops else 0.0
        # Without a robot the place is taken to be what most files are in: millimetres.
        assumed = 1e-3 * extent
        unit, reason = guess_unit(
            extent, opening, length or _ASSUMED_LENGTH * assumed, diameter or _ASSUMED_DIAMETER * assumed
        )
        reason = reason if length is not None else "most mesh files are; check it"
    return _mesh_place(file, unit, reason, METRES_PER_UNIT[unit] * raw.vertices, raw.faces, found.surface_error)


def _mesh_place(
    file: Path, unit: str | None, reason: str, vertices: FloatArray, faces: IntArray, error: float
) -> Place:
    return Place(file, "mesh", unit, reason, vertices, faces, survey_surface(vertices, faces), None, error)


def _has_faces(file: Path) -> bool:
    """Whether a file of an ending that meshes and clouds share holds triangles."""
    if file.suffix.lower() != ".ply":
        return False
    try:
        return len(read_mesh_file(file).faces) > 0
    except FormatError:
        return False


def _survey_volume(file: Path, region: Region | None) -> Place:
    find_volume_format(file)
    if region is None:
        raise InputError("--label or --threshold", "what of the volume is inside", "neither")
    volume = read_volume(file)
    vertices, faces = region_surface(file, volume, region, closed=False)
    error = volume.grid.surface_error
    reason = f"its spacing stands in the file; axes {volume.grid.frame}"
    return Place(file, "volume", None, reason, vertices, faces, survey_surface(vertices, faces), region, error)


def _survey_cloud(file: Path, unit: str | None) -> Place:
    raw = read_cloud(file)
    unit = unit or ("mm" if np.ptp(raw, axis=0).max() > 20.0 else "m")
    points = METRES_PER_UNIT[unit] * raw
    distances, _ = cKDTree(points).query(points, k=2)
    # Neighbours in a scan stand in rows: the gap across is wider than that to the next point.
    radius = 2.0 * float(np.quantile(distances[:, 1], 0.99))
    empty = np.empty((0, 3), dtype=np.int64)
    return Place(file, "cloud", unit, "by its size; check it", points, empty, None, None, radius)


def centreline_of(place: Place, entry: Entry, radius: float) -> Centreline | None:
    """Returns the line into a place from its entry along which a ball has most room, or None; see `find_centreline`."""
    mesh = SceneMesh.from_arrays(place.file.name, place.vertices, place.faces, "cavity", entry.point, entry.normal)
    return find_centreline(mesh, mesh.entry or entry, radius)


def describe_place(place: Place) -> list[str]:
    """Returns what a place is, as lines for people."""
    size = " x ".join(f"{1e3 * value:.4g}" for value in np.ptp(place.vertices, axis=0))
    unit = f"unit {place.unit} ({place.unit_reason})" if place.unit is not None else place.unit_reason
    if place.report is None:
        return [
            f"{place.file.name}: a point cloud of {len(place.vertices):,} points, {size} mm; {unit}",
            f"  a point_radius_m of {1e3 * place.error:.3g} mm closes the gaps between most neighbours",
        ]
    found = place.report
    lines = [f"{place.file.name}: {found.faces:,} triangles, {size} mm; {unit}"]
    pieces = f"{found.pieces} piece{'s' * (found.pieces != 1)}, {found.closed} closed"
    faults = [
        (found.tangled, "without an inside (edges of three or more triangles, or one-sided)"),
        (found.inward, "closed with their triangles facing inward (turned when read)"),
    ]
    lines.append("  " + "; ".join([pieces, *(f"{count} {text}" for count, text in faults if count)]))
    if found.flipped:
        lines.append(f"  {found.flipped} triangles face the other way than their neighbours (turned when read)")
    for loop in found.loops[:5]:
        lines.append(f"  opening {1e3 * loop.diameter:.3g} mm across at {np.round(1e3 * loop.centre, 2) + 0.0} mm")
    if len(found.loops) > 5:
        lines.append(f"  and {len(found.loops) - 5} smaller openings")
    if place.error:
        lines.append(f"  surface within {1e3 * place.error:.2g} mm of the true one, added to the clearance")
    return lines
