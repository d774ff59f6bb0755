"""A strip below a talking head with curves of its parameters and its phones.

The strip is drawn once, as a long picture in which time goes to the right, and each frame of the
movie shows the part of it around the time of the frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from mocap_fit.drawing import CYCLE
from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSequence
from mocap_fit.render.pictures import Image, create_canvas
from mocap_fit.tracks import FloatArray, ParameterTracks

_CURVE_HEIGHT = 58
_PHONE_HEIGHT = 34
_SECONDS_SHOWN = 2.4
# Strips are drawn in chunks: no picture is wider than the drawing library allows.
_SECONDS_A_CHUNK = 20.0
_PAPER = 255
_NOW = np.array([200, 40, 40], dtype=np.float64)
_MOST_CURVES = 6
# Pixels: phones that are narrower are not labelled.
_MIN_LABELLED = 7.0


@dataclass(frozen=True, eq=False)
class Curve:
    """A parameter of one track over time.

    Parameters
    ----------
    times
        Times of the frames, ``(frames,)``, seconds.
    values
        Values of the parameter, ``(frames,)``, 1 is the full gesture; NaN leaves a gap.
    colour
        A colour of matplotlib.
    """

    times: FloatArray
    values: FloatArray
    colour: str


class RunningStrip:
    """A strip of curves and phones, of which the part around any time can be shown.

    Parameters
    ----------
    width
        Width of the part that is shown, pixels.
    curves
        Names of parameters and their curves, one panel each.
    phones
        Phones that are written along the bottom.
    start
        Start of the movie, seconds.
    end
        End of the movie, seconds.
    """

    def __init__(
        self,
        width: int,
        curves: Mapping[str, Sequence[Curve]],
        phones: PhoneSequence | None,
        start: float,
        end: float,
    ) -> None:
        self.width = width
        self._curves = dict(curves)
        self._phones = phones
        self._start, self._end = start, end
        self._scale = width / _SECONDS_SHOWN
        self.height = _CURVE_HEIGHT * len(curves) + (_PHONE_HEIGHT if phones is not None else 0)
        self._limits = {name: _compute_limits(some) for name, some in curves.items()}
        self._get_chunk = lru_cache(maxsize=3)(self._draw_chunk)
        self._names = _draw_panel_names(list(curves), self.height) if curves else None

    def at(self, time: float) -> Image:
        """Return the part of the strip around a time, with a line at that time.

        Parameters
        ----------
        time
            The time in the middle, seconds.

        Returns
        -------
        ndarray
            The picture, ``(height, width, 3)``, 0 to 255.
        """
        left = round((time - self._start) * self._scale) - self.width // 2
        chunk_width = round(_SECONDS_A_CHUNK * self._scale)
        shown = np.full((self.height, self.width, 3), _PAPER, dtype=np.uint8)
        for chunk in range(left // chunk_width, (left + self.width - 1) // chunk_width + 1):
            begin = chunk * chunk_width
            first, last = max(left, begin), min(left + self.width, begin + chunk_width)
            shown[:, first - left : last - left] = self._get_chunk(chunk)[
                :, first - begin : last - begin
            ]
        middle = self.width // 2
        now = shown[:, middle - 1 : middle + 1].astype(np.float64)
        shown[:, middle - 1 : middle + 1] = np.rint(0.25 * now + 0.75 * _NOW)
        if self._names is not None:
            corner = shown[:, : self._names.shape[1]]
            np.minimum(corner, self._names[:, : corner.shape[1]], out=corner)
        return shown

    def _draw_chunk(self, chunk: int) -> Image:
        """Return a chunk of the strip; chunk 0 begins at the start of the movie."""
        pixels = round(_SECONDS_A_CHUNK * self._scale)
        begin = self._start + chunk * pixels / self._scale
        end = begin + pixels / self._scale
        if end < self._start or begin > self._end:
            return np.full((self.height, pixels, 3), _PAPER, dtype=np.uint8)
        figure, canvas = create_canvas(pixels, self.height)
        top = self.height
        for name, curves in self._curves.items():
            axes = _add_panel(figure, top - _CURVE_HEIGHT, _CURVE_HEIGHT, self.height, begin, end)
            axes.axhline(0.0, color="0.85", lw=0.8)
            for curve in curves:
                axes.plot(curve.times, curve.values, color=curve.colour, lw=1.6)
            axes.set_ylim(*self._limits[name])
            self._mark_phones(axes, begin, end, labelled=False)
            top -= _CURVE_HEIGHT
        if self._phones is not None:
            axes = _add_panel(figure, 0, _PHONE_HEIGHT, self.height, begin, end)
            axes.set_ylim(0, 1)
            self._mark_phones(axes, begin, end, labelled=True)
        return _read_pixels(canvas, self.height, pixels)

    def _mark_phones(self, axes: Any, begin: float, end: float, *, labelled: bool) -> None:
        for segment in self._phones or ():
            # A phone at the edge of two chunks is drawn, cut, in both.
            if segment.end < begin - 1 or segment.start > end + 1:
                continue
            for edge in (segment.start, segment.end):
                axes.axvline(edge, color="0.80" if labelled else "0.92", lw=0.8, zorder=0)
            wide = segment.duration * self._scale
            if labelled and wide > _MIN_LABELLED:
                axes.text(
                    segment.centre,
                    0.5,
                    segment.phone,
                    ha="center",
                    va="center",
                    fontsize=11 if wide > 9.0 * len(segment.phone) + 4.0 else 7,
                    parse_math=False,
                    clip_on=True,
                )


def select_moving(tracks: Sequence[ParameterTracks], count: int = 4) -> tuple[str, ...]:
    """Select the parameters that move most.

    Parameters
    ----------
    tracks
        Tracks that may have different parameters.
    count
        Number of parameters at most.

    Returns
    -------
    tuple of str
        Their names, in the order of the tracks.
    """
    deviations: dict[str, float] = {}
    for track in tracks:
        for i, name in enumerate(track.names):
            values = track.values[:, i]
            values = values[np.isfinite(values)]
            deviation = float(values.std()) if len(values) else 0.0
            deviations[name] = max(deviations.get(name, 0.0), deviation)
    moving = [name for name in deviations if deviations[name] > 1e-3]
    most = set(sorted(moving, key=lambda name: -deviations[name])[:count])
    return tuple(name for name in deviations if name in most)


def to_curves(
    tracks: Mapping[str, ParameterTracks], parameters: Sequence[str]
) -> dict[str, list[Curve]]:
    """Convert parameters of several tracks to curves, a colour for each track.

    Parameters
    ----------
    tracks
        Tracks by the name of the head.
    parameters
        Names of parameters.

    Returns
    -------
    dict of list of Curve
        The curves of each parameter.

    Raises
    ------
    DataError
        If none of the tracks has a parameter of that name, or there are too many to be read.
    """
    if len(parameters) > _MOST_CURVES:
        raise DataError(
            "too many curves for one picture",
            found=len(parameters),
            expected=f"at most {_MOST_CURVES}",
        )
    curves: dict[str, list[Curve]] = {}
    for name in parameters:
        some = [
            Curve(track.times, track[name], CYCLE[i % len(CYCLE)])
            for i, track in enumerate(tracks.values())
            if name in track.names
        ]
        if not some:
            known = sorted({known for track in tracks.values() for known in track.names})
            raise DataError(
                f"there is no parameter '{name}'", expected=f"some of {', '.join(known)}"
            )
        curves[name] = some
    return curves


@lru_cache(maxsize=512)
def draw_text(text: str, points: float = 13.0, colour: str = "black") -> Image:
    """Draw a line of text on white, as narrow as it can be.

    Parameters
    ----------
    text
        One line.
    points
        Size of the letters, points (1/72 inch at 100 pixels an inch).
    colour
        A colour of matplotlib.

    Returns
    -------
    ndarray
        The picture, ``(height, width, 3)``, 0 to 255; not to be changed.
    """
    height = round(2.2 * points)
    width = round(len(text) * points * 1.1 * 100 / 72) + 20
    figure, canvas = create_canvas(width, height)
    figure.text(
        0.5, 0.5, text, ha="center", va="center", fontsize=points, color=colour, parse_math=False
    )
    drawn = _read_pixels(canvas, height, width)
    inked = np.flatnonzero((drawn < 250).any(axis=(0, 2)))
    if not inked.size:
        return np.full((height, 1, 3), _PAPER, dtype=np.uint8)
    return drawn[:, max(inked[0] - 2, 0) : inked[-1] + 3]


def _compute_limits(curves: Sequence[Curve]) -> tuple[float, float]:
    values = np.concatenate([curve.values for curve in curves])
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
    low, high = min(low, 0.0), max(high, 0.2)
    margin = 0.08 * (high - low)
    return low - margin, high + 3 * margin


def _draw_panel_names(names: Sequence[str], height: int) -> Image:
    width = 220
    figure, canvas = create_canvas(width, height)
    for row, name in enumerate(names):
        figure.text(
            5 / width,
            1 - (row * _CURVE_HEIGHT + 3) / height,
            name.replace("_", " "),
            ha="left",
            va="top",
            fontsize=8.5,
            color="0.25",
            parse_math=False,
        )
    return _read_pixels(canvas, height, width)


def _add_panel(
    figure: Any, bottom: int, height: int, full_height: int, begin: float, end: float
) -> Any:
    axes = figure.add_axes((0, bottom / full_height, 1, height / full_height))
    axes.set(xlim=(begin, end), xticks=[], yticks=[])
    axes.spines[["left", "right"]].set_visible(False)
    axes.spines[["top", "bottom"]].set_color("0.85")
    return axes


def _read_pixels(canvas: Any, height: int, width: int) -> Image:
    canvas.draw()
    drawn = np.asarray(canvas.buffer_rgba())[:height, :width, :3]
    return np.ascontiguousarray(drawn)
