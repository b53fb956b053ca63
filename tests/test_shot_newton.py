"""Newton imports an exported scene as cloth."""

import warnings

import numpy as np
import pytest
from warpcloth.scenes import export_scene, scene_from_toml

newton = pytest.importorskip("newton")
pytest.importorskip("newton_usd_schemas")

SCENE = """
[[cloth]]
name = "napkin"
shape = "grid"
resolution = [9, 7]
size = [0.4, 0.3]
position = [0.1, 0.2, 0.5]
rotation = [20.0, 10.0, 30.0]
fabric = "denim"
[[cloth]]
shape = "disc"
resolution = 4
fabric = "silk"
position = [2.0, 0.0, 0.5]
[[obstacle]]
shape = "sphere"
radius = 0.2
center = [0.1, 0.2, 0.05]
[[obstacle]]
shape = "plane"
"""


@pytest.mark.parametrize("ending", [".usda", ".usdz"])
def test_newton_imports_it_as_cloth(tmp_path, ending):
    scene = scene_from_toml(SCENE)
    path = export_scene(scene, tmp_path / f"scene{ending}")
    builder = newton.ModelBuilder()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*surfaceShearStiffness is not applied")  # a limit of its membrane
        builder.add_usd(str(path))
    cloths = scene.build()[0]
    assert builder.particle_count == sum(len(cloth.points) for cloth in cloths)
    assert builder.tri_count == sum(len(cloth.triangles) for cloth in cloths)
    np.testing.assert_allclose(builder.particle_q, np.concatenate([cloth.points for cloth in cloths]), atol=1e-6)
    np.testing.assert_allclose(sum(builder.particle_mass), sum(cloth.mass for cloth in cloths), rtol=1e-5)
    count = len(cloths[0].triangles)
    stretch = [material[0] for material in builder.tri_materials]
    assert np.all(np.array(stretch[:count]) >= cloths[0].fabric.stretch[0])
    np.testing.assert_allclose(np.ptp(stretch[:count]), 0.0)
    bend = np.array(builder.edge_bending_properties)[:, 0]
    np.testing.assert_allclose(bend[0], cloths[0].fabric.bending[0], rtol=1e-5)
    assert builder.shape_count == 2
