"""Forced alignment: when each phone of a known text is heard.

pocketsphinx (hidden Markov models of phones, Viterbi search) does it in two passes over the
sound: the first finds the words, with a pronunciation for each and silences between them, the
second the states of the phones within them. Its English model and dictionary come with it;
models and dictionaries in its format serve other languages.
"""

from __future__ import annotations

import math
import os
import re
import unicodedata
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.errors import (
    ConfigurationError,
    DataError,
    FileFormatError,
    MissingExtraError,
    from_os_error,
)
from mocap_fit.io.text import check_file
from mocap_fit.phones import PhoneSegment, PhoneSequence, PhoneSet, load_phone_set, normalise_phones
from mocap_fit.tracks import FloatArray

MODEL_RATE = 16000
"""Samples per second that the models are made for."""

# A text that is known needs no guessing: with the usual narrow beams the search loses it.
_BEAM = 1e-80
_PEAK = 0.5
_SHORTEST = 0.1
_VARIANT = re.compile(r"\(\d+\)$")
# Silence, and the noises that models have phones for: breath, cough, "uh".
_NO_SPEECH = re.compile(r"SIL|\+.*\+", re.IGNORECASE)


class Aligner:
    """What finds the phones of sentences, one after another, with one model.

    Parameters
    ----------
    dictionary
        A pronouncing dictionary in CMU's format, a word and its phones a line, in place of the
        English one; or words and their phones (``{"mocap": "M OW K AE P"}``), added to it.
    acoustic_model
        A folder with a model of pocketsphinx, in place of the English one.
    phone_set
        What the model's phones are read as; ``en-arpabet`` for the English model. Where not given
        with another model, symbols stay as the model has them, and silence is ``sil``.

    Raises
    ------
    MissingExtraError
        If pocketsphinx is not installed.
    ConfigurationError
        If the model or the dictionary cannot be loaded.
    """

    def __init__(
        self,
        dictionary: str | os.PathLike[str] | Mapping[str, str] | None = None,
        acoustic_model: str | os.PathLike[str] | None = None,
        phone_set: PhoneSet | str | Path | None = None,
    ) -> None:
        added = dictionary if isinstance(dictionary, Mapping) else {}
        path = None if isinstance(dictionary, Mapping) else dictionary
        self._decoder = _decoder(path, acoustic_model)
        if phone_set is None and acoustic_model is None:
            phone_set = "en-arpabet"
        self._set = load_phone_set(phone_set) if isinstance(phone_set, str | Path) else phone_set
        for word, phones in added.items():
            self._add(word, phones)

    def _add(self, word: str, phones: str) -> None:
        try:
            done = self._decoder.add_word(word, phones, True)
        except RuntimeError:
            done = -1
        if done is not None and done < 0:
            raise ConfigurationError(
                f"the word '{word}' cannot be added to the dictionary",
                found=phones,
                expected="phones of the acoustic model with blanks between, for a new word",
            )

    def words(self, text: str) -> list[str]:
        """The words of a text as the dictionary writes them.

        Raises
        ------
        DataError
            If words are not in the dictionary; all are listed. Or if there is no word.
        """
        found: list[str] = []
        missing: list[str] = []
        for token in unicodedata.normalize("NFC", text).replace("’", "'").split():
            if not any(unicodedata.category(c)[0] in "LNM" for c in token):
                continue
            entries = self._looked_up(token)
            if entries:
                found += entries
            elif _bare(token) not in missing:
                missing.append(_bare(token))
        if missing:
            raise DataError(
                # In the sentence itself, which is not shortened as what was found is.
                f"{len(missing)} words are not in the dictionary: {', '.join(missing)}",
                advice="Check the spelling, write numbers as words, or give their phones "
                "(dictionary=...).",
            )
        if not found:
            raise DataError("there is no word to align", found=repr(text))
        return found

    def _looked_up(self, token: str) -> list[str] | None:
        bare = _bare(token)
        for word in dict.fromkeys(
            form for whole in (token, bare, bare.strip("'")) for form in _forms(whole)
        ):
            if word and self._decoder.lookup_word(word) is not None:
                return [word]
        parts = re.split(r"[-–—/]+", bare)
        if len(parts) < 2:
            return None
        known = [self._looked_up(part) for part in parts if part]
        return [w for part in known for w in part or []] if all(known) else None

    def align(
        self,
        sound: str | os.PathLike[str] | ArrayLike,
        text: str,
        rate: float | None = None,
        *,
        name: str = "",
    ) -> PhoneSequence:
        """Find when each phone of a text is heard.

        Parameters
        ----------
        sound
            A wav file, or `(samples,)` or `(samples, channels)` of any scale; of several
            channels the mean is taken.
        text
            What is said, in words.
        rate
            Samples per second of an array.
        name
            Of the utterance; the file's where not given.

        Returns
        -------
        PhoneSequence
            From 0 to the sound's end without a gap; stress is not marked. Times have a resolution
            of 10 ms, the step of the model's frames.

        Raises
        ------
        FileFormatError
            If the file is no wav file.
        DataError
            If words are not in the dictionary, the sound is silent or too short, or the text
            cannot be what is said.
        """
        if isinstance(sound, str | os.PathLike):
            path: str | os.PathLike[str] | None = sound
            samples, rate = _read_wav(sound)
            name = name or Path(sound).stem
        else:
            path = None
            if rate is None:
                raise DataError("samples need their rate", advice="Give rate=, in hertz.")
            samples = np.asarray(sound, dtype=np.float64)
        words = self.words(text)
        try:
            duration = len(samples) / rate
            segments = self._segments(_prepared(samples, rate), words, duration)
        except DataError as error:
            raise DataError(
                error.problem,
                path=path,
                found=error.found,
                expected=error.expected,
                advice=error.advice,
            ) from None
        sequence = PhoneSequence(tuple(segments), name=name)
        if self._set is not None:
            sequence = normalise_phones(sequence, self._set)
        return sequence.add_step("align", {"text": " ".join(words)})

    def _segments(self, pcm: bytes, words: list[str], duration: float) -> list[PhoneSegment]:
        decoder = self._decoder
        failed = DataError(
            "the text cannot be aligned to the sound",
            found=" ".join(words),
            advice="Check that it is what is said, all of it and nothing more.",
        )
        try:
            decoder.set_align_text(" ".join(words))
            _hear(decoder, pcm)
            heard = [_VARIANT.sub("", s.word) for s in decoder.seg() or ()]
            wanted = [_VARIANT.sub("", word) for word in words]
            if [word for word in heard if word in set(wanted)] != wanted:
                raise failed
            decoder.set_alignment()
            _hear(decoder, pcm)
            alignment = decoder.get_alignment()
            found = [
                (_VARIANT.sub("", word.name), phone.name, phone.start)
                for word in (alignment.words() if alignment is not None else ())
                for phone in word
            ]
        except RuntimeError:
            raise failed from None
        if not found:
            raise failed
        # The model hears in frame i the sound of a window that begins at i steps. The border of
        # two frames lies between the middles of their windows, half a window less half a step on.
        step = 1.0 / decoder.config["frate"]
        shift = 0.5 * (float(decoder.config["wlen"]) - step)
        starts = [0.0, *(start * step + shift for _, _, start in found[1:])]
        ends = [*starts[1:], duration]
        segments: list[PhoneSegment] = []
        for (word, phone, _), begin, end in zip(found, starts, ends, strict=True):
            start = begin
            if not start < end:
                raise failed
            silent = _NO_SPEECH.fullmatch(phone) is not None
            if silent and segments and segments[-1].phone == "sil":
                start = segments.pop().start
            symbol, spoken = ("sil", "") if silent else (phone, word)
            segments.append(PhoneSegment(start, end, symbol, word=spoken))
        return segments


