"""Checks of labels: their times, their symbols, and whether they fit recording and sound."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from corpus_tools.validation.findings import Evidence, Finding, Location
from corpus_tools.validation.thresholds import Thresholds
from mocap_fit.errors import shorten
from mocap_fit.labels import Label, Labels, Tier, find_label_faults
from mocap_fit.phones import PhoneSet
from mocap_fit.tracks import FloatArray

_CODES = {
    "overlap": "MF201",
    "order": "MF202",
    "no duration": "MF203",
    "negative duration": "MF203",
}
_SHOWN = 5


@dataclass(frozen=True, eq=False)
class Loudness:
    """Energy of a sound over time.

    Parameters
    ----------
    times
        Times, ``(points,)``, seconds.
    energy_db
        Energy, ``(points,)``, decibels.
    """

    times: FloatArray
    energy_db: FloatArray


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What labels are compared with.

    Parameters
    ----------
    phone_set
        The phone set; None where it is not known.
    recorded
        First and last time of the recording, seconds; None without one.
    sound_end
        End of the sound, seconds; None without a sound.
    loudness
        Loudness of the sound; None without one.
    """

    phone_set: PhoneSet | None = None
    recorded: tuple[float, float] | None = None
    sound_end: float | None = None
    loudness: Loudness | None = None


