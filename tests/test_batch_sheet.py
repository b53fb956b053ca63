"""The picture of a batch: all of each drape is in it, wherever its scene has it."""

import numpy as np
import pytest
from batch_sweeps import simulated, written
from PIL import Image

from warpcloth.batch.sheet import write_sheet

pytest.importorskip("pyvista")

SWEEP = """
scene = "scene.toml"
design = "grid"

[[parameter]]
path = "cloth.0.position.2"
values = [5.0, 9.0, -4.0]
"""
SCENE = """
frames = 1

[simulation]
device = "cpu"

[[cloth]]
shape = "grid"
size = [0.3, 0.3]
resolution = [5, 5]
rotation = [{turn}, 0.0, 0.0]
fabric = {{ color = [0.8, 0.0, 0.0] }}
pins = [{{ edge = "top" }}]
"""
BALL = """
[[obstacle]]
shape = "sphere"
center = [0.0, 0.0, {z}]
radius = 0.2
color = [0.8, 0.0, 0.0]
"""


def red(picture: np.ndarray) -> np.ndarray:
    """Where a picture is red."""
    return (picture[..., 0] > 100) & (picture[..., 1] < 0.6 * picture[..., 0])


def shown(folder, scene: str, sweep: str = SWEEP) -> np.ndarray:
    """Where the sheet of a batch is red."""
    batch, _ = simulated(written(folder, sweep, scene), folder / "batch", worlds=3)
    return red(np.asarray(Image.open(write_sheet(batch))))


@pytest.mark.parametrize("turn", [0.0, 90.0])
def test_cloth_at_any_height_is_in_the_picture(tmp_path, turn):
    """Three pieces in two rows; those that hang are as high as wide."""
    seen = shown(tmp_path, SCENE.format(turn=turn))
    assert seen.mean() > 0.2
    assert not any(edge.any() for edge in (seen[0], seen[-1], seen[:, 0], seen[:, -1]))


def test_solids_somewhat_larger_than_cloth_are_in_the_picture_side_by_side(tmp_path):
    sweep = SWEEP.replace("[5.0, 9.0, -4.0]", "[5.0, 5.01]")
    seen = shown(tmp_path, SCENE.format(turn=0.0) + BALL.format(z=4.75), sweep)
    assert seen.mean() > 0.2
    assert not any(edge.any() for edge in (seen[0], seen[-1], seen[:, 0], seen[:, -1]))
    assert not seen[:, seen.shape[1] // 2].any()


def test_networks_are_in_the_picture(tmp_path):
    sweep = 'scene = "pendulum"\ndesign = "grid"\n[[parameter]]\npath = "network.k_s"\nvalues = [200.0, 300.0]\n'
    sweep += '[[parameter]]\npath = "frames"\nvalues = [2]\n[[parameter]]\npath = "network.width"\nvalues = [0.1]\n'
    batch, _ = simulated(written(tmp_path, sweep), tmp_path / "batch", worlds=1)
    left, right = np.array_split(np.asarray(Image.open(write_sheet(batch))), 2, axis=1)
    assert (left.std(axis=(0, 1)) > 5.0).all()
    assert (right.std(axis=(0, 1)) > 5.0).all()
