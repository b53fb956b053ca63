"""The session without a page, and the page in a real browser."""

import shutil
import time
import urllib.request

import numpy as np
import pytest
from warpcloth.scenes import check_cache, scene_from_toml

from warpcloth.cli import run
from warpcloth.view.session import Session

SCENE = """
[simulation]
integrator = "xpbd"
substeps = 20
[[cloth]]
name = "curtain"
shape = "grid"
size = [0.8, 0.8]
resolution = [11, 11]
position = [0.0, 0.0, 0.8]
rotation = [90.0, 0.0, 0.0]
pins = [{ edge = "top" }]
[[obstacle]]
name = "ball"
shape = "sphere"
center = [0.75, 0.0, 0.5]
radius = 0.15
[[obstacle]]
name = "ground"
shape = "plane"
"""
MIDDLE = ((0.0, -3.0, 0.8), (0.0, 1.0, 0.0))  # a ray to the middle of the cloth
BROWSER = shutil.which("chromium") or shutil.which("google-chrome")


def until(condition, seconds=60.0):
    """Waits for a condition; says which one never came true."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


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
    session.wait()
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
    ],
)
def test_mistakes(options, sentence, capfd):
    assert run(["view", *options]) == 2
    assert sentence in capfd.readouterr().err


class Browser:
    """A page in Chromium, and where things are on it."""

    def __init__(self, chromium, page):
        self.server, self.page = page.server, chromium.new_page(viewport={"width": 700, "height": 440})
        known = set(self.server.get_clients())
        self.page.goto(page.url)
        self.page.wait_for_selector("canvas", timeout=90_000)
        until(lambda: set(self.server.get_clients()) - known)
        self.who = (set(self.server.get_clients()) - known).pop()
        self.camera = self.server.get_clients()[self.who].camera
        until(lambda: abs(self.camera.look_at[2]) > 0.3)  # it has taken the place it was given
        self.box = self.page.locator("canvas").first.bounding_box(timeout=90_000)

    def pixel(self, place):
        """Where a point in the world [m] is on the page."""
        box, eye = self.box, np.asarray(self.camera.position)
        ahead = np.asarray(self.camera.look_at) - eye
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        way = np.asarray(place) - eye
        scale = 0.5 * box["height"] / np.tan(0.5 * self.camera.fov) / (way @ ahead)
        x, y = way @ right * scale, way @ np.cross(right, ahead) * scale
        return box["x"] + 0.5 * box["width"] + x, box["y"] + 0.5 * box["height"] - y

    def press(self, place):
        """Mouse down at a point in the world, and moved a little, which makes it a drag."""
        x, y = self.pixel(place)
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        for k in range(1, 5):
            self.page.mouse.move(x + 3 * k, y)
            time.sleep(0.05)

    def drag(self, place):
        """To another point, with the mouse down."""
        self.page.mouse.move(*self.pixel(place), steps=8)

    def button(self, name):
        self.page.get_by_role("button", name=name, exact=True).click()


@pytest.fixture(scope="module")
def chromium():
    """Debian's Chromium; the session runs in this process, so that tests see into it."""
    if BROWSER is None:
        pytest.skip("there is no chromium on this machine; `apt-get install chromium` brings it")
    sync = pytest.importorskip("playwright.sync_api", reason="the extra `test` brings playwright")
    options = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
    with sync.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=options)
        yield browser
        browser.close()


@pytest.fixture
def page(session, tmp_path):
    from warpcloth.view.page import Page

    page = Page(session, port=8931, folder=tmp_path)
    yield page
    page.close()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_page_in_a_browser(chromium, session, page, tmp_path):
    browser = Browser(chromium, page)
    session.play()
    until(lambda: session.snapshot.time > 0.2 and page.updates > 5)
    middle = points(session)[60].astype(float)
    browser.press(middle)
    until(lambda: browser.who in session.stage.hands)
    browser.drag(np.add(middle, (-0.2, -0.1, 0.1)))
    grab = session.stage.hands[browser.who]
    until(lambda: np.linalg.norm(grab.target - middle) > 0.1 and np.linalg.norm(grab.point - grab.target) < 0.1)
    assert np.abs(points(session)[60] - middle).max() > 0.05
    session.pause()
    browser.page.screenshot(path=tmp_path / "grabbed.png", timeout=120_000)
    browser.page.mouse.up()
    until(lambda: not session.stage.hands)

    browser.page.locator("input[value='xpbd']").first.click()
    browser.page.get_by_role("option", name="implicit_euler", exact=True).click()
    until(lambda: session.snapshot.settings.integrator == "implicit_euler")

    browser.page.get_by_role("checkbox").first.click(force=True)
    session.pause()
    session.wait()
    time.sleep(2.0)
    browser.page.screenshot(path=tmp_path / "gizmo.png", timeout=120_000)
    browser.press((0.92, 0.0, 0.5))
    browser.drag((1.2, 0.0, 0.5))
    until(lambda: np.abs(session.stage.led["ball"].hand[:3]).max() > 0.05)
    browser.page.mouse.up()
    before = session.snapshot.obstacles["ball"][0].copy()
    browser.button("Next frame")
    until(lambda: np.abs(session.snapshot.obstacles["ball"][0] - before).max() > 0.01)

    session.change(integrator="forward_euler", substeps=1, stiffness=1000.0)
    session.play()
    browser.page.get_by_text("diverged").wait_for(timeout=90_000)
    browser.page.screenshot(path=tmp_path / "diverged.png", timeout=120_000)
    browser.button("Reset")
    until(lambda: session.snapshot.status == "paused" and session.snapshot.time == 0.0)

    session.change(gravity=(4.0, 4.0, -8.0))  # so that it swings
    browser.button("Record")
    until(lambda: session.snapshot.recording)
    session.play()
    until(lambda: session.snapshot.time > 0.3)
    browser.page.get_by_role("button", name="Stop recording").click()
    until(lambda: not session.snapshot.recording)
    assert check_cache(tmp_path / "curtain_1.usdc").ok
    browser.page.close()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_two_browsers_one_that_reloads_and_one_that_vanishes(chromium, session, page):
    one, other = Browser(chromium, page), Browser(chromium, page)
    session.play()
    until(lambda: session.snapshot.time > 0.1)
    other.press(points(session)[60])
    until(lambda: other.who in session.stage.hands)
    one.page.reload()
    one.page.wait_for_selector("canvas", timeout=90_000)
    other.page.close()  # with the mouse down
    until(lambda: not session.stage.hands)
    now = session.snapshot.time
    until(lambda: session.snapshot.time > now + 0.2)
    assert session.snapshot.error == ""
    one.page.close()


def test_the_page_listens_on_loopback_only(page):
    assert page.url.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(page.url, timeout=10) as answer:
        assert answer.status == 200
