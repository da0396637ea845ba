"""tdcr view: the moving picture of a result or a scenario, written and opened in a browser."""

from __future__ import annotations

import os
import sys
import webbrowser
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

if TYPE_CHECKING:
    from tdcr_planner.query.result import PlanResult
    from tdcr_planner.report.picture import Picture


def view(
    file: tyro.conf.Positional[Path],
    *,
    out: Path | None = None,
    export: tuple[Path, ...] = (),
    open_browser: bool = True,
    live: bool = False,
    port: int = 8080,
    host: str = "127.0.0.1",
) -> int:
    """Write the HTML of a result or a scenario and open it in a browser.

    For a scenario it also says whether the start is valid, with its clearance or what it touches.

    Example: tdcr view out/elbow/result.json --export elbow.gif elbow.glb

    Example: tdcr view scenes/duct/scenario_elbow.toml --live

    Exit code 1 when the page was written and an export failed, or no browser could be opened.

    Args:
        file: The result.json of `tdcr plan` (or its folder), or a scenario (.toml).
        out: Where to write the page; path.html beside the result or, for a scenario NAME.toml, NAME.html here.
        export: Files to write besides, by ending: .png, .gif, .mp4, .glb (the robot moves), and of a result .json
            (ROS-style joint trajectory), .csv (trajectory) or .npz (all shapes).
        open_browser: Open the page when it is written.
        live: Serve a viewer until Ctrl-C and write nothing: sliders set each tendon, insertion and roll, and what
            the robot touches is shown in place.
        port: Port of the live viewer, or the next free one where it is taken; 0 for any free one.
        host: Address that the live viewer listens at: 127.0.0.1 for this machine alone, 0.0.0.0 for everybody who
            can reach this machine, without a password.
    """
    from tdcr_planner.bounds import PORT
    from tdcr_planner.errors import FormatError, TdcrError
    from tdcr_planner.files import check_file_target, real_path
    from tdcr_planner.planning.scenario import load_scenario
    from tdcr_planner.report.export import check_export
    from tdcr_planner.report.picture import gather_picture, gather_scenario_picture, with_start_checked
    from tdcr_planner.report.results import read_result

    PORT.check("--port", port)
    if live:
        return _view_live(file, port, host, open_browser)
    result = None
    has_result = file.suffix != ".toml"
    for target in export:
        check_export(target, has_result=has_result, name="--export")
    for target in export if out is None else (out, *export):
        check_file_target(target)
    if file.suffix == ".toml":
        picture = gather_scenario_picture(load_scenario(file))
        try:
            picture = with_start_checked(picture)
        except TdcrError as error:  # the picture may show what is wrong with the scene
            picture = replace(picture, message=f"start: not checked, {error}")
        page = out or Path(f"{file.stem}.html")
    elif file.suffix == ".json" or os.path.isdir(file):
        result = read_result(file)
        picture = gather_picture(result)
        page = out or (file if os.path.isdir(file) else file.parent) / "path.html"
    else:
        raise FormatError(file, f"expected a result (.json) or a scenario (.toml), got {file.suffix or 'no ending'!r}")
    drawn = _draw_page(picture, page)
    if result is None:
        print(picture.message)
    exported = [_export(picture, target, result) for target in export]
    if not (drawn and all(exported)):
        return 1
    if open_browser and not open_page(real_path(page).as_uri()):
        print("no browser could be opened here; open that file in one", file=sys.stderr)
        return 1
    return 0


def _draw_page(picture: Picture, page: Path) -> bool:
    """Writes the page and returns whether it could be drawn; if not, a warning names it.

    Raises:
        FormatError: The page cannot be written.
    """
    from tdcr_planner.errors import TdcrError
    from tdcr_planner.files import write_file_whole
    from tdcr_planner.report.drawing import warn_not_drawn
    from tdcr_planner.report.scene_html import write_html

    try:
        with write_file_whole(page) as temporary:
            write_html(picture, temporary)
    except TdcrError:
        raise
    except Exception as error:
        warn_not_drawn(page, error)
        return False
    print(page)
    return True


def _export(picture: Picture, target: Path, result: PlanResult | None) -> bool:
    """Exports one file and returns whether it could be; if not, a warning names it and the other files stand."""
    from tdcr_planner.report.drawing import warn_not_drawn
    from tdcr_planner.report.export import export_picture

    try:
        export_picture(picture, target, result)
    except Exception as error:
        warn_not_drawn(target, error)
        return False
    print(target)
    return True


def _view_live(file: Path, port: int, host: str, open_browser: bool) -> int:
    import threading

    from tdcr_planner.planning.scenario import load_scenario
    from tdcr_planner.query.session import PlanningSession
    from tdcr_planner.report.live import find_port, serve_live
    from tdcr_planner.report.results import read_result

    port = find_port(host, port)
    scenario = load_scenario(file) if file.suffix == ".toml" else read_result(file).scenario
    viewer = serve_live(PlanningSession(scenario), port=port, host=host)
    print(f"{viewer.address} (Ctrl-C ends it)")
    if open_browser and not open_page(viewer.address):
        print("no browser could be opened here; open that address in one", file=sys.stderr)
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        viewer.stop()
    return 0


def open_page(address: str) -> bool:
    """Opens an address in the user's browser; false where there is none or no display to show it."""
    shown_by = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in shown_by):
        return False
    try:
        return webbrowser.open(address)
    except webbrowser.Error:
        return False
