from dataclasses import replace

import numpy as np
import pytest
import trimesh

from tdcr_planner.report.picture import DisplayMesh, gather_picture
from tdcr_planner.report.viewpoint import choose_camera


@pytest.mark.parametrize("size", [(1470, 700), (926, 700), (300, 500)])
@pytest.mark.parametrize("extents", [(0.09, 0.195, 0.08), (0.2, 0.05, 0.4)])
def test_no_view_looks_straight_at_the_side_of_a_box(make_result, size, extents):
    box = trimesh.creation.box(extents=extents)
    picture = replace(
        gather_picture(make_result()),
        meshes=(DisplayMesh("box.stl", "cavity", np.asarray(box.vertices), np.asarray(box.faces)),),
    )
    camera = choose_camera(picture, *size)
    towards = camera.rotation[2]
    compass = np.rad2deg(np.arctan2(towards[1], towards[0])) % 90.0  # gravity is along z or absent
    assert 15.0 - 1e-6 <= compass <= 75.0 + 1e-6
    # the normals of all faces turn at least so far away
    assert np.rad2deg(np.arccos(np.abs(box.face_normals @ towards).max())) > 15.0
    np.testing.assert_array_equal(choose_camera(picture, *size).rotation, camera.rotation)
