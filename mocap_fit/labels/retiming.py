"""Labels and phones of another clock, brought to the recording's by known moments."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import overload

import numpy as np

from mocap_fit.errors import DataError
from mocap_fit.labels.readers import Labels
from mocap_fit.phones import PhoneSequence
from mocap_fit.tracks import FloatArray


@overload
def retime(labels: PhoneSequence, anchors: Sequence[tuple[float, float]]) -> PhoneSequence: ...
@overload
def retime(labels: Labels, anchors: Sequence[tuple[float, float]]) -> Labels: ...
def retime(
    labels: PhoneSequence | Labels, anchors: Sequence[tuple[float, float]]
) -> PhoneSequence | Labels:
    """Shift and stretch labels so that known moments come where they belong.

    Parameters
    ----------
    labels
        Phones, or labels as read.
    anchors
        Pairs of a time by the labels' clock and the same moment by the recording's, seconds. One
        pair shifts; between two, times are stretched evenly, and before the first and after the
        last as between the two nearest.

    Raises
    ------
    DataError
        If there is no pair, or they are not in one order by both clocks.
    """
    pairs = np.array(sorted(anchors), dtype=np.float64).reshape(-1, 2)
    ordered = bool(np.all(np.diff(pairs, axis=0) > 0))
    if not len(pairs) or not np.isfinite(pairs).all() or not ordered:
        raise DataError(
            "the anchor times cannot be used",
            found=[tuple(pair) for pair in pairs.tolist()],
            expected="pairs (label time, recording time), later by one clock, later by the other",
            advice="Leave out the pair that is wrong.",
        )
    if isinstance(labels, PhoneSequence):
        starts, ends = _moved(labels.starts, pairs), _moved(labels.ends, pairs)
        segments = tuple(
            dataclasses.replace(segment, start=float(start), end=float(end))
            for segment, start, end in zip(labels, starts, ends, strict=True)
        )
        return labels.replace(segments=segments).add_step("retime", {"anchors": pairs.tolist()})

    def moved(time: float) -> float:
        return float(_moved(np.array([time]), pairs)[0])

    tiers = []
    for tier in labels.tiers:
        entries = tuple(
            dataclasses.replace(entry, start=moved(entry.start), end=moved(entry.end))
            for entry in tier.entries
        )
        start = None if tier.start is None else moved(tier.start)
        end = None if tier.end is None else moved(tier.end)
        tiers.append(dataclasses.replace(tier, entries=entries, start=start, end=end))
    return dataclasses.replace(
        labels, tiers=tuple(tiers), start=moved(labels.start), end=moved(labels.end)
    )


def _moved(times: FloatArray, pairs: FloatArray) -> FloatArray:
    """Times `(n,)` by the recording's clock; `pairs` `(anchors, 2)`."""
    if len(pairs) == 1:
        shifted: FloatArray = times + (pairs[0, 1] - pairs[0, 0])
        return shifted
    before = np.clip(np.searchsorted(pairs[:, 0], times, side="right") - 1, 0, len(pairs) - 2)
    rates = np.diff(pairs[:, 1]) / np.diff(pairs[:, 0])
    stretched: FloatArray = pairs[before, 1] + (times - pairs[before, 0]) * rates[before]
    return stretched
