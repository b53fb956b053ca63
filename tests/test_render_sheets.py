"""Sheets of frames: their size, and what is written on them."""

import numpy as np
from PIL import Image
from warpcloth.scenes import simulate

from warpcloth.render import pictures, render


def pixels(path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture)


def test_a_sheet_has_the_size_asked_for_and_its_colour_bar_below_all_frames(tmp_path, monkeypatch):
    (tmp_path / "napkin.toml").write_text('[[cloth]]\nshape = "grid"\nresolution = [4, 4]\n')
    cache = simulate(tmp_path / "napkin.toml", tmp_path / "napkin.usdc", frames=4, device="cpu").output
    seen = []
    shown = render(cache, tmp_path / "plain.png", size=(242, 162), sheet=5, on_picture=lambda *done: seen.append(done))
    assert pixels(shown.output).shape == (162, 242, 3)
    assert seen == [(k, 5) for k in range(1, 6)]
    monkeypatch.setattr(pictures, "with_color_bar", lambda image, coloring: image)
    bare = pixels(render(cache, tmp_path / "bare.png", size=(242, 162), sheet=5, color="strain").output)
    monkeypatch.undo()
    full = pixels(render(cache, tmp_path / "full.png", size=(242, 162), sheet=5, color="strain").output)
    bar = (full != bare).any(axis=2)
    assert bar.sum() > 200
    assert (bare[bar] == 255).all()  # there is nothing but paper under it
    assert not bar[:, [0, -1]].any()  # and it is all on it
