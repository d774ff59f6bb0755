"""Tracks for people: a summary in a few lines, a table in a notebook, a plot."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mocap_fit.drawing import CYCLE, create_axes, write_plainly

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from mocap_fit.tracks.base import Tracks

# Names that a summary shows at most, and lines that a legend shows.
_NAMES, _LEGEND = 8, 12


def _describe_extent(tracks: Tracks) -> list[tuple[str, str]]:
    names = ", ".join(tracks.names[:_NAMES])
    if len(tracks.names) > _NAMES:
        names += f", … ({len(tracks.names)} in all)"
    extent = [("frames", f"{tracks.frames} at {tracks.rate:g} Hz, {tracks.duration:.3f} s")]
    if tracks.frames:
        first, last = tracks.times[[0, -1]]
        extent += [("times", f"{first:.3f} s to {last:.3f} s")]
        extent += [("missing", f"{1 - tracks.visible.mean():.2%} of the samples")]
    return [*extent, (tracks.plural, names)]


def summarise(tracks: Tracks) -> str:
    """Return a summary of tracks in a few lines.

    Parameters
    ----------
    tracks
        Markers, poses or parameters.

    Returns
    -------
    str
        Kind and name, number of frames, rate, times, share of missing samples, names of tracks.
    """
    lines = [f"{type(tracks).__name__} '{tracks.name}'"]
    lines += [f"  {key}: {text}" for key, text in _describe_extent(tracks)]
    return "\n".join(lines)


def to_html(tracks: Tracks) -> str:
    """Return a summary of tracks as HTML, for notebooks.

    Parameters
    ----------
    tracks
        Markers, poses or parameters.

    Returns
    -------
    str
        A table.
    """
    steps = ", ".join(step.name for step in tracks.provenance)
    rows = [*_describe_extent(tracks), ("provenance", steps or "none")]
    body = "".join(
        f"<tr><th style='text-align:left'>{key}</th>"
        f"<td style='text-align:left'>{html.escape(text)}</td></tr>"
        for key, text in rows
    )
    title = html.escape(f"{type(tracks).__name__} '{tracks.name}'")
    return f"<table><caption>{title}</caption><tbody>{body}</tbody></table>"


def plot_tracks(tracks: Tracks, names: Sequence[str] | None = None, ax: Axes | None = None) -> Axes:
    """Plot tracks over time, a line each; see `Tracks.plot`.

    Parameters
    ----------
    tracks
        Markers, poses or parameters.
    names
        The tracks that are drawn; all of them where left out.
    ax
        The axes to draw into; those of a new figure where left out.

    Returns
    -------
    matplotlib.axes.Axes
        The axes.

    Raises
    ------
    DataError
        If there are no tracks of some of the names.
    """
    names = tracks.names if names is None else tuple(names)
    values = tracks.main_array[:, tracks.indices(names)]
    label = "parameter (0 rest, 1 full gesture)"
    if values.ndim == 3:
        seen = ~np.isnan(values).all(axis=(0, 2))
        middle = np.full(values.shape[1:], np.nan)
        middle[seen] = np.nanmedian(values[:, seen], axis=0)
        values = np.linalg.norm(values - middle, axis=2)
        label = "distance from the median position (mm)"
    ax = create_axes((8.0, 3.5)) if ax is None else ax
    for k, name in enumerate(names):
        color = CYCLE[k % len(CYCLE)]
        ax.plot(tracks.times, values[:, k], label=name, color=color, linewidth=1.0)
    ax.set(xlabel="time (s)", ylabel=label)
    ax.set_title(tracks.name, parse_math=False)
    if len(names) <= _LEGEND:
        with write_plainly():
            ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return ax
