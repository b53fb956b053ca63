"""What impacts have pushed into solids is put back on their surfaces; all else stays where it is."""

import numpy as np
import pytest
import warp as wp

import warpcloth as wc


def test_only_what_was_pushed_into_a_solid_of_its_world_is_put_back():
    """Two worlds with a sheet of four particles each; the ball is in the first one."""
    cloth, ball = wc.Cloth.grid((0.1, 0.1), (2, 2), wc.Fabric(thickness=0.01)), wc.Sphere((0.0, 0.0, 1.0), 0.2)
    model = wc.Model.build_worlds([([cloth], [ball]), ([cloth], [])], device="cpu", precision="float64")
    reach = 0.2 + 0.005 + model.shapes.shapes.thickness.numpy()[0]
    offset = reach - 0.2
    heights = np.array([0.1, 0.1, 0.2 + 0.9 * offset, 0.2 + 0.995 * offset, 0.1, 0.1, 0.1, 0.1])
    now = np.column_stack([np.zeros(8), np.zeros(8), 1.0 + heights])
    before = now + np.array([0.0, 0.0, 0.01])
    before[1] = now[1]  # was not pushed
    model.shapes.place(model.tracks, wp.zeros(2, dtype=wp.float64, device="cpu"), 0.0)
    out = wp.array(now, dtype=model.vec3, device="cpu")
    wp.launch(
        model.kernels.contact_impact.keep_out,
        dim=8,
        inputs=[
            0, model.particle_world, model.particle_radius, model.shapes.shapes,
            wp.array(before, dtype=model.vec3, device="cpu"), model.shapes.end,
        ],
        outputs=[out],
        device="cpu",
    )  # fmt: skip
    expected = heights.copy()
    expected[[0, 2]] = reach  # the fourth one is near enough to its surface
    assert out.numpy()[:, 2] - 1.0 == pytest.approx(expected)
