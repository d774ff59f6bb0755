"""What runs along below a talking head: curves of its parameters, and its phones.

The strip is drawn once, as a long picture in which time goes to the right, and each frame of the
movie shows the part of it around its own time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSequence
from mocap_fit.tracks import FloatArray, ParameterTracks

Image = NDArray[np.uint8]

COLOURS = ("#1f5fa8", "#d1701c", "#3a8f4d", "#8a4fa3", "#8c6d31", "#4b4b4b")
_DOTS_PER_INCH = 100
_CURVE_HEIGHT = 58
_PHONE_HEIGHT = 34
_SECONDS_SHOWN = 2.4
# Strips are drawn in pieces: no picture is wider than the drawing library allows.
_SECONDS_A_PIECE = 20.0
_PAPER = 255
_NOW = np.array([200, 40, 40], dtype=np.float64)
_MOST_CURVES = 6
# Pixels: phones that are narrower have no room for their name.
_LEAST_LABELLED = 7.0


@dataclass(frozen=True, eq=False)
class Curve:
    """A parameter of one track over time.

    Parameters
    ----------
    times, values
        `(frames,)`, seconds and the parameter; NaN leaves a gap.
    colour
        As matplotlib has it.
    """

    times: FloatArray
    values: FloatArray
    colour: str


class RunningStrip:
    """A strip of curves and phones, of which a stretch around any time can be had.

    Parameters
    ----------
    width
        Pixels.
    curves
        Name of a parameter → its curves; one panel each.
    phones
        Labelled along the bottom.
    start, end
        The time that the movie covers, seconds.
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
        self._limits = {name: _limits(some) for name, some in curves.items()}
        self._piece = lru_cache(maxsize=3)(self._drawn)
        self._names = _names_of_panels(list(curves), self.height) if curves else None

    def at(self, time: float) -> Image:
        """The stretch around a time, `(height, width, 3)`, with a line at that time."""
        left = round((time - self._start) * self._scale) - self.width // 2
        per_piece = round(_SECONDS_A_PIECE * self._scale)
        shown = np.full((self.height, self.width, 3), _PAPER, dtype=np.uint8)
        for piece in range(left // per_piece, (left + self.width - 1) // per_piece + 1):
            begin = piece * per_piece
            first, last = max(left, begin), min(left + self.width, begin + per_piece)
            shown[:, first - left : last - left] = self._piece(piece)[
                :, first - begin : last - begin
            ]
        middle = self.width // 2
        now = shown[:, middle - 1 : middle + 1].astype(np.float64)
        shown[:, middle - 1 : middle + 1] = np.rint(0.25 * now + 0.75 * _NOW)
        if self._names is not None:
            place = shown[:, : self._names.shape[1]]
            np.minimum(place, self._names[:, : place.shape[1]], out=place)
        return shown

    def _drawn(self, piece: int) -> Image:
        """A piece of the strip; piece 0 begins at the start of the movie."""
        pixels = round(_SECONDS_A_PIECE * self._scale)
        begin = self._start + piece * pixels / self._scale
        end = begin + pixels / self._scale
        if end < self._start or begin > self._end:
            return np.full((self.height, pixels, 3), _PAPER, dtype=np.uint8)
        figure, canvas = _figure(pixels, self.height)
        top = self.height
        for name, curves in self._curves.items():
            axes = _panel(figure, top - _CURVE_HEIGHT, _CURVE_HEIGHT, self.height, begin, end)
            axes.axhline(0.0, color="0.85", lw=0.8)
            for curve in curves:
                axes.plot(curve.times, curve.values, color=curve.colour, lw=1.6)
            axes.set_ylim(*self._limits[name])
            self._mark_phones(axes, begin, end, labelled=False)
            top -= _CURVE_HEIGHT
        if self._phones is not None:
            axes = _panel(figure, 0, _PHONE_HEIGHT, self.height, begin, end)
            axes.set_ylim(0, 1)
            self._mark_phones(axes, begin, end, labelled=True)
        return _pixels(canvas, self.height, pixels)

    def _mark_phones(self, axes: Any, begin: float, end: float, *, labelled: bool) -> None:
        for segment in self._phones or ():
            # A phone at the seam of two pieces is drawn, cut, in both.
            if segment.end < begin - 1 or segment.start > end + 1:
                continue
            for edge in (segment.start, segment.end):
                axes.axvline(edge, color="0.80" if labelled else "0.92", lw=0.8, zorder=0)
            wide = segment.duration * self._scale
            if labelled and wide > _LEAST_LABELLED:
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


def moving_most(tracks: Sequence[ParameterTracks], count: int = 4) -> tuple[str, ...]:
    """The parameters that move most in some tracks, in the order of the first."""
    spread: dict[str, float] = {}
    for track in tracks:
        for i, name in enumerate(track.names):
            values = track.values[:, i]
            values = values[np.isfinite(values)]
            own = float(values.std()) if len(values) else 0.0
            spread[name] = max(spread.get(name, 0.0), own)
    moving = [name for name in spread if spread[name] > 1e-3]
    most = set(sorted(moving, key=lambda name: -spread[name])[:count])
    return tuple(name for name in spread if name in most)


def curves_of(
    tracks: Mapping[str, ParameterTracks], parameters: Sequence[str]
) -> dict[str, list[Curve]]:
    """The curves of some parameters in several tracks, a colour a track.

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
            Curve(track.times, track[name], COLOURS[i % len(COLOURS)])
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


def lettering(text: str, *, points: float = 13.0, colour: str = "black") -> Image:
    """A line of text on white paper, `(height, width, 3)`, as small as it can be."""
    return _lettering(text, points, colour)


@lru_cache(maxsize=512)
def _lettering(text: str, points: float, colour: str) -> Image:
    height = round(points * 2.2 * _DOTS_PER_INCH / 100)
    width = round(len(text) * points * 1.1 * _DOTS_PER_INCH / 72) + 20
    figure, canvas = _figure(width, height)
    figure.text(
        0.5, 0.5, text, ha="center", va="center", fontsize=points, color=colour, parse_math=False
    )
    drawn = _pixels(canvas, height, width)
    inked = np.flatnonzero((drawn < 250).any(axis=(0, 2)))
    if not inked.size:
        return np.full((height, 1, 3), _PAPER, dtype=np.uint8)
    return drawn[:, max(inked[0] - 2, 0) : inked[-1] + 3]


def _limits(curves: Sequence[Curve]) -> tuple[float, float]:
    values = np.concatenate([curve.values for curve in curves])
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
    low, high = min(low, 0.0), max(high, 0.2)
    room = 0.08 * (high - low)
    return low - room, high + 3 * room


def _names_of_panels(names: Sequence[str], height: int) -> Image:
    width = 220
    figure, canvas = _figure(width, height)
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
    return _pixels(canvas, height, width)


def _figure(width: int, height: int) -> tuple[Any, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / _DOTS_PER_INCH, height / _DOTS_PER_INCH), dpi=_DOTS_PER_INCH)
    return figure, FigureCanvasAgg(figure)


def _panel(figure: Any, bottom: int, height: int, whole: int, begin: float, end: float) -> Any:
    axes = figure.add_axes((0, bottom / whole, 1, height / whole))
    axes.set_xlim(begin, end)
    axes.set_xticks([])
    axes.set_yticks([])
    for side in ("left", "right"):
        axes.spines[side].set_visible(False)
    for side in ("top", "bottom"):
        axes.spines[side].set_color("0.85")
    return axes


def _pixels(canvas: Any, height: int, width: int) -> Image:
    canvas.draw()
    drawn = np.asarray(canvas.buffer_rgba())[:height, :width, :3]
    return np.ascontiguousarray(drawn)