def align(
    sound: str | os.PathLike[str] | ArrayLike,
    text: str,
    rate: float | None = None,
    *,
    dictionary: str | os.PathLike[str] | Mapping[str, str] | None = None,
    acoustic_model: str | os.PathLike[str] | None = None,
    phone_set: PhoneSet | str | Path | None = None,
    name: str = "",
) -> PhoneSequence:
    """Find when each phone of a text is heard in one sound; for many, make one `Aligner`.

    Parameters
    ----------
    sound, text, rate, name
        As for `Aligner.align`.
    dictionary, acoustic_model, phone_set
        As for `Aligner`.

    Raises
    ------
    MocapFitError
        As `Aligner` and `Aligner.align` do.
    """
    aligner = Aligner(dictionary, acoustic_model, phone_set)
    return aligner.align(sound, text, rate, name=name)


def _decoder(
    dictionary: str | os.PathLike[str] | None, acoustic_model: str | os.PathLike[str] | None
) -> Any:
    try:
        from pocketsphinx import Decoder
    except ImportError:
        raise MissingExtraError(
            "forced alignment needs pocketsphinx",
            advice='Install it with: pip install "mocap-fit[speech]"',
        ) from None
    settings: dict[str, Any] = {
        "lm": None,
        "beam": _BEAM,
        "pbeam": _BEAM,
        "wbeam": _BEAM,
        "bestpath": False,
        # The mean over the whole sound, so that a sentence does not depend on those before it.
        "cmn": "batch",
        "loglevel": "FATAL",
    }
    for key, path in (("dict", dictionary), ("hmm", acoustic_model)):
        if path is not None:
            if key == "dict":
                check_file(path)
            elif not (Path(path) / "mdef").is_file():
                raise ConfigurationError(
                    "this is no acoustic model of pocketsphinx",
                    path=path,
                    expected="a folder with mdef, means, variances and what belongs to them",
                )
            settings[key] = os.fspath(path)
    try:
        return Decoder(**settings)
    except (RuntimeError, ValueError) as error:
        raise ConfigurationError(
            "the acoustic model and the dictionary cannot be loaded",
            path=acoustic_model or dictionary,
            found=error,
            advice="Check that they belong together: the same phones in both.",
        ) from None


