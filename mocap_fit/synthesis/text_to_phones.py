"""From text to sound and phones in time, by espeak-ng.

espeak-ng is a GPL program. It comes with the extra ``speech`` (espeakng-loader) and runs in a
process of its own, which speaks a text and says when each phone began. Its phones, in IPA, are
written in a phone set of ours.
"""

from __future__ import annotations

import dataclasses
import json
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from mocap_fit.errors import ConfigurationError, DataError, MissingExtraError
from mocap_fit.phones import (
    PhoneSegment,
    PhoneSequence,
    PhoneSet,
    load_phone_set,
    map_phones,
    normalise_phones,
)
from mocap_fit.sound import Sound

# A pause shorter than this is the closure of the stop after it, or none at all.
_SHORTEST_PAUSE = 0.09
# The part of a sound that belongs to a phone which is merged into its end.
_MERGED = 0.35
# Times are given to a hundredth of a millisecond, less than half a sample.
_DECIMALS = 5
_STRESS = {"ˈ": 1, "ˌ": 2}
_SLOWEST, _FASTEST = 80, 450
_PUNCTUATION = re.compile(r"^[^\w]+|[^\w]+$")


@dataclass(frozen=True)
class Voice:
    """A voice of espeak-ng, and the phone set for it.

    Parameters
    ----------
    name
        espeak-ng's name of it.
    phone_set
        What its phones are written in.
    respelled
        Sounds as the voice names them → the same in IPA as the phone set has it, with blanks
        between several.
    joined
        Two sounds in a row in a word → the one, or the two (with a blank), that they are in this
        language.
    """

    name: str
    phone_set: str
    respelled: Mapping[str, str] = field(default_factory=dict)
    joined: Mapping[tuple[str, str], str] = field(default_factory=dict)


LANGUAGES: dict[str, Voice] = {
    "sv": Voice(
        "sv",
        "sv-sta",
        {"sx": "ɧ", "ʃ": "ɧ", "y": "ʏ", "œ": "ø"},
        # The voice has few of the retroflexes of Central Swedish, and no open vowels before r.
        {
            ("ɛ", "r"): "æ r",
            ("ɛː", "r"): "æː r",
            ("ø", "r"): "œ r",
            ("øː", "r"): "œː r",
            ("r", "t"): "ʈ",
            ("r", "d"): "ɖ",
            ("r", "n"): "ɳ",
            ("r", "s"): "ʂ",
            ("r", "l"): "ɭ",
        },
    ),
    "cs": Voice("cs", "cs-sampa", {"dʑ": "d͡z"}),
    "en": Voice(
        "en-us",
        "en-arpabet",
        {"ɾ": "d", "ᵻ": "ɪ", "ɐ": "ə", "ʔ": "t", "ɜː": "ɝ", "iə": "i ə", "aɪə": "aɪ ə"},
        {("ɹ", "ɹ"): "ɹ"},
    ),
}
"""Languages with a phone set of their own. Any other name is a voice of espeak-ng, with IPA."""


@dataclass(frozen=True, eq=False)
class SpokenText:
    """A text that was spoken.

    Parameters
    ----------
    text
        What was said.
    sound
        One channel.
    phones
        From 0 to the sound's end, silence included.
    """

    text: str
    sound: Sound
    phones: PhoneSequence


