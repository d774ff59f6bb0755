"""Forced alignment: the times of the phones of a known text in a sound.

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
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.errors import ConfigurationError, DataError, MissingExtraError, add_path
from mocap_fit.io.text import check_file
from mocap_fit.phones import PhoneSegment, PhoneSequence, PhoneSet, load_phone_set, normalise_phones
from mocap_fit.sound import read_sound, resample
from mocap_fit.tracks import FloatArray

MODEL_RATE = 16000
"""Hertz: the sampling rate of the models."""

# The text is known: with the usual narrow beams the search may lose it.
_BEAM = 1e-80
_PEAK = 0.5
_SHORTEST = 0.1
# Hertz. Below it there is no speech to align.
_LOWEST_RATE = 4000.0
_VARIANT = re.compile(r"\(\d+\)$")
# Silence, and the noises that models have phones for: breath, cough, "uh".
_NO_SPEECH = re.compile(r"SIL|\+.*\+", re.IGNORECASE)


class Aligner:
    """A model that finds the times of the phones of sentences, one after another.

    Parameters
    ----------
    dictionary
        A pronouncing dictionary in CMU's format, a word and its phones a line, that replaces the
        English one; or words and their phones (``{"mocap": "M OW K AE P"}``), which are added to
        it.
    acoustic_model
        A folder with a model of pocketsphinx that replaces the English one.
    phone_set
        The phone set of the model's phones; ``en-arpabet`` for the English model. If None with
        another model, symbols stay as the model has them, and silence is ``sil``.

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
        additions = dictionary if isinstance(dictionary, Mapping) else {}
        path = None if isinstance(dictionary, Mapping) else dictionary
        self._decoder = _create_decoder(path, acoustic_model)
        if phone_set is None and acoustic_model is None:
            phone_set = "en-arpabet"
        self._set = load_phone_set(phone_set) if isinstance(phone_set, str | Path) else phone_set
        for word, phones in additions.items():
            self._add_word(word, phones)

    def _add_word(self, word: str, phones: str) -> None:
        try:
            number = self._decoder.add_word(word, phones, True)
        except RuntimeError:
            number = -1
        if number is not None and number < 0:
            raise ConfigurationError(
                f"the word '{word}' cannot be added to the dictionary",
                found=phones,
                expected="phones of the acoustic model with blanks between, for a new word",
            )

    def find_words(self, text: str) -> list[str]:
        """Find the words of a text in the dictionary.

        Parameters
        ----------
        text
            Words, with or without punctuation.

        Returns
        -------
        list of str
            The words as the dictionary spells them.

        Raises
        ------
        DataError
            If words are not in the dictionary, which are all listed, or there is no word.
        """
        words: list[str] = []
        missing: list[str] = []
        for token in unicodedata.normalize("NFC", text).replace("’", "'").split():
            if not any(unicodedata.category(c)[0] in "LNM" for c in token):
                continue
            entries = self._look_up(token)
            if entries:
                words += entries
            elif _strip_punctuation(token) not in missing:
                missing.append(_strip_punctuation(token))
        if missing:
            raise DataError(
                # Not as what was found, which is shortened.
                f"{len(missing)} words are not in the dictionary: {', '.join(missing)}",
                advice="Check the spelling, write numbers as words, or give their phones "
                "(dictionary=...).",
            )
        if not words:
            raise DataError("there is no word to align", found=repr(text))
        return words

    def _look_up(self, token: str) -> list[str] | None:
        bare = _strip_punctuation(token)
        for word in dict.fromkeys(
            form
            for spelling in (token, bare, bare.strip("'"))
            for form in (spelling, spelling.lower(), spelling.upper())
        ):
            if word and self._decoder.lookup_word(word) is not None:
                return [word]
        parts = re.split(r"[-–—/]+", bare)
        if len(parts) < 2:
            return None
        known = [self._look_up(part) for part in parts if part]
        return [w for part in known for w in part or []] if all(known) else None

    def align(
        self,
        sound: str | os.PathLike[str] | ArrayLike,
        text: str,
        rate: float | None = None,
        *,
        name: str = "",
    ) -> PhoneSequence:
        """Find the times of the phones of a text in a sound.

        Parameters
        ----------
        sound
            A sound file, or samples of any scale, ``(samples,)`` or ``(samples, channels)``; the
            mean of several channels is taken.
        text
            The words that are said.
        rate
            Sampling rate of samples, hertz.
        name
            Name of the utterance; that of the file by default.

        Returns
        -------
        PhoneSequence
            From 0 to the sound's end without a gap; stress is not marked. Times have a resolution
            of 10 ms, the step of the model's frames.

        Raises
        ------
        FileFormatError
            If the file is no sound file.
        DataError
            If words are not in the dictionary, the sound is silent or too short, or the text
            is not what is said.
        """
        path = sound if isinstance(sound, str | os.PathLike) else None
        if isinstance(sound, str | os.PathLike):
            read = read_sound(sound)
            samples, rate, name = read.samples, read.rate, name or read.name
        elif rate is None:
            raise DataError("samples need their rate", advice="Give rate=, in hertz.")
        else:
            samples = np.asarray(sound, dtype=np.float64)
        words = self.find_words(text)
        try:
            segments = self._find_segments(_to_pcm(samples, rate), words, len(samples) / rate)
        except DataError as error:
            raise (error if path is None else add_path(error, path)) from None
        sequence = PhoneSequence(tuple(segments), name=name)
        if self._set is not None:
            sequence = normalise_phones(sequence, self._set)
        return sequence.add_step("align", {"text": " ".join(words)})

    def _find_segments(self, pcm: bytes, words: list[str], duration: float) -> list[PhoneSegment]:
        decoder = self._decoder
        failed = DataError(
            "the text cannot be aligned to the sound",
            found=" ".join(words),
            advice="Check that it is what is said, all of it and nothing more.",
        )
        try:
            decoder.set_align_text(" ".join(words))
            _decode(decoder, pcm)
            spoken = [_VARIANT.sub("", s.word) for s in decoder.seg() or ()]
            expected = [_VARIANT.sub("", word) for word in words]
            if [word for word in spoken if word in set(expected)] != expected:
                raise failed
            decoder.set_alignment()
            _decode(decoder, pcm)
            alignment = decoder.get_alignment()
            phones = [
                (_VARIANT.sub("", word.name), phone.name, phone.start)
                for word in (alignment.words() if alignment is not None else ())
                for phone in word
            ]
        except RuntimeError:
            raise failed from None
        if not phones:
            raise failed
        # The window of frame i begins at i steps. The border of two frames lies between the
        # middles of their windows: half a window less half a step later.
        step = 1.0 / decoder.config["frate"]
        shift = 0.5 * (float(decoder.config["wlen"]) - step)
        starts = [0.0, *(start * step + shift for _, _, start in phones[1:])]
        ends = [*starts[1:], duration]
        segments: list[PhoneSegment] = []
        for (word, phone, _), begin, end in zip(phones, starts, ends, strict=True):
            start = begin
            if not start < end:
                raise failed
            silent = _NO_SPEECH.fullmatch(phone) is not None
            if silent and segments and segments[-1].phone == "sil":
                start = segments.pop().start
            symbol, label = ("sil", "") if silent else (phone, word)
            segments.append(PhoneSegment(start, end, symbol, word=label))
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
    """Find the times of the phones of a text in one sound; for many, make one `Aligner`.

    Parameters
    ----------
    sound
        A sound file, or samples of any scale, ``(samples,)`` or ``(samples, channels)``; the mean
        of several channels is taken.
    text
        The words that are said.
    rate
        Sampling rate of samples, hertz.
    dictionary
        A pronouncing dictionary that replaces the English one, or words and their phones, which
        are added to it.
    acoustic_model
        A folder with a model of pocketsphinx that replaces the English one.
    phone_set
        The phone set of the model's phones; ``en-arpabet`` for the English model.
    name
        Name of the utterance; that of the file by default.

    Returns
    -------
    PhoneSequence
        Phones from 0 to the sound's end without a gap; their times are multiples of 10 ms.

    Raises
    ------
    MissingExtraError
        If pocketsphinx is not installed.
    ConfigurationError
        If the model or the dictionary cannot be loaded.
    FileFormatError
        If the file is no sound file.
    DataError
        If words are not in the dictionary, the sound is silent or too short, or the text is not
        what is said.
    """
    aligner = Aligner(dictionary, acoustic_model, phone_set)
    return aligner.align(sound, text, rate, name=name)


