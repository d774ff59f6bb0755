"""Compute face parameters of phones with a control model, for an utterance or phone by phone."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mocap_fit import control
from mocap_fit.control import ControlModel
from mocap_fit.control.tongue import compute_tongue
from mocap_fit.errors import DataError
from mocap_fit.face import load_face
from mocap_fit.face.rig import Rig
from mocap_fit.phones import (
    PhoneSegment,
    PhoneSequence,
    PhoneSet,
    list_phone_sets,
    load_phone_set,
    map_phones,
    normalise_phones,
)
from mocap_fit.synthesis.closures import LipCloser, close_lips, find_closures, limit_to_bounds
from mocap_fit.tracks import FloatArray, ParameterTracks

# Seconds after which a phone no longer matters to the tongue.
_TONGUE_MEMORY = 2.0


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a live utterance.

    Parameters
    ----------
    time
        Time on the clock of the phones, seconds.
    values
        Face parameters in the order of the model, ``(parameters,)``, 1 is the full gesture; then
        those of the tongue, where they were wanted.
    """

    time: float
    values: FloatArray


def synthesise(
    phones: PhoneSequence,
    model: ControlModel | str | os.PathLike[str],
    rate: float | None = None,
    *,
    nearest: bool = False,
    face: Rig | str | Path | None = None,
    articulation: float = 1.0,
    start_time: float | None = None,
    frames: int | None = None,
) -> ParameterTracks:
    """Compute face parameters of phones with a control model.

    Parameters
    ----------
    phones
        The phones of an utterance, in time. Phones of another set of the same language are mapped
        to the model's by their sound.
    model
        A trained model, or its file.
    rate
        Frame rate, hertz; that of the model's training if None.
    nearest
        Whether phones of another language, and sounds that the model's set lacks, are replaced by
        the nearest that it has; otherwise they are an error.
    face
        A face whose lips then close on every bilabial and open at a limited speed, whatever the
        model says (`mocap_fit.synthesis.closures`). By default the movement is the model's,
        as the papers evaluate it.
    articulation
        Factor of the movements about rest, no unit: above 1 is clearer than usual speech.
    start_time
        Time of the first frame, seconds; the start of the first phone if None.
    frames
        Number of frames; all that begin before the end of the last phone if None.

    Returns
    -------
    ParameterTracks
        On the clock of the phones, from the start of the first to the end of the last.

    Raises
    ------
    DataError
        If there are no phones, the model is not trained, or it was trained on other phones; or
        the face has none of its parameters.
    FileFormatError
        If the file holds no model.
    ConfigurationError
        If the face does not say where its lips are.

    See Also
    --------
    read_phones : Read the phones of an utterance.
    control.create : Create a control model.
    render_movie : Make a movie of the talking head.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> from mocap_fit.control.rule_based import RuleBased
    >>> phones = mf.read_phones(mf.load_sample("take_01.TextGrid"), phone_set="sv-sta")
    >>> tracks = mf.synthesise(phones, RuleBased().prepare("sv-sta"))
    >>> tracks.frames, tracks.rate
    (185, 60.0)
    """
    chosen = model if isinstance(model, ControlModel) else control.load(model)
    mapped = to_model_phones(phones, chosen, nearest=nearest)
    tracks = chosen.predict(mapped, rate, start_time=start_time, frames=frames)
    rig = load_face(face) if isinstance(face, str | Path) else face
    if rig is None and articulation == 1.0:
        return tracks
    values = articulation * tracks.values
    if rig is not None:
        values = limit_to_bounds(values, rig, tracks.names)
        grid = tracks.rate, tracks.start_time, tracks.frames
        closures = find_closures(mapped, chosen.phone_set_, *grid)
        values = close_lips(values, tracks.times, closures, rig, tracks.names)
    about = {"articulation": articulation, "lips_closed": rig is not None}
    return tracks.replace(values=values).add_step("synthesise", about)


