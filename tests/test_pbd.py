"""What is peculiar to position-based dynamics as first published: shares of errors, not stiffness."""

import numpy as np
import pytest

import warpcloth as wc


def test_each_kind_of_spring_has_its_own_share_in_pbd():
    """Bend springs that have no particle in common, and nothing else at work: each keeps (1 − s)ⁿ of its error."""
    cloth, kept = wc.Cloth.grid((0.2, 0.1), (3, 2)), {}
    for stiffness, bending in ((0.0, 0.3), (0.0, 0.0)):
        sim = wc.Simulation(
            wc.Model.build(cloth, precision="float64"), "pbd", (0.0, 0.0, 0.0), substeps=1,
            integrator_options={"iterations": 2, "stiffness": stiffness, "bending": bending},
        )  # fmt: skip
        sim.state.particle_q.assign(1.1 * cloth.points)
        sim.step(0.01)
        q = sim.state.particle_q.numpy()
        kept[bending] = (np.linalg.norm(q[[2, 5]] - q[[0, 3]], axis=1) - 0.2) / 0.02
    assert kept[0.3] == pytest.approx(0.7**2, rel=1e-12)
    assert kept[0.0] == pytest.approx(1.0, rel=1e-12)
