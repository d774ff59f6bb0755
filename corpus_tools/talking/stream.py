"""``mocap-fit stream``: phones in, frames out, as they come."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from typing import Any, TextIO

from corpus_tools.cli import console
from corpus_tools.cli.console import Status
from corpus_tools.talking import speak_models
from mocap_fit.errors import FileFormatError, MocapFitError
from mocap_fit.phones import PhoneSegment

_EXPECTED = 'START END PHONE [STRESS], or {"start": …, "end": …, "phone": …}'


def run(
    model: str,
    *,
    language: str = "en",
    rate: float | None = None,
    lines: TextIO | None = None,
    out: TextIO | None = None,
) -> Status:
    """Read phones line by line and write frames as soon as they are sure.

    Parameters
    ----------
    model
        The file of a trained model, or a kind of model.
    language
        Of a kind of model.
    rate
        Frames per second; the model's own where not given.
    lines, out
        Where phones come from and frames go; stdin and stdout where not given.

    Raises
    ------
    MocapFitError
        If the model cannot be used, or a line is wrong; frames until then have been written.
    """
    from mocap_fit.face import load_face
    from mocap_fit.phones import load_phone_set
    from mocap_fit.synthesis import stream_frames
    from mocap_fit.synthesis.text_to_phones import LANGUAGES

    voice = LANGUAGES.get(language)
    phone_set = load_phone_set("ipa" if voice is None else voice.phone_set)
    chosen = speak_models.model_for(model, language, phone_set, load_face().parameter_names)
    console.say(f"{speak_models.described(chosen)}; looks ahead {chosen.look_ahead:g} s")
    source, sink = lines or sys.stdin, out or sys.stdout
    reader = _Reader(source)
    while not reader.ended:
        try:
            for frame in stream_frames(reader.utterance(), chosen, rate):
                values = dict(zip(chosen.parameter_names_, frame.values.tolist(), strict=True))
                rounded = {name: round(value, 6) for name, value in values.items()}
                sink.write(json.dumps({"time": round(frame.time, 6), **rounded}) + "\n")
                # Whoever animates waits for it.
                sink.flush()
        except MocapFitError as error:
            if error.line is not None:
                raise
            raise FileFormatError(
                error.problem,
                path="stdin",
                line=reader.line,
                found=error.found,
                expected=error.expected,
                advice=error.advice,
            ) from None
    return Status.DONE


class _Reader:
    """Utterances from lines; an empty line ends one."""

    def __init__(self, lines: TextIO) -> None:
        self._lines = lines
        self.line = 0
        self.ended = False

    def utterance(self) -> Iterator[PhoneSegment]:
        """The phones until the next empty line, each as soon as its line is there."""
        # Not a loop over the file, which would read ahead.
        while True:
            text = self._lines.readline()
            if not text:
                self.ended = True
                return
            self.line += 1
            if not text.strip():
                return
            yield _segment(text.strip(), self.line)


def _segment(text: str, line: int) -> PhoneSegment:
    try:
        start, end, phone, stress = _fields(text)
        return PhoneSegment(
            float(start), float(end), phone, None if stress is None else int(stress)
        )
    except (ValueError, KeyError, TypeError):
        raise FileFormatError(
            "the line is not a phone", path="stdin", line=line, found=text, expected=_EXPECTED
        ) from None
    except MocapFitError as error:
        raise FileFormatError(
            error.problem, path="stdin", line=line, found=error.found, expected=error.expected
        ) from None


def _fields(text: str) -> tuple[Any, Any, str, Any]:
    """Start, end, phone and stress; a `ValueError`, `KeyError` or `TypeError` if they are not."""
    if not text.startswith("{"):
        start, end, phone, *rest = text.split()
        if len(rest) > 1:
            raise ValueError(text)
        return start, end, phone, rest[0] if rest else None
    given = json.loads(text)
    if not isinstance(given["phone"], str):
        raise TypeError(given["phone"])
    return given["start"], given["end"], given["phone"], given.get("stress")
