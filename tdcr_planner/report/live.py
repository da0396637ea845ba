"""The live viewer: a robot in its scene, moved by sliders in a browser, with contacts shown as they happen."""

from __future__ import annotations

import errno
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb

from tdcr_planner.arrays import FloatArray
from tdcr_planner.collision.body import RobotBody
from tdcr_planner.collision.roles import find_role
from tdcr_planner.collision.scene import Contact
from tdcr_planner.errors import InputError
from tdcr_planner.planning.scenario import Validity
from tdcr_planner.query.session import PlanningSession
from tdcr_planner.report import plots
from tdcr_planner.report.body_mesh import part_mesh, shaft_mesh, sleeve_mesh
from tdcr_planner.report.live_scene import Controls, LiveScene, Look, describe
from tdcr_planner.report.picture import Picture, gather_scenario_picture
from tdcr_planner.report.robot_mesh import (
    Mesh,
    backbone_curve,
    disk_mesh,
    merge_meshes,
    tendon_lines,
    tube_mesh,
)
from tdcr_planner.report.scene_guides import AXIS_COLOURS, GRAVITY_COLOUR, base_axes, entry_disks
from tdcr_planner.report.tendon_style import tendon_colour
from tdcr_planner.report.text import SHORT, page_text, plain_text
from tdcr_planner.report.viewpoint import choose_camera
from tdcr_planner.shape.registry import SHAPE_MODELS

NEAR = "#E69F00"
_BACKGROUND = (214, 221, 229)
_NOTE_PX = 196
LARGEST_PORT = 65535
# viser gives a slider's number room for five characters, and cuts the others.
_STYLE = "<style>.mantine-NumberInput-root { width: 4.6rem !important; flex: none; }</style>"
# What may be drawn of a state beside the robot; removed where a state has none of it.
_PASSING = ("/contact/parts", "/contact/triangles", "/contact/points", "/contact/label")


def serve_live(session: PlanningSession, *, port: int = 8080, host: str = "127.0.0.1") -> LiveViewer:
    """Starts the live viewer and returns it; it runs in threads of its own until `stop`.

    Args:
        session: The scene, its robot and its models.
        port: Where a browser finds it, or the next free one where it is taken; 0 for any free one.
        host: IPv4 address to listen at: 127.0.0.1 for this machine alone, 0.0.0.0 for the network.

    Raises:
        InputError: viser is not installed, or there is no such port or host to listen at.
    """
    port = find_port(host, port)
    try:
        import viser
    except ImportError as error:
        raise InputError("--live", "the package viser: pip install 'tdcr-planner[live]'", "none installed") from error
    return LiveViewer(LiveScene(session), viser.ViserServer(host=host, port=port, verbose=False, label="tdcr"))


def find_port(host: str, port: int) -> int:
    """Returns the first port from `port` on that can be listened at: a server's own thread could only die of it.

    Args:
        host: IPv4 address of this machine.
        port: From 0 to 65535; 0 for any free one.

    Raises:
        InputError: There is no such port or host, this user may not listen there, or all ports above are taken.
    """
    if not 0 <= port <= LARGEST_PORT:
        raise InputError("--port", f"a port from 0 to {LARGEST_PORT}", port)
    here = "an IPv4 address of this machine, such as 127.0.0.1 or 0.0.0.0"
    try:
        socket.getaddrinfo(host or "no address", None, socket.AF_INET)
    except (socket.gaierror, UnicodeError) as error:
        raise InputError("--host", here, repr(host)) from error
    for candidate in range(port, LARGEST_PORT + 1):
        try:
            with socket.create_server((host, candidate)) as listener:
                found: int = listener.getsockname()[1]
                return found
        except OSError as error:
            if error.errno == errno.EADDRNOTAVAIL:
                raise InputError("--host", here, repr(host)) from error
            if error.errno != errno.EADDRINUSE:
                reason = os.strerror(error.errno or 0)
                raise InputError("--port", f"a port of {host} to listen at", f"{candidate}: {reason}") from error
    raise InputError("--port", f"a port with a free one from it to {LARGEST_PORT}", port)


