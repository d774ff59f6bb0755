"""One look for all figures, and how they are written.

Colours are Okabe and Ito's, which people with any colour vision can tell apart. A figure is drawn
by a function that makes a `matplotlib.figure.Figure` with `new_figure`; `save_figure` gives it the
look and writes it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import FileFormatError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
PINK, SKY, YELLOW = "#CC79A7", "#56B4E9", "#F0E442"
#: In the order in which lines of one figure take them.
CYCLE = (BLUE, RED, GREEN, ORANGE, PINK, SKY, "#6A3D9A", "#8A8A8A", "#A6761D", "#1B1B1B")
INK, GREY, PALE = "#222222", "#8A8A8A", "#D9D9D9"
_STYLE: Any = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.labelsize": 9,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "grid.color": "#EBEBEB",
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "figure.titlesize": 11,
    # Names of elements in an SVG file are made of this and not of chance.
    "svg.hashsalt": "mocap-fit",
}
# Nothing of the moment or the program goes into a file.
_METADATA: Mapping[str, Mapping[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
}


def new_figure(
    size: tuple[float, float], rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, Any]:
    """Make a figure and its panels.

    Parameters
    ----------
    size
        Width and height, inches.
    rows, columns
        Of panels.
    options
        For `Figure.subplots`.

    Returns
    -------
    figure
        Not known to pyplot: it opens no window and does not outlive its use.
    panels
        `(rows, columns)` of axes.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def figure_title(figure: Figure, text: str) -> None:
    """Write the title of a figure, at the left."""
    figure.suptitle(text, x=0.01, ha="left", fontweight="bold")


def save_figure(path: Path, draw: Callable[..., Figure], *arguments: Any) -> None:
    """Draw a figure and write it, whole or not at all; the same figure, the same bytes.

    Parameters
    ----------
    path
        A name in ``.png`` or ``.svg``.
    draw
        Makes the figure.
    arguments
        What it takes.

    Raises
    ------
    FileFormatError
        If the name ends otherwise.
    """
    import matplotlib

    kind = path.suffix.lower().removeprefix(".")
    if kind not in _METADATA:
        raise FileFormatError(
            "figures are not written in this format",
            path=path,
            expected="a name in .png or .svg",
        )
    with write_atomically(path, "figure") as partial, matplotlib.rc_context(_STYLE):
        figure = draw(*arguments)
        figure.savefig(partial, format=kind, dpi=150, metadata=_METADATA[kind])
