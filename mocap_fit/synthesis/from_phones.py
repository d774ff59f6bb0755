"""From phones to face parameters by a control model: a whole utterance, or phone by phone."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from mocap_fit import control
from mocap_fit.control import ControlModel
from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSegment, PhoneSequence, PhoneSet, map_phones, normalise_phones
from mocap_fit.tracks import FloatArray, ParameterTracks


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of a live utterance.

    Parameters
    ----------
    time
        Seconds on the clock of the phones.
    values
        `(parameters,)`, in the order of the model.
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
    """Let a control model speak.

    Parameters
    ----------
    phones
        What is said, and when. Phones of another set of the same language are written in the
        model's by their sound.
    model
        A trained model, or its file.
    rate
        Frames per second; those that the model was trained at where not given.
    nearest
        Whether phones of another language, and sounds that the model's set lacks, are replaced by
        the nearest that it has; else they are an error.

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

    Examples
    --------
    >>> from mocap_fit.control.rule_based import RuleBased
    >>> from mocap_fit.phones import PhoneSegment, PhoneSequence
    >>> said = PhoneSequence((PhoneSegment(0, 0.1, "B"), PhoneSegment(0.1, 0.3, "AA", 1)))
    >>> tracks = synthesise(said.replace(phone_set="en-arpabet"), RuleBased().prepare("en-arpabet"))
    >>> tracks.frames, tracks.rate
    (18, 60.0)
    """
    chosen = model if isinstance(model, ControlModel) else control.load(model)
    return chosen.predict(phones_for(phones, chosen, nearest=nearest), rate)


def phones_for(
    phones: PhoneSequence, model: ControlModel, *, nearest: bool = False
) -> PhoneSequence:
    """The phones as a model knows them.

    Parameters
    ----------
    phones
        Of the model's set in any of its spellings, or of another set that they name.
    model
        A trained one.
    nearest
        As for `synthesise`.

    Raises
    ------
    DataError
        If the model is not trained, or it was trained on other phones.
    """
    if not model.is_fitted:
        raise DataError(f"the model '{model.name}' is not trained", advice="Train or load it.")
    own = model.phone_set_
    if not phones.phone_set or phones.phone_set == own.name:
        return normalise_phones(phones, own)
    if not nearest and not _one_language(phones.phone_set, own):
        raise DataError(
            "the model was trained on another phone set",
            found=f"phones of '{phones.phone_set}'",
            expected=f"'{own.name}', as in its corpus",
            advice="Take a model of that language, or ask for the nearest sounds (nearest).",
        )
    return map_phones(phones, own, nearest=nearest)


def stream_frames(
    segments: Iterable[PhoneSegment], model: ControlModel, rate: float | None = None
) -> Iterator[Frame]:
    """Give frames as soon as the phones that they depend on are known.

    The frames are those that `synthesise` gives for the same phones: as many phones as the model
    looks ahead are read before the first.

    Parameters
    ----------
    segments
        Phones of the model's set, in the order of time; waited for one by one.
    model
        A trained one.
    rate
        Frames per second; those that the model was trained at where not given.

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
    given = 0

    def framed(values: FloatArray) -> Iterator[Frame]:
        nonlocal given
        for row in values:
            assert stream.start_time is not None
            yield Frame(stream.start_time + given / stream.rate, row)
            given += 1

    for segment in segments:
        alone = PhoneSequence((segment,), phone_set=model.phone_set_.name)
        stream.push(normalise_phones(alone, model.phone_set_)[0])
        yield from framed(stream.pull())
    if stream.start_time is not None:
        yield from framed(stream.finish())


def _one_language(name: str, own: PhoneSet) -> bool:
    """Whether a shipped phone set is of a language, or of all of them."""
    from mocap_fit.phones import list_phone_sets, load_phone_set

    if name not in list_phone_sets():
        return False
    language = load_phone_set(name).language
    return not language or not own.language or language == own.language
