"""Lip closure on bilabials: what root mean squares do not see (Beskow section 5).

A bilabial stop or nasal (`bilabial_stop` of `mocap_fit.phones.QUESTION_CLASSES`) is closed when
the least inner gap of the lips within its segment is under 10 % of the gap on open vowels: the
median, over the vowels whose feature ``open`` is 0.7 or more, of the largest gap within the
segment, on the target tracks. One threshold serves the target and every model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mocap_fit.face import Rig, compute_lip_gap
from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

OPEN_VOWEL = 0.7
CLOSED_PART = 0.1


@dataclass(frozen=True, eq=False)
class Gaps:
    """Lip gaps of the segments that matter, in millimetres.

    Parameters
    ----------
    bilabials
        The least gap within each bilabial.
    open_vowels
        The largest gap within each open vowel.
    """

    bilabials: FloatArray
    open_vowels: FloatArray

    def open_gap(self) -> float:
        """The median gap on open vowels; NaN without any."""
        return float(np.median(self.open_vowels)) if self.open_vowels.size else float("nan")

    def closed(self, open_gap: float) -> float:
        """Part of the bilabials that are closed, 0 to 1; NaN without any."""
        if not self.bilabials.size or not np.isfinite(open_gap):
            return float("nan")
        return float(np.mean(self.bilabials < CLOSED_PART * open_gap))


def segment_gaps(
    rig: Rig, values: FloatArray, times: FloatArray, phones: PhoneSequence, phone_set: PhoneSet
) -> Gaps:
    """Lip gaps on the bilabials and open vowels of an utterance.

    Parameters
    ----------
    rig
        The face; its parameters are those of the values.
    values, times
        `(frames, parameters)` and `(frames,)`.
    phones, phone_set
        Its phones. Segments without a frame that has a value do not count.
    """
    at = phones.at(times)
    kinds: list[int] = []
    for segment in phones:
        phone = phone_set.get_phone(segment)
        bilabial = "bilabial_stop" in phone.get_classes()
        is_open = phone.kind == "vowel" and phone.values["open"] >= OPEN_VOWEL
        kinds.append(1 if bilabial else 2 if is_open else 0)
    wanted = np.array([*kinds, 0])[at] > 0
    gaps = np.full(len(times), np.nan)
    gaps[wanted] = compute_lip_gap(rig, values[wanted])
    found: dict[int, list[float]] = {1: [], 2: []}
    for i, kind in enumerate(kinds):
        own = gaps[at == i] if kind else gaps[:0]
        own = own[np.isfinite(own)]
        if own.size:
            found[kind].append(float(own.min() if kind == 1 else own.max()))
    return Gaps(np.array(found[1]), np.array(found[2]))


def together(parts: list[Gaps]) -> Gaps:
    """The gaps of several utterances as one."""
    empty = np.zeros(0)
    return Gaps(
        np.concatenate([empty, *(part.bilabials for part in parts)]),
        np.concatenate([empty, *(part.open_vowels for part in parts)]),
    )
