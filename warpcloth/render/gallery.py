"""Pictures of the bundled scenes: ``python -m warpcloth.render.gallery scenes/pictures`` makes them all.

Names of scenes after the folder make only those. Each scene is simulated first; its picture is a JPEG.
"""

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..scenes import bundled_scenes, load_scene, simulate
from .pictures import render

SIZE = (960, 600)


@dataclass(frozen=True)
class View:
    """What suits a scene: the share of its frames after which it looks best, and the camera."""

    when: float = 1.0
    camera: str = "auto"


VIEWS = {
    "drape_bunny": View(1.0, "160,16"),
    "flag": View(0.75),
    "fold_over_table": View(1.0, "1.17,-1.46,1.78,-0.05,0.0,0.64"),
    "four_fabrics": View(1.0, "-90,30"),
    "funnel": View(0.09, "-58,40"),
    "hanging": View(1.0, "-68,14"),
    "pendulum": View(0.6, "-75,14"),
    "pile": View(1.0, "-58,34"),
    "sphere_through_curtain": View(0.625, "50,14"),
    "twist": View(0.5),
}


def make_pictures(folder: Path, names: Sequence[str]) -> None:
    """Simulates scenes and writes ``NAME.jpg`` of each."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        for name in names:
            view, scene = VIEWS.get(name, View()), load_scene(name)
            frames = max(1, round(view.when * scene.frames))
            cache = simulate(scene, Path(work) / f"{name}.usdc", frames=frames).output
            picture = render(cache, folder / f"{name}.jpg", size=SIZE, camera=view.camera)
            print(f"{picture.output}: frame {frames}, {picture.seconds:.0f} s", flush=True)


if __name__ == "__main__":
    make_pictures(Path(sys.argv[1]), sys.argv[2:] or bundled_scenes())
