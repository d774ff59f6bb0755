"""Lips that meet where they should, which root mean squares do not show (Beskow section 5).

The gap is the largest opening along the whole lip line, from corner to corner. A bilabial stop or
nasal (`bilabial_stop` of `mocap_fit.phones.QUESTION_CLASSES`) is closed when the least gap within
its segment is at most a limit: `CLOSED` on a synthetic face; on measured speech `CLOSED_PART` of
the gap on open vowels, which is the median, over the vowels whose feature ``open`` is 0.7 or more,
of the largest gap within the segment, on the target tracks. One limit serves the target and every
model. An open vowel whose largest gap stays below the same limit touches, which is the opposite
fault. On a labiodental the lower lip comes within `CONTACT` of the edge of the upper teeth; where
the measured speaker seldom does, whose teeth no marker shows, as near as that speaker's median.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mocap_fit.face import Rig
from mocap_fit.face.lips import compute_lip_openings, compute_teeth_distance
from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

OPEN_VOWEL = 0.7
CLOSED = 0.5
"""Millimetres: lips of a synthetic face that are closed."""
CLOSED_PART = 0.1
CONTACT = 2.0
"""Millimetres from the lower lip to the teeth's edge; vertices of both rarely meet."""


@dataclass(frozen=True)
class LipEvent:
    """What the lips do on one phone.

    Parameters
    ----------
    phone
        The phone.
    start, end
        Its segment, seconds.
    gap
        Of a bilabial the least gap, of an open vowel the largest, of a labiodental the least
        distance of the lower lip from the upper teeth; millimetres.
    """

    phone: str
    start: float
    end: float
    gap: float


