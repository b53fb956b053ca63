"""What the pages show, without a browser: the session behind them, the timeline, the command."""

import json
import socket
import time

import numpy as np
import pytest
from usd_shots import write_shot
from view_browser import SCENE, until
from warpcloth.scenes import check_cache, scene_from_toml

from warpcloth.cli import run
from warpcloth.cli.view import check_host
from warpcloth.errors import InputError
from warpcloth.view.player import Player
from warpcloth.view.server import free_port
from warpcloth.view.session import Session

MIDDLE = ((0.0, -3.0, 0.8), (0.0, 1.0, 0.0))  # a ray to the middle of the cloth


@pytest.fixture
def session():
    session = Session(scene_from_toml(SCENE, name="curtain"))
    yield session
    session.close()


def points(session):
    return session.snapshot.points["curtain"]


def test_play_pause_step_reset(session):
    start = points(session).copy()
    session.single_step()
    session.wait()
    assert (session.snapshot.status, session.snapshot.time) == ("paused", pytest.approx(1 / 30))
    session.play()
    until(lambda: session.snapshot.time > 0.2)
    session.pause()
    until(lambda: session.snapshot.status == "paused")
    stopped = session.snapshot.time
    time.sleep(0.2)
    assert session.snapshot.time == stopped
    assert np.abs(points(session) - start).max() > 1e-4
    session.reset()
    session.wait()
    assert session.snapshot.time == 0.0
    assert np.array_equal(points(session), start)


def test_a_hand_leads_the_cloth_and_lets_go(session):
    session.grab("me", MIDDLE)
    session.move("me", (0.0, -0.4, 0.9))
    for _ in range(30):
        session.single_step()
    session.wait()
    assert np.linalg.norm(session.stage.hands["me"].point - (0.0, -0.4, 0.9)) < 0.1
    assert points(session)[:, 1].min() < -0.3
    session.release("me")
    session.release("nobody")
    for _ in range(60):
        session.single_step()
    session.wait()
    assert session.stage.hands == {}
    assert points(session)[:, 1].min() > -0.3


def test_changes_go_on_from_where_the_cloth_is(session):
    session.grab("me", MIDDLE)
    session.move("me", (0.0, -0.3, 0.8))
    for _ in range(10):
        session.single_step()
    session.wait()
    before = points(session).copy()
    session.change(integrator="implicit_euler", gravity=(0.0, 0.0, -2.0), stiffness=3.0, friction=2.0, fabric="denim")
    session.wait()
    assert session.snapshot.error == ""
    assert np.array_equal(points(session), before)
    simulation = session.stage.simulation
    assert simulation.integrator.name == "implicit_euler"
    assert simulation.forces.world_gravity.numpy()[0] == pytest.approx((0.0, 0.0, -2.0))
    assert session.stage.hands["me"].held
    session.change(integrator="magic")
    session.wait()
    assert "ntegrator must be one of" in session.snapshot.error
    assert session.snapshot.settings.integrator == "implicit_euler"


def test_pins_come_and_go(session):
    assert len(session.snapshot.pinned) == 11
    session.toggle_pin(MIDDLE)
    session.wait()
    assert len(session.snapshot.pinned) == 12
    where = session.snapshot.pinned[np.abs(session.snapshot.pinned[:, 2] - 0.8).argmin()]
    for _ in range(5):
        session.single_step()
    session.wait()
    assert np.abs(session.snapshot.pinned - where).sum(axis=1).min() == 0.0
    session.toggle_pin(MIDDLE)
    session.wait()
    assert len(session.snapshot.pinned) == 11


def test_an_obstacle_is_led_into_the_cloth_and_pushes_it(session):
    session.lead("ball", (-0.55, 0.0, 0.2), (0.0, 0.0, 0.5))
    for _ in range(30):
        session.single_step()
    session.wait()
    center, turn = session.snapshot.obstacles["ball"]
    assert center == pytest.approx((0.2, 0.0, 0.7))
    assert turn == pytest.approx((0.0, 0.0, 0.5))
    away = np.linalg.norm(points(session) - center, axis=1)
    assert away.min() > 0.149
    assert np.abs(points(session)[:, 1]).max() > 0.05


