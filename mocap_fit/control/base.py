"""The control models' one base class: phones in, face parameters out.

A model is a dataclass whose fields are its settings; its constructor only stores them. `fit` learns
from a corpus, and what it learned is in attributes that end in ``_``. To write one, subclass
`ControlModel`, give the methods that begin with one underscore, and register the class as an
entry point of the group ``mocap_fit.control_models``.
"""

from __future__ import annotations

import abc
import dataclasses
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from mocap_fit.control.model_file import read_model_file, write_model_file
from mocap_fit.control.streaming import Stream, WindowStream
from mocap_fit.corpus import Corpus
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError
from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.registry import Registry
from mocap_fit.tracks import FloatArray, ParameterTracks

CONTROL_MODELS = Registry("mocap_fit.control_models", "control model")


@dataclass(frozen=True)
class LogEntry:
    """One line of a training log.

    Parameters
    ----------
    iteration
        From 0, before anything was learned.
    training_error
        Root mean square error over the frames that are trained on, all parameters, in the unit of
        the parameters (eq. 4 of Beskow, divided by the number of values, and its root).
    validation_error
        The same over the validation part; None where there is none.
    part
        What was trained, such as a parameter or a network; empty for the whole model.
    """

    iteration: int
    training_error: float
    validation_error: float | None = None
    part: str = ""


Progress = Callable[[LogEntry], object]