def _create_decoder(
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
    if dictionary is not None:
        check_file(dictionary)
        settings["dict"] = os.fspath(dictionary)
    if acoustic_model is not None:
        if not (Path(acoustic_model) / "mdef").is_file():
            raise ConfigurationError(
                "this is no acoustic model of pocketsphinx",
                path=acoustic_model,
                expected="a folder with mdef, means, variances and what belongs to them",
            )
        settings["hmm"] = os.fspath(acoustic_model)
    try:
        return Decoder(**settings)
    except (RuntimeError, ValueError) as error:
        raise ConfigurationError(
            "the acoustic model and the dictionary cannot be loaded",
            path=acoustic_model or dictionary,
            found=error,
            advice="Check that they belong together: the same phones in both.",
        ) from None


def _decode(decoder: Any, pcm: bytes) -> None:
    # Without this the decoder adapts to noise, and a result would depend on those before it.
    decoder.reinit_feat()
    decoder.start_utt()
    try:
        decoder.process_raw(pcm, full_utt=True)
    finally:
        decoder.end_utt()


def _strip_punctuation(token: str) -> str:
    """Return a word without the punctuation around it; apostrophes stay."""
    outside = {c for c in token if unicodedata.category(c)[0] in "PS"} - {"'"}
    return token.strip("".join(outside)) if outside else token


def _to_pcm(samples: FloatArray, rate: float) -> bytes:
    """Convert a sound to what the model reads: 16 kHz, one channel, 16 bits, a fixed level."""
    if samples.ndim == 2:
        samples = samples.mean(axis=1)
    if samples.ndim != 1 or not _LOWEST_RATE <= rate < math.inf:
        raise DataError(
            "the shape or the rate of the sound is out of range",
            found=f"{samples.shape} at {rate:g} Hz",
            expected=f"(samples,) or (samples, channels) at {_LOWEST_RATE:g} Hz or more",
        )
    if len(samples) < _SHORTEST * rate:
        raise DataError(
            "the sound is too short to align",
            found=f"{len(samples) / rate:.3f} s",
            expected=f"at least {_SHORTEST} s",
        )
    if not np.isfinite(samples).all():
        raise DataError("the sound has samples that are not numbers")
    samples = samples - samples.mean()
    peak = float(np.abs(samples).max())
    if peak == 0:
        raise DataError("the sound is silent", advice="Check the channel and the file.")
    resampled = resample(samples / peak, rate, MODEL_RATE)
    return bytes(np.clip(resampled * _PEAK * 32767, -32768, 32767).astype("<i2").tobytes())
