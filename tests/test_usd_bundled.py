"""The first frames of every bundled scene, checked as caches."""

import pytest
from warpcloth.scenes import bundled_scenes, simulate
from warpcloth.scenes.usd import check_cache


@pytest.mark.parametrize("name", bundled_scenes())
def test_bundled_scenes_write_sound_caches(tmp_path, name):
    result = simulate(name, tmp_path / f"{name}.usdc", frames=4, device="cpu")
    report = check_cache(result.output, every=True)
    assert report.usd_errors == ()
    assert report.ok
    assert report.frames == 5
    assert report.particles == result.particles
    assert report.intersections == 0
