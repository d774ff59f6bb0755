"""Speak texts with espeak-ng: their sound, and their phones in time.

espeak-ng is a GPL program. It comes with the extra ``speech`` (espeakng-loader) and runs in a
separate process, which speaks a text and reports when each phone began. Its phones, in IPA, are
mapped to a phone set.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from mocap_fit.errors import ConfigurationError, DataError, MissingExtraError, MocapFitWarning
from mocap_fit.phones import (
    PhoneSegment,
    PhoneSequence,
    PhoneSet,
    load_phone_set,
    map_phones,
    normalise_phones,
)
from mocap_fit.sound import Sound
from mocap_fit.synthesis.espeak_ipa import STRESS, clean_name, split_name
from mocap_fit.synthesis.espeak_voices import LANGUAGES, SYLLABIC, find_voice
from mocap_fit.tracks import FloatArray

# A pause shorter than this is the closure of the stop after it, or none at all.
_SHORTEST_PAUSE = 0.09
# The share of a sound that belongs to a phone which is merged into its end.
_MERGED = 0.35
# Times are rounded to a hundredth of a millisecond, less than half a sample.
_DECIMALS = 5
_STRESS_MARKS = "".join(STRESS)
# Words a minute.
_SLOWEST, _FASTEST = 80, 450
_PUNCTUATION = re.compile(r"^[^\w]+|[^\w]+$")


@dataclass(frozen=True, eq=False)
class SpokenText:
    """A text that was spoken.

    Parameters
    ----------
    text
        The text.
    sound
        Its sound, one channel.
    phones
        Its phones from 0 to the sound's end, silence included.
    """

    text: str
    sound: Sound
    phones: PhoneSequence


class TextSpeaker:
    """A voice that speaks texts.

    Parameters
    ----------
    language
        A tag of the language, such as ``sv``, ``no`` or ``pt-BR``, or a voice of espeak-ng.
    phone_set
        The phone set of the phones; that of the language if None.
    words_per_minute
        Speed, 80 to 450 words a minute.
    silence
        Duration of the silence before and after, seconds.

    Raises
    ------
    MissingExtraError
        If espeakng-loader is not installed.
    ConfigurationError
        If the speed or the silence is out of range.
    """

    def __init__(
        self,
        language: str,
        *,
        phone_set: PhoneSet | str | Path | None = None,
        words_per_minute: float = 160.0,
        silence: float = 0.25,
    ) -> None:
        if find_spec("espeakng_loader") is None:
            raise MissingExtraError(
                "speaking a text needs espeak-ng, which is not installed",
                advice="Run: pip install 'mocap-fit[speech]'",
            )
        if not _SLOWEST <= words_per_minute <= _FASTEST or not silence >= 0:
            raise ConfigurationError(
                "the voice cannot speak like this",
                found=f"{words_per_minute} words a minute, silence of {silence} s",
                expected=f"{_SLOWEST} to {_FASTEST} words a minute, silence of 0 s or more",
            )
        self.voice = find_voice(language)
        chosen = self.voice.phone_set if phone_set is None else phone_set
        self.phone_set = chosen if isinstance(chosen, PhoneSet) else load_phone_set(chosen)
        self._ipa = load_phone_set("ipa")
        self.words_per_minute = float(words_per_minute)
        self.silence = float(silence)

    def speak(
        self,
        text: str,
        *,
        name: str = "",
        words_per_minute: float | None = None,
        silence: float | None = None,
    ) -> SpokenText:
        """Speak a text.

        Parameters
        ----------
        text
            One or more sentences.
        name
            Name of the utterance.
        words_per_minute
            Speed, 80 to 450 words a minute; that of the speaker if None.
        silence
            Duration of the silence before and after, seconds; that of the speaker if None.

        Returns
        -------
        SpokenText
            Its sound and its phones.

        Raises
        ------
        ConfigurationError
            If espeak-ng has no such voice.
        DataError
            If there is nothing to say in the text, or the phone set lacks sounds of it.

        Warns
        -----
        MocapFitWarning
            If the voice has sounds that are not IPA; the nearest phones are taken.
        """
        speed = self.words_per_minute if words_per_minute is None else words_per_minute
        # Bytes of the command line that are not text.
        text = text.encode("utf-8", "replace").decode("utf-8")
        marked = self.voice.mark_syllabic(text)
        answer, samples = self._run_espeak(marked, round(speed))
        rate = float(answer["rate"])
        pad = np.zeros(round((self.silence if silence is None else silence) * rate))
        sound = Sound(np.concatenate([pad, samples, pad]), rate, name=name)
        segments: list[tuple[PhoneSegment, int]] = []
        events = [event for event in map(_clean_event, answer["events"]) if event]
        positions = [position - 1 for kind, _, position, *_ in events if kind == "word"]
        words = [word.replace(SYLLABIC, "") for word in _match_words(positions, marked)]
        unknown: dict[str, str] = {}
        for start, end, spoken, number in _list_spoken(events, len(samples)):
            word = words[number] if number >= 0 else ""
            for first, last, phone, stress in self._split_spoken(start, end, spoken, unknown):
                begin = round((first + len(pad)) / rate, _DECIMALS)
                finish = round((last + len(pad)) / rate, _DECIMALS)
                if begin < finish:
                    segments.append((PhoneSegment(begin, finish, phone, stress, word), number))
        if not any(segment.word for segment, _ in segments):
            raise DataError(
                f"there is nothing to say in the text for the voice '{self.voice.name}'",
                found=repr(text),
                advice="Give words in the language and the script of the voice. Some voices of "
                "espeak-ng have no dictionary, and are silent.",
            )
        if unknown:
            replaced = ", ".join(f"'{name}' as '{phone}'" for name, phone in unknown.items())
            warnings.warn(
                f"the voice '{self.voice.name}' has sounds that are not IPA; they are taken for "
                f"the nearest phones: {replaced}",
                MocapFitWarning,
                stacklevel=2,
            )
        merged = self._merge_pairs(segments)
        phones = PhoneSequence(tuple(merged), phone_set="ipa", name=name)
        if self.phone_set.name == self._ipa.name:
            phones = normalise_phones(phones, self.phone_set)
        else:
            phones = map_phones(phones, self.phone_set, nearest=True)
        phones = _fill_silence(phones, self.phone_set.silence, sound.duration)
        return SpokenText(text, sound, phones)

    def _run_espeak(self, text: str, speed: int) -> tuple[dict[str, Any], FloatArray]:
        """Return the answer of espeak-ng, and its samples as part of full scale."""
        answer, raw = _run_process(self.voice.name, text, speed)
        if "error" in answer:
            raise ConfigurationError(
                f"espeak-ng has no voice '{self.voice.name}'",
                expected=", ".join([*LANGUAGES, *answer["voices"]]),
                advice="Name the language by its tag, such as de or en-gb.",
            )
        if answer["is_cut"]:
            raise DataError(
                "the text is too long to be spoken at once",
                found=f"{len(text)} characters",
                expected=f"at most {answer['samples'] / answer['rate'] / 60:.0f} minutes of speech",
                advice="Give it in parts.",
            )
        return answer, np.frombuffer(raw, dtype="<i2").astype(np.float64) / 32768.0

    def _split_spoken(
        self, start: int, end: int, spoken: str, unknown: dict[str, str]
    ) -> list[tuple[int, int, str, int | None]]:
        """Return start and end (samples), phone and stress of the phones of one event.

        What is not understood is added to the unknown ones.
        """
        name = spoken.lstrip(_STRESS_MARKS)
        if not name:
            return [(start, end, "sil", None)]
        name = self.voice.replacements.get(name, name)
        if len(name) > 1:
            # A vowel with its r is one event, and two phones.
            name = name.replace("ɹ", " ɹ ")
        parts, others = split_name(name, self._ipa)
        unknown.update(others)
        edges = np.linspace(start, end, len(parts) + 1).round().astype(int).tolist()
        phones = []
        for part, first, last in zip(parts, edges[:-1], edges[1:], strict=True):
            phone = self._ipa.parse(part)
            vowel = phone is not None and self._ipa.get_phone(phone[0]).takes_stress
            phones.append((first, last, part, STRESS.get(spoken[0], 0) if vowel else None))
        return phones

    def _merge_pairs(self, segments: list[tuple[PhoneSegment, int]]) -> list[PhoneSegment]:
        """Replace pairs of sounds in a word by what they are in the language of the voice."""
        merged: list[PhoneSegment] = []
        word = -1
        for segment, number in segments:
            # Not by what is written: a word may come twice.
            before = merged[-1] if number == word and merged else None
            replacement = before and self.voice.pairs.get((before.phone, segment.phone))
            if before is not None and replacement:
                merged.pop()
                first, _, second = replacement.partition(" ")
                if second:
                    merged.append(dataclasses.replace(before, phone=first))
                    segment = dataclasses.replace(segment, phone=second)
                else:
                    segment = dataclasses.replace(segment, start=before.start, phone=first)
            merged.append(segment)
            word = number
        return merged


def speak_text(
    text: str,
    language: str = "en",
    *,
    phone_set: PhoneSet | str | Path | None = None,
    words_per_minute: float = 160.0,
    silence: float = 0.25,
    name: str = "",
) -> SpokenText:
    """Speak a text and return its sound and its phones in time.

    Parameters
    ----------
    text
        One or more sentences.
    language
        A tag of the language, such as ``sv``, ``no`` or ``pt-BR``, or a voice of espeak-ng.
    phone_set
        The phone set of the phones; that of the language if None, IPA for other voices.
    words_per_minute
        Speed, 80 to 450 words a minute.
    silence
        Duration of the silence before and after, seconds.
    name
        Name of the utterance.

    Returns
    -------
    SpokenText
        Its sound and its phones.

    Raises
    ------
    MissingExtraError
        If the extra ``speech`` is not installed.
    ConfigurationError
        If espeak-ng has no such voice, or cannot speak so fast.
    DataError
        If there is nothing to say in the text, or the phone set lacks sounds of it.
    """
    speaker = TextSpeaker(
        language, phone_set=phone_set, words_per_minute=words_per_minute, silence=silence
    )
    return speaker.speak(text, name=name)


def list_voices() -> tuple[str, ...]:
    """Return the tags of the languages that espeak-ng speaks.

    Returns
    -------
    tuple of str
        The tags, sorted; one voice may have several.
    """
    answer, _ = _run_process("", "", _SLOWEST)
    return tuple(answer["voices"])


def _run_process(voice: str, text: str, speed: int) -> tuple[dict[str, Any], bytes]:
    """Return the answer of espeak-ng, and its samples."""
    script = Path(__file__).with_name("espeak_process.py")
    request = {"voice": voice, "text": text.replace("\0", " "), "speed": speed}
    process = subprocess.run(
        [sys.executable, str(script)],
        input=json.dumps(request).encode(),
        capture_output=True,
        check=False,
    )
    line, _, raw = process.stdout.partition(b"\n")
    if process.returncode or not line:
        last = process.stderr.decode("utf-8", "replace").strip().rpartition("\n")[2]
        raise DataError(
            f"espeak-ng has ended without an answer with the voice '{voice}'",
            found=last or f"status {process.returncode}",
            advice="Try another voice. Where all end so, install espeakng-loader again.",
        )
    answer: dict[str, Any] = json.loads(line)
    return answer, raw


def _clean_event(event: list[Any]) -> list[Any] | None:
    """Return an event without what is no sound in it; None where nothing is left."""
    name = clean_name(event[-1])
    return [*event[:-1], name] if event[0] == "word" or name or not event[-1] else None


def _list_spoken(events: list[list[Any]], samples: int) -> list[tuple[int, int, str, int]]:
    """Return start and end (samples), sound and number of the word of each event.

    Pauses have no sound, and -1 for the word.
    """
    word = -1
    starts: list[tuple[int, str, int]] = []
    for kind, sample, _, _, name in events:
        if kind == "word":
            word += 1
        else:
            starts.append((sample, name, word if name.lstrip(_STRESS_MARKS) else -1))
    starts = _order_starts(starts, samples)
    ends = [start for start, _, _ in starts[1:]] + [samples]
    spoken: list[tuple[int, int, str, int]] = []
    for (start, name, word), end in zip(starts, ends, strict=True):
        if start == end and name and spoken and spoken[-1][2]:
            # An l after a vowel is part of the vowel's event, and is reported at its end.
            first, _, vowel, its_word = spoken[-1]
            start = round(end - _MERGED * (end - first))
            spoken[-1] = first, start, vowel, its_word
        spoken.append((start, end, name, word))
    return spoken


def _order_starts(starts: list[tuple[int, str, int]], samples: int) -> list[tuple[int, str, int]]:
    """Return sounds in order of their starts, which those of fast speech are not always in.

    Where the first of those that begin together follows no sound, they share the time until the
    next.
    """
    times = np.maximum.accumulate([min(start, samples) for start, _, _ in starts] + [samples])
    first = 0
    for i in range(1, len(times)):
        if times[i] == times[first]:
            continue
        if i - first > 1 and starts[first][1] and not (first and starts[first - 1][1]):
            times[first:i] = np.linspace(times[first], times[i], i - first, endpoint=False)
        first = i
    return [(int(t), name, word) for t, (_, name, word) in zip(times[:-1], starts, strict=True)]


def _match_words(positions: list[int], text: str) -> Iterator[str]:
    """Yield what is written at each of the positions where espeak-ng reports a word.

    It speaks small words together with their neighbours ("in the"), and at times counts one
    character too many or too few: from the beginning of a word to the next position is one word.
    """
    spans = [match.span() for match in re.finditer(r"\S+", text)]
    begins = np.array([start for start, _ in spans], dtype=np.int64)
    ends = np.array([end for _, end in spans], dtype=np.int64)
    first = [int(np.searchsorted(ends, position, side="right")) for position in positions]
    first = [max(0, min(index, len(spans) - 1)) for index in first]
    for index, following in itertools.pairwise([*first, len(spans)]):
        last = max(index, following - 1)
        yield " ".join(
            bare
            for word in text[begins[index] : ends[last]].split()
            if (bare := _PUNCTUATION.sub("", word))
        )


def _fill_silence(phones: PhoneSequence, silence: str, duration: float) -> PhoneSequence:
    """Extend phones from 0 to the end; short pauses join the next phone, long ones each other."""
    segments: list[PhoneSegment] = []
    for segment in phones:
        if segments and segments[-1].phone == silence:
            before = segments[-1]
            short = len(segments) > 1 and segment.start - before.start < _SHORTEST_PAUSE
            if segment.phone == silence or short:
                segments.pop()
                segment = dataclasses.replace(segment, start=before.start)
        segments.append(segment)
    first, last = segments[0], segments[-1]
    if first.phone == silence:
        segments[0] = PhoneSegment(0.0, first.end, silence)
    elif first.start > 0:
        segments.insert(0, PhoneSegment(0.0, first.start, silence))
    if last.phone == silence:
        segments[-1] = PhoneSegment(segments[-1].start, duration, silence)
    elif last.end < duration:
        segments.append(PhoneSegment(last.end, duration, silence))
    return phones.replace(segments=tuple(segments))
