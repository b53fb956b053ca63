"""The pages in a real browser; the server runs in this process, so that tests see into it."""

import threading
import time
import urllib.request

import numpy as np
import pytest
from PIL import Image
from view_browser import SCENE, Browser, chromium, until
from warpcloth.scenes import check_cache, scene_from_toml, simulate
from warpcloth.scenes.usd.playback import Playback

from warpcloth.view.page import Page
from warpcloth.view.playback_page import PlaybackPage
from warpcloth.view.session import Session

__all__ = ["chromium"]


@pytest.fixture
def session():
    session = Session(scene_from_toml(SCENE, name="curtain"))
    yield session
    session.close()


def points(session):
    return session.snapshot.points["curtain"]


@pytest.fixture
def page(session, tmp_path):
    page = Page(session, port=8931, folder=tmp_path)
    yield page
    page.close()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_page_in_a_browser(chromium, session, page, tmp_path):
    browser = Browser(chromium, page)
    session.play()
    until(lambda: session.snapshot.time > 0.2 and page.updates > 5)
    session.pause()  # a page that is drawn slowly shows moving cloth where it was
    browser.take(lambda: points(session)[60], lambda: browser.who in session.stage.hands)
    session.play()
    middle = points(session)[60].astype(float)
    browser.drag(np.add(middle, (-0.2, -0.1, 0.1)))
    grab = session.stage.hands[browser.who]
    until(lambda: np.linalg.norm(grab.target - middle) > 0.1 and np.linalg.norm(grab.point - grab.target) < 0.1)
    assert np.abs(points(session)[60] - middle).max() > 0.05
    session.pause()
    browser.page.screenshot(path=tmp_path / "grabbed.png", timeout=120_000)
    browser.page.mouse.up()
    until(lambda: not session.stage.hands)

    browser.choose(
        "input[value='xpbd']", "implicit_euler", lambda: session.snapshot.settings.integrator == "implicit_euler"
    )

    browser.page.get_by_role("checkbox").first.click(force=True)
    session.pause()
    session.wait()
    time.sleep(2.0)
    browser.page.screenshot(path=tmp_path / "gizmo.png", timeout=120_000)
    led = session.stage.led["ball"]
    browser.take(lambda: (0.92, 0.0, 0.5), lambda: np.abs(led.hand[:3]).max() > 0.0)
    browser.drag((1.2, 0.0, 0.5))
    until(lambda: np.abs(led.hand[:3]).max() > 0.05)
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
    session.pause()
    other.take(lambda: points(session)[60], lambda: other.who in session.stage.hands)
    session.play()
    one.page.reload()
    one.page.wait_for_selector("canvas", timeout=90_000)
    other.page.close()  # with the mouse down
    until(lambda: not session.stage.hands)
    now = session.snapshot.time
    until(lambda: session.snapshot.time > now + 0.2)
    assert session.snapshot.error == ""
    one.page.close()


def test_controls_follow_the_settings_but_not_while_a_change_waits(session, page):
    session.wait()
    held, wind = threading.Event(), page._panel._controls["wind"]
    session._order(held.wait)  # the session is busy
    before = session.snapshot
    wind.value = (0.0, 0.0, 6.0)
    session.change(wind=wind.value)
    page._panel._follow(before)
    assert wind.value == (0.0, 0.0, 6.0)
    held.set()
    session.wait()
    page._panel._follow(session.snapshot)
    assert wind.value == session.stage.settings.wind == (0.0, 0.0, 6.0)
    session.change(wind=(np.nan, 0.0, 0.0))  # refused
    wind.value = (1.0, 0.0, 0.0)
    session.wait()
    until(lambda: wind.value == (0.0, 0.0, 6.0))


def test_the_page_listens_on_loopback_only(page):
    assert page.url.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(page.url, timeout=10) as answer:
        assert answer.status == 200


