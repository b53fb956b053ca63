"""A curtain to look at, and a browser to look with."""

import shutil
import time

import numpy as np
import pytest

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
BROWSER = shutil.which("chromium") or shutil.which("google-chrome")


def until(condition, seconds=30.0):
    """Waits for a condition; says which one never came true."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


class Browser:
    """A page in Chromium, and where things are on it."""

    def __init__(self, chromium, page):
        self.server, self.page = page.server, chromium.new_page(viewport={"width": 900, "height": 440})
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

    def take(self, place, taken):
        """Presses at ``place()`` until ``taken()``: a page that is still being drawn does not feel the first one."""
        for _ in range(8):
            self.press(place())
            try:
                return until(taken, 5.0)
            except AssertionError:
                self.page.mouse.up()
        raise AssertionError("nothing was taken")

    def choose(self, field, name, chosen):
        """An entry of a list, until ``chosen()``: a list may close again while the page is still being drawn."""
        from playwright.sync_api import TimeoutError

        for _ in range(8):
            self.page.locator(field).first.click()
            try:
                self.page.get_by_role("option", name=name, exact=True).click(timeout=5_000)
                return until(chosen)
            except TimeoutError:
                continue
        raise AssertionError(f"{name} was never offered")

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