@pytest.mark.filterwarnings("ignore::warpcloth.errors.StabilityWarning")
def test_divergence_is_told_and_reset_mends_it(session):
    session.change(integrator="forward_euler", substeps=1, stiffness=1000.0)
    session.play()
    until(lambda: session.snapshot.status == "failed")
    assert "diverged" in session.snapshot.error
    session.play()
    session.wait()
    assert session.snapshot.status == "failed"
    session.reset()
    session.wait()
    session.play()
    until(lambda: session.snapshot.time > 0.1)
    assert session.snapshot.error == ""


def test_a_recording_passes_the_check(session, tmp_path):
    session.grab("me", MIDDLE)
    session.record(tmp_path / "shot.usdc")
    session.lead("ball", (0.0, 0.2, 0.0))
    for k in range(12):
        session.move("me", (0.0, -0.01 * k, 0.8))
        session.single_step()
    session.stop_recording()
    session.wait()
    report = check_cache(tmp_path / "shot.usdc")
    assert report.ok, str(report)
    assert report.frames == 13


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["hanging", "--host", "0.0.0.0"], "0.0.0.0 can be reached from other machines; add --public"),
        (["hangin"], "there is no scene 'hangin'"),
        (["none.usdc"], "Cannot read none.usdc: there is no such file."),
        (["hanging", "--port", "99999"], "Port must be a whole number from 1 to 65,535, got 99999."),
        (["hanging", "--port", "-1"], "Port must be a whole number from 1 to 65,535, got -1."),
        (["hanging", "--host", "a..b", "--public"], "A page cannot be at the address 'a..b':"),
        (["hanging", "--host", "192.0.2.1", "--public"], "A page cannot be at the address '192.0.2.1':"),
    ],
)
def test_mistakes(options, sentence, capfd):
    assert run(["view", *options]) == 2
    assert sentence in capfd.readouterr().err


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "the file is empty"),
        ("PXR-USDC and then nothing", "Cannot read"),
        ('#usda 1.0\ndef Mesh "m" {}\n', "cloth"),  # nothing moves in it: a scene, but without cloth
    ],
)
def test_files_that_are_no_caches(text, sentence, tmp_path, capfd):
    path = tmp_path / ("stage.usda" if text.startswith("#") else "stage.usdc")
    path.write_text(text)
    assert run(["view", str(path)]) == 2
    told = capfd.readouterr().err
    assert sentence in told
    assert "Traceback" not in told


def test_options_of_simulations_are_refused_with_a_cache(tmp_path, capfd):
    cache = write_shot(tmp_path / "shot.usdc")
    assert run(["view", str(cache), "--fps", "30"]) == 2
    assert "--set and --fps change how a scene is simulated; shot.usdc is a cache." in capfd.readouterr().err


def test_another_address_needs_a_flag_and_prints_a_warning(capfd):
    check_host("127.0.0.1", public=False)
    check_host("localhost", public=False)
    assert capfd.readouterr().err == ""
    check_host("0.0.0.0", public=True)
    assert "whoever reaches 0.0.0.0 sees this page, can stop the simulation" in capfd.readouterr().err


def test_a_page_takes_the_next_port_that_is_free():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert port < free_port("127.0.0.1", port) < port + 1000


def test_addresses_that_a_machine_has_not_are_left_out(monkeypatch):
    """As of ``localhost`` where there is no IPv6; servers do the same."""
    kind = (socket.AF_INET, socket.SOCK_STREAM, 6, "")
    foreign, own = "192.0.2.1", "127.0.0.1"  # the first is of nobody (RFC 5737)

    def addresses(*hosts):
        monkeypatch.setattr(socket, "getaddrinfo", lambda host, port, **_: [(*kind, (each, port)) for each in hosts])

    with socket.socket() as taken:
        taken.bind((own, 0))
        taken.listen()
        port = taken.getsockname()[1]
        addresses(foreign, own)
        assert port < free_port("localhost", port) < port + 1000
        addresses(foreign)
        with pytest.raises(InputError, match="A page cannot be at the address 'localhost'"):
            free_port("localhost", port)


