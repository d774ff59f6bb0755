"""Compute face parameters of phones with a control model, for an utterance or phone by phone."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from mocap_fit import control
from mocap_fit.control import ControlModel
from mocap_fit.errors import DataError
from mocap_fit.phones import (
    PhoneSegment,
    PhoneSequence,
    PhoneSet,
    list_phone_sets,
    load_phone_set,
    map_phones,
    normalise_phones,
)
from mocap_fit.tracks import FloatArray, ParameterTracks


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a live utterance.

    Parameters
    ----------
    time
        Time on the clock of the phones, seconds.
    values
        Face parameters in the order of the model, ``(parameters,)``, 1 is the full gesture.
    """

    time: float
    values: FloatArray


def synthesise(
    phones: PhoneSequence,
    model: ControlModel | str | os.PathLike[str],
    rate: float | None = None,
    *,
    nearest: bool = False,
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

    Returns
    -------
    ParameterTracks
        On the clock of the phones, from the start of the first to the end of the last.

    Raises
    ------
    DataError
        If there are no phones, the model is not trained, or it was trained on other phones.
    FileFormatError
        If the file holds no model.

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
    return chosen.predict(to_model_phones(phones, chosen, nearest=nearest), rate)


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
    segments: Iterable[PhoneSegment], model: ControlModel, rate: float | None = None
) -> Iterator[Frame]:
    """Yield frames as soon as the phones that they depend on are known.

    The frames are those that `synthesise` gives for the same phones: as many phones as the model
    looks ahead are read before the first.

    Parameters
    ----------
    segments
        Phones of the model's set, in the order of time; each is waited for.
    model
        A trained model.
    rate
        Frame rate, hertz; that of the model's training if None.

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

    def pull_frames() -> Iterator[FloatArray]:
        for segment in segments:
            single = PhoneSequence((segment,), phone_set=model.phone_set_.name)
            stream.push(normalise_phones(single, model.phone_set_)[0])
            yield from stream.pull()
        if stream.start_time is not None:
            yield from stream.finish()

    for index, values in enumerate(pull_frames()):
        assert stream.start_time is not None
        yield Frame(stream.start_time + index / stream.rate, values)


def _is_same_language(name: str, phone_set: PhoneSet) -> bool:
    """Return whether a shipped phone set is of the same language as another, or of all."""
    if name not in list_phone_sets():
        return False
    language = load_phone_set(name).language
    return not language or not phone_set.language or language == phone_set.language