def _hear(decoder: Any, pcm: bytes) -> None:
    # Forgets the noise that it has learnt: both passes hear the same, whatever was heard before.
    decoder.reinit_feat()
    decoder.start_utt()
    try:
        decoder.process_raw(pcm, full_utt=True)
    finally:
        decoder.end_utt()


def _bare(token: str) -> str:
    """A word without the punctuation around it; apostrophes stay."""
    outside = {c for c in token if unicodedata.category(c)[0] in "PS"} - {"'"}
    return token.strip("".join(outside)) if outside else token


def _forms(word: str) -> tuple[str, ...]:
    return word, word.lower(), word.upper()


def _prepared(samples: FloatArray, rate: float) -> bytes:
    """The sound as the model wants it: 16 kHz, one channel, 16 bits, at a fixed level."""
    from scipy.signal import resample_poly

    if samples.ndim == 2:
        samples = samples.mean(axis=1)
    whole = round(rate)
    if samples.ndim != 1 or not math.isfinite(rate) or whole < 1 or abs(rate - whole) > 1e-6:
        raise DataError(
            "the sound has an impossible shape or rate",
            found=f"{samples.shape} at {rate} Hz",
            expected="(samples,) or (samples, channels) at a whole number of hertz",
        )
    if len(samples) < _SHORTEST * rate:
        raise DataError(
            "the sound is too short to align",
            found=f"{len(samples) / rate:.3f} s",
            expected=f"at least {_SHORTEST} s",
        )
    if not np.isfinite(samples).all():
        raise DataError("the sound has samples that are no numbers")
    samples = samples - samples.mean()
    peak = float(np.abs(samples).max())
    if peak == 0:
        raise DataError("the sound is silent", advice="Check the channel and the file.")
    divisor = math.gcd(MODEL_RATE, whole)
    heard = resample_poly(samples / peak, MODEL_RATE // divisor, whole // divisor)
    return bytes(np.clip(heard * _PEAK * 32767, -32768, 32767).astype("<i2").tobytes())


def _read_wav(path: str | os.PathLike[str]) -> tuple[FloatArray, float]:
    from scipy.io import wavfile

    file = check_file(path)
    try:
        with warnings.catch_warnings():
            # Chunks that say nothing of the sound.
            warnings.simplefilter("ignore", wavfile.WavFileWarning)
            rate, samples = wavfile.read(file)
    except OSError as error:
        raise from_os_error(error, path) from None
    except (ValueError, EOFError, TypeError, ArithmeticError) as error:
        raise FileFormatError(
            "this is not a wav file that can be read",
            path=path,
            found=error,
            expected="PCM or float samples",
            advice="Convert the sound to a plain wav file.",
        ) from None
    return np.asarray(samples, dtype=np.float64), float(rate)
