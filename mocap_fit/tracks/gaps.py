"""Gaps of a recording: counting them, and filling the short ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.tracks.arrays import FloatArray
from mocap_fit.tracks.interpolation import find_runs
from mocap_fit.tracks.rigid import describe_degeneracy, estimate_rigid_transforms
from mocap_fit.tracks.rigid_sets import compute_mean_shape
from mocap_fit.tracks.types import MarkerTracks, Origin

if TYPE_CHECKING:
    import pandas as pd

Method = Literal["pchip", "linear", "rigid"]


@dataclass(frozen=True)
class MarkerGaps:
    """The gaps of one marker.

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
        Length of the longest gap in frames.
    longest_seconds
        Length of the longest gap in seconds.
    at_ends
        Number of missing frames before the first sample and after the last one, which
        interpolation cannot fill.
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
    """The gaps of a recording, marker by marker.

    Parameters
    ----------
    frames
        Number of frames of the recording.
    rate
        Frames per second, hertz.
    markers
        The gaps of each marker, in the order of the recording.
    """

    frames: int
    rate: float
    markers: tuple[MarkerGaps, ...]

    @property
    def share(self) -> float:
        """Missing samples over all samples, 0 to 1."""
        return float(np.mean([marker.share for marker in self.markers]))

    def to_frame(self) -> pd.DataFrame:
        """Return the report as a table.

        Returns
        -------
        pandas.DataFrame
            A row for each marker, with the fields of `MarkerGaps` as columns.
        """
        import pandas as pd

        return pd.DataFrame([vars(marker) for marker in self.markers])

    def __str__(self) -> str:
        """Return a table of the markers that have gaps."""
        lines = [
            f"{self.frames} frames at {self.rate:g} Hz, {len(self.markers)} markers, "
            f"{self.share:.2%} of the samples missing"
        ]
        with_gaps = [marker for marker in self.markers if marker.missing]
        if with_gaps:
            width = max(6, *(len(marker.name) for marker in with_gaps))
            lines.append(f"{'marker':{width}}  gaps  missing           longest          at ends")
            lines += [
                f"{m.name:{width}}  {m.gaps:4d}  {m.missing:7d} ({m.share:6.1%})  "
                f"{m.longest:5d} ({m.longest_seconds:.3f} s)  {m.at_ends:7d}"
                for m in with_gaps
            ]
        return "\n".join(lines)


def count_gaps(tracks: MarkerTracks) -> GapReport:
    """Count the gaps of every marker.

    Parameters
    ----------
    tracks
        A recording.

    Returns
    -------
    GapReport
        The gaps, marker by marker.
    """
    markers = []
    for name, seen in zip(tracks.names, tracks.visible.T, strict=True):
        gaps = find_runs(~seen)
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
        median over the frames that show all of it, and the marker passes smoothly into the
        samples before and after the gap, from which a real set differs a little.
    maximum_gap
        Longest gap that is filled, seconds; infinite for no limit. It holds for all methods; for
        ``rigid``, which follows the motion of the head, it may be long.
    rigid_set
        Markers of the rigid set, four or more; only these are filled. For ``rigid`` alone.

    Returns
    -------
    MarkerTracks
        The recording; filled samples have the origin `Origin.FILLED`. Nothing is filled before
        the first sample of a marker or after its last one.

    Raises
    ------
    DataError
        If the method is unknown, the length is not a number of seconds, or the rigid set is
        missing, too small, on a line, or never seen as a whole.
    """
    _check_arguments(method, maximum_gap, rigid_set)
    positions, origin = tracks.positions.copy(), tracks.origin.copy()
    # A tolerance, because seconds times rate are seldom integers; infinity stays.
    limit = np.floor(maximum_gap * tracks.rate + 1e-6)
    chosen = np.arange(len(tracks.names)) if rigid_set is None else _check_set(tracks, rigid_set)
    shape = compute_mean_shape(tracks.positions[:, chosen]) if rigid_set is not None else None
    for k, marker in enumerate(chosen):
        seen = tracks.visible[:, marker]
        gaps = [
            gap
            for gap in find_runs(~seen)
            if gap.start > 0 and gap.stop < len(seen) and gap.stop - gap.start <= limit
        ]
        if not gaps:
            continue
        if shape is None:
            filled = _interpolate_gaps(tracks.positions[:, marker], seen, gaps, method)
        else:
            others = tracks.positions[:, np.delete(chosen, k)]
            filled = _predict_from_others(tracks.positions[:, marker], others, shape, k, gaps)
        for gap in gaps:
            positions[gap, marker] = filled[gap]
            known = ~np.isnan(filled[gap]).any(axis=1)
            origin[gap, marker] = np.where(known, Origin.FILLED, Origin.MISSING)
    # JSON has no infinity.
    length = None if np.isinf(maximum_gap) else float(maximum_gap)
    arguments: dict[str, object] = {"method": method, "maximum_gap": length}
    if rigid_set is not None:
        arguments["rigid_set"] = list(rigid_set)
    return tracks.replace(positions=positions, origin=origin).add_step("fill_gaps", arguments)


def _check_arguments(method: Method, maximum_gap: float, rigid_set: Sequence[str] | None) -> None:
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


def _check_set(tracks: MarkerTracks, rigid_set: Sequence[str]) -> NDArray[np.intp]:
    chosen = tracks.indices(rigid_set)
    if len(set(rigid_set)) < 4 or len(set(rigid_set)) != len(rigid_set):
        raise DataError(
            "a rigid set needs three markers besides the missing one",
            found=", ".join(rigid_set) or "none",
            expected="four or more different markers",
        )
    complete = ~np.isnan(tracks.positions[:, chosen]).any(axis=(1, 2))
    if complete.any():
        reason = describe_degeneracy(tracks.positions[int(np.argmax(complete)), chosen])
        if reason is not None:
            raise DataError(
                "the rigid set cannot tell where a missing marker is",
                found=reason,
                expected="markers that are not on a line",
            )
    return chosen


def _interpolate_gaps(
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


def _predict_from_others(
    positions: FloatArray, others: FloatArray, shape: FloatArray, marker: int, gaps: list[slice]
) -> FloatArray:
    """Return the positions of a marker, in its gaps as the rest of the body predicts them."""
    result = positions.copy()
    needed = np.unique(np.concatenate([np.arange(gap.start - 1, gap.stop + 1) for gap in gaps]))
    rest = np.delete(shape, marker, axis=0)
    rotations, translations, _ = estimate_rigid_transforms(rest, others[needed])
    predicted = rotations @ shape[marker] + translations
    # The errors of the samples at the edges, in the coordinates of the body.
    errors = np.einsum("fji,fj->fi", rotations, positions[needed] - predicted)
    errors = np.where(np.isnan(errors), 0.0, errors)
    for gap in gaps:
        first = int(np.searchsorted(needed, gap.start - 1))
        length = gap.stop - gap.start
        inside = slice(first + 1, first + 1 + length)
        share = np.arange(1, length + 1)[:, None] / (length + 1)
        correction = (1 - share) * errors[first] + share * errors[first + length + 1]
        result[gap] = predicted[inside] + np.einsum("fij,fj->fi", rotations[inside], correction)
    return result
