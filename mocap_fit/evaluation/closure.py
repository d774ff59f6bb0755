"""Lip closure on bilabials, which root mean squares do not show (Beskow section 5).

A bilabial stop or nasal (`bilabial_stop` of `mocap_fit.phones.QUESTION_CLASSES`) is closed when
the least inner gap of the lips within its segment is under 10 % of the gap on open vowels: the
median, over the vowels whose feature ``open`` is 0.7 or more, of the largest gap within the
segment, on the target tracks. One threshold serves the target and every model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mocap_fit.face import Rig, compute_lip_gap
from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

OPEN_VOWEL = 0.7
CLOSED_PART = 0.1


@dataclass(frozen=True, eq=False)
class LipGaps:
    """Lip gaps of bilabials and of open vowels.

    Parameters
    ----------
    bilabials
        The least gap within each bilabial, ``(bilabials,)``, millimetres.
    open_vowels
        The largest gap within each open vowel, ``(vowels,)``, millimetres.
    """

    bilabials: FloatArray
    open_vowels: FloatArray

    def compute_open_gap(self) -> float:
        """Compute the median gap on open vowels.

        Returns
        -------
        float
            Millimetres; NaN without any.
        """
        return float(np.median(self.open_vowels)) if self.open_vowels.size else float("nan")

    def compute_closed_share(self, open_gap: float) -> float:
        """Compute the part of the bilabials that are closed.

        Parameters
        ----------
        open_gap
            The gap on open vowels, millimetres.

        Returns
        -------
        float
            0 to 1; NaN without bilabials or open gap.
        """
        if not self.bilabials.size or not np.isfinite(open_gap):
            return float("nan")
        return float(np.mean(self.bilabials < CLOSED_PART * open_gap))


def measure_gaps(
    rig: Rig, values: FloatArray, times: FloatArray, phones: PhoneSequence, phone_set: PhoneSet
) -> LipGaps:
    """Measure the lip gaps on the bilabials and open vowels of an utterance.

    Parameters
    ----------
    rig
        The face.
    values
        Its parameters, ``(frames, parameters)``, no unit.
    times
        ``(frames,)``, seconds.
    phones
        Phones of the utterance. Segments without a frame that has a value do not count.
    phone_set
        Their phone set.

    Returns
    -------
    LipGaps
        In the order of the segments.
    """
    at = phones.at(times)
    is_bilabial, is_open = [], []
    for segment in phones:
        phone = phone_set.get_phone(segment)
        is_bilabial.append("bilabial_stop" in phone.get_classes())
        is_open.append(phone.kind == "vowel" and phone.values["open"] >= OPEN_VOWEL)
    counts = np.array([*np.logical_or(is_bilabial, is_open), False])[at]
    gaps = np.full(len(times), np.nan)
    gaps[counts] = compute_lip_gap(rig, values[counts])
    least: list[float] = []
    largest: list[float] = []
    for i in range(len(phones)):
        inside = gaps[(at == i) & np.isfinite(gaps)]
        if inside.size and is_bilabial[i]:
            least.append(float(inside.min()))
        elif inside.size:
            largest.append(float(inside.max()))
    return LipGaps(np.array(least), np.array(largest))


def concatenate_gaps(parts: Sequence[LipGaps]) -> LipGaps:
    """Concatenate the gaps of several utterances.

    Parameters
    ----------
    parts
        One an utterance.

    Returns
    -------
    LipGaps
        In the same order.
    """
    empty = np.zeros(0)
    return LipGaps(
        np.concatenate([empty, *(part.bilabials for part in parts)]),
        np.concatenate([empty, *(part.open_vowels for part in parts)]),
    )