def check_phone_tier(
    tier: Tier, around: Surroundings, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    """Find what is wrong with the labels of an utterance's phones.

    Parameters
    ----------
    tier
        Intervals, in the order of the file.
    around
        What they are compared with.
    location
        The file and the utterance.
    limits
        What counts as wrong.

    Yields
    ------
    Finding
        What is wrong.
    """
    if tier.kind != "interval" or not any(entry.text.strip() for entry in tier.entries):
        text = f"{len(tier.entries)} labels, none with a symbol"
        yield Finding("MF210", location, text, "phones")
        return
    yield from _check_times(tier, location, limits)
    yield from _check_symbols(tier, around, location)
    yield from _check_durations(tier, around, location, limits)
    yield from _check_extent(tier, around, location, limits)
    if around.loudness is not None and around.phone_set is not None:
        yield from _check_silences(tier, around.phone_set, around.loudness, location, limits)


def _check_times(tier: Tier, location: Location, limits: Thresholds) -> Iterator[Finding]:
    entries = tier.entries
    start = min(entry.start for entry in entries)
    end = max(entry.end for entry in entries)
    for fault in find_label_faults(Labels((tier,), start, end)):
        code = _CODES.get(fault.kind)
        length = fault.end - fault.start
        where = location.at(fault.text or "(empty)", seconds=(fault.start, fault.end))
        if fault.kind == "gap" and fault.entry and length > limits.labels.gap:
            before = entries[fault.entry - 1].text
            between = f"between {before} and {fault.text}"
            text = f"nothing is labelled for {length:.3f} s"
            expected = f"less than {limits.labels.gap} s"
            yield Finding("MF205", dataclasses.replace(where, item=between), text, expected)
        elif code == "MF201" and length < limits.labels.rounding:
            continue
        elif code is not None:
            text = f"{fault.kind} (entry {fault.entry + 1} of '{tier.name}')"
            yield Finding(code, where, text, "each to begin where the one before has ended")


def _check_symbols(tier: Tier, around: Surroundings, location: Location) -> Iterator[Finding]:
    phones = around.phone_set
    if phones is None:
        return
    unknown: dict[str, list[Label]] = {}
    for entry in tier.entries:
        if phones.parse(entry.text) is None:
            unknown.setdefault(entry.text, []).append(entry)
    for text, entries in unknown.items():
        first = entries[0]
        more = f", {len(entries)} times" if len(entries) > 1 else ""
        where = location.at(shorten(text, 40), seconds=(first.start, first.end))
        yield Finding(
            "MF207", where, f"'{shorten(text, 40)}'{more}", f"a symbol of '{phones.name}'"
        )


def _is_silence(entry: Label, phones: PhoneSet | None) -> bool:
    text = entry.text.strip()
    if not text:
        return True
    parsed = None if phones is None else phones.parse(text)
    if phones is None or parsed is None:
        return text.casefold() in ("sil", "sp", "#", "_", "<p:>", "h#", "pau")
    return phones.is_silence(parsed[0])


def _check_durations(
    tier: Tier, around: Surroundings, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    for entry in tier.entries:
        length = entry.end - entry.start
        if length <= 0 or _is_silence(entry, around.phone_set):
            continue
        where = location.at(entry.text, seconds=(entry.start, entry.end))
        if length > limits.labels.longest_phone:
            expected = f"at most {limits.labels.longest_phone} s"
            yield Finding("MF208", where, f"{length:.3f} s", expected)
        elif length < limits.labels.shortest_phone - 1e-9:
            expected = f"at least {limits.labels.shortest_phone} s"
            yield Finding("MF209", where, f"{length:.4f} s", expected)


def _check_extent(
    tier: Tier, around: Surroundings, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    entries = [entry for entry in tier.entries if entry.end > entry.start]
    if not entries:
        return
    start, end = min(e.start for e in entries), max(e.end for e in entries)
    recorded, rules = around.recorded, limits.labels
    # Silence may be labelled after the last frame, but not after the sound, or what the file
    # itself says that it covers.
    reach, what = around.sound_end, "sound"
    if reach is None:
        reach, what = tier.end, "file, as it says itself,"
    beyond = [] if reach is None else [e for e in entries if e.end > reach + rules.end]
    if beyond:
        where = location.at(_format_entries(beyond), seconds=(beyond[0].start, end))
        text = f"{len(beyond)} labels, until {end:.3f} s"
        yield Finding("MF204", where, text, f"the {what} ends at {reach:.3f} s")
    if start < -rules.end:
        where = location.at(entries[0].text, seconds=(start, 0.0))
        yield Finding("MF204", where, f"labels from {start:.3f} s", "none before 0 s")
    if recorded is None:
        return
    outside = [
        e
        for e in entries
        if not _is_silence(e, around.phone_set)
        and (e.end < recorded[0] - rules.end or e.start > recorded[1] + rules.end)
        and e not in beyond
    ]
    if outside:
        where = location.at(_format_entries(outside), seconds=(outside[0].start, outside[-1].end))
        text = f"{len(outside)} phones"
        yield Finding("MF212", where, text, f"frames from {recorded[0]:.3f} to {recorded[1]:.3f} s")
    duration = recorded[1] - recorded[0]
    inside = sum(max(0.0, min(e.end, recorded[1]) - max(e.start, recorded[0])) for e in entries)
    if duration > 0 and inside < rules.covered * duration:
        where = location.at("", seconds=(start, end))
        text = f"{inside:.2f} of {duration:.2f} s are labelled"
        yield Finding("MF206", where, text, f"{rules.covered:.0%} or more")


def _format_entries(entries: Sequence[Label]) -> str:
    texts = [entry.text or "(empty)" for entry in entries[:_SHOWN]]
    return ", ".join(texts) + (" …" if len(entries) > _SHOWN else "")


def _check_silences(
    tier: Tier, phones: PhoneSet, loudness: Loudness, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    times, energy = loudness.times, loudness.energy_db
    silent = np.zeros(len(times), dtype=bool)
    spoken = np.zeros(len(times), dtype=bool)
    silences: list[Label] = []
    merged = _merge_silences(tier.entries, phones)
    for entry, quiet in merged:
        inside = (times >= entry.start) & (times < entry.end)
        if quiet:
            silent |= inside
            silences.append(entry)
        elif phones.parse(entry.text) and phones.is_vowel(entry.text):
            spoken |= inside
    if not silent.any() or not spoken.any():
        return
    # Speech's level over its vowels; the quietest of the silences is the room.
    speech = float(np.median(energy[spoken]))
    noise = float(np.quantile(energy[silent], 0.1))
    if speech - noise < 2 * limits.labels.loud_silence:
        return
    limit = speech - limits.labels.loud_silence
    step = float(times[1] - times[0]) if len(times) > 1 else 0.0
    for entry in silences:
        if entry.end - entry.start < limits.labels.loud_time:
            continue
        # Boundaries are never exact: the ends of a silence may be loud.
        inside = (times >= entry.start + 0.03) & (times < entry.end - 0.03)
        loud = inside & (energy > limit)
        if loud.sum() * step >= limits.labels.loud_time:
            around = (times >= entry.start - 0.2) & (times < entry.end + 0.2)
            where = location.at(entry.text or "(empty)", seconds=(entry.start, entry.end))
            above = f"for {loud.sum() * step:.2f} s above {limit:.0f} dB"
            text = f"{float(np.max(energy[loud])):.0f} dB, {above}"
            expected = f"silence; speech has {speech:.0f} dB, the room {noise:.0f} dB"
            picture = Evidence(times[around], {"energy": energy[around]}, "dB")
            yield Finding("MF211", where, text, expected, evidence=picture)


def _merge_silences(entries: Sequence[Label], phones: PhoneSet) -> list[tuple[Label, bool]]:
    """Labels with neighbouring silences as one."""
    result = []
    for quiet, group in itertools.groupby(entries, key=lambda entry: _is_silence(entry, phones)):
        members = list(group)
        if quiet:
            first, last = members[0], members[-1]
            members = [Label(first.start, max(last.end, first.start), first.text)]
        result += [(member, quiet) for member in members]
    return result