def to_model_phones(
    phones: PhoneSequence, model: ControlModel, *, nearest: bool = False
) -> PhoneSequence:
    """Convert phones to the phone set of a control model.

    Parameters
    ----------
    phones
        Phones of the model's set in any of its spellings, or of another set that they name.
    model
        A trained model.
    nearest
        Whether phones of another language, and sounds that the model's set lacks, are replaced by
        the nearest that it has; otherwise they are an error.

    Returns
    -------
    PhoneSequence
        Phones of the model's set.

    Raises
    ------
    DataError
        If the model is not trained, or it was trained on other phones.
    """
    if not model.is_fitted:
        raise DataError(f"the model '{model.name}' is not trained", advice="Train or load it.")
    target = model.phone_set_
    if not phones.phone_set or phones.phone_set == target.name:
        return normalise_phones(phones, target)
    if not nearest and not _is_same_language(phones.phone_set, target):
        raise DataError(
            "the model was trained on another phone set",
            found=f"phones of '{phones.phone_set}'",
            expected=f"'{target.name}', as in its corpus",
            advice="Take a model of that language, or ask for the nearest sounds (nearest).",
        )
    return map_phones(phones, target, nearest=nearest)


def stream_frames(
    segments: Iterable[PhoneSegment],
    model: ControlModel,
    rate: float | None = None,
    *,
    face: Rig | None = None,
    articulation: float = 1.0,
    tongue: bool = False,
) -> Iterator[Frame]:
    """Yield frames as soon as the phones that they depend on are known.

    The frames are those that `synthesise` gives for the same phones: as many phones as the model
    looks ahead are read before the first. Lips close for the phones that are known by then.

    Parameters
    ----------
    segments
        Phones of the model's set, in the order of time; each is waited for.
    model
        A trained model.
    rate
        Frame rate, hertz; that of the model's training if None.
    face
        A face whose lips then close on every bilabial; by default the movement is the model's.
    articulation
        Factor of the movements about rest, no unit.
    tongue
        Whether the parameters of the tongue follow in each frame (`TONGUE_PARAMETERS`), by rule
        from the phones that are known by then.

    Yields
    ------
    Frame
        In the order of time.

    Raises
    ------
    DataError
        If a phone is unknown or out of order, or the model is not trained.
    """
    stream = model.stream(rate)
    closer = None if face is None else LipCloser(face, model.phone_set_, model.parameter_names_)
    index = 0
    pushed: deque[PhoneSegment] = deque()

    def add_tongue(values: FloatArray, times: FloatArray) -> FloatArray:
        while pushed[0].end < times[0] - _TONGUE_MEMORY:
            pushed.popleft()
        phones = PhoneSequence(tuple(pushed), phone_set=model.phone_set_.name)
        names = model.parameter_names_
        jaw = values[:, names.index("jaw_rotation")] if "jaw_rotation" in names else None
        moved = compute_tongue(phones, times, jaw=jaw, phone_set=model.phone_set_)
        return np.hstack([values, moved])

    def to_frames(values: FloatArray) -> Iterator[Frame]:
        nonlocal index
        assert stream.start_time is not None
        times = stream.start_time + (index + np.arange(len(values))) / stream.rate
        index += len(values)
        values = articulation * values
        if closer is not None:
            values = closer.close(values, times, stream.rate)
        if tongue and len(values):
            values = add_tongue(values, times)
        yield from map(Frame, times.tolist(), values)

    for segment in segments:
        single = PhoneSequence((segment,), phone_set=model.phone_set_.name)
        (phone,) = normalise_phones(single, model.phone_set_)
        stream.push(phone)
        pushed.append(phone)
        if closer is not None:
            closer.push(phone)
        yield from to_frames(stream.pull())
    if stream.start_time is not None:
        yield from to_frames(stream.finish())


def _is_same_language(name: str, phone_set: PhoneSet) -> bool:
    """Return whether a shipped phone set is of the same language as another, or of all."""
    if name not in list_phone_sets():
        return False
    language = load_phone_set(name).language
    return not language or not phone_set.language or language == phone_set.language
