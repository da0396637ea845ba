"""Drawing an inspection's files: still and moving picture, the map as meshes, the tip view as an animation."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from tdcr_planner.inspection.answer import Inspection
from tdcr_planner.report.drawing import draw_pictures

if TYPE_CHECKING:
    from tdcr_planner.report.coverage_picture import CoveragePicture


def draw_inspection(inspection: Inspection, folder: str | Path) -> list[str]:
    """Draws coverage.png, .html, .glb and .ply and tip_view.gif; returns the names of those that were drawn.

    Args:
        inspection: The answer to an inspection.
        folder: The folder that `write_inspection_data` wrote.
    """

    # what draws is loaded by the drawings: where it cannot be, the result stands
    @cache
    def shown() -> CoveragePicture:
        from tdcr_planner.report.coverage_picture import CoveragePicture

        return CoveragePicture(inspection)

    def png(file: Path) -> None:
        from tdcr_planner.report.coverage_png import write_coverage_png

        write_coverage_png(shown(), file)

    def html(file: Path) -> None:
        from tdcr_planner.report.coverage_html import write_coverage_html

        write_coverage_html(shown(), file)

    def mesh(file: Path) -> None:
        from tdcr_planner.report.coverage_map import write_map

        write_map(shown().painted, file)

    def video(file: Path) -> None:
        from tdcr_planner.report.tip_view import write_tip_video

        write_tip_video(shown().views, file)

    drawings = {"coverage.png": png, "coverage.html": html, "coverage.glb": mesh, "coverage.ply": mesh}
    if inspection.plan.path is not None:
        drawings["tip_view.gif"] = video
    return draw_pictures(folder, drawings, stale=("tip_view.gif",))
