"""What is written on pictures: a colour bar, and the time on a contact sheet."""

import math

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from .coloring import Coloring, color_scale
from .shade import display

INK = (45, 43, 40)
SHARES = (0.0, 0.5, 1.0)  # of the colour bar, at which it says the value


def with_color_bar(image: np.ndarray, coloring: Coloring) -> np.ndarray:
    """A picture with a colour bar in its lower right corner, where colours show a measure."""
    measure = coloring.measured
    if measure is None:
        return image
    height, width = image.shape[:2]
    canvas = Image.fromarray(image)
    draw = ImageDraw.Draw(canvas)
    text_size, tall = _sizes(height)
    font = ImageFont.load_default(text_size)
    long = max(round(0.2 * width), math.ceil(font.getlength(measure.title)))
    values = [f"{measure.factor * coloring.top * share:.2g}" for share in SHARES]
    beyond = math.ceil(0.5 * font.getlength(values[-1])) + 2  # of the last one, over the bar's end
    left, top = min(round(0.96 * width), width - beyond) - long, round(0.95 * height) - tall - text_size
    ramp = display(color_scale(np.linspace(0.0, 1.0, long)))[None].repeat(tall, axis=0)
    canvas.paste(Image.fromarray(np.round(255.0 * ramp).astype(np.uint8)), (left, top))
    for share, value in zip(SHARES, values, strict=True):
        draw.text((left + share * long, top + 1.3 * tall), value, INK, font, anchor="mt")
    draw.text((left, top - 0.4 * text_size), measure.title, INK, font, anchor="ls")
    return np.asarray(canvas)


def color_bar_height(height: int, coloring: Coloring) -> int:
    """Pixels that a colour bar takes at the foot of a picture of that height, with what is written above and below."""
    text_size, tall = _sizes(height)
    return 0 if coloring.measured is None else height - round(0.95 * height) + tall + math.ceil(2.6 * text_size)


def _sizes(height: int) -> tuple[int, int]:
    """Of the text, and the bar's own height [pixels]."""
    return max(10, height // 40), max(6, height // 60)


def with_label(image: np.ndarray, text: str) -> np.ndarray:
    """A picture with a line of text in its lower left corner."""
    canvas = Image.fromarray(image)
    font = ImageFont.load_default(max(9, image.shape[0] // 18))
    ImageDraw.Draw(canvas).text((0.03 * image.shape[1], 0.96 * image.shape[0]), text, INK, font, anchor="ls")
    return np.asarray(canvas)