class LiveViewer:
    """Sliders for each tendon, insertion, roll and bending; the robot, what it touches, and other models' shapes."""

    def __init__(self, scene: LiveScene, server: Any) -> None:
        """Fills a viser server with the scene and the sliders."""
        self._scene = scene
        self._server = server
        self._lock = threading.RLock()
        self._shown: set[str] = set()
        self._asked = 0
        # the thread that sets sliders itself: viser calls back in that thread, and there is nothing to answer
        self._setter: int | None = None
        self._size = float(scene.robot.disk_radii.max())
        server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        server.scene.set_background_image(np.full((2, 2, 3), _BACKGROUND, dtype=np.uint8), format="png")
        self._draw_scene()
        self._note = server.gui.add_html("")
        self._add_controls()
        self.update()

    @property
    def address(self) -> str:
        """Where a browser finds it."""
        return f"http://{self._server.get_host()}:{self._server.get_port()}"

    @property
    def note(self) -> str:
        """What stands above the sliders: verdict, contact and clearance, as HTML."""
        return str(self._note.content)

    @property
    def controls(self) -> Controls:
        """What the sliders show."""
        values = np.array([slider.value for slider in self._tendons])
        insertion = 0.0 if self._insertion is None else 1e-3 * float(self._insertion.value)
        roll = 0.0 if self._roll is None else float(np.deg2rad(self._roll.value))
        return Controls(values, insertion, roll)

    def move(self, controls: Controls, model: Validity | None = None) -> Look:
        """Moves the sliders and returns what is drawn.

        Args:
            controls: What to set.
            model: The shape model to draw with; None to leave it.
        """
        with self._lock:
            with self._setting():
                if model is not None:
                    self._model.value = model
                for slider, value in zip(self._tendons, controls.tensions, strict=True):
                    slider.value = float(value)
                if self._insertion is not None:
                    self._insertion.value = 1e3 * controls.insertion
                if self._roll is not None:
                    self._roll.value = float(np.rad2deg(controls.roll))
            return self.update()

    def update(self) -> Look:
        """Draws the robot as the sliders have it, and returns what is drawn."""
        with self._lock:
            controls = self.controls
            self._show_bending(controls)
            look = self._scene.look(controls, self._model.value)
            with self._server.atomic():
                self._draw_robot(look)
                self._draw_contacts(look)
                distances = self._draw_ghosts(controls, look)
            head, lines = describe(look)
            colour = plots.STATUS_COLOURS["verified"] if look.allowed else plots.ALERT if look.contacts else NEAR
            self._note.content = _note_html(head, colour, [*lines, *distances])
            return look

    def stop(self) -> None:
        """Ends the server."""
        self._server.stop()

    def _add_controls(self) -> None:
        gui, scene = self._server.gui, self._scene
        start, robot = scene.start, scene.robot
        self._tendons = []
        for segment in range(robot.segment_count):
            with gui.add_folder(f"Tensions of segment {segment + 1} (N)"):
                for index in np.flatnonzero(robot.tendon_segments == segment).tolist():
                    name = f"tendon {index + 1} ({np.rad2deg(robot.tendon_angles[index]):g}°)"
                    low, high = robot.pretensions[index], robot.max_tensions[index]
                    self._tendons.append(_slider(gui, name, low, high, start.tensions[index]))
        space = scene.session.space
        self._insertion, self._roll = None, None
        if space.has_insertion or space.has_roll:
            with gui.add_folder("Base"):
                column = space.bending_count
                if space.has_insertion:
                    low, high = 1e3 * space.lower[column], 1e3 * space.upper[column]
                    self._insertion = _slider(gui, "insertion (mm)", low, high, 1e3 * start.insertion)
                if space.has_roll:
                    low, high = np.rad2deg([space.lower[-1], space.upper[-1]])
                    self._roll = _slider(gui, "roll (deg)", low, high, float(np.rad2deg(start.roll)))
        with gui.add_folder("Bending vector (N), tensions of least sum", expand_by_default=False):
            reach = space.upper[: space.bending_count]
            names = [f"segment {index + 1}, {axis}" for index in range(robot.segment_count) for axis in "xy"]
            self._bending = [
                _slider(gui, name, -_rounded_up(high), _rounded_up(high), 0.0)
                for name, high in zip(names, reach, strict=True)
            ]
        with gui.add_folder("Shapes"):
            self._model = gui.add_dropdown("drawn and judged", scene.models, initial_value=scene.models[0])
            self._ghosts = {name: gui.add_checkbox(f"+ {_words(name)}", False) for name in scene.models}
        button = gui.add_button("Back to the start")
        button.on_click(lambda _: self.move(scene.start))
        for control in (self._model, *self._ghosts.values(), *self._tendons, self._insertion, self._roll):
            if control is not None:
                control.on_update(lambda _: self._answer())
        for control in self._bending:
            control.on_update(lambda _: self._answer_bending())

    @contextmanager
    def _setting(self) -> Iterator[None]:
        """Marks this thread as one that sets sliders itself; the lock must be held."""
        before, self._setter = self._setter, threading.get_ident()
        try:
            yield
        finally:
            self._setter = before

    def _answer(self) -> None:
        """Draws what a person has set, unless a later change is waiting already, which then answers for this one."""
        if self._setter == threading.get_ident():
            return
        self._asked += 1
        mine = self._asked
        with self._lock:
            if mine == self._asked:
                self.update()

    def _answer_bending(self) -> None:
        if self._setter == threading.get_ident():
            return
        # read before waiting: a drawing in progress moves these sliders to the tensions that it shows
        bending = np.array([slider.value for slider in self._bending]).reshape(-1, 2)
        self._asked += 1
        mine = self._asked
        with self._lock:
            if mine == self._asked:
                self.move(self._scene.with_bending(self.controls, bending))

    def _show_bending(self, controls: Controls) -> None:
        """Moves the bending sliders to what the tensions stand for."""
        with self._setting():
            for slider, value in zip(self._bending, self._scene.bending(controls).ravel(), strict=True):
                slider.value = float(np.clip(value, slider.min, slider.max))

    def _draw_scene(self) -> None:
        picture = gather_scenario_picture(self._scene.session.scenario)
        camera = choose_camera(picture, 800, 600)
        # a view in perspective shows less of what is near
        height = 1.6 * camera.height / camera.scale
        # the sliders' panel covers the right of the window
        centre = camera.centre + 0.22 * height * camera.rotation[0]
        view = self._server.initial_camera
        view.up, view.look_at, view.position = camera.rotation[1], centre, centre + 0.75 * height * camera.rotation[2]
        for number, mesh in enumerate(picture.meshes):
            wall = find_role(mesh.role).wall
            self._server.scene.add_mesh_simple(
                f"/scene/{number}",
                mesh.vertices.astype(np.float32),
                mesh.faces.astype(np.uint32),
                color=_rgb(wall.live),
                opacity=wall.live_opacity,
                side="double",
            )
        self._draw_guides(picture)
        for number, goal in enumerate(picture.goals):
            self._server.scene.add_icosphere(
                f"/goal/{number}",
                radius=max(goal.tolerance, 0.15 * self._size),
                color=_rgb(plots.GOAL),
                opacity=0.6,
                position=goal.position,
            )

    def _draw_guides(self, picture: Picture) -> None:
        """Draws the entry planes as dashed circles and the base frame at the start as three lines."""
        for number, disk in enumerate(entry_disks(picture)):
            # every other piece of the rim: a dashed line
            dashes = [
                tube_mesh(disk.rim[start : start + 2], 0.04 * self._size, 6) for start in range(0, len(disk.rim) - 1, 2)
            ]
            self._put(f"/entry/{number}", merge_meshes(dashes), GRAVITY_COLOUR)
        origin, rotation = base_axes(picture)
        for index, (axis, colour) in enumerate(AXIS_COLOURS.items()):
            arm = np.stack([origin, origin + 3.0 * self._size * rotation[:, index]])
            self._put(f"/base/{axis}", tube_mesh(arm, 0.06 * self._size), colour)

    def _draw_robot(self, look: Look) -> None:
        if not look.has_shape:
            self._remove(
                "/robot/disks",
                "/robot/backbone",
                "/robot/sleeve",
                "/robot/shaft",
                *(f"/robot/tendon{i}" for i in range(len(self._tendons))),
            )
            return
        robot, positions, rotations = self._scene.robot, look.positions, look.rotations
        self._put("/robot/disks", disk_mesh(robot, positions, rotations), plots.ROBOT)
        line = backbone_curve(positions, rotations, robot.arc_lengths)
        self._put("/robot/backbone", tube_mesh(line, robot.backbone.radius_m), plots.INK)
        body = self._scene.session.scene.body
        bare = RobotBody(robot, None, body.shaft)
        self._put_or_remove(
            "/robot/sleeve", _drawn(sleeve_mesh(bare, positions, rotations)), plots.SLEEVE, opacity=0.35
        )
        self._put_or_remove("/robot/shaft", _drawn(shaft_mesh(bare, positions, rotations)), plots.SHAFT)
        # a real tendon is a hair that no screen shows
        radius = max(robot.body.tendon_radius_m, 0.04 * self._size)
        for index, points in enumerate(tendon_lines(robot, positions, rotations)):
            self._put(f"/robot/tendon{index}", tube_mesh(points, radius, sides=6), tendon_colour(index))

    def _draw_contacts(self, look: Look) -> None:
        contacts = look.contacts or (() if look.near is None else (look.near,))
        if not contacts:
            self._remove(*_PASSING)
            return
        colour = plots.ALERT if look.contacts else NEAR
        names = {name for contact in contacts for name in contact.part.split(" and ")}
        body = self._scene.session.scene.body
        parts = [part_mesh(body, look.positions, look.rotations, name, 0.02 * self._size) for name in names]
        self._put_or_remove("/contact/parts", [part for part in parts if part is not None], colour)
        walls = {mesh.name: mesh for mesh in self._scene.session.scene.meshes}
        touched = [contact for contact in contacts if contact.triangle >= 0]
        triangles = [
            walls[contact.mesh].wall_vertices[walls[contact.mesh].wall_faces[contact.triangle]] for contact in touched
        ]
        corners = [(triangle, np.array([[0, 1, 2]])) for triangle in triangles]
        edges = [tube_mesh(triangle[[0, 1, 2, 0]], 0.03 * self._size, sides=5) for triangle in triangles]
        self._put_or_remove("/contact/triangles", [*corners, *edges], colour)
        balls = [_ball(contact.point, (0.22 if contact is contacts[0] else 0.12) * self._size) for contact in contacts]
        self._put("/contact/points", merge_meshes(balls), plots.INK)
        self._shown.add("/contact/label")
        self._server.scene.add_label(
            "/contact/label", plain_text(_short(contacts[0], bool(look.contacts)), SHORT), position=contacts[0].point
        )

    def _draw_ghosts(self, controls: Controls, look: Look) -> list[str]:
        """Draws the shapes of the other models that are asked for, and returns how far their tips are, in words."""
        robot, lines = self._scene.robot, []
        for name, box in self._ghosts.items():
            node = f"/ghost/{name}"
            if not box.value or name == self._model.value:
                self._remove(node)
                continue
            positions, rotations, problem = self._scene.shape(controls, name)
            if problem:
                self._remove(node)
                lines.append(problem)
                continue
            line = backbone_curve(positions, rotations, robot.arc_lengths)
            mesh = merge_meshes([disk_mesh(robot, positions, rotations), tube_mesh(line, robot.backbone.radius_m)])
            self._put(node, mesh, SHAPE_MODELS.find(name).colour, opacity=0.45)
            apart = 1e3 * float(np.linalg.norm(positions[-1] - look.positions[-1]))
            if np.isfinite(apart):
                lines.append(f"tip of the {_words(name)} shape {_length(apart)} away")
        return lines

    def _put_or_remove(self, name: str, meshes: list[Mesh], colour: str, opacity: float | None = None) -> None:
        if meshes:
            self._put(name, merge_meshes(meshes), colour, opacity)
        else:
            self._remove(name)

    def _put(self, name: str, mesh: Mesh, colour: str, opacity: float | None = None) -> None:
        vertices, faces = mesh
        self._shown.add(name)
        self._server.scene.add_mesh_simple(
            name,
            vertices.astype(np.float32),
            faces.astype(np.uint32),
            color=_rgb(colour),
            opacity=opacity,
            flat_shading=True,
            side="double",
        )

    def _remove(self, *names: str) -> None:
        for name in self._shown.intersection(names):
            self._server.scene.remove_by_name(name)
        self._shown.difference_update(names)


