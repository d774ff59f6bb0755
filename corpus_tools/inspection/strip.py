"""The lower part of the window: sound, labels, curves, gaps and findings over one time line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from corpus_tools.inspection.curves import Curve
from corpus_tools.inspection.material import Material, list_marks
from corpus_tools.inspection.paint import BLUE, RED, Colour
from corpus_tools.inspection.time_line import TimeLine
from corpus_tools.validation.findings import Finding
from mocap_fit.render.running_strip import select_moving
from mocap_fit.tracks import Origin, ParameterTracks
from mocap_fit.tracks.rigid_sets import compute_median

LEFT = 164
"""Pixels left of the time line, for names."""

RIGHT = 10
"""Pixels right of it."""
_HEIGHTS = {
    "ruler": 18,
    "waveform": 46,
    "spectrogram": 56,
    "words": 20,
    "phones": 22,
    "parameter": 34,
    "difference": 30,
    "residual": 32,
    "gaps": 44,
    "marker": 40,
    "distance": 32,
    "findings": 18,
    "overview": 16,
}
_LEAST_PARAMETER = 24
# Parameters that move most come first.
_MOVING = 5
HEAD_COLOURS: tuple[Colour, ...] = (BLUE, RED, (40, 140, 80), (140, 80, 170))
"""Colours of heads, in order."""

# Pixels: a boundary or a mark is hit that far away.
_REACH = 5


@dataclass(frozen=True)
class Row:
    """A row of the strip.

    Parameters
    ----------
    kind
        A key of the table of heights.
    name
        What it shows.
    top, bottom
        First row of pixels, and the one after the last.
    """

    kind: str
    name: str
    top: int
    bottom: int


class Strip:
    """The rows of some material.

    Parameters
    ----------
    material
        What is shown.
    other
        What it is compared with.
    """

    def __init__(self, material: Material, other: Material | None = None) -> None:
        self.material, self.other = material, other
        self.heads: dict[str, ParameterTracks] = dict(material.heads)
        if other is not None:
            self.heads = {name_head(material, name): h for name, h in material.heads.items()}
            for name, head in other.heads.items():
                label = name_head(other, name)
                self.heads[f"{label}, other" if label in self.heads else label] = head
        self.marks = list_marks(material.findings, material.rate)
        names = [name for head in self.heads.values() for name in head.names]
        moving = select_moving(list(self.heads.values()), _MOVING) if names else ()
        self.parameters = (*moving, *(n for n in dict.fromkeys(names) if n not in moving))
        self.first_parameter = 0
        self.picked: int | None = None
        self._marker: str | None = None
        self.marker_curves: dict[str, Curve] = {}
        self.rows: list[Row] = []

    def _list_kinds(self) -> list[tuple[str, str]]:
        material = self.material
        kinds = [("ruler", "seconds")]
        if material.sound is not None:
            kinds += [("waveform", "sound"), ("spectrogram", "spectrogram")]
        kinds += [("words" if name != "phones" else "phones", name) for name in material.tiers]
        kinds += [("parameter", name) for name in self.parameters[self.first_parameter :]]
        if self.difference is not None:
            kinds.append(("difference", "difference"))
        if self.residuals:
            kinds.append(("residual", "residual"))
        if self.marker_curves:
            kinds.append(("marker", str(self._marker)))
        if "residual" in self.marker_curves:
            kinds.append(("distance", "its residual"))
        if material.recording is not None:
            kinds.append(("gaps", "gaps"))
        if self.marks:
            kinds.append(("findings", "findings"))
        return [*kinds, ("overview", "")]

    def trace_marker(self, name: str | None) -> None:
        """Show where a marker is over time, and its residual.

        Parameters
        ----------
        name
            The marker; None for none.
        """
        if name == self._marker:
            return
        self._marker, self.marker_curves = name, {}
        tracks = self.material.measured or self.material.recording
        if name is None or tracks is None or name not in tracks.names:
            return
        away = tracks[name] - compute_median(tracks[name])
        for axis, values in zip("xyz", away.T, strict=True):
            self.marker_curves[axis] = Curve(tracks.start_time, tracks.rate, values)
        traced = self.material.trace_residual(name)
        if traced is not None and len(traced[0]) > 1:
            times, residuals = traced
            rate = 1.0 / (times[1] - times[0])
            self.marker_curves["residual"] = Curve(times[0], rate, residuals)

    def arrange(self, height: int) -> None:
        """Arrange as many rows as there is height for; parameters are left out first.

        Parameters
        ----------
        height
            Height of the strip, pixels.
        """
        kinds = self._list_kinds()
        fixed = sum(_HEIGHTS[kind] for kind, _ in kinds if kind != "parameter")
        rest = max(height - fixed, 0)
        wanted = sum(kind == "parameter" for kind, _ in kinds)
        shown = min(wanted, rest // _LEAST_PARAMETER)
        each = min(rest // shown, 60) if shown else 0
        rows, top = [], 0
        for kind, name in kinds:
            if kind == "parameter" and shown == 0:
                continue
            shown -= kind == "parameter"
            tall = each if kind == "parameter" else _HEIGHTS[kind]
            rows.append(Row(kind, name, top, min(top + tall, height)))
            top += tall
        self.rows = rows

    def measure(self) -> int:
        """Measure the height that all rows would like to have.

        Returns
        -------
        int
            The height, pixels.
        """
        return sum(_HEIGHTS[kind] for kind, _ in self._list_kinds())

    @cached_property
    def residuals(self) -> dict[str, Curve]:
        """Residuals of the heads that have some."""
        return {
            name: Curve(head.start_time, head.rate, head.residuals)
            for name, head in self.heads.items()
            if np.isfinite(head.residuals).any()
        }

    @cached_property
    def gap_sums(self) -> dict[Origin, NDArray[np.int32]]:
        """How many samples before each frame are missing or filled, ``(frames + 1, markers)``."""
        recording = self.material.recording
        assert recording is not None
        sums = {}
        for origin in (Origin.MISSING, Origin.FILLED):
            total = np.zeros((recording.frames + 1, len(recording.names)), dtype=np.int32)
            np.cumsum(recording.origin == origin, axis=0, out=total[1:])
            sums[origin] = total
        return sums

    @cached_property
    def difference(self) -> Curve | None:
        """Root mean square difference of the first two heads, full gestures."""
        if len(self.heads) < 2:
            return None
        one, other = list(self.heads.values())[:2]
        names = [name for name in one.names if name in other.names]
        if not names:
            return None
        times = one.times
        inside = (times >= other.times[0]) & (times <= other.times[-1])
        apart = one.select(names).at(times) - other.select(names).at(times)
        values = np.where(inside, np.sqrt((apart**2).mean(axis=1)), np.nan)
        return Curve(one.start_time, one.rate, values)

    @cached_property
    def sound(self) -> Curve | None:
        """The mean of the channels of the sound; None without."""
        sound = self.material.sound
        return None if sound is None else Curve(0.0, sound.rate, sound.samples.mean(axis=1))

    @cached_property
    def curves(self) -> dict[tuple[str, str], tuple[Curve, Curve | None]]:
        """Curves of every head and parameter, with those of the standard deviations."""
        curves = {}
        for label, head in self.heads.items():
            for k, name in enumerate(head.names):
                deviations = head.standard_deviations[:, k]
                known = np.isfinite(deviations).any()
                curves[label, name] = (
                    Curve(head.start_time, head.rate, head.values[:, k]),
                    Curve(head.start_time, head.rate, deviations) if known else None,
                )
        return curves

    def get_limits(self, parameter: str) -> tuple[float, float]:
        """Return the least and the largest value that is drawn of a parameter.

        Parameters
        ----------
        parameter
            Its name.

        Returns
        -------
        tuple of float
            Full gestures.
        """
        values = [
            curve.values for (_, name), (curve, _) in self.curves.items() if name == parameter
        ]
        low = min((float(np.nanmin(v)) for v in values if np.isfinite(v).any()), default=0.0)
        high = max((float(np.nanmax(v)) for v in values if np.isfinite(v).any()), default=1.0)
        return min(low, -0.05), max(high, 0.5)

    def to_x(self, time: float, line: TimeLine, width: int) -> float:
        """Return where a time is, pixels from the left.

        Parameters
        ----------
        time
            The time, seconds.
        line
            What is shown.
        width
            Width of the strip, pixels.

        Returns
        -------
        float
            Distance in pixels.
        """
        return LEFT + (time - line.start) / line.span * (width - LEFT - RIGHT)

    def to_time(self, x: float, line: TimeLine, width: int) -> float:
        """Return the time at a column, seconds.

        Parameters
        ----------
        x
            Distance in pixels from the left.
        line
            What is shown.
        width
            Width of the strip, pixels.

        Returns
        -------
        float
            The time, seconds.
        """
        return line.start + (x - LEFT) / (width - LEFT - RIGHT) * line.span

    def locate_row(self, y: float) -> Row | None:
        """Return the row at a height, pixels from the top; None below all.

        Parameters
        ----------
        y
            Distance in pixels from the top of the strip.

        Returns
        -------
        Row or None
            The row.
        """
        return next((row for row in self.rows if row.top <= y < row.bottom), None)

    def locate_boundary(self, x: float, row: Row, line: TimeLine, width: int) -> float | None:
        """Return the time of the boundary of labels that a point is near to.

        Parameters
        ----------
        x
            Distance in pixels from the left.
        row
            A row of labels.
        line
            What is shown.
        width
            Width of the strip, pixels.

        Returns
        -------
        float or None
            The time, seconds.
        """
        entries = self.material.tiers[row.name].entries
        times = {time for label in entries for time in (label.start, label.end)}
        near = min(times, key=lambda t: abs(self.to_x(t, line, width) - x), default=None)
        if near is None or abs(self.to_x(near, line, width) - x) > _REACH:
            return None
        return near

    def locate_mark(self, x: float, line: TimeLine, width: int) -> Finding | None:
        """Return the finding whose mark is at a column.

        Parameters
        ----------
        x
            Distance in pixels from the left.
        line
            What is shown.
        width
            Width of the strip, pixels.

        Returns
        -------
        Finding or None
            The finding.
        """
        for start, end, finding in self.marks:
            left, right = self.to_x(start, line, width), self.to_x(end, line, width)
            if left - _REACH <= x <= right + _REACH:
                return finding
        return None

    def paint(self, line: TimeLine, width: int, height: int) -> NDArray[np.uint8]:
        """Paint all rows, without the cursor and the selection.

        Parameters
        ----------
        line
            What is shown.
        width
            Width, pixels.
        height
            Height, pixels.

        Returns
        -------
        ndarray
            The picture, ``(height, width, 3)``.
        """
        from corpus_tools.inspection.strip_painting import paint_rows

        self.arrange(height)
        return paint_rows(self, line, width, height)


def name_head(material: Material, label: str) -> str:
    """Name a head that is compared with that of other material.

    Parameters
    ----------
    material
        What it belongs to.
    label
        Its label there.

    Returns
    -------
    str
        The title of the material, with the label where it has several heads.
    """
    return material.title if len(material.heads) == 1 else f"{material.title}: {label}"


def combine_extent(materials: Sequence[Material]) -> tuple[float, float]:
    """Combine the extents of what is shown together.

    Parameters
    ----------
    materials
        One or more.

    Returns
    -------
    tuple of float
        Start and end, seconds.
    """
    starts, ends = zip(*(each.extent for each in materials), strict=True)
    return min(starts), max(ends)
