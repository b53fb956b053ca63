"""Meshes with openings: bowls have no inside, scans with holes have one."""

import numpy as np
import pytest
import trimesh

import warpcloth as wc
from warpcloth.errors import BadStartError

BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.15)


def ball_below(height: float, welded: bool = True) -> wc.MeshObstacle:
    """What is left of a ball where its triangles below a height are kept [m]."""
    faces = BALL.faces[BALL.triangles_center[:, 2] < height]
    if welded:
        return wc.MeshObstacle(BALL.vertices, faces)
    return wc.MeshObstacle(BALL.vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3))


@pytest.mark.parametrize("welded", [True, False])
def test_what_has_small_openings_only_is_solid(welded):
    """Of a ball cut at the height z above its middle the opening has the share (r² − z²)/(2 r (r + z) + r² − z²)."""
    assert ball_below(1.0, welded).solid
    assert ball_below(0.14, welded).solid  # 3 %
    assert ball_below(0.125, welded).solid  # 8 %
    assert not ball_below(0.08, welded).solid  # 19 %
    assert not ball_below(0.0, welded).solid  # a third


def test_openings_do_not_cancel():
    """The two ends of a tube face each other."""
    tube = trimesh.creation.cylinder(radius=0.1, height=0.3)
    sides = tube.faces[np.abs(tube.face_normals[:, 2]) < 0.5]
    assert tube.is_watertight
    assert not wc.MeshObstacle(tube.vertices, sides).solid


def test_cloth_may_lie_in_a_bowl_but_not_start_in_a_ball_with_a_hole():
    cloth = wc.Cloth.grid((0.1, 0.1), (9, 9), transform=(0.0, 0.0, -0.08))
    bowl = wc.Simulation(wc.Model.build([cloth], [ball_below(0.0)]), "xpbd", contact="all")
    bowl.run(12, fps=24)
    assert bowl.metrics()["max_penetration_m"] == 0.0
    assert bowl.state.particle_q.numpy()[:, 2].min() > -0.15  # and it holds what lies in it
    with pytest.raises(BadStartError):
        wc.Simulation(wc.Model.build([cloth], [ball_below(0.14)]), "xpbd")