def _drawn(mesh: Mesh) -> list[Mesh]:
    """Returns a mesh in a list, which is empty for one that has no triangles or is one point."""
    vertices, faces = mesh
    return [mesh] if len(faces) and np.ptp(vertices, axis=0).max() > 0.0 else []


def _slider(gui: Any, name: str, low: float, high: float, value: float) -> Any:
    """Adds a slider whose numbers have three digits behind the first of its range; what is set stays exact."""
    digits = 3 - int(np.floor(np.log10(max(float(high - low), 1e-6))))
    step = 10.0**-digits
    # viser shows as many digits as the first value, the limits and the step have
    shown = float(np.clip(round(float(value), max(digits, 0)), low, high))
    slider = gui.add_slider(name, min=float(low), max=float(high), step=step, initial_value=shown)
    slider.value = float(value)
    return slider


def _rounded_up(value: float) -> float:
    """Returns a limit of a slider with three digits, at least the value."""
    unit = 10.0 ** (np.floor(np.log10(max(value, 1e-6))) - 2)
    return float(f"{np.ceil(value / unit * (1.0 - 1e-12)) * unit:.3g}")


def _words(name: str) -> str:
    return name.replace("_", " ")


def _length(millimetres: float) -> str:
    """Returns a length as finely as it matters to a robot."""
    return f"{millimetres:.2f} mm" if millimetres >= 0.01 else "less than 0.01 mm"


def _note_html(head: str, colour: str, lines: list[str]) -> str:
    """Returns the verdict as a badge over its sentences, in a box of one height: the sliders below it stay in place."""
    badge = f'<b style="background:{colour};color:white;padding:3px 12px;border-radius:11px">{page_text(head)}</b>'
    text = "".join(f'<div style="margin-top:5px">{page_text(line)}</div>' for line in lines)
    return (
        f'{_STYLE}<div style="height:{_NOTE_PX}px;overflow:auto;padding:8px 12px 0;font-size:13px">{badge}{text}</div>'
    )


def _short(contact: Contact, touching: bool) -> str:
    """Returns a contact as a few words that fit into the scene."""
    if contact.mesh == "robot":
        return contact.part
    if contact.triangle < 0:
        return f"{contact.part}: wrong side of {contact.mesh}"
    return f"{contact.part} {'touches' if touching else 'near'} {contact.mesh}"


def _ball(centre: FloatArray, radius: float) -> Mesh:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    return ball.vertices + centre, ball.faces


def _rgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = (round(255 * part) for part in to_rgb(colour))
    return red, green, blue