class ControlModel(abc.ABC):
    """Phones in, parameter tracks out.

    Attributes
    ----------
    parameter_names_
        The face parameters, in the order of the corpus.
    phone_set_
        What the phones of the corpus are written in; phones of another set are refused.
    rate_
        Frames per second of the corpus, hertz.
    trained_on_
        What it was trained on: ``language``, ``phone_set``, ``utterances``, ``frames``,
        ``validation_utterances``, and what a caller adds, such as ``corpus``.
    log_
        The training log, `LogEntry` each.
    """

    #: The name it is registered under.
    name: ClassVar[str]
    #: What people call it, for tables and figures.
    title: ClassVar[str]

    parameter_names_: tuple[str, ...]
    phone_set_: PhoneSet
    rate_: float
    trained_on_: dict[str, Any]
    log_: tuple[LogEntry, ...]

    # -- what a model gives --------------------------------------------------------------------

    @abc.abstractmethod
    def _fit(
        self,
        corpus: Corpus,
        validation: Corpus | None,
        progress: Progress,
        checkpoint: Path | None,
    ) -> None:
        """Learn. The attributes above are set already; call ``progress`` once an iteration.

        Frames with a missing value of a parameter do not count for that parameter. A model whose
        training is long writes ``checkpoint`` now and then, and goes on from one that fits.
        """

    @abc.abstractmethod
    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        """Parameters `(times, parameters)` at any times `(times,)`, in seconds, ascending.

        The phones are of the model's own set, one at least. Before the first and after the last
        of them is silence, or what the model makes of it, never NaN.
        """

    @property
    @abc.abstractmethod
    def parameter_count(self) -> int:
        """How many free parameters were learned."""

    @property
    def look_ahead(self) -> float:
        """How far beyond a frame phones must be known, seconds; infinite: to the end of all."""
        return math.inf

    @property
    def look_back(self) -> float:
        """How far before a frame phones matter, seconds."""
        return math.inf

    @abc.abstractmethod
    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        """What was learned: values that JSON can hold, and arrays of numbers by name."""

    @abc.abstractmethod
    def _restore(
        self, values: Mapping[str, Any], arrays: Mapping[str, np.ndarray[Any, Any]]
    ) -> None:
        """Take back what `_state` gave."""

    # -- what every model has ------------------------------------------------------------------

    @property
    def settings(self) -> dict[str, Any]:
        """The constructor's arguments."""
        assert dataclasses.is_dataclass(self), "a control model is a dataclass of its settings"
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}

    @property
    def is_fitted(self) -> bool:
        """Whether it has learned, or needs not to."""
        return hasattr(self, "parameter_names_")

    def fit(
        self,
        corpus: Corpus,
        validation: Corpus | None = None,
        *,
        progress: Progress | None = None,
        checkpoint: str | os.PathLike[str] | None = None,
    ) -> Self:
        """Learn from a corpus.

        Parameters
        ----------
        corpus
            The training part.
        validation
            Utterances whose error tells when to stop (Beskow section 4.1); without them training
            ends when its own error does not fall any more.
        progress
            Called with a `LogEntry` an iteration.
        checkpoint
            A file in which a long training keeps how far it is; one that is there and fits is
            gone on from.

        Returns
        -------
        ControlModel
            Itself.

        Raises
        ------
        DataError
            If the corpus is empty, or the validation part is of another kind.
        """
        if not len(corpus):
            raise DataError("the corpus has no utterance to train on")
        if validation is not None and (
            validation.parameter_names != corpus.parameter_names
            or validation.phone_set.name != corpus.phone_set.name
        ):
            raise DataError(
                "the validation part is not like the training part",
                found=f"{validation.phone_set.name}, {', '.join(validation.parameter_names)}",
                expected=f"{corpus.phone_set.name}, {', '.join(corpus.parameter_names)}",
            )
        before = dict(vars(self))
        self.parameter_names_ = corpus.parameter_names
        self.phone_set_ = corpus.phone_set
        first = corpus.utterances[0].read_tracks()
        self.rate_ = corpus.rate if corpus.rate is not None else first.rate
        self.trained_on_ = {
            "language": corpus.language,
            "phone_set": corpus.phone_set.name,
            "utterances": len(corpus),
            "validation_utterances": 0 if validation is None else len(validation),
        }
        entries: list[LogEntry] = []

        def keep(entry: LogEntry) -> None:
            entries.append(entry)
            if progress is not None:
                progress(entry)

        self.log_ = ()
        try:
            self._fit(corpus, validation, keep, None if checkpoint is None else Path(checkpoint))
        except BaseException:
            # Half trained is not trained: it stays what it was.
            vars(self).clear()
            vars(self).update(before)
            raise
        self.log_ = (*self.log_, *entries)
        return self

    def predict_at(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        """Face parameters at any times.

        Parameters
        ----------
        phones
            Of an utterance, in the model's phone set.
        times
            `(times,)`, seconds on the clock of the phones, ascending.

        Returns
        -------
        FloatArray
            `(times, parameters)`.

        Raises
        ------
        DataError
            If the model is not trained, there are no phones, or they are of another set.
        """
        self._check_fitted()
        self._check_phones(phones)
        return self._predict(phones, np.asarray(times, dtype=np.float64))

    def predict(
        self,
        phones: PhoneSequence,
        rate: float | None = None,
        *,
        start_time: float | None = None,
        frames: int | None = None,
    ) -> ParameterTracks:
        """Face parameters of an utterance.

        Parameters
        ----------
        phones
            The utterance, in the model's phone set.
        rate
            Frames per second; those of the training corpus where not given.
        start_time
            Of the first frame, seconds; the start of the first phone where not given.
        frames
            How many; all that begin before the last phone ends where not given.

        Raises
        ------
        DataError
            If the model is not trained, there are no phones, or they are of another set.
        """
        self._check_fitted()
        self._check_phones(phones)
        rate = self.rate_ if rate is None else rate
        if not math.isfinite(rate) or rate <= 0:
            raise DataError("the frame rate is not possible", found=f"{rate} Hz")
        start = phones[0].start if start_time is None else start_time
        if frames is None:
            frames = max(0, math.ceil((phones[-1].end - start) * rate - 1e-6))
        values = self._predict(phones, start + np.arange(frames) / rate)
        tracks = ParameterTracks(
            self.parameter_names_,
            rate,
            values,
            start_time=start,
            name=phones.name,
            provenance=phones.provenance,
        )
        return tracks.with_step("predict", {"model": self.name, "settings": _plain(self.settings)})

    def stream(self, rate: float | None = None) -> Stream:
        """Begin a live utterance: phones are pushed, frames are pulled as they come.

        The frames are those of `predict`. A model with an infinite look-ahead gives them when the
        utterance has ended.

        Parameters
        ----------
        rate
            Frames per second; those of the training corpus where not given.
        """
        self._check_fitted()
        return WindowStream(
            self.predict_at, self.rate_ if rate is None else rate, self.look_ahead, self.look_back
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the trained model as one file of arrays and JSON, whole or not at all.

        Raises
        ------
        DataError
            If it is not trained.
        FileFormatError
            If the file cannot be written.
        """
        self._check_fitted()
        values, arrays = self._state()
        header = {
            "model": self.name,
            "settings": _plain(self.settings),
            "parameter_names": list(self.parameter_names_),
            "phone_set": self.phone_set_.to_dict(),
            "rate": self.rate_,
            "trained_on": self.trained_on_,
            "log": [dataclasses.astuple(entry) for entry in self.log_],
            "learned": values,
        }
        write_model_file(header, arrays, path)

    def _check_fitted(self) -> None:
        if not self.is_fitted:
            raise DataError(
                f"the model '{self.name}' is not trained", advice="Call fit, or load a trained one."
            )

    def _check_phones(self, phones: PhoneSequence) -> None:
        if not len(phones):
            raise DataError(f"the utterance '{phones.name}' has no phones")
        own = self.phone_set_.name
        if phones.phone_set and own and phones.phone_set != own:
            raise DataError(
                "the phones are of another set than those that the model was trained on",
                found=phones.phone_set,
                expected=own,
                advice="Map them with mocap_fit.phones.map_phones, or take another model.",
            )
        unknown = sorted({s.phone for s in phones if self.phone_set_.parse(s.phone) is None})
        if unknown:
            raise DataError(
                f"the phone set '{own}' of the model lacks phones of '{phones.name}'",
                found=", ".join(unknown),
                advice="Map them with mocap_fit.phones.map_phones.",
            )


def create(name: str, **settings: Any) -> ControlModel:
    """Make a control model that is not trained yet.

    Parameters
    ----------
    name
        One of `names`.
    settings
        Of that model; its defaults are the paper's.

    Raises
    ------
    RegistryError
        If there is no such model.
    ConfigurationError
        If it has no such setting.
    """
    kind: type[ControlModel] = CONTROL_MODELS.get(name)
    known = [f.name for f in dataclasses.fields(kind)]  # type: ignore[arg-type]
    unknown = [key for key in settings if key not in known]
    if unknown:
        raise ConfigurationError(
            f"the control model '{name}' has no setting '{unknown[0]}'",
            expected=f"some of {', '.join(known)}" if known else "none",
        )
    return kind(**settings)


def names() -> tuple[str, ...]:
    """Names of all control models that are installed, sorted."""
    return CONTROL_MODELS.names()


def load(path: str | os.PathLike[str]) -> ControlModel:
    """Read a trained model that `ControlModel.save` wrote. Nothing in the file is run.

    Raises
    ------
    FileFormatError
        If the file is none of these, is damaged, or of a later format.
    RegistryError
        If its kind of model is not installed.
    """
    header, arrays = read_model_file(path)
    try:
        settings = {
            k: tuple(v) if isinstance(v, list) else v for k, v in header["settings"].items()
        }
        model = create(header["model"], **settings)
        model.parameter_names_ = tuple(header["parameter_names"])
        model.phone_set_ = PhoneSet.from_dict(header["phone_set"])
        model.rate_ = float(header["rate"])
        model.trained_on_ = dict(header["trained_on"])
        model.log_ = tuple(LogEntry(*entry) for entry in header["log"])
        model._restore(header["learned"], arrays)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise FileFormatError(
            "this model file is damaged", path=path, found=f"{type(error).__name__}: {error}"
        ) from None
    except (ConfigurationError, DataError) as error:
        raise FileFormatError(
            f"this model file cannot be used: {error.problem}", path=path, found=error.found
        ) from None
    return model


def _plain(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings as JSON holds them."""
    return {k: list(v) if isinstance(v, tuple) else v for k, v in settings.items()}
