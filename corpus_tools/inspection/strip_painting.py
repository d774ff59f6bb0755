"""Paint the rows of the strip."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from corpus_tools.inspection.curves import compute_spectrogram
from corpus_tools.inspection.paint import (
    BLUE,
    FAINT,
    INK,
    ORANGE,
    RED,
    RULE,
    SHADE,
    Canvas,
    Colour,
    fit_text,
)
from corpus_tools.inspection.strip import HEAD_COLOURS, LEFT, RIGHT, Row, Strip
from corpus_tools.inspection.time_line import TimeLine
from corpus_tools.validation.findings import Severity
from mocap_fit.labels import Label
from mocap_fit.tracks import FloatArray, Origin

SEVERITY_COLOURS = {Severity.ERROR: RED, Severity.WARNING: ORANGE, Severity.NOTE: BLUE}
_STEPS = np.array([0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 300])


def paint_rows(strip: Strip, line: TimeLine, width: int, height: int) -> NDArray[np.uint8]:
    """Paint the rows of a strip as they are arranged.

    Parameters
    ----------
    strip
        The strip.
    line
        What is shown.
    width, height
        Size of the picture, pixels.

    Returns
    -------
    ndarray
        Red, green and blue, ``(height, width, 3)``.
    """
    return _Painter(strip, line, width, height).paint()


class _Painter:
    """Paints the rows of a strip at one stretch of time."""

    def __init__(self, strip: Strip, line: TimeLine, width: int, height: int) -> None:
        self._strip, self._line = strip, line
        self._canvas = Canvas(width, height)
        self._edges = np.linspace(line.start, line.end, width - LEFT - RIGHT + 1)

    def paint(self) -> NDArray[np.uint8]:
        canvas = self._canvas
        canvas.fill(0, 0, LEFT, canvas.height, SHADE)
        for row in self._strip.rows:
            kind = "tier" if row.kind in ("words", "phones") else row.kind
            getattr(self, f"_paint_{kind}")(row)
            canvas.fill(0, row.bottom - 1, canvas.width, row.bottom, RULE)
        canvas.fill(LEFT - 1, 0, LEFT, canvas.height, RULE)
        return canvas.pixels

    def _to_x(self, time: float) -> float:
        return self._strip.to_x(time, self._line, self._canvas.width)

    def _name(self, row: Row, text: str, colour: Colour = INK) -> None:
        middle = 0.5 * (row.top + row.bottom)
        self._canvas.write(8, middle, fit_text(text, LEFT - 44, 11), colour, 11)

    def _write_limits(self, row: Row, low: str, high: str) -> None:
        if row.bottom - row.top >= 24:
            self._canvas.write(LEFT - 5, row.top + 7, high, FAINT, 9, "right")
            self._canvas.write(LEFT - 5, row.bottom - 8, low, FAINT, 9, "right")

    def _draw_curve(
        self,
        row: Row,
        curve: tuple[FloatArray, FloatArray],
        limits: tuple[float, float],
        colour: Colour,
        alpha: float = 1.0,
    ) -> None:
        low, high = limits
        scale = (row.bottom - row.top - 5) / (high - low)
        lower, upper = (row.bottom - 3 - (each - low) * scale for each in curve)
        self._canvas.draw_band(LEFT, upper, lower, colour, (row.top, row.bottom - 1), alpha)

    def _paint_ruler(self, row: Row) -> None:
        width = self._canvas.width
        self._canvas.fill(LEFT, row.top, width, row.bottom, SHADE)
        self._name(row, f"{self._line.start:.3f} to {self._line.end:.3f} s", FAINT)
        wide = 80 * self._line.span / (width - LEFT - RIGHT)
        step = float(_STEPS[min(int(np.searchsorted(_STEPS, wide)), len(_STEPS) - 1)])
        digits = max(0, int(np.ceil(-np.log10(step))))
        first, last = np.ceil(self._line.start / step), np.floor(self._line.end / step)
        for time in step * np.arange(first, last + 1):
            x = self._to_x(float(time))
            self._canvas.fill(x, row.bottom - 5, x + 1, self._canvas.height, RULE)
            text = f"{time:.{digits}f}"
            self._canvas.write(
                x, row.top + 7, text, FAINT, 10, "middle" if x > LEFT + 16 else "left"
            )

    def _paint_waveform(self, row: Row) -> None:
        assert self._strip.sound is not None
        self._name(row, "sound")
        low, high = self._strip.sound.reduce(self._edges)
        largest = max(float(np.nanmax(np.abs([low, high]), initial=0.0)), 1e-4)
        self._draw_curve(row, (low, high), (-largest, largest), (60, 66, 78))

    def _paint_spectrogram(self, row: Row) -> None:
        sound = self._strip.material.sound
        assert sound is not None
        assert self._strip.sound is not None
        self._name(row, "spectrogram")
        top = min(5.0, sound.rate / 2000)
        self._write_limits(row, "0", f"{top:g} kHz")
        rows = slice(row.top, row.bottom - 1)
        grey = compute_spectrogram(
            self._strip.sound.values, sound.rate, self._edges, rows.stop - rows.start
        )
        self._canvas.pixels[rows, LEFT : LEFT + grey.shape[1]] = grey[:, :, None]

    def _paint_tier(self, row: Row) -> None:
        self._name(row, row.name)
        for index, label in enumerate(self._strip.material.tiers[row.name].entries):
            if label.end < self._line.start or label.start > self._line.end:
                continue
            left = max(self._to_x(label.start), LEFT)
            right = min(self._to_x(label.end), self._canvas.width - RIGHT)
            if row.kind == "phones" and index == self._strip.picked:
                self._canvas.fill(left, row.top, right, row.bottom - 1, (255, 236, 190))
            for x in (left, right):
                self._canvas.fill(x, row.top, x + 1, row.bottom, (150, 156, 166))
            self._write_label(row, label, left, right)

    def _write_label(self, row: Row, label: Label, left: float, right: float) -> None:
        text = label.text.strip()
        size = 12 if row.kind == "phones" else 11
        if text and right - left > 5:
            middle = 0.5 * (row.top + row.bottom - 1)
            shown = fit_text(text, right - left - 1, size)
            if shown == text or len(shown) > 2:
                self._canvas.write(0.5 * (left + right), middle, shown, INK, size, "middle")

    def _paint_parameter(self, row: Row) -> None:
        self._name(row, row.name.replace("_", " "))
        limits = self._strip.get_limits(row.name)
        self._write_limits(row, f"{limits[0]:.1f}", f"{limits[1]:.1f}")
        scale = (row.bottom - row.top - 5) / (limits[1] - limits[0])
        zero = row.bottom - 3 + limits[0] * scale
        self._canvas.fill(LEFT, zero, self._canvas.width - RIGHT, zero + 1, RULE)
        for colour, label in zip(HEAD_COLOURS, self._strip.heads, strict=False):
            if (label, row.name) not in self._strip.curves:
                continue
            curve, deviations = self._strip.curves[label, row.name]
            low, high = curve.reduce(self._edges)
            if deviations is not None:
                wide = 1.96 * np.minimum(deviations.reduce(self._edges)[1], limits[1] - limits[0])
                self._draw_curve(row, (low - wide, high + wide), limits, colour, 0.22)
            self._draw_curve(row, (low, high), limits, colour)

    def _paint_difference(self, row: Row) -> None:
        assert self._strip.difference is not None
        self._name(row, "difference (RMS)")
        largest = max(float(np.nanmax(self._strip.difference.values, initial=0.0)), 0.05)
        self._write_limits(row, "0", f"{largest:.2f}")
        curve = self._strip.difference.reduce(self._edges)
        zeros = np.where(np.isnan(curve[0]), np.nan, 0.0)
        self._draw_curve(row, (zeros, curve[1]), (0.0, largest), ORANGE, 0.3)
        self._draw_curve(row, curve, (0.0, largest), ORANGE)

    def _paint_residual(self, row: Row) -> None:
        self._name(row, "residual")
        largest = max(
            float(np.quantile(each.values[np.isfinite(each.values)], 0.999))
            for each in self._strip.residuals.values()
        )
        limits = 0.0, max(1.1 * largest, 0.5)
        self._write_limits(row, "0", f"{limits[1]:.1f} mm")
        for colour, curve in zip(HEAD_COLOURS, self._strip.residuals.values(), strict=False):
            self._draw_curve(row, curve.reduce(self._edges), limits, colour)

    def _paint_marker(self, row: Row) -> None:
        """Paint how far the marker is from its median, along each axis."""
        self._name(row, row.name)
        curves = {axis: self._strip.marker_curves[axis] for axis in "xyz"}
        known = np.concatenate([curve.values for curve in curves.values()])
        known = known[np.isfinite(known)]
        high = max(float(np.quantile(np.abs(known), 0.999)), 1.0) if len(known) else 1.0
        self._write_limits(row, f"{-high:.0f}", f"{high:.0f} mm")
        for number, (colour, (axis, curve)) in enumerate(
            zip(HEAD_COLOURS, curves.items(), strict=False)
        ):
            self._draw_curve(row, curve.reduce(self._edges), (-high, high), colour)
            self._canvas.write(LEFT + 6 + 10 * number, row.top + 8, axis, colour, 10)

    def _paint_distance(self, row: Row) -> None:
        self._name(row, row.name)
        curve = self._strip.marker_curves["residual"]
        known = curve.values[np.isfinite(curve.values)]
        high = max(1.1 * float(np.quantile(known, 0.999)), 0.5) if len(known) else 0.5
        self._write_limits(row, "0", f"{high:.1f} mm")
        self._draw_curve(row, curve.reduce(self._edges), (0.0, high), ORANGE)

    def _paint_gaps(self, row: Row) -> None:
        """Paint a line for each marker: red where it is missing, orange where it was filled."""
        recording = self._strip.material.recording
        assert recording is not None
        missing = self._strip.gap_sums[Origin.MISSING][-1]
        share = 100 * float(missing.sum()) / max(recording.origin.size, 1)
        self._name(row, f"gaps: {share:.1f} %")
        count, tall = len(recording.names), row.bottom - row.top - 3
        positions = (self._edges - recording.start_time) * recording.rate
        first = np.clip(np.rint(positions[:-1]), 0, recording.frames).astype(np.intp)
        last = np.clip(np.rint(positions[1:]), 0, recording.frames).astype(np.intp)
        last = np.maximum(last, np.minimum(first + 1, recording.frames))
        inside = np.flatnonzero((positions[1:] > 0) & (first < recording.frames))
        if not inside.size:
            return
        hit = {
            origin: (total[last[inside]] > total[first[inside]]).T
            for origin, total in self._strip.gap_sums.items()
        }
        lines = np.minimum(np.arange(tall) * count // max(tall, 1), count - 1)
        part = self._canvas.pixels[row.top + 1 : row.top + 1 + tall, LEFT:][:, inside]
        part[:] = (236, 239, 243)
        for origin, colour in ((Origin.FILLED, ORANGE), (Origin.MISSING, RED)):
            part[hit[origin][lines]] = colour
        self._canvas.pixels[row.top + 1 : row.top + 1 + tall, LEFT + inside] = part

    def _paint_findings(self, row: Row) -> None:
        self._name(row, f"findings: {len(self._strip.marks)}")
        for start, end, finding in self._strip.marks:
            colour = SEVERITY_COLOURS[finding.severity]
            left = self._to_x(start)
            right = max(self._to_x(end), left + 4)
            if right < LEFT or left > self._canvas.width - RIGHT:
                continue
            left, right = max(left, LEFT), min(right, self._canvas.width - RIGHT)
            self._canvas.fill(left, row.top + 4, right, row.bottom - 5, colour)

    def _paint_overview(self, row: Row) -> None:
        """Paint where what is shown lies in all that there is."""
        wide = self._canvas.width - LEFT - RIGHT
        total = self._line.last - self._line.first
        self._canvas.fill(LEFT, row.top, self._canvas.width - RIGHT, row.bottom - 1, SHADE)
        for start, end, finding in self._strip.marks:
            left = LEFT + (start - self._line.first) / total * wide
            right = LEFT + (end - self._line.first) / total * wide
            colour = SEVERITY_COLOURS[finding.severity]
            self._canvas.fill(left, row.top + 1, max(right, left + 2), row.top + 4, colour)
        left = LEFT + (self._line.start - self._line.first) / total * wide
        right = LEFT + (self._line.end - self._line.first) / total * wide
        self._canvas.fill(left, row.top + 5, max(right, left + 6), row.bottom - 3, (176, 184, 196))
        self._name(row, f"all: {total:.2f} s", FAINT)