class TextSpeaker:
    """A voice that speaks texts.

    Parameters
    ----------
    language
        One of `LANGUAGES`, or the name of a voice of espeak-ng (``de``, ``en-gb``).
    phone_set
        What the phones are written in; the language's where not given.
    words_per_minute
        How fast, from 80 to 450.
    silence
        Seconds of silence before and after.

    Raises
    ------
    MissingExtraError
        If espeakng-loader is not installed.
    ConfigurationError
        If the speed is impossible.
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
        self.voice = LANGUAGES.get(language, Voice(language, "ipa"))
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
            Of the utterance.
        words_per_minute, silence
            Where this text is spoken otherwise than the rest.

        Raises
        ------
        ConfigurationError
            If espeak-ng has no such voice.
        DataError
            If there is nothing to say in the text, or it has sounds that the phone set cannot
            write.
        """
        speed = self.words_per_minute if words_per_minute is None else words_per_minute
        answer, samples = self._asked(text, round(speed))
        rate = float(answer["rate"])
        pad = np.zeros(round((self.silence if silence is None else silence) * rate))
        sound = Sound(np.concatenate([pad, samples, pad]), rate, name=name)
        heard = _heard(answer["events"], len(samples), text)
        segments: list[PhoneSegment] = []

        def put(start: int, end: int, phone: str, stress: int | None, word: str) -> None:
            first = round((start + len(pad)) / rate, _DECIMALS)
            last = round((end + len(pad)) / rate, _DECIMALS)
            if first < last:
                segments.append(PhoneSegment(first, last, phone, stress, word))

        for start, end, sound_name, word in heard:
            ipa = sound_name.lstrip("ˈˌ")
            if not ipa:
                put(start, end, "sil", None, "")
                continue
            parts = self._parts(ipa)
            edges = np.linspace(start, end, len(parts) + 1).round().astype(int)
            for part, first, last in zip(parts, edges, edges[1:], strict=False):
                phone = self._ipa.parse(part)
                vowel = phone is not None and self._ipa.get_phone(phone[0]).takes_stress
                stress = _STRESS.get(sound_name[0], 0) if vowel else None
                put(int(first), int(last), part, stress, word)
        if not any(segment.word for segment in segments):
            raise DataError(
                "there is nothing to say in the text",
                found=repr(text),
                advice="Give words in the language of the voice.",
            )
        segments = self._joined(segments)
        phones = self._written(PhoneSequence(tuple(segments), phone_set="ipa", name=name))
        return SpokenText(text, sound, _whole(phones, self.phone_set.silence, sound.duration))

    def _asked(self, text: str, speed: int) -> tuple[dict[str, Any], Any]:
        """What espeak-ng answers, and its samples as part of full scale."""
        script = Path(__file__).with_name("espeak_process.py")
        request = {"voice": self.voice.name, "text": text.replace("\0", " "), "speed": speed}
        done = subprocess.run(
            [sys.executable, str(script)],
            input=json.dumps(request).encode(),
            capture_output=True,
            check=False,
        )
        line, _, raw = done.stdout.partition(b"\n")
        if done.returncode or not line:
            last = done.stderr.decode("utf-8", "replace").strip().rpartition("\n")[2]
            raise DataError(
                "espeak-ng has ended without an answer",
                found=last or f"status {done.returncode}",
                advice="Check that espeakng-loader is complete: install it again.",
            )
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise ConfigurationError(
                f"espeak-ng has no voice '{self.voice.name}'",
                expected=", ".join([*LANGUAGES, *answer["voices"]]),
                advice="Name the language as espeak-ng does, such as de or en-gb.",
            )
        return answer, np.frombuffer(raw, dtype="<i2").astype(np.float64) / 32768.0

    def _parts(self, ipa: str) -> list[str]:
        """An event's sounds: one, or several where the voice says two phones in one."""
        parts: list[str] = []
        ipa = self.voice.respelled.get(ipa, ipa)
        if len(ipa) > 1:
            # A vowel with its r is said in one, and is two phones.
            ipa = ipa.replace("ɹ", " ɹ ")
        while ipa := ipa.strip():
            if " " in ipa:
                first, _, ipa = ipa.partition(" ")
                parts += self._parts(first)
                continue
            known = (n for n in range(len(ipa), 0, -1) if self._ipa.parse(ipa[:n]) is not None)
            length = next(known, 1)
            parts.append(ipa[:length])
            ipa = ipa[length:].lstrip("ˈˌ")
        return parts

    def _joined(self, segments: list[PhoneSegment]) -> list[PhoneSegment]:
        found: list[PhoneSegment] = []
        for segment in segments:
            before = found[-1] if found else segment
            one = self.voice.joined.get((before.phone, segment.phone))
            if one is not None and before.word == segment.word:
                found.pop()
                first, _, second = one.partition(" ")
                if second:
                    found.append(dataclasses.replace(before, phone=first))
                    segment = dataclasses.replace(segment, phone=second)
                else:
                    segment = dataclasses.replace(segment, start=before.start, phone=first)
            found.append(segment)
        return found

    def _written(self, phones: PhoneSequence) -> PhoneSequence:
        if self.phone_set.name == self._ipa.name:
            return normalise_phones(phones, self.phone_set)
        return map_phones(phones, self.phone_set, nearest=True)