def test_a_timeline():
    player = Player([2.0, 2.1, 2.2, 2.3])
    player.advance(0.15)
    assert player.frame == 0
    player.toggle()
    player.advance(0.15)
    assert player.frame == 1
    player.speed = 0.5
    player.advance(0.11)
    assert player.frame == 2
    player.advance(0.4)  # 0.405 s of a loop of 0.4 s
    assert (player.frame, player.playing) == (0, True)
    player.loop = False
    player.advance(2.0)
    assert (player.frame, player.playing) == (3, False)
    player.toggle()
    assert (player.frame, player.playing) == (0, True)
    player.seek(99)
    assert (player.frame, player.playing) == (3, False)
    player.skip(-1)
    assert player.frame == 2
    player.loop = True
    player.skip(2)
    assert player.frame == 0
    still = Player([0.0])
    still.toggle()
    still.advance(3.3)
    assert (still.frame, still.last) == (0, 0)


def test_frames_that_take_long_are_shown_in_parts(session, tmp_path):
    step, numbers = session.stage.step, []

    def slow(slices=1):
        step(slices)
        time.sleep(0.1 / slices)
        numbers.append((slices, session.stage.simulation.substeps))

    session.stage.step = slow
    for _ in range(12):
        session.single_step()
    session.wait()
    assert numbers[0] == (1, 20)
    assert numbers[-1] == (4, 5)  # 25 ms each, of 50 that they may take
    assert session.snapshot.time == pytest.approx(12 / 30)
    assert (session.snapshot.slices, session.snapshot.substeps) == (4, 20)
    session._order(session._part)
    session.wait()
    assert session.snapshot.time == pytest.approx(12.25 / 30)
    session.record(tmp_path / "whole.usdc")  # which begins when the frame in hand is whole
    session.wait()
    assert session.snapshot.time == pytest.approx(13 / 30)


def test_gravity_and_wind_change_at_once_and_a_flood_of_changes_is_one(session):
    simulation = session.stage.simulation
    for k in range(50):
        session.change(gravity=(0.0, 0.0, -0.1 * k))
        session.change(wind=(0.1 * k, 0.0, 0.0))
    session.wait()
    assert session.stage.simulation is simulation
    assert session.stage.settings.gravity == pytest.approx((0.0, 0.0, -4.9))
    assert simulation.forces.world_gravity.numpy()[0] == pytest.approx((0.0, 0.0, -4.9))
    start = points(session).copy()
    session.change(gravity=(0.0, 0.0, 0.0), wind=(0.0, 6.0, 0.0))
    for _ in range(10):
        session.single_step()
    session.wait()
    assert (points(session) - start)[:, 1].mean() > 0.02  # blown away, and not falling
    for k in range(20):
        session.change(stiffness=1.0 + k)
    session.wait()
    assert session.stage.settings.stiffness == 20.0
    assert session.stage.simulation is not simulation


def test_the_benchmark_counts_what_a_client_gets(tmp_path, capfd):
    assert run(["bench", "view", "--resolution", "9", "--budget", "1", "-o", str(tmp_path), "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["particles"] == 81
    assert found["updates_per_second"] > 5
    assert found["bytes_per_update"] > 81 * 12
    assert found["gap_ms"]["median"] < 200
    assert 0 < found["latency_s"]["gravity"]["median"] < 5
    assert json.loads((tmp_path / "results.json").read_text())["substeps"] == found["substeps"]
    assert run(["bench", "view", "--count", "3"]) == 2
    assert "--count is an option of `bench contact`, not of `bench view`" in capfd.readouterr().err


def test_obstacles_turn_about_their_pivots():
    scene = scene_from_toml(
        SCENE
        + """
[[obstacle]]
name = "door"
shape = "box"
center = [3.0, 0.0, 0.5]
size = [0.8, 0.1, 0.8]
motion.pivot = [2.6, 0.0, 0.5]
motion.keys = [{ time = 0.0 }, { time = 0.5, rotation = [0.0, 0.0, 90.0] }]
"""
    )
    session = Session(scene)
    for _ in range(15):
        session.single_step()
    session.wait()
    center, turn = session.snapshot.obstacles["door"]
    assert center == pytest.approx((2.6, 0.4, 0.5))
    assert turn == pytest.approx((0.0, 0.0, 0.5 * np.pi))
    session.close()
