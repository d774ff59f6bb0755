"""The one style of all figures, and writing them to files.

Colours are Okabe and Ito's, which people with any colour vision can distinguish. A figure for a
file is drawn by a function that makes a `matplotlib.figure.Figure` with `create_figure`, to which
`save_figure` applies the style; `create_axes` makes the axes of a figure to look at.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import FileFormatError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
PINK, SKY, YELLOW = "#CC79A7", "#56B4E9", "#F0E442"
#: Colours of the lines of one figure, in order.
CYCLE = (BLUE, RED, GREEN, ORANGE, PINK, SKY, "#6A3D9A", "#8A8A8A", "#A6761D", "#1B1B1B")
INK, GREY, PALE = "#222222", "#8A8A8A", "#D9D9D9"
# A $ in a sentence or in the name of a marker is no mathematics.
_PLAIN: Any = {"text.parse_math": False}
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
    **_PLAIN,
    # Names of elements in an SVG file are derived from this text instead of random numbers.
    "svg.hashsalt": "mocap-fit",
}
# Neither the time nor the program's version is written to a file.
_METADATA: Mapping[str, Mapping[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
}


def create_figure(
    size: tuple[float, float], rows: int = 1, columns: int = 1, **options: Any
) -> tuple[Figure, Any]:
    """Make a figure for a file, with its panels.

    Parameters
    ----------
    size
        Width and height, inches.
    rows
        Number of rows of panels.
    columns
        Number of columns of panels.
    **options
        Further arguments of `Figure.subplots`.

    Returns
    -------
    figure : matplotlib.figure.Figure
        Not known to pyplot: it opens no window and is freed after its use.
    panels : ndarray
        Axes, ``(rows, columns)``.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def create_axes(size: tuple[float, float]) -> Axes:
    """Make the axes of a figure to look at, in a window or a notebook.

    Parameters
    ----------
    size
        Width and height, inches.

    Returns
    -------
    matplotlib.axes.Axes
        Of a figure that pyplot knows, so that a notebook or ``pyplot.show`` displays it.
    """
    from matplotlib import pyplot, rc_context

    with rc_context(_STYLE):
        return pyplot.subplots(figsize=size, layout="constrained")[1]


@contextlib.contextmanager
def write_plainly() -> Iterator[None]:
    """Make texts inside that no sign turns into mathematics, also in axes that a user made.

    Yields
    ------
    None
        Nothing.
    """
    import matplotlib

    with matplotlib.rc_context(_PLAIN):
        yield


def write_title(figure: Figure, text: str) -> None:
    """Write the title of a figure, at the left.

    Parameters
    ----------
    figure
        The figure.
    text
        The title.
    """
    figure.suptitle(text, x=0.01, ha="left", fontweight="bold")


def set_log_scale(axes: Axes) -> None:
    """Make the vertical axis logarithmic, with numbers that need no mathematics.

    Parameters
    ----------
    axes
        The axes.
    """
    from matplotlib.ticker import LogFormatter

    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(LogFormatter())
    axes.yaxis.set_minor_formatter(LogFormatter())


def save_figure(path: Path, draw: Callable[..., Figure], *arguments: Any) -> None:
    """Draw a figure and write it to a file; the same figure gives the same bytes.

    Parameters
    ----------
    path
        A name that ends in ``.png`` or ``.svg``.
    draw
        The function that makes the figure.
    *arguments
        Its arguments.

    Raises
    ------
    FileFormatError
        If the name ends otherwise, or the file cannot be written.
    """
    import matplotlib

    extension = path.suffix.lower().removeprefix(".")
    if extension not in _METADATA:
        raise FileFormatError(
            "figures are not written in this format",
            path=path,
            expected="a name in .png or .svg",
        )
    with write_atomically(path, "figure") as partial, matplotlib.rc_context(_STYLE):
        figure = draw(*arguments)
        figure.savefig(partial, format=extension, dpi=150, metadata=_METADATA[extension])