@dataclass(frozen=True)
class Share:
    """How many of several are as they should be.

    Parameters
    ----------
    hits, count
        Number of those, and of all.
    """

    hits: int
    count: int

    @property
    def value(self) -> float:
        """The share, 0 to 1; NaN of none."""
        return self.hits / self.count if self.count else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the share, 0 to 1; NaN of none."""
        if not self.count:
            return float("nan"), float("nan")
        from scipy.stats import binomtest

        low, high = binomtest(self.hits, self.count).proportion_ci(method="wilson")
        return float(low), float(high)


@dataclass(frozen=True)
class LipScores:
    """Whether lips meet where they should, and only there.

    Parameters
    ----------
    closed
        Of the bilabials.
    contact
        Of the labiodentals: those whose lower lip comes to the teeth.
    opened
        Of the open vowels: those that do not touch.
    speed
        The largest speed of the gap, millimetres a second; NaN where it is not known.
    """

    closed: Share
    contact: Share
    opened: Share
    speed: float

    def to_dict(self) -> dict[str, Any]:
        """Convert the scores to values that JSON can hold.

        Returns
        -------
        dict
            ``bilabials_closed``, ``labiodentals_touch`` and ``open_vowels_open`` with ``count``,
            ``value``, ``low`` and ``high`` (0 to 1), and ``largest_speed``, millimetres a second.
        """
        shares = {
            "bilabials_closed": self.closed,
            "labiodentals_touch": self.contact,
            "open_vowels_open": self.opened,
        }
        rows = {
            name: {
                "count": share.count,
                "value": share.value,
                "low": share.interval[0],
                "high": share.interval[1],
            }
            for name, share in shares.items()
        }
        return {**rows, "largest_speed": self.speed}


@dataclass(frozen=True)
class LipGaps:
    """What the lips do on the phones that show on them.

    Parameters
    ----------
    bilabials, labiodentals, open_vowels
        In the order of time. There are no labiodentals where the face has no teeth.
    speed
        The largest speed of the gap, millimetres a second.
    """

    bilabials: tuple[LipEvent, ...] = ()
    labiodentals: tuple[LipEvent, ...] = ()
    open_vowels: tuple[LipEvent, ...] = ()
    speed: float = float("nan")

    def compute_open_gap(self) -> float:
        """Compute the median gap on open vowels.

        Returns
        -------
        float
            Millimetres; NaN without any.
        """
        gaps = [event.gap for event in self.open_vowels]
        return float(np.median(gaps)) if gaps else float("nan")

    def compute_contact(self) -> float:
        """Compute how near a lip is that is at the teeth, from those of a measured speaker.

        Returns
        -------
        float
            Millimetres: the median over labiodentals, and at least `CONTACT`.
        """
        distances = [event.gap for event in self.labiodentals]
        return max(CONTACT, float(np.median(distances))) if distances else CONTACT

    def score(self, limit: float, contact: float = CONTACT) -> LipScores:
        """Count the phones on which the lips do as they should.

        Parameters
        ----------
        limit
            The gap of lips that are closed, millimetres; NaN where it is not known.
        contact
            The distance of a lower lip that is at the teeth, millimetres.

        Returns
        -------
        LipScores
            The counts; bilabials and open vowels count only where the limit is known.
        """
        known = bool(np.isfinite(limit))
        closed = [event.gap <= limit for event in self.bilabials if known]
        opened = [event.gap > limit for event in self.open_vowels if known]
        touching = [event.gap <= contact for event in self.labiodentals]
        shares = [Share(sum(hits), len(hits)) for hits in (closed, touching, opened)]
        return LipScores(shares[0], shares[1], shares[2], self.speed)


def measure_gaps(
    rig: Rig, values: FloatArray, times: FloatArray, phones: PhoneSequence, phone_set: PhoneSet
) -> LipGaps:
    """Measure the lips on the bilabials, labiodentals and open vowels of an utterance.

    Parameters
    ----------
    rig
        The face.
    values
        Its parameters, ``(frames, parameters)``, no unit.
    times
        ``(frames,)``, seconds, ascending and evenly spaced.
    phones
        Phones of the utterance. A segment in which there is no frame has the nearest (both, if two
        are as near), at most half a frame away. Segments without a frame that has a value do not
        count.
    phone_set
        Their phone set.

    Returns
    -------
    LipGaps
        In the order of the segments.
    """
    gaps = compute_lip_openings(rig, values).max(axis=1)
    distances = compute_teeth_distance(rig, values)
    events: tuple[list[LipEvent], list[LipEvent], list[LipEvent]] = ([], [], [])
    half = 0.5 * float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    for segment in phones:
        phone = phone_set.get_phone(segment)
        classes = phone.get_classes()
        if "bilabial_stop" in classes:
            kind, measured, choose = 0, gaps, np.min
        elif "labiodental" in classes:
            kind, measured, choose = 1, distances, np.min
        elif phone.kind == "vowel" and phone.values["open"] >= OPEN_VOWEL:
            kind, measured, choose = 2, gaps, np.max
        else:
            continue
        first, last = np.searchsorted(times, [segment.start, segment.end])
        chosen = slice(first, last)
        if first == last and len(times):
            apart = np.maximum(segment.start - times, times - segment.end)
            # Two that are as near as each other both count.
            chosen = apart <= min(apart.min(), half) + 1e-6 * half
        inside = measured[chosen]
        inside = inside[np.isfinite(inside)]
        if inside.size:
            gap = float(choose(inside))
            events[kind].append(LipEvent(segment.phone, segment.start, segment.end, gap))
    speeds = np.abs(np.diff(gaps) / np.diff(times))
    speeds = speeds[np.isfinite(speeds)]
    speed = float(speeds.max()) if speeds.size else float("nan")
    bilabials, labiodentals, vowels = map(tuple, events)
    return LipGaps(bilabials, labiodentals, vowels, speed)


def concatenate_gaps(parts: Sequence[LipGaps]) -> LipGaps:
    """Concatenate the gaps of several utterances.

    Parameters
    ----------
    parts
        One an utterance.

    Returns
    -------
    LipGaps
        In the same order, with the largest speed of all.
    """
    speeds = [part.speed for part in parts if np.isfinite(part.speed)]
    return LipGaps(
        tuple(event for part in parts for event in part.bilabials),
        tuple(event for part in parts for event in part.labiodentals),
        tuple(event for part in parts for event in part.open_vowels),
        max(speeds, default=float("nan")),
    )
