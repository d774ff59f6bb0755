"""``mocap-fit stream``: phones in, frames out, as they come."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

from corpus_tools.talking import speak_models
from corpus_tools.tasks import TaskProgress
from mocap_fit.control import ControlModel, list_live_models
from mocap_fit.errors import FileFormatError, MocapFitError
from mocap_fit.face.rig import Rig
from mocap_fit.parsing import parse_json
from mocap_fit.phones import PhoneSegment

_EXPECTED = 'START END PHONE [STRESS], or {"start": …, "end": …, "phone": …}'

# Seconds.
_LONGEST = 600.0


def stream(
    model: str,
    lines: Iterable[str],
    *,
    language: str = "en",
    rate: float | None = None,
    articulation: float = 1.0,
    progress: TaskProgress | None = None,
) -> Iterator[dict[str, float]]:
    """Read phones line by line and yield frames as soon as they are certain.

    Parameters
    ----------
    model
        The file of a trained model, or the name of a kind of model.
    lines
        Where phones come from, one per line; an empty line ends an utterance.
    language
        Language of a kind of model: sv, cs, en, or any voice of espeak-ng.
    rate
        Frames per second, hertz; None for the model's rate.
    articulation
        Factor of the movements about rest, no unit. Lips close on bilabials whatever it is.
    progress
        Called with a description of the model, and while a model is trained.

    Yields
    ------
    dict[str, float]
        ``time`` in seconds and the parameters by name, no unit, rounded to six places.

    Raises
    ------
    MocapFitError
        If the model cannot be used, or a line is wrong; all frames before it have been yielded.
    """
    from mocap_fit.face import load_face
    from mocap_fit.phones import load_phone_set
    from mocap_fit.synthesis.espeak_voices import find_language, find_voice

    language = find_language(language)
    phone_set = load_phone_set(find_voice(language).phone_set)
    face = load_face()
    names = face.parameter_names
    chosen = speak_models.find_model(model, language, phone_set, names, progress=progress)
    if progress is not None:
        description = speak_models.describe_model(chosen)
        if math.isinf(chosen.look_ahead):
            ahead = f"waits for the end of each utterance; live are {', '.join(list_live_models())}"
        else:
            ahead = f"live, looks ahead {chosen.look_ahead:g} s"
        progress(f"{description}; {ahead}", 0, None)
    reader = _Reader(lines)
    while not reader.ended:
        try:
            yield from _predict(reader, chosen, rate, face, articulation)
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


def _predict(
    reader: _Reader, model: ControlModel, rate: float | None, face: Rig, articulation: float
) -> Iterator[dict[str, float]]:
    from mocap_fit.control.tongue import TONGUE_PARAMETERS
    from mocap_fit.synthesis import stream_frames

    phones = reader.read_utterance()
    # A tongue that the model does not move is moved by rule.
    names = model.parameter_names_
    tongue = not set(TONGUE_PARAMETERS) & set(names)
    if tongue:
        names = (*names, *TONGUE_PARAMETERS)
    how: dict[str, Any] = {"face": face, "articulation": articulation, "tongue": tongue}
    for frame in stream_frames(phones, model, rate, **how):
        values = dict(zip(names, frame.values.tolist(), strict=True))
        rounded = {name: round(value, 6) for name, value in values.items()}
        yield {"time": round(frame.time, 6), **rounded}


class _Reader:
    """Utterances from lines; an empty line ends one."""

    def __init__(self, lines: Iterable[str]) -> None:
        self._lines = iter(lines)
        self.line = 0
        self.ended = False

    def read_utterance(self) -> Iterator[PhoneSegment]:
        """Yield the phones until the next empty line, each as soon as its line is there."""
        end = None
        for text in self._lines:
            self.line += 1
            # Windows begins files with a byte order mark.
            text = text.removeprefix("\ufeff").strip()
            if not text:
                return
            segment = _parse_segment(text, self.line)
            # All frames until its end are computed at once.
            length = segment.end - (segment.start if end is None else end)
            if length > _LONGEST:
                raise FileFormatError(
                    "the phone ends too long after the one before",
                    path="stdin",
                    line=self.line,
                    found=f"{length:g} s",
                    expected=f"at most {_LONGEST:g} s",
                    advice="Times are in seconds. An empty line ends an utterance.",
                )
            end = segment.end
            yield segment
        self.ended = True


def _parse_segment(text: str, line: int) -> PhoneSegment:
    try:
        start, end, phone, stress = _split_fields(text)
        stress = None if stress is None else int(stress)
        return PhoneSegment(float(start), float(end), phone, stress)
    except (ValueError, KeyError, TypeError):
        raise FileFormatError(
            "the line is not a phone", path="stdin", line=line, found=text, expected=_EXPECTED
        ) from None


def _split_fields(text: str) -> tuple[Any, Any, str, Any]:
    """Return start, end, phone and stress, or raise ValueError, KeyError or TypeError."""
    if not text.startswith("{"):
        start, end, phone, *rest = text.split()
        if len(rest) > 1:
            raise ValueError(text)
        return start, end, phone, rest[0] if rest else None
    fields = parse_json(text)
    if not isinstance(fields["phone"], str):
        raise TypeError(fields["phone"])
    return fields["start"], fields["end"], fields["phone"], fields.get("stress")
