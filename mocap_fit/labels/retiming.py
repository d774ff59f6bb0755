"""Transfer labels and phones from one clock to another by known moments."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TypeVar, overload

import numpy as np

from mocap_fit.errors import DataError
from mocap_fit.labels.types import Label, Labels, Tier
from mocap_fit.phones import PhoneSequence
from mocap_fit.tracks import FloatArray

_Part = TypeVar("_Part", Label, Tier, Labels)


@overload
def retime(labels: PhoneSequence, anchors: Sequence[tuple[float, float]]) -> PhoneSequence: ...
@overload
def retime(labels: Labels, anchors: Sequence[tuple[float, float]]) -> Labels: ...
def retime(
    labels: PhoneSequence | Labels, anchors: Sequence[tuple[float, float]]
) -> PhoneSequence | Labels:
    """Shift and stretch labels from their clock to that of the recording.

    Parameters
    ----------
    labels
        Phones, or labels as read.
    anchors
        Pairs of a time by the clock of the labels and the same moment by that of the recording,
        seconds. One pair shifts; between two pairs times are interpolated linearly, and before
        the first and after the last they are extrapolated.

    Returns
    -------
    PhoneSequence or Labels
        The same labels by the clock of the recording.

    Raises
    ------
    DataError
        If there is no pair, or their order differs between the clocks.
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
        starts, ends = _retime_times(labels.starts, pairs), _retime_times(labels.ends, pairs)
        segments = tuple(
            dataclasses.replace(segment, start=float(start), end=float(end))
            for segment, start, end in zip(labels, starts, ends, strict=True)
        )
        return labels.replace(segments=segments).add_step("retime", {"anchors": pairs.tolist()})

    def retime_ends(part: _Part) -> _Part:
        ends = {name: getattr(part, name) for name in ("start", "end")}
        known = {name: np.array([time]) for name, time in ends.items() if time is not None}
        changes = {name: float(_retime_times(time, pairs)[0]) for name, time in known.items()}
        return dataclasses.replace(part, **changes)  # type: ignore[arg-type]

    tiers = []
    for tier in labels.tiers:
        entries = tuple(retime_ends(entry) for entry in tier.entries)
        tiers.append(dataclasses.replace(retime_ends(tier), entries=entries))
    return dataclasses.replace(retime_ends(labels), tiers=tuple(tiers))


def _retime_times(times: FloatArray, pairs: FloatArray) -> FloatArray:
    """Return times, ``(times,)``, by the second clock of pairs, ``(anchors, 2)``."""
    if len(pairs) == 1:
        return np.asarray(times + (pairs[0, 1] - pairs[0, 0]))
    before = np.clip(np.searchsorted(pairs[:, 0], times, side="right") - 1, 0, len(pairs) - 2)
    rates = np.diff(pairs[:, 1]) / np.diff(pairs[:, 0])
    return np.asarray(pairs[before, 1] + (times - pairs[before, 0]) * rates[before])
