"""The live viewer: a robot in its scene, moved by sliders in a browser, with contacts shown as they happen."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import InputError
from tdcr_planner.planning.scenario import Validity
from tdcr_planner.report import plots
from tdcr_planner.report.picture import gather_scenario_picture
from tdcr_planner.report.robot_mesh import Mesh, backbone_curve, disk_mesh, merge_meshes, tendon_lines, tube_mesh
from tdcr_planner.report.viewpoint import choose_camera
from tdcr_planner.session import PlanningSession

MODELS: tuple[Validity, ...] = ("learned", "reference", "constant_curvature")


@dataclass(frozen=True)
class Look:
    """What one configuration looks like.

    Attributes:
        positions: Disk centres, shape (d, 3), m, world frame; NaN where there is no shape.
        rotations: world_from_disk, shape (d, 3, 3).
        tensions: Shape (t,), N.
        clearance: Of the body without margins, m; NaN where there is no shape.
        problem: Why the planner would reject it; empty when it would not.
    """

    positions: FloatArray
    rotations: FloatArray
    tensions: FloatArray
    clearance: float
    problem: str


class LiveScene:
    """A scene in which single configurations are asked for, with any of the shape models.

    Attributes:
        session: The scene, its robot and its models.
        models: Names of the shape models that the scenario can use.
    """

    def __init__(self, session: PlanningSession) -> None:
        """Prepares the scene; checkers are made at their first use."""
        self.session = session
        has_model = session.scenario.shape_model_path is not None
        self.models = MODELS if has_model else MODELS[1:]
        self._checkers: dict[Validity, Any] = {}

    def look(self, row: FloatArray, model: Validity) -> Look:
        """Returns what a configuration, shape (dimension,), looks like by one of the shape models."""
        if model not in self._checkers:
            self._checkers[model] = self.session.checker(self.session.scenario.with_planner(validity=model))
        checker = self._checkers[model]
        positions, rotations, solved = checker.world_poses(row[None])
        clearance = float(self.session.scene.clearance(positions, rotations)[0]) if solved[0] else float("nan")
        if not solved[0]:
            positions, rotations = np.full_like(positions, np.nan), np.full_like(rotations, np.nan)
        tensions = self.session.space.actuate(row[None]).tensions[0]
        return Look(positions[0], rotations[0], tensions, clearance, checker.explain(row))


def serve_live(session: PlanningSession, *, port: int = 8080, host: str = "127.0.0.1") -> LiveViewer:
    """Starts the live viewer and returns it; it runs in threads of its own until `stop`.

    Args:
        session: The scene, its robot and its models.
        port: Where a browser finds it; viser takes the next free one where it is taken.
        host: 127.0.0.1 for this machine alone, 0.0.0.0 for the network.

    Raises:
        InputError: viser is not installed.
    """
    try:
        import viser
    except ImportError as error:
        raise InputError("--live", "the package viser: pip install 'tdcr-planner[live]'", "none installed") from error
    return LiveViewer(LiveScene(session), viser.ViserServer(host=host, port=port, verbose=False, label="tdcr"))


class LiveViewer:
    """Sliders for bending, insertion and roll, a choice of shape model, and the robot, red where it may not be."""

    def __init__(self, scene: LiveScene, server: Any) -> None:
        """Fills a viser server with the scene and the sliders."""
        self._scene = scene
        self._server = server
        self._lock = threading.Lock()
        self._draw_scene()
        self._model = server.gui.add_dropdown("shape model", scene.models, initial_value=scene.models[0])
        self._sliders = self._add_sliders()
        self._note = server.gui.add_markdown("")
        for control in (self._model, *self._sliders):
            control.on_update(lambda _: self.update())
        self.update()

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return f"http://{self._server.get_host()}:{self._server.get_port()}"

    @property
    def row(self) -> FloatArray:
        """The configuration that the sliders show, shape (dimension,)."""
        return np.array([slider.value for slider in self._sliders]) / self._scales

    def move(self, row: FloatArray) -> None:
        """Moves the sliders to a configuration, shape (dimension,)."""
        for slider, value in zip(self._sliders, row * self._scales, strict=True):
            slider.value = float(value)
        self.update()

    def update(self) -> None:
        """Draws the robot as the sliders have it."""
        with self._lock:
            look = self._scene.look(self.row, self._model.value)
            self._draw_robot(look)
            self._note.content = describe(look)

    def stop(self) -> None:
        """Ends the server."""
        self._server.stop()

    def _add_sliders(self) -> list[Any]:
        space, gui = self._scene.session.space, self._server.gui
        names = [f"bending {i + 1} {axis} (N)" for i in range(space.robot.segment_count) for axis in "xy"]
        scales = [1.0] * len(names)
        if space.has_insertion:
            names.append("insertion (mm)")
            scales.append(1e3)
        if space.has_roll:
            names.append("roll (deg)")
            scales.append(float(np.rad2deg(1.0)))
        self._scales = np.array(scales)
        start = self._scene.session.scenario.file.start
        initial = space.row(start.bending_n, start.insertion_m, start.roll_deg) * self._scales
        low, high = space.lower * self._scales, space.upper * self._scales
        return [
            gui.add_slider(name, min=float(a), max=float(b), step=float(b - a) / 1000, initial_value=float(value))
            for name, a, b, value in zip(names, low, high, initial, strict=True)
        ]

    def _draw_scene(self) -> None:
        picture = gather_scenario_picture(self._scene.session.scenario)
        camera = choose_camera(picture, 800, 600)
        away = 0.9 * camera.height / camera.scale * camera.rotation[2]
        view = self._server.initial_camera
        view.up, view.look_at, view.position = camera.rotation[1], camera.centre, camera.centre + away
        for number, mesh in enumerate(picture.meshes):
            self._server.scene.add_mesh_simple(
                f"/scene/{number}",
                mesh.vertices.astype(np.float32),
                mesh.faces.astype(np.uint32),
                color=(160, 178, 196) if mesh.role == "cavity" else (190, 178, 162),
                opacity=0.25 if mesh.role == "cavity" else 0.55,
                side="double",
            )

    def _draw_robot(self, look: Look) -> None:
        if not np.isfinite(look.positions).all():
            self._server.scene.remove_by_name("/robot")
            return
        robot = self._scene.session.scenario.robot
        disks = disk_mesh(robot, look.positions, look.rotations)
        line = backbone_curve(look.positions, look.rotations, robot.arc_lengths)
        tendons = [
            tube_mesh(points, robot.body.tendon_radius_m, sides=6)
            for points in tendon_lines(robot, look.positions, look.rotations)
        ]
        wires = merge_meshes([tube_mesh(line, robot.backbone.radius_m), *tendons])
        self._put("/robot/disks", disks, plots.ALERT if look.problem else plots.ROBOT)
        self._put("/robot/wires", wires, plots.INK)

    def _put(self, name: str, mesh: Mesh, colour: str) -> None:
        vertices, faces = mesh
        rgb = tuple(round(255 * part) for part in to_rgb(colour))
        self._server.scene.add_mesh_simple(
            name, vertices.astype(np.float32), faces.astype(np.uint32), color=rgb, flat_shading=True, side="double"
        )


def describe(look: Look) -> str:
    """Returns a configuration's verdict, clearance and tensions as Markdown."""
    verdict = f"**not allowed**: {look.problem}" if look.problem else "**free**"
    clearance = f"{1e3 * look.clearance:.2f} mm" if np.isfinite(look.clearance) else "not known"
    tensions = ", ".join(f"{value:.2f}" for value in look.tensions)
    return f"{verdict}\n\nclearance: {clearance}\n\ntensions: {tensions} N"
