"""Pictures and films as files, complete under their name or not there at all."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from ..errors import InputError, MissingExtraError

STILLS, FILMS = (".png", ".jpg", ".jpeg"), (".mp4", ".gif")
FASTEST_GIF = 25.0  # pictures per second where none are asked for


def check_output(path: Path, kinds: tuple[str, ...], what: str) -> None:
    """Refuses a file name that cannot be written.

    Raises:
        InputError: on another ending than those of ``kinds``, or a folder that does not exist.
    """
    if path.suffix.lower() not in kinds:
        raise InputError(f"Cannot write {what} {path.name}: its name must end in {', '.join(kinds)}.")
    if not path.absolute().parent.is_dir():
        raise InputError(f"Cannot write {path.name}: the folder {path.absolute().parent} does not exist.")


def write_still(path: Path, image: np.ndarray) -> None:
    """Writes a picture.

    Raises:
        InputError: the file cannot be written.
    """
    partial = path.with_name(f"{path.stem}.partial{path.suffix}")
    options: dict[str, Any] = (
        {} if path.suffix.lower() == ".png" else {"quality": 88, "subsampling": 0, "progressive": True}
    )
    try:
        Image.fromarray(image).save(partial, optimize=True, **options)
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(f"Cannot write {path.name}: {error.strerror or error}.") from error


def film_rate(path: Path, fps: float) -> float:
    """Pictures per second at which a file of this name can play, as near to ``fps`` as its format has them: a GIF shows
    each picture for whole hundredths of a second, and two at least."""
    return 100.0 / max(2, round(100.0 / fps)) if path.suffix.lower() == ".gif" else fps


def write_film(path: Path, images: Iterable[np.ndarray], fps: float) -> None:
    """Writes a film, ``.mp4`` (H.264) or ``.gif``; memory stays flat for the former.

    Args:
        fps: pictures per second, of :func:`film_rate`.

    Raises:
        InputError: the file cannot be written; MissingExtraError: imageio-ffmpeg is not installed.
    """
    partial = path.with_name(f"{path.stem}.partial{path.suffix}")
    try:
        (_write_gif if path.suffix.lower() == ".gif" else _write_mp4)(partial, images, fps)
        os.replace(partial, path)
    except OSError as error:
        raise InputError(f"Cannot write {path.name}: {error.strerror or error}.") from error
    finally:
        partial.unlink(missing_ok=True)


def _write_gif(path: Path, images: Iterable[np.ndarray], fps: float) -> None:
    frames = [Image.fromarray(image).quantize(256, dither=Image.Dither.FLOYDSTEINBERG) for image in images]
    duration = round(1000.0 / fps)  # [ms]; whole hundredths of a second, as of film_rate
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=duration, loop=0, optimize=False)


def _write_mp4(path: Path, images: Iterable[np.ndarray], fps: float) -> None:
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise MissingExtraError(
            'Films need imageio-ffmpeg, which is not installed; get it with: pip install "warpcloth[render]".'
        ) from error
    writer = None
    try:
        for image in images:
            if writer is None:
                size = (image.shape[1], image.shape[0])
                writer = imageio_ffmpeg.write_frames(
                    str(path), size, fps=fps, codec="libx264", quality=None, macro_block_size=2,
                    output_params=["-crf", "17", "-preset", "medium", "-movflags", "+faststart"],
                )  # fmt: skip
                writer.send(None)
            writer.send(np.ascontiguousarray(image))
    finally:
        if writer is not None:
            writer.close()
