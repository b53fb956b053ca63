"""Obstacles in scenes that are viewed: where a simulation of the scene has them, and where hands lead them."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdPhysics
from shot_files import add_cloth, add_mesh, cached_points, new_stage, sheet, to_stage
from view_browser import SCENE
from warpcloth.scenes import load_scene, scene_from_toml
from warpcloth.scenes.built import BuiltScene, make_model, make_simulation

from warpcloth.view.session import Session
from warpcloth.view.settings import Settings
from warpcloth.view.stage import LedObstacle, Stage

PADDLE = """
[[obstacle]]
name = "paddle"
shape = "box"
center = [0.0, -0.12, 0.5]
size = [0.5, 0.02, 0.2]
"""


@pytest.mark.parametrize(
    "motion",
    [
        "motion.keys = [{ time = 0.0 }, { time = 0.25, rotation = [0.0, 0.0, 360.0] }]",
        "motion.keys = [{ time = 0.0 }, { time = 0.11, position = [0.0, 0.2, 0.0] }, { time = 0.25 }]",
        "motion.keys = [{ time = 0.05 }, { time = 0.17, position = [0.0, 0.2, 0.0] }]",  # jumps back
        "motion.interpolation = 'smooth'\nmotion.keys = [{ time = 0.0 }, { time = 0.25, position = [0.0, 0.2, 0.0] }]",
    ],
)
def test_what_moves_in_a_loop_is_where_a_simulation_has_it_and_so_is_the_cloth(motion):
    scene = scene_from_toml(SCENE + PADDLE + "motion.loop = true\n" + motion).changed({"fps": 30.0})
    stage, built = Stage(scene, Settings("xpbd", 20, scene.simulation.gravity, scene.air.wind)), BuiltScene.of(scene)
    plain = make_simulation([built], make_model([built]))
    still = plain.state.particle_q.numpy().copy()
    for _ in range(20):
        stage.step()
        plain.step(1.0 / 30.0)
        ends = [world.model.shapes.start.numpy() for world in (stage.simulation, plain)]
        assert ends[0]["position"] == pytest.approx(ends[1]["position"], abs=1e-6)
        assert ends[0]["rotation"] == pytest.approx(ends[1]["rotation"], abs=1e-6)
    cloth = plain.state.particle_q.numpy()
    assert np.abs(cloth - still)[:, 1].max() > 0.02  # it was met
    assert stage.simulation.state.particle_q.numpy() == pytest.approx(cloth, abs=1e-6)


def test_what_spins_spins_on_while_a_hand_leads_it():
    keys = "motion.loop = true\nmotion.keys = [{ time = 0.0 }, { time = 0.25, rotation = [0.0, 0.0, 360.0] }]"
    scene = scene_from_toml(SCENE + PADDLE + keys)
    item = LedObstacle(next(o for o in BuiltScene.of(scene).obstacles if o.name == "paddle"))
    item.hand = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    motion = item.follow(0.24, 0.03)
    turns = np.diff([motion.keys_at(time)[1][2] for time in np.linspace(0.24, 0.27, 50)])
    assert turns == pytest.approx(8.0 * np.pi * 0.03 / 49)
    assert motion.keys_at(0.27)[0] == pytest.approx((0.06, 0.0, 0.0))
    assert item.obstacle.motion.keys_at(0.27)[0] == pytest.approx((0.06, 0.0, 0.0))


def test_a_recording_begun_after_a_change_has_obstacles_where_they_are(tmp_path):
    keys = "motion.keys = [{ time = 0.0 }, { time = 10.0, position = [0.0, -10.0, 0.0] }]"
    session = Session(scene_from_toml(SCENE + PADDLE + keys))
    session.lead("paddle", (0.0, 0.0, 0.1))
    for _ in range(15):
        session.single_step()
    session.change(stiffness=2.0)
    session.record(tmp_path / "shot.usda")
    session.single_step()
    session.close()
    stage = Usd.Stage.Open(str(tmp_path / "shot.usda"))
    paddle = UsdGeom.Xformable(stage.GetPrimAtPath("/World/Obstacles/paddle"))
    places = [np.array(paddle.ComputeLocalToWorldTransform(code))[3, :3] for code in (0.0, 1.0)]
    assert places[0] == pytest.approx((0.0, -0.62, 0.6), abs=1e-6)
    assert places[1] == pytest.approx((0.0, -0.62 - 1 / 30, 0.6), abs=1e-6)


def test_a_recording_begun_later_has_what_deforms_where_it_shaped_the_cloth(tmp_path):
    stage = new_stage(tmp_path / "shot.usda", frames=24)
    add_cloth(stage)
    points, counts, indices = sheet(2, 1.0, 0.49)
    lid = add_mesh(stage, "/World/Lid", (points, counts, indices))
    UsdPhysics.CollisionAPI.Apply(lid.GetPrim())
    for frame in (0, 24):
        lid.GetPointsAttr().Set(to_stage(stage, points + np.array((0.0, 0.0, 0.01 * frame))), frame)
    stage.Save()
    session = Session(load_scene(tmp_path / "shot.usda", ["simulation.integrator=xpbd"]), 24.0)
    for _ in range(12):
        session.single_step()
    session.record(tmp_path / "recorded.usdc")
    session.single_step()
    session.close()
    assert (session.snapshot.error, session.snapshot.time) == ("", pytest.approx(13 / 24))
    shown = Usd.Stage.Open(str(tmp_path / "recorded.usdc"))
    obstacles = shown.GetPrimAtPath("/World/Obstacles").GetChildren()
    assert len(obstacles) == 1
    for frame in (0, 1):
        heights = cached_points(tmp_path / "recorded.usdc", str(obstacles[0].GetPath()), frame)[:, 2]
        assert heights == pytest.approx(0.49 + 0.01 * (12 + frame), abs=1e-6)
