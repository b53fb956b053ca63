"""What is written on pictures: a colour bar, and the time on a contact sheet."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from .coloring import Coloring, color_scale
from .shade import display

INK = (45, 43, 40)


def with_color_bar(image: np.ndarray, coloring: Coloring) -> np.ndarray:
    """A picture with a colour bar in its lower right corner, where colours show a measure."""
    measure = coloring.measured
    if measure is None:
        return image
    height, width = image.shape[:2]
    canvas = Image.fromarray(image)
    draw = ImageDraw.Draw(canvas)
    text_size = max(10, height // 40)
    font = ImageFont.load_default(text_size)
    long, tall = round(0.2 * width), max(6, height // 60)
    left, top = round(0.96 * width) - long, round(0.95 * height) - tall - text_size
    ramp = display(color_scale(np.linspace(0.0, 1.0, long)))[None].repeat(tall, axis=0)
    canvas.paste(Image.fromarray(np.round(255.0 * ramp).astype(np.uint8)), (left, top))
    for share in (0.0, 0.5, 1.0):
        value = f"{measure.factor * coloring.top * share:.2g}"
        draw.text((left + share * long, top + 1.3 * tall), value, INK, font, anchor="mt")
    draw.text((left, top - 0.4 * text_size), measure.title, INK, font, anchor="ls")
    return np.asarray(canvas)


def with_label(image: np.ndarray, text: str) -> np.ndarray:
    """A picture with a line of text in its lower left corner."""
    canvas = Image.fromarray(image)
    font = ImageFont.load_default(max(9, image.shape[0] // 18))
    ImageDraw.Draw(canvas).text((0.03 * image.shape[1], 0.96 * image.shape[0]), text, INK, font, anchor="ls")
    return np.asarray(canvas)
