"""Gaps of a recording: what is missing, and filling what may be filled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.tracks.rigid import refusal, rigid_transforms
from mocap_fit.tracks.rigid_sets import mean_shape
from mocap_fit.tracks.types import FloatArray, MarkerTracks, Origin

if TYPE_CHECKING:
    import pandas as pd

Method = Literal["pchip", "linear", "rigid"]


def runs(there: NDArray[np.bool_]) -> list[slice]:
    """Stretches of True, in order.

    Parameters
    ----------
    there
        `(frames,)`.
    """
    edges = np.diff(np.concatenate([[0], there.astype(np.int8), [0]]))
    pairs = zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True)
    return [slice(int(first), int(last)) for first, last in pairs]


@dataclass(frozen=True)
class MarkerGaps:
    """What is missing of one marker.

    Parameters
    ----------
    name
        The marker.
    gaps
        Number of gaps, those at the ends of the recording among them.
    missing
        Number of missing frames.
    share
        Missing frames over all frames, 0 to 1.
    longest
        Frames of the longest gap.
    longest_seconds
        The same in seconds.
    at_ends
        Missing frames before the first sample and after the last one, which interpolation cannot
        fill.
    """

    name: str
    gaps: int
    missing: int
    share: float
    longest: int
    longest_seconds: float
    at_ends: int


@dataclass(frozen=True)
class GapReport:
    """What is missing of a recording, marker by marker.

    Parameters
    ----------
    frames
        Frames of the recording.
    rate
        Hertz.
    markers
        In the order of the recording.
    """

    frames: int
    rate: float
    markers: tuple[MarkerGaps, ...]

    @property
    def share(self) -> float:
        """Missing samples over all samples, 0 to 1."""
        return float(np.mean([marker.share for marker in self.markers]))

    def to_frame(self) -> pd.DataFrame:
        """A table with a row for each marker."""
        import pandas as pd

        return pd.DataFrame([vars(marker) for marker in self.markers])

    def __str__(self) -> str:
        """A table of the markers that have gaps."""
        lines = [
            f"{self.frames} frames at {self.rate:g} Hz, {len(self.markers)} markers, "
            f"{self.share:.2%} of the samples missing"
        ]
        gappy = [marker for marker in self.markers if marker.missing]
        if gappy:
            width = max(6, *(len(marker.name) for marker in gappy))
            lines.append(f"{'marker':{width}}  gaps  missing           longest          at ends")
            lines += [
                f"{m.name:{width}}  {m.gaps:4d}  {m.missing:7d} ({m.share:6.1%})  "
                f"{m.longest:5d} ({m.longest_seconds:.3f} s)  {m.at_ends:7d}"
                for m in gappy
            ]
        return "\n".join(lines)


def gap_report(tracks: MarkerTracks) -> GapReport:
    """Count the gaps of every marker."""
    markers = []
    for name, seen in zip(tracks.names, tracks.visible.T, strict=True):
        gaps = runs(~seen)
        lengths = [gap.stop - gap.start for gap in gaps]
        missing, longest = sum(lengths), max(lengths, default=0)
        at_ends = sum(
            gap.stop - gap.start for gap in gaps if gap.start == 0 or gap.stop == len(seen)
        )
        share = missing / max(1, tracks.frames)
        markers.append(
            MarkerGaps(name, len(gaps), missing, share, longest, longest / tracks.rate, at_ends)
        )
    return GapReport(tracks.frames, tracks.rate, tuple(markers))


def fill_gaps(
    tracks: MarkerTracks,
    method: Method = "pchip",
    maximum_gap: float = 0.1,
    rigid_set: Sequence[str] | None = None,
) -> MarkerTracks:
    """Fill short gaps.

    Parameters
    ----------
    tracks
        A recording.
    method
        ``pchip``: a cubic through the neighbours that does not overshoot (Fritsch and Carlson
        1980). ``linear``: a straight line. ``rigid``: from the other markers of a rigid set, of
        which three or more that are not on a line must be seen; the shape of the set is the
        median over the frames that show all of it, and the marker is led into the samples before
        and after the gap, from which a real set differs a little.
    maximum_gap
        Seconds; a gap that lasts longer stays as it is; infinite for no limit. It counts for all
        methods, but for ``rigid``, which knows how the head moved meanwhile, it may be long.
    rigid_set
        Markers of the rigid set, four or more; only these are filled. For ``rigid`` alone.

    Returns
    -------
    MarkerTracks
        Filled samples have the origin `Origin.FILLED`. Nothing is filled before the first sample
        of a marker or after its last one.

    Raises
    ------
    DataError
        If the method is unknown, the length is not a number of seconds, or the rigid set is
        missing, too small, on a line, or never seen as a whole.
    """
    if method not in get_args(Method):
        raise DataError(
            f"there is no method '{method}' to fill gaps",
            expected=f"one of {', '.join(get_args(Method))}",
        )
    if np.isnan(maximum_gap) or maximum_gap < 0:
        raise DataError(
            "the maximum gap is not possible", found=maximum_gap, expected="seconds, 0 or more"
        )
    if (rigid_set is None) == (method == "rigid"):
        raise DataError(
            "the method 'rigid' needs a rigid set, and no other method takes one",
            found=f"method '{method}', rigid set {rigid_set}",
        )
    positions, origin = tracks.positions.copy(), tracks.origin.copy()
    # A hair of tolerance: seconds times rate are seldom whole.
    limit = maximum_gap * tracks.rate * (1 + 1e-9)
    chosen = np.arange(len(tracks.names)) if rigid_set is None else _checked_set(tracks, rigid_set)
    shape = mean_shape(tracks.positions[:, chosen]) if rigid_set is not None else None
    for place, marker in enumerate(chosen):
        seen = tracks.visible[:, marker]
        gaps = [
            gap
            for gap in runs(~seen)
            if gap.start > 0 and gap.stop < len(seen) and gap.stop - gap.start <= limit
        ]
        if not gaps:
            continue
        if shape is None:
            filled = _interpolated(tracks.positions[:, marker], seen, gaps, method)
        else:
            others = np.delete(chosen, place)
            filled = _from_others(
                tracks.positions[:, marker],
                tracks.positions[:, others],
                shape[place],
                np.delete(shape, place, axis=0),
                gaps,
            )
        for gap in gaps:
            positions[gap, marker] = filled[gap]
            there = ~np.isnan(filled[gap, 0])
            origin[gap, marker] = np.where(there, Origin.FILLED, Origin.MISSING)
    # JSON has no infinity.
    length = None if np.isinf(maximum_gap) else float(maximum_gap)
    arguments: dict[str, object] = {"method": method, "maximum_gap": length}
    if rigid_set is not None:
        arguments["rigid_set"] = list(rigid_set)
    return tracks.replace(positions=positions, origin=origin).with_step("fill_gaps", arguments)


def _checked_set(tracks: MarkerTracks, rigid_set: Sequence[str]) -> NDArray[np.intp]:
    chosen = tracks.indices(rigid_set)
    if len(set(rigid_set)) < 4 or len(set(rigid_set)) != len(rigid_set):
        raise DataError(
            "a rigid set needs three markers besides the missing one",
            found=", ".join(rigid_set) or "none",
            expected="four or more different markers",
        )
    whole = ~np.isnan(tracks.positions[:, chosen]).any(axis=(1, 2))
    if whole.any():
        reason = refusal(tracks.positions[int(np.argmax(whole)), chosen])
        if reason is not None:
            raise DataError(
                "the rigid set cannot tell where a missing marker is",
                found=reason,
                expected="markers that are not on a line",
            )
    return chosen


def _interpolated(
    positions: FloatArray, seen: NDArray[np.bool_], gaps: list[slice], method: Method
) -> FloatArray:
    frames = np.arange(len(positions), dtype=np.float64)
    result = positions.copy()
    inside = np.concatenate([np.arange(gap.start, gap.stop) for gap in gaps])
    if method == "pchip":
        from scipy.interpolate import PchipInterpolator

        result[inside] = PchipInterpolator(frames[seen], positions[seen], axis=0)(inside)
    else:
        for axis in range(3):
            result[inside, axis] = np.interp(inside, frames[seen], positions[seen, axis])
    return result


def _from_others(
    positions: FloatArray,
    others: FloatArray,
    place: FloatArray,
    shape: FloatArray,
    gaps: list[slice],
) -> FloatArray:
    """Where the rest of the body puts a marker in its gaps."""
    result = positions.copy()
    needed = np.unique(np.concatenate([np.arange(gap.start - 1, gap.stop + 1) for gap in gaps]))
    rotations, translations, _ = rigid_transforms(shape, others[needed])
    predicted = rotations @ place + translations
    # How far the samples at the edges are off, as the body sees it.
    off = np.einsum("fji,fj->fi", rotations, positions[needed] - predicted)
    off = np.where(np.isnan(off), 0.0, off)
    for gap in gaps:
        first = int(np.searchsorted(needed, gap.start - 1))
        length = gap.stop - gap.start
        inside = slice(first + 1, first + 1 + length)
        share = np.arange(1, length + 1)[:, None] / (length + 1)
        lead = (1 - share) * off[first] + share * off[first + length + 1]
        result[gap] = predicted[inside] + np.einsum("fij,fj->fi", rotations[inside], lead)
    return result
