"""Pictures in memory and on disk, sheets of them, and text on them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import DataError, FileFormatError

Image = NDArray[np.uint8]

_PAPER = 255
_LABEL_HEIGHT = 26
_LABEL_POINTS = 9.0
_DOTS_PER_INCH = 100


def make_sheet(
    images: Sequence[Image],
    columns: int = 4,
    labels: Sequence[str] | None = None,
    *,
    margin: int = 8,
) -> Image:
    """Arrange pictures of one size in rows on a white sheet.

    Parameters
    ----------
    images
        Pictures, ``(height, width, 3)`` each, 0 to 255.
    columns
        Number of pictures in a row.
    labels
        A line of text under each picture.
    margin
        Space between pictures and around them, pixels.

    Returns
    -------
    ndarray
        The sheet, ``(height, width, 3)``, 0 to 255.

    Raises
    ------
    DataError
        If there are no pictures, their sizes differ, or labels and pictures do not match.
    """
    _check_sheet(images, columns, labels)
    height, width = images[0].shape[:2]
    columns = min(columns, len(images))
    rows = -(-len(images) // columns)
    step_y = height + margin + (0 if labels is None else _LABEL_HEIGHT)
    step_x = width + margin
    sheet = np.full((margin + rows * step_y, margin + columns * step_x, 3), _PAPER, dtype=np.uint8)
    corners = [
        (margin + (i // columns) * step_y, margin + (i % columns) * step_x)
        for i in range(len(images))
    ]
    for image, (top, left) in zip(images, corners, strict=True):
        sheet[top : top + height, left : left + width] = image
    if labels is None:
        return sheet
    centres = [(left + width / 2, top + height + _LABEL_HEIGHT / 2) for top, left in corners]
    return _write_texts(sheet, labels, centres)


def save_picture(image: Image, path: str | os.PathLike[str]) -> None:
    """Write a picture as PNG.

    Parameters
    ----------
    image
        The picture, ``(height, width, 3)``, 0 to 255.
    path
        A name in ``.png``; an existing file is replaced.

    Raises
    ------
    FileFormatError
        If the name does not end in ``.png``, or the file cannot be written.
    """
    from matplotlib.image import imsave

    path = Path(path)
    if path.suffix.lower() != ".png":
        raise FileFormatError("pictures are written as PNG", path=path, expected="a name in .png")
    with write_atomically(path, "picture") as partial:
        imsave(partial, image, format="png")


def create_canvas(width: int, height: int) -> tuple[Any, Any]:
    """Return an empty matplotlib figure and the canvas that draws it.

    Parameters
    ----------
    width
        Width, pixels.
    height
        Height, pixels.

    Returns
    -------
    Figure
        Unknown to pyplot: it opens no window.
    FigureCanvasAgg
        Its `buffer_rgba` has the pixels after `draw`.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / _DOTS_PER_INCH, height / _DOTS_PER_INCH), dpi=_DOTS_PER_INCH)
    return figure, FigureCanvasAgg(figure)


def _check_sheet(images: Sequence[Image], columns: int, labels: Sequence[str] | None) -> None:
    if not images:
        raise DataError("there are no pictures to put on a sheet")
    if columns < 1:
        raise DataError("a sheet has at least one column", found=columns)
    shapes = {np.shape(image) for image in images}
    if len(shapes) > 1 or any(len(shape) != 3 or shape[2] != 3 for shape in shapes):
        raise DataError(
            "the pictures of a sheet must have one size",
            found=sorted(shapes),
            expected="(height, width, 3) for all",
        )
    if labels is not None and len(labels) != len(images):
        raise DataError(
            "each picture of a sheet needs one label", found=len(labels), expected=len(images)
        )


def _write_texts(
    sheet: Image, texts: Sequence[str], centres: Sequence[tuple[float, float]]
) -> Image:
    """Return a sheet with texts centred on points (pixels from the left and the top)."""
    height, width = sheet.shape[:2]
    figure, canvas = create_canvas(width, height)
    figure.patch.set_alpha(0.0)
    for text, (x, y) in zip(texts, centres, strict=True):
        figure.text(
            x / width,
            1 - y / height,
            text,
            ha="center",
            va="center",
            fontsize=_LABEL_POINTS,
            color="black",
            parse_math=False,
        )
    canvas.draw()
    drawn = np.asarray(canvas.buffer_rgba())[:height, :width].astype(np.float64)
    ink = drawn[..., 3:] / 255.0
    mixed = sheet[: drawn.shape[0], : drawn.shape[1]] * (1 - ink) + drawn[..., :3] * ink
    written = sheet.copy()
    written[: drawn.shape[0], : drawn.shape[1]] = np.rint(mixed).astype(np.uint8)
    return written
