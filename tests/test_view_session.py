"""What a session does between orders: parts of frames, hands, factors, settings that do not suit the scene."""

from dataclasses import replace

import numpy as np
import pytest
from view_browser import SCENE
from warpcloth.scenes import scene_from_toml

from warpcloth.errors import InputError
from warpcloth.view.pace import MOST_SLICES, SLICE, Pace
from warpcloth.view.session import Session
from warpcloth.view.settings import Settings
from warpcloth.view.stage import Stage

MIDDLE = ((0.0, -3.0, 0.8), (0.0, 1.0, 0.0))  # a ray to the middle of the cloth
TURN = "motion.keys = [{ time = 0.0 }, { time = 1.0, rotation = [0.0, 0.0, 90.0] }]"


@pytest.fixture
def session():
    session = Session(scene_from_toml(SCENE, name="curtain"))
    yield session
    session.close()


def stage_of(text: str, **settings) -> Stage:
    scene = scene_from_toml(text).changed({"fps": 30.0})
    return Stage(scene, Settings("xpbd", 20, scene.simulation.gravity, scene.air.wind, **settings))


class Frames:
    """Runs a pace with frames that take so long [s]."""

    def __init__(self):
        self.pace, self.now, self.time = Pace(), 0.0, 0.0

    def run(self, *spent: float) -> int:
        for seconds in spent:
            done = False
            while not done:
                begun, parts = self.now, self.pace.slices
                self.now += seconds / parts
                self.time += 0.04 / parts
                done = self.pace.done(begun, self.now, self.time)
        return self.pace.slices


def test_frames_are_cut_where_they_are_slow_and_joined_where_they_are_fast_again():
    frames = Frames()
    assert frames.run(20.0 * SLICE, 20.0 * SLICE) == 1  # kernels were loaded
    assert frames.run(*[0.1 * SLICE] * 5) == 1
    assert frames.run(*[100.0 * SLICE] * 60) == MOST_SLICES
    assert frames.run(*[0.1 * SLICE] * 60) == 1


def test_the_pace_is_simulated_over_wall_time_of_the_last_second():
    frames = Frames()
    assert frames.pace.factor == 0.0
    frames.run(*[0.04] * 50)
    assert frames.pace.factor == pytest.approx(1.0)
    frames.run(*[0.4] * 6)
    assert frames.pace.factor == pytest.approx(0.1)
    frames.pace.interrupt()
    assert frames.pace.factor == 0.0


def test_a_reset_within_a_frame_begins_a_whole_one(session):
    session._order(lambda: setattr(session._pace, "slices", 4))
    session._order(session._part)
    session.wait()
    assert session.snapshot.time == pytest.approx(0.25 / 30)
    session.reset()
    session.single_step()
    session.wait()
    assert session.snapshot.time == pytest.approx(1 / 30)


def test_who_takes_hold_again_lets_go_first(session):
    session.grab("me", MIDDLE)
    session.wait()
    first = session.stage.hands["me"]
    session.grab("me", MIDDLE)
    session.wait()
    assert not first.held
    assert session.stage.hands["me"].held


def test_factors_are_on_what_the_scene_has():
    plain, scaled = stage_of(SCENE), stage_of(SCENE, stiffness=3.0, damping=4.0, friction=2.0)
    before, after = plain.simulation.model, scaled.simulation.model
    for name, factor in (("spring_stiffness", 3.0), ("spring_damping", 12.0)):
        values = getattr(before, name).numpy()
        assert values.max() > 0.0
        assert getattr(after, name).numpy() == pytest.approx(factor * values)
    # of a pair the coefficient is the geometric mean, of which only the cloth's part is scaled
    assert before.particle_friction.numpy().min() > 0.0
    assert after.particle_friction.numpy() == pytest.approx(4.0 * before.particle_friction.numpy())


def test_settings_that_do_not_suit_the_scene_change_nothing(monkeypatch):
    stage = stage_of(SCENE)
    settings, simulation = stage.settings, stage.simulation

    def refuse(*_arguments, **_options):
        raise InputError("no.")

    monkeypatch.setattr("warpcloth.view.stage.make_simulation", refuse)
    with pytest.raises(InputError):
        stage.change(replace(settings, stiffness=2.0))
    assert stage.settings is settings
    assert stage.simulation is simulation


def test_a_gust_needs_no_wind_to_be_turned_off():
    stage = stage_of(SCENE + "[air]\nwind = [0.0, 3.0, 0.0]\ngust = 0.5\n")
    stage.change(replace(stage.settings, wind=(0.0, 0.0, 0.0)))
    stage.change(replace(stage.settings, stiffness=2.0))  # which builds it all anew
    assert stage.settings.wind == (0.0, 0.0, 0.0)


def test_pins_that_move_turn_about_the_same_middle_when_one_is_let_go():
    text = SCENE.replace('pins = [{ edge = "top" }]', f'[[cloth.pins]]\nedge = "top"\n{TURN}\n')
    all_held, without = stage_of(text), stage_of(text)
    *held, corner = np.flatnonzero(all_held.simulation.model.particle_inv_mass.numpy() == 0.0)
    start = all_held.simulation.state.particle_q.numpy()[held]
    assert not without.toggle_pin(corner)
    for stage in (all_held, without):
        for _ in range(15):
            stage.step()
    places = [stage.simulation.state.particle_q.numpy()[held] for stage in (all_held, without)]
    assert np.abs(places[0] - start).max() > 0.2
    assert places[1] == pytest.approx(places[0], abs=1e-6)
