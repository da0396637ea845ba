"""What every picture of an inspection shows, made once: the painted scene and the tip views along the path."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tdcr_planner.arrays import IntArray
from tdcr_planner.inspection.answer import Inspection
from tdcr_planner.report import raster
from tdcr_planner.report.coverage_map import PaintedMesh, paint
from tdcr_planner.report.picture import Picture, gather_picture
from tdcr_planner.report.tip_view import TipScene, draw_tip_view
from tdcr_planner.report.viewpoint import up_direction

MAX_VIEWS = 64
VIEW_PX = 240


@dataclass(frozen=True, eq=False)
class CoveragePicture:
    """The pictures of an inspection, each made when it is first needed.

    Attributes:
        inspection: What is shown.
    """

    inspection: Inspection

    @cached_property
    def picture(self) -> Picture:
        """Scene and robot."""
        coverage = self.inspection.coverage
        return replace(gather_picture(self.inspection.plan), in_view=coverage.targets.points[coverage.can_be_seen])

    @cached_property
    def painted(self) -> list[PaintedMesh]:
        """The scene's meshes with the coverage map."""
        return paint(self.inspection.coverage, self.picture.meshes)

    @cached_property
    def shown(self) -> IntArray:
        """States that get a tip view: evenly spread over the time; none without a path."""
        return self.picture.frame_states(MAX_VIEWS) if self.picture.has_path else np.zeros(0, dtype=np.int64)

    @cached_property
    def views(self) -> list[raster.Image]:
        """What the camera sees in each of the shown states, shape (VIEW_PX, VIEW_PX, 3) each, 0 to 1."""
        return [self.view(int(state), VIEW_PX) for state in self.shown]

    def view(self, state: int, size: int) -> raster.Image:
        """Returns what the camera sees in a state, shape (size, size, 3), 0 to 1."""
        camera = self.inspection.coverage.camera
        centres, frames = camera.poses(self.picture.positions[[state]], self.picture.rotations[[state]])
        return draw_tip_view(self._scene, camera, centres[0], frames[0], up_direction(self.picture), size)

    @cached_property
    def _scene(self) -> TipScene:
        return TipScene.of(self.painted)