def speak_text(
    text: str,
    language: str = "en",
    *,
    phone_set: PhoneSet | str | Path | None = None,
    words_per_minute: float = 160.0,
    silence: float = 0.25,
    name: str = "",
) -> SpokenText:
    """Speak a text: its sound, and its phones in time.

    Parameters
    ----------
    text
        One or more sentences.
    language
        One of `LANGUAGES`, or the name of a voice of espeak-ng.
    phone_set
        What the phones are written in; the language's where not given, IPA for other voices.
    words_per_minute
        How fast, from 80 to 450.
    silence
        Seconds of silence before and after.
    name
        Of the utterance.

    Raises
    ------
    MissingExtraError
        If the extra ``speech`` is not installed.
    ConfigurationError
        If espeak-ng has no such voice, or cannot speak so fast.
    DataError
        If there is nothing to say in the text, or it has sounds that the phone set cannot write.
    """
    speaker = TextSpeaker(
        language, phone_set=phone_set, words_per_minute=words_per_minute, silence=silence
    )
    return speaker.speak(text, name=name)


def _heard(events: list[list[Any]], samples: int, text: str) -> list[tuple[int, int, str, str]]:
    """Start and end (samples), sound and word of each phone; pauses have no sound."""
    words = _words([position - 1 for kind, _, position, *_ in events if kind == "word"], text)
    word = ""
    starts: list[tuple[int, str, str]] = []
    for kind, sample, _, _, name in events:
        if kind == "word":
            word = next(words)
        else:
            starts.append((sample, name, word if name.lstrip("ˈˌ") else ""))
    ends = [start for start, _, _ in starts[1:]] + [samples]
    heard: list[tuple[int, int, str, str]] = []
    for (start, name, word), end in zip(starts, ends, strict=True):
        if start == end and name and heard and heard[-1][2]:
            # An l after a vowel is part of the vowel's sound, and said to begin at its end.
            first, _, vowel, its_word = heard[-1]
            start = round(end - _MERGED * (end - first))
            heard[-1] = first, start, vowel, its_word
        heard.append((start, end, name, word))
    return heard


def _words(positions: list[int], text: str) -> Iterator[str]:
    """What is written at each of the places where espeak-ng says that a word begins.

    It says small words together with their neighbours ("in the"), and counts a character wrong at
    times: what is between one place and the next, from the beginning of a word, is one word here.
    """
    written = [match.span() for match in re.finditer(r"\S+", text)]
    begins = np.array([start for start, _ in written], dtype=np.int64)
    ends = np.array([end for _, end in written], dtype=np.int64)
    first = [int(np.searchsorted(ends, position, side="right")) for position in positions]
    first = [max(0, min(place, len(written) - 1)) for place in first]
    for here, after in zip(first, [*first[1:], len(written)], strict=True):
        last = max(here, after - 1)
        yield " ".join(
            bare
            for word in text[begins[here] : ends[last]].split()
            if (bare := _PUNCTUATION.sub("", word))
        )


def _whole(phones: PhoneSequence, silence: str, duration: float) -> PhoneSequence:
    """From 0 to the end: pauses that are none joined to what follows, silence in one piece."""
    segments: list[PhoneSegment] = []
    for segment in phones:
        pause = segment.phone == silence
        if segments and segments[-1].phone == silence:
            before = segments[-1]
            short = len(segments) > 1 and segment.start - before.start < _SHORTEST_PAUSE
            if pause or short:
                segments.pop()
                segment = PhoneSegment(
                    before.start, segment.end, segment.phone, segment.stress, segment.word
                )
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
