"""Figures of a report: what is usual over all utterances, and single findings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from corpus_tools.validation.findings import Finding
from corpus_tools.validation.report import Report
from corpus_tools.validation.subject import Summary
from mocap_fit.drawing import BLUE, CYCLE, GREY, INK, ORANGE, RED, create_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDTH = 8.0
# Markers that a figure of names has room for.
_MOST_NAMES = 60


def list_overviews(report: Report) -> Iterator[tuple[str, Callable[[], Figure]]]:
    """Yield the figures of all utterances; those without data are left out.

    Parameters
    ----------
    report
        After its `finish`.

    Yields
    ------
    caption
        What the figure shows.
    draw
        A function that draws it.
    """
    summaries, limits = report.summaries, report.limits
    gaps = _collect_columns(summaries, "gaps")
    if gaps:
        yield (
            "How often each marker is missing: the mean over the utterances (bar) and the worst "
            "utterance (dot). The line is the threshold of MF101.",
            lambda: _draw_gaps(gaps, limits.markers.gap_share),
        )
    faces = [s for s in summaries if s.shape is not None and s.shape.against_layout is not None]
    if faces:
        yield (
            "Where the markers are, from the front, in the middle of each utterance: the speaker's "
            "left is at the right. A marker whose dots lie apart was glued on anew, or swapped.",
            lambda: _draw_front(faces),
        )
    residuals = _collect_figures(summaries, "residual_mm")
    if len(residuals):
        yield (
            "How far the markers are from the fitted face: the median of each utterance. The line "
            "is the threshold of MF301.",
            lambda: _draw_histogram(
                residuals, "residual (mm)", "utterances", limits.parameters.residual
            ),
        )
    if any(s.reach for s in summaries):
        yield (
            "How far each parameter goes: from the lowest to the highest hundredth of each "
            "utterance (lines), and its bounds (grey).",
            lambda: _draw_reach(summaries, report.bounds),
        )
    lips = np.array([c.gap for s in summaries for c in s.closures])
    if len(lips):
        yield (
            "The lips' smallest gap in every bilabial stop and nasal. Closed lips are near 0.",
            lambda: _draw_histogram(lips, "gap of the lips (mm)", "phones", None),
        )
    lengths = np.array(
        [
            (s.figures["recording_s"], s.figures["sound_s"])
            for s in summaries
            if {"recording_s", "sound_s"} <= s.figures.keys()
        ]
    ).reshape(-1, 2)
    if len(lengths):
        yield ("The length of each recording and of its sound.", lambda: _draw_lengths(lengths))
    offsets = np.array([s.offset[0] for s in summaries if s.offset is not None])
    if len(offsets):
        yield (
            "How late the frames are, as lips and loudness tell: single utterances are a syllable "
            "off, their middle is not. The lines are the thresholds of MF147.",
            lambda: _draw_histogram(
                1000 * offsets, "offset (ms)", "utterances", 1000 * limits.time.offset, both=True
            ),
        )


def draw_evidence(finding: Finding) -> Figure:
    """Draw the curves about a finding, with its time marked.

    Parameters
    ----------
    finding
        A finding with evidence.

    Returns
    -------
    Figure
        The figure.
    """
    shown = finding.evidence
    assert shown is not None
    figure, panel = _create_panel((_WIDTH, 2.2))
    if finding.location.seconds is not None:
        start, end = finding.location.seconds
        half = 0.5 * float(np.median(np.diff(shown.times))) if len(shown.times) > 1 else 0.01
        panel.axvspan(start - half, end + half, color=ORANGE, alpha=0.25, linewidth=0)
    single = len(shown.curves) > 1
    for colour, (name, values) in zip(CYCLE, shown.curves.items(), strict=False):
        # Coordinates lie far apart; what counts is how they change.
        level = float(np.nanmedian(values)) if single and np.isfinite(values).any() else 0.0
        shift = level if _has_coordinates(finding) else 0.0
        panel.plot(shown.times, values - shift, color=colour, label=name, marker=".", markersize=3)
    panel.set(xlabel="time (s)", ylabel=shown.unit)
    panel.margins(x=0.01)
    if single:
        panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _create_panel(size: tuple[float, float]) -> tuple[Figure, Any]:
    figure, panels = create_figure(size)
    return figure, panels[0, 0]


def _has_coordinates(finding: Finding) -> bool:
    """Whether the curves are the three coordinates of one marker, whose levels say nothing."""
    assert finding.evidence is not None
    return len({name.rsplit(" ", 1)[0] for name in finding.evidence.curves}) == 1


def _collect_columns(summaries: Sequence[Summary], attribute: str) -> dict[str, list[float]]:
    columns: dict[str, list[float]] = {}
    for summary in summaries:
        for name, value in getattr(summary, attribute).items():
            columns.setdefault(name, []).append(value)
    return columns


def _collect_figures(summaries: Sequence[Summary], name: str) -> Any:
    return np.array([s.figures[name] for s in summaries if name in s.figures])


def _draw_gaps(gaps: dict[str, list[float]], limit: float) -> Figure:
    worst = sorted(gaps, key=lambda name: -max(gaps[name]))[:_MOST_NAMES]
    names = [name for name in gaps if name in worst]
    figure, panel = _create_panel((_WIDTH, 0.9 + 0.16 * len(names)))
    locations = np.arange(len(names))
    panel.barh(locations, [100 * np.mean(gaps[n]) for n in names], color=BLUE, height=0.7)
    panel.plot(
        [100 * max(gaps[n]) for n in names], locations, ".", color=RED, label="worst utterance"
    )
    panel.axvline(100 * limit, color=GREY, linestyle="--", linewidth=1)
    panel.set_yticks(locations, names, fontsize=7)
    panel.set_ylim(len(names) - 0.4, -0.6)
    panel.set_xlim(left=0)
    panel.set_xlabel("missing (% of the frames)")
    return figure


def _draw_front(summaries: Sequence[Summary]) -> Figure:
    figure, panel = _create_panel((_WIDTH, 4.2))
    for summary in summaries:
        shape = summary.shape
        assert shape is not None
        fit = shape.against_layout
        assert fit is not None
        face = (shape.placed - np.nanmean(shape.placed, axis=0)) @ fit.matrix
        panel.plot(face[:, 0], face[:, 1], ".", color=BLUE, alpha=0.35, markersize=4)
    last = summaries[-1].shape
    assert last is not None
    _name_points(panel, last.names, face[:, :2])
    panel.set(aspect="equal", xlabel="to the speaker's left (mm)", ylabel="up (mm)")
    return figure


def _name_points(panel: Any, names: Sequence[str], points: Any) -> None:
    """Write the names of points on both sides of them, at even distances, with a line to each."""
    there = np.flatnonzero(np.isfinite(points).all(axis=1))
    if not len(there):
        return
    low, high = points[there].min(axis=0), points[there].max(axis=0)
    middle, half = 0.5 * (low[0] + high[0]), 0.5 * (high[0] - low[0])
    is_right = points[there, 0] > np.median(points[there, 0])
    for align, side, members in (("right", -1, there[~is_right]), ("left", 1, there[is_right])):
        ordered = members[np.argsort(points[members, 1])]
        heights = np.linspace(low[1], high[1], max(2, len(ordered)))
        for k, height in zip(ordered, heights, strict=False):
            panel.annotate(
                names[k],
                points[k],
                (middle + 1.3 * side * half, height),
                fontsize=7,
                color=INK,
                ha=align,
                va="center",
                arrowprops={"arrowstyle": "-", "color": GREY, "linewidth": 0.4, "alpha": 0.6},
            )
    panel.set_xlim(middle - 2.1 * half, middle + 2.1 * half)


def _draw_histogram(
    values: Any, label: str, counted: str, limit: float | None, *, both: bool = False
) -> Figure:
    figure, panel = _create_panel((_WIDTH, 2.4))
    panel.hist(values, bins=min(40, max(8, len(values) // 4)), color=BLUE)
    for value in [] if limit is None else [limit, -limit] if both else [limit]:
        panel.axvline(value, color=RED, linestyle="--", linewidth=1)
    panel.set(xlabel=label, ylabel=counted)
    return figure


def _draw_reach(summaries: Sequence[Summary], bounds: dict[str, tuple[float, float]]) -> Figure:
    reaches = [summary.reach for summary in summaries if summary.reach]
    names = list(reaches[0])
    figure, panel = _create_panel((_WIDTH, 0.9 + 0.3 * len(names)))
    for row, name in enumerate(names):
        if name in bounds:
            low, high = bounds[name]
            panel.barh(row, high - low, left=low, height=0.8, color="#E8E8E8")
        spans = np.array([reach[name] for reach in reaches if name in reach])
        heights = row + np.linspace(-0.32, 0.32, len(spans)) if len(spans) > 1 else np.array([row])
        panel.hlines(heights, spans[:, 0], spans[:, 1], color=BLUE, linewidth=0.6)
    panel.axvline(0, color=GREY, linewidth=0.8)
    panel.set_yticks(np.arange(len(names)), names)
    panel.set_ylim(len(names) - 0.4, -0.6)
    panel.set_xlabel("value (0 is rest, 1 the full gesture)")
    return figure


def _draw_lengths(lengths: Any) -> Figure:
    figure, panel = _create_panel((4.6, 3.6))
    top = 1.05 * float(lengths.max())
    panel.plot([0, top], [0, top], color=GREY, linewidth=0.8)
    panel.plot(lengths[:, 0], lengths[:, 1], ".", color=BLUE)
    panel.set(xlim=(0, top), ylim=(0, top), xlabel="recording (s)", ylabel="sound (s)")
    return figure
