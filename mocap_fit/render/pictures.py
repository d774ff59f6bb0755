"""Pictures in memory and on disk."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import FileFormatError

Image = NDArray[np.uint8]

_DOTS_PER_INCH = 100


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