def picture_of(browser, tmp_path, act):
    """The PNG that the browser is given when ``act`` is done, as an array [height, width, 3]."""
    with browser.page.expect_download(timeout=60_000) as download:
        act()
    path = tmp_path / download.value.suggested_filename
    download.value.save_as(path)
    with Image.open(path) as image:
        return path.name, np.asarray(image.convert("RGB")).astype(int)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_keys_buttons_wind_and_pins(chromium, session, page, tmp_path):
    browser = Browser(chromium, page)
    keyboard = browser.page.keyboard
    keyboard.press("p")
    until(lambda: session.snapshot.status == "playing")
    keyboard.press("p")
    until(lambda: session.snapshot.status == "paused")
    for act in (lambda: keyboard.press("n"), lambda: browser.button("Next frame")):
        before = session.snapshot.time
        act()
        until(lambda: session.snapshot.time == pytest.approx(before + 1 / 30))  # noqa: B023
    browser.button("Play")
    until(lambda: session.snapshot.status == "playing" and session.snapshot.time > 0.2)
    browser.button("Pause")
    until(lambda: session.snapshot.status == "paused")
    keyboard.press("v")
    until(lambda: session.snapshot.recording == "curtain_1.usdc")
    keyboard.press("v")
    until(lambda: not session.snapshot.recording)
    keyboard.press("r")
    until(lambda: session.snapshot.time == 0.0)

    low = points(session)[np.linalg.norm(points(session) - (0.24, 0.0, 0.56), axis=1).argmin()]
    browser.page.mouse.move(*browser.pixel(low))
    for pins in (12, 11):
        keyboard.down("Shift")
        browser.page.mouse.click(*browser.pixel(low))
        keyboard.up("Shift")
        until(lambda: len(session.snapshot.pinned) == pins)  # noqa: B023

    wind = browser.page.locator("input[value='0']").nth(3)  # after two of gravity and the first of wind
    wind.fill("6")
    wind.press("Enter")
    until(lambda: any(session.stage.settings.wind))
    assert sorted(session.stage.settings.wind) == [0.0, 0.0, 6.0]

    name, image = picture_of(browser, tmp_path, lambda: browser.button("Picture"))
    assert name == "curtain.png"
    assert image.shape == (800, 1280, 3)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 100  # shaded cloth and ball, not an empty page
    browser.page.close()


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A short shot of the curtain, which a wind takes away from its start."""
    path = tmp_path_factory.mktemp("view") / "shot.usdc"
    scene = scene_from_toml("frames = 12\n[air]\nwind = [2.0, 8.0, 0.0]\n" + SCENE)
    simulate(scene, path, device="cpu")
    return path


def shown(page):
    """Which frame the vertices on the page are of."""
    cloth = page.playback.cloths[0]
    ways = [
        np.abs(page._cloths[0].mesh.vertices - page.playback.points(cloth, k)).max()
        for k in range(page.playback.frames)
    ]
    assert min(ways) < 1e-6
    return int(np.argmin(ways))


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_cache_in_a_browser(chromium, cache, tmp_path):
    page = PlaybackPage(Playback(cache), port=8932)
    browser = Browser(chromium, page)
    player, keyboard = page.player, browser.page.keyboard
    assert not player.playing
    _, first = picture_of(browser, tmp_path, lambda: keyboard.press("t"))
    browser.button("Play")
    frames = set()
    until(lambda: frames.add(page.shown) or len(frames) > 4)
    browser.button("Pause")
    until(lambda: not player.playing)

    thumb = browser.page.get_by_role("slider").first
    thumb.press("End")
    until(lambda: page.shown == 12)
    assert shown(page) == 12
    name, last = picture_of(browser, tmp_path, lambda: browser.button("Picture"))
    assert name == "shot_12.png"
    assert np.mean(np.abs(first - last).max(axis=2) > 20) > 0.002  # the cloth is elsewhere in the picture, too
    for key, frame in (("b", 11), ("b", 10), ("n", 11)):
        keyboard.press(key)
        until(lambda: page.shown == frame)  # noqa: B023

    browser.choose("input[value='1']:visible", "4", lambda: player.speed == 4.0)
    browser.page.get_by_role("checkbox").first.click(force=True)
    until(lambda: not player.loop)
    browser.button("Play")
    until(lambda: page.shown == 12 and not player.playing)

    browser.choose("input[value='fabric']", "speed", lambda: page._cloths[0].dots.visible)
    browser.page.get_by_text("speed [m/s]").wait_for(timeout=30_000)
    assert len(np.unique(page._cloths[0].dots.colors, axis=0)) > 20
    browser.page.screenshot(path=tmp_path / "speed.png", timeout=120_000)
    browser.page.close()
    page.close()
