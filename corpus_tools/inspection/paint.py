"""Paint rectangles, curves and texts into a picture in memory."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray

Colour = tuple[int, int, int]
Anchor = Literal["left", "middle", "right"]

PAPER: Colour = (255, 255, 255)
SHADE: Colour = (243, 244, 247)
RULE: Colour = (222, 225, 230)
FAINT: Colour = (126, 132, 142)
INK: Colour = (34, 38, 46)
BLUE: Colour = (38, 110, 190)
RED: Colour = (200, 46, 42)
ORANGE: Colour = (214, 126, 20)
GREEN: Colour = (44, 140, 84)
CHOSEN: Colour = (216, 231, 249)


class Canvas:
    """A picture that is painted.

    Parameters
    ----------
    width
        Width, pixels.
    height
        Height, pixels.
    colour
        Its paper.
    """

    def __init__(self, width: int, height: int, colour: Colour = PAPER) -> None:
        self.pixels: NDArray[np.uint8] = np.empty((height, width, 3), dtype=np.uint8)
        self.pixels[:] = colour
        self.width, self.height = width, height

    def fill(
        self, x0: float, y0: float, x1: float, y1: float, colour: Colour, alpha: float = 1.0
    ) -> None:
        """Fill a rectangle.

        Parameters
        ----------
        x0, y0, x1, y1
            Left, top, right and bottom, pixels from the left and from the top.
        colour
            Red, green and blue.
        alpha
            Share that is covered, 0 to 1.
        """
        left, top, right, bottom = (max(round(each), 0) for each in (x0, y0, x1, y1))
        part = self.pixels[top:bottom, left:right]
        if alpha >= 1:
            part[:] = colour
        elif part.size:
            part[:] = np.rint(part + alpha * (np.array(colour) - part.astype(np.float32)))

    def draw_band(
        self,
        left: int,
        low: FloatArray,
        high: FloatArray,
        colour: Colour,
        rows: tuple[int, int],
        alpha: float = 1.0,
        width: float = 1.3,
    ) -> None:
        """Draw a vertical stroke in each column, with smooth ends.

        Parameters
        ----------
        left
            First column.
        low, high
            Upper and lower end of each stroke, ``(columns,)``, pixels from the top; NaN for none.
        colour
            Red, green and blue.
        rows
            First row, and the row after the last, that may be painted.
        alpha
            Share that is covered, 0 to 1.
        width
            Length of a stroke whose ends are the same, pixels.
        """
        first, last = rows
        part = self.pixels[first:last, left : left + len(low)]
        at = np.arange(first, last, dtype=np.float32)[:, None]
        half = 0.5 * width
        upper = np.minimum(low, high).astype(np.float32) - half
        lower = np.maximum(low, high).astype(np.float32) + half
        with np.errstate(invalid="ignore"):
            cover = np.clip(np.minimum(at + 1, lower) - np.maximum(at, upper), 0.0, 1.0)
        cover = np.where(np.isnan(cover), 0.0, alpha * cover)[: part.shape[0], : part.shape[1]]
        part[:] = np.rint(part + cover[:, :, None] * (np.array(colour, np.float32) - part))

    def write(
        self,
        x: float,
        y: float,
        text: str,
        colour: Colour = INK,
        size: int = 12,
        anchor: Anchor = "left",
        bold: bool = False,
    ) -> int:
        """Write a text.

        Parameters
        ----------
        x
            Its left end, middle or right end, pixels from the left.
        y
            The middle of its height, pixels from the top.
        text
            The text.
        colour
            Red, green and blue.
        size
            Height of the letters, pixels.
        anchor
            What `x` is.
        bold
            Whether it is bold.

        Returns
        -------
        int
            Its width, pixels.
        """
        cover = draw_text(text, size, bold)
        height, width = cover.shape
        x -= {"left": 0, "middle": width / 2, "right": width}[anchor]
        left, top = round(x), round(y - height / 2)
        x0, y0 = max(left, 0), max(top, 0)
        part = self.pixels[y0 : max(top + height, 0), x0 : max(left + width, 0)]
        shown = cover[y0 - top :, x0 - left :][: part.shape[0], : part.shape[1], None]
        part[:] = np.rint(part + shown * (np.array(colour, np.float32) - part))
        return int(width)


@lru_cache(maxsize=64)
def _load_font(size: int, bold: bool) -> Any:
    from matplotlib import get_data_path
    from PIL import ImageFont

    # It has the letters of the IPA.
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(f"{get_data_path()}/fonts/ttf/{name}", size)


@lru_cache(maxsize=8192)
def draw_text(text: str, size: int = 12, bold: bool = False) -> NDArray[np.float32]:
    """Draw a text, and remember it.

    Parameters
    ----------
    text
        The text, on one line.
    size
        Height of the letters, pixels.
    bold
        Whether it is bold.

    Returns
    -------
    ndarray
        How much of each pixel it covers, ``(height, width)``, 0 to 1.
    """
    from PIL import Image, ImageDraw

    font = _load_font(size, bold)
    width = max(int(np.ceil(font.getlength(text))), 1)
    ascent, descent = font.getmetrics()
    image = Image.new("L", (width + 1, ascent + descent), 0)
    ImageDraw.Draw(image).text((0, 0), text, font=font, fill=255)
    return np.asarray(image, dtype=np.float32) / 255.0


def fit_text(text: str, width: float, size: int = 12, bold: bool = False) -> str:
    """Fit a text into a width by leaving out its end.

    Parameters
    ----------
    text
        The text.
    width
        The width, pixels.
    size
        Height of the letters, pixels.
    bold
        Whether it is bold.

    Returns
    -------
    str
        The text, or its beginning and an ellipsis.
    """
    font = _load_font(size, bold)
    if font.getlength(text) <= width:
        return text
    low, high = 0, len(text)
    while low < high:
        middle = (low + high + 1) // 2
        if font.getlength(text[:middle].rstrip() + "…") <= width:
            low = middle
        else:
            high = middle - 1
    return text[:low].rstrip() + "…"
