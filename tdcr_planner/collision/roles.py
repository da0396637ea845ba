"""The roles of meshes: what a body must do about each, and what its walls look like. A role is added here."""

from __future__ import annotations

from dataclasses import dataclass

from tdcr_planner.errors import UnknownNameError


@dataclass(frozen=True)
class WallStyle:
    """What the walls of a role look like.

    Attributes:
        shades: Colours of a wall in the page, turned away from the light and facing it, "#rrggbb".
        opacity: Of a wall in the page.
        paint: Colour in still pictures, "#rrggbb".
        far_cover: Cover of the walls farthest from the viewer in still pictures, 0 to 1.
        glass: Cover of the nearest walls where they face the viewer, and how much it grows where they turn away.
        live: Colour in the live viewer, "#rrggbb", darker, since that viewer lights a scene brightly.
        live_opacity: Of a wall in the live viewer.
        export: Colour in exported scenes, "#rrggbb".
        smooth: Whether light runs evenly over a wall's faces.
    """

    shades: tuple[str, str]
    opacity: float
    paint: str
    far_cover: float
    glass: tuple[float, float]
    live: str
    live_opacity: float
    export: str
    smooth: bool = False


@dataclass(frozen=True)
class MeshRole:
    """What a mesh is to the body.

    Attributes:
        name: What scenario files call it.
        keeps_inside: Whether the body stays inside of it, and may be outside only behind its entry plane; otherwise
            the body stays outside of a closed mesh and off an open one.
        wall: What its walls look like.
    """

    name: str
    keeps_inside: bool
    wall: WallStyle


CAVITY = MeshRole(
    name="cavity",
    keeps_inside=True,
    wall=WallStyle(
        shades=("#5E7891", "#D5E2EE"),
        opacity=0.30,
        paint="#C3D0DC",
        far_cover=0.9,
        glass=(0.04, 0.55),
        live="#3E5C7A",
        live_opacity=0.38,
        export="#C2D1DB",
        smooth=True,
    ),
)
OBSTACLE = MeshRole(
    name="obstacle",
    keeps_inside=False,
    wall=WallStyle(
        shades=("#7B6A56", "#E9E1D6"),
        opacity=0.55,
        paint="#C9BFB4",
        far_cover=0.35,
        glass=(0.40, 0.45),
        live="#705C42",
        live_opacity=0.55,
        export="#C9BFB2",
    ),
)
MESH_ROLES: dict[str, MeshRole] = {role.name: role for role in (CAVITY, OBSTACLE)}


def find_role(name: str) -> MeshRole:
    """Returns the role of a name.

    Raises:
        UnknownNameError: There is no such role.
    """
    if name not in MESH_ROLES:
        raise UnknownNameError("role", str(name), MESH_ROLES)
    return MESH_ROLES[name]
