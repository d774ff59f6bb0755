"""The reference pose: a file or a span of a take, laid on itself frame by frame, and judged."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from mocap_fit.edits import load_edits
from mocap_fit.errors import DataError, add_path
from mocap_fit.fitting.layout import Layout
from mocap_fit.head.aligned_frames import align_frames
from mocap_fit.io import read_tracks
from mocap_fit.tracks import FloatArray, MarkerTracks
from mocap_fit.tracks.rigid_sets import compute_median

# Feature points of MPEG-4 on the upper and lower lip: inner border, outer border.
_LIPS = (("2.2", "2.3"), ("8.1", "8.2"))

# Seconds: how long a span that is suggested is, and over how long noise is averaged.
_DURATION, _SMOOTHED = 0.3, 0.1
# Part of the lips' range within which they are closed, and millimetres that noise may be.
_CLOSED, _CLOSED_MM = 0.2, 1.0
# Part of the markers that are most often seen together which must be seen in a span.
_SEEN = 0.8
# Millimetres: beyond, lips speak or are open, and a marker moves against the others.
_SPEAKS, _OPEN, _MOVES = 2.0, 3.0, 1.5
# Times the residual of the best span: beyond, another span is better.
_WORSE = 2.0

_SOURCE = re.compile(r"(.+)@(-?\d+(?:\.\d*)?)-(-?\d+(?:\.\d*)?)", re.DOTALL)


@dataclass(frozen=True)
class ReferenceFile:
    """Where a reference pose is.

    Parameters
    ----------
    path
        The recording.
    span
        Start and end of the reference pose in it, seconds; None for all of it.
    """

    path: Path
    span: tuple[float | None, float | None] | None = None

    def __str__(self) -> str:
        if self.span is None:
            return str(self.path)
        start, end = ("" if time is None else f"{time:g}" for time in self.span)
        return f"{self.path}@{start}-{end}"


@dataclass(frozen=True)
class ReferenceSpan:
    """A span of a recording that can be a reference pose.

    Parameters
    ----------
    start
        Start, seconds on the recording's clock.
    end
        End, seconds.
    residual
        Root mean square distance of the markers from their median, frames laid on each other,
        millimetres.
    lip_gap
        Distance of the markers in the middle of both lips, millimetres; NaN where the layout has
        none.
    """

    start: float
    end: float
    residual: float
    lip_gap: float

    def __str__(self) -> str:
        return f"{self.start:.3f}-{self.end:.3f}"


@dataclass(frozen=True)
class ReferenceFault:
    """What is wrong with a reference pose.

    Parameters
    ----------
    kind
        ``speaks``: the lips move or are open; ``moves``: another marker moves; ``worse``: another
        span of the recording would be better.
    problem
        What it is, with the numbers.
    expected
        What should be.
    advice
        What to do.
    """

    kind: Literal["speaks", "moves", "worse"]
    problem: str
    expected: str
    advice: str


def parse_reference(source: str | os.PathLike[str]) -> ReferenceFile:
    """Return the recording and the span that ``FILE`` or ``FILE@START-END`` name.

    Parameters
    ----------
    source
        A recording, or one with a span in seconds, such as ``take.tsv@0.2-0.5``.

    Returns
    -------
    ReferenceFile
        Where the reference pose is.

    Raises
    ------
    DataError
        If the end is not after the start.
    """
    text = os.fspath(source)
    match = None if Path(text).exists() else _SOURCE.fullmatch(text)
    if match is None:
        return ReferenceFile(Path(text))
    start, end = float(match[2]), float(match[3])
    if not start < end:
        raise DataError(
            "the span of the reference pose ends before it starts",
            path=match[1],
            found=f"{match[2]}-{match[3]}",
            expected="START-END in seconds, such as 0.2-0.5",
        )
    return ReferenceFile(Path(match[1]), (start, end))


def read_reference(
    source: str | os.PathLike[str], read: Callable[[str | Path], MarkerTracks] = read_tracks
) -> tuple[MarkerTracks, MarkerTracks]:
    """Read a reference pose, as the edit list beside its recording has mended it.

    Parameters
    ----------
    source
        ``FILE`` or ``FILE@START-END``. Without a span, an edit that sets the reference pose says
        which span it is, and of which recording.
    read
        How files are read.

    Returns
    -------
    pose
        The frames of the reference pose.
    take
        All frames of its recording.

    Raises
    ------
    MocapFitError
        If a file cannot be read, an edit cannot be applied, or no frame is in the span.
    """
    where = parse_reference(source)
    edits = load_edits(where.path)
    if where.span is None and edits is not None and edits.reference is not None:
        chosen = edits.reference
        path = where.path
        if chosen.recording is not None:
            path = path.with_name(chosen.recording)
            edits = load_edits(path)
        where = ReferenceFile(path, (chosen.start, chosen.end))
    take = read(where.path)
    try:
        if edits is not None:
            take = edits.apply(take)
        if where.span is None:
            return take, take
        pose = take.between(*where.span)
    except DataError as error:
        raise add_path(error, where.path) from None
    name = str(replace(where, path=Path(take.name)))
    return pose.replace(name=name), take


def find_lips(layout: Layout) -> tuple[str, str] | None:
    """Return the markers in the middle of both lips.

    Parameters
    ----------
    layout
        The marker layout.

    Returns
    -------
    tuple of str or None
        Names of a marker on the upper lip and of one on the lower lip; None where there are none.
    """
    by_point = {marker.feature_point: marker.name for marker in layout.face_markers}
    for upper, lower in _LIPS:
        if upper in by_point and lower in by_point:
            return by_point[upper], by_point[lower]
    return None


def align_reference(layout: Layout, pose: MarkerTracks) -> MarkerTracks:
    """Lay the frames of a reference pose on each other, so that their median is not blurred.

    Parameters
    ----------
    layout
        The marker layout; its head markers say how the head moves, or without, all markers.
    pose
        The reference pose, with the names of the layout.

    Returns
    -------
    MarkerTracks
        The same frames at the middle pose of the head; as they were where no pose is known.
    """
    aligned = align_frames(pose, _get_head(layout, pose)) if pose.frames > 1 else None
    if aligned is None:
        return pose
    positions = aligned.place(aligned.positions)
    origin = np.where(np.isnan(positions[:, :, 0]), 0, pose.origin)
    return pose.replace(positions=positions, origin=origin)


def suggest_reference(
    tracks: MarkerTracks, layout: Layout, *, duration: float = _DURATION
) -> ReferenceSpan:
    """Find the stillest span of a recording in which the lips are closed.

    Parameters
    ----------
    tracks
        A recording with the names of the layout.
    layout
        The marker layout.
    duration
        Length of the span, seconds; that of the recording, where it is shorter.

    Returns
    -------
    ReferenceSpan
        The span; ``FILE@START-END`` names it wherever a reference pose is taken.

    Raises
    ------
    DataError
        If no frame shows the pose of the head.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> take = mf.read_tracks(mf.load_sample("take_01"))
    >>> span = suggest_reference(take, mf.load_layout("face30-head5"))
    >>> span.residual < 0.5
    True
    """
    still, gap = _align_markers(layout, tracks)
    count = min(tracks.frames, max(3, round(duration * tracks.rate)))
    residuals = _compute_residuals(still, count)
    openings = _average(gap, count)
    if not np.isnan(openings).all():
        low, high = np.nanquantile(openings, (0.02, 0.98))
        limit = low + max(_CLOSED_MM, _CLOSED * (high - low))
        with np.errstate(invalid="ignore"):
            residuals = np.where(openings <= limit, residuals, np.nan)
    if np.isnan(residuals).all():
        raise DataError(
            f"no span of {duration:g} s shows the face with closed lips",
            expected="a recording that shows most markers of the layout",
        )
    first = int(np.nanargmin(residuals))
    start = float(tracks.times[first])
    frames = slice(first, first + count)
    return ReferenceSpan(
        start,
        start + count / tracks.rate,
        _compute_residual(still[frames]),
        float(compute_median(gap[frames, None])[0]),
    )


def find_reference_faults(
    layout: Layout, pose: MarkerTracks, take: MarkerTracks, path: str | os.PathLike[str]
) -> Iterator[ReferenceFault]:
    """Find out whether a reference pose speaks, moves, or is worse than another span.

    Parameters
    ----------
    layout
        The marker layout.
    pose
        The reference pose, with the names of the layout.
    take
        The recording that it is from, with the names of the layout.
    path
        The file of that recording, for the advice.

    Yields
    ------
    ReferenceFault
        What is wrong with it.
    """
    try:
        still, gap = _align_markers(layout, pose)
        best = suggest_reference(take, layout)
    except DataError:
        # What there is to be said of such a pose is said where it is laid on the face.
        return
    advice = (
        f"The stillest span with closed lips is {os.fspath(path)}@{best} ({best.residual:.2f} mm): "
        "give it as the reference pose if the face is at rest there, or record one."
    )
    width = max(1, min(pose.frames, round(_SMOOTHED * pose.rate)))
    smooth_gap = _average(gap, width)
    if not np.isnan(smooth_gap).all():
        low, high = np.nanquantile(smooth_gap, (0.05, 0.95))
        opened = float(np.nanmedian(gap)) - best.lip_gap
        if high - low > _SPEAKS:
            text = f"the lips move in the reference pose, by {high - low:.1f} mm"
            yield ReferenceFault("speaks", text, f"at most {_SPEAKS:g} mm", advice)
        elif opened > _OPEN:
            text = f"the lips are open in the reference pose, by {opened:.1f} mm"
            yield ReferenceFault("speaks", text, f"at most {_OPEN:g} mm", advice)
    off = _average(still - compute_median(still), width)
    moves = np.sqrt(np.nan_to_num(_average_squares(off)))
    worst = int(np.argmax(moves))
    if moves[worst] > _MOVES:
        text = f"'{_get_names(layout, pose)[worst]}' moves in the reference pose, by "
        text += f"{moves[worst]:.1f} mm (root mean square)"
        yield ReferenceFault("moves", text, f"at most {_MOVES:g} mm", advice)
    residual = _compute_residual(still)
    if residual > _WORSE * best.residual:
        text = f"the reference pose is blurred: its frames differ by {residual:.2f} mm"
        expected = f"at most twice the {best.residual:.2f} mm of the best span"
        yield ReferenceFault("worse", text, expected, advice)


def _get_head(layout: Layout, tracks: MarkerTracks) -> list[int]:
    names = {marker.name for marker in layout.head_markers}
    return [k for k, name in enumerate(tracks.names) if name in names]


def _get_names(layout: Layout, tracks: MarkerTracks) -> list[str]:
    return [m.name for m in layout.markers if m.name in tracks.names]


def _align_markers(layout: Layout, tracks: MarkerTracks) -> tuple[FloatArray, FloatArray]:
    """Return the layout's markers without the head's motion, and how far the lips are apart."""
    aligned = align_frames(tracks, _get_head(layout, tracks))
    if aligned is None:
        raise DataError("the pose of the head is known in no frame")
    lips = find_lips(layout)
    gap = np.full(tracks.frames, np.nan)
    if lips is not None and set(lips) <= set(tracks.names):
        upper, lower = aligned.positions[:, tracks.indices(lips)].transpose(1, 0, 2)
        gap = np.linalg.norm(upper - lower, axis=1)
    return aligned.positions[:, tracks.indices(_get_names(layout, tracks))], gap


def _average(values: FloatArray, width: int) -> FloatArray:
    """Return means over windows of frames; NaN where fewer than half of the frames have values."""
    seen = ~np.isnan(values)
    sums = _sum_windows(np.where(seen, values, 0.0), width)
    counts = _sum_windows(seen.astype(np.float64), width)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(counts >= 0.5 * width, sums / counts, np.nan)


def _sum_windows(values: FloatArray, width: int) -> FloatArray:
    total = np.cumsum(np.insert(values, 0, 0.0, axis=0), axis=0)
    return np.asarray(total[width:] - total[:-width])


def _compute_residuals(still: FloatArray, width: int) -> FloatArray:
    """Return how far the markers are from their means in every window, root mean square."""
    centred = still - compute_median(still)
    variances = (_average(centred**2, width) - _average(centred, width) ** 2).sum(axis=2)
    counts = (~np.isnan(variances)).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = np.nansum(np.maximum(variances, 0.0), axis=1) / counts
    enough = counts >= max(1.0, _SEEN * counts.max(initial=0))
    return np.where(enough, np.sqrt(means), np.nan)


def _compute_residual(still: FloatArray) -> float:
    squares = _average_squares(still - compute_median(still))
    return float(np.sqrt(np.nanmean(squares)))


def _average_squares(off: FloatArray) -> FloatArray:
    """Return the mean square length of each marker's differences; NaN where it is never seen."""
    squares = (off**2).sum(axis=2)
    counts = (~np.isnan(squares)).sum(axis=0)
    return np.where(counts > 0, np.nansum(squares, axis=0) / np.maximum(counts, 1), np.nan)
