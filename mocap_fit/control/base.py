"""The base class of the control models: phones in, face parameters out.

A model is a dataclass whose fields are its settings; its constructor only stores them. `fit` learns
from a corpus, and learned attributes end in ``_``. To write a model, subclass `ControlModel`,
implement the methods that begin with one underscore, and register the class as an entry point of
the group ``mocap_fit.control_models``.
"""

from __future__ import annotations

import abc
import contextlib
import dataclasses
import json
import math
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from mocap_fit.control.model_file import write_model_file
from mocap_fit.control.settings import check_settings, describe_settings, get_settings, to_json
from mocap_fit.control.streaming import Stream, WindowStream
from mocap_fit.corpus import Corpus
from mocap_fit.errors import DataError, RegistryError, SmallCorpusWarning
from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.processes import limit_to_one_thread
from mocap_fit.registry import Registry
from mocap_fit.tracks import FloatArray, ParameterTracks

CONTROL_MODELS = Registry("mocap_fit.control_models", "control model")
# Fewer utterances than this, or a validation part of one, are warned of.
_FEW_UTTERANCES = 50

#: Arrays of a trained model, by name.
Arrays = Mapping[str, np.ndarray[Any, Any]]


@dataclass(frozen=True)
class LogEntry:
    """One line of a training log.

    Parameters
    ----------
    iteration
        Number of iterations that were done; 0 before anything was learned.
    training_error
        Root mean square error over the training frames and all parameters, in the unit of the
        parameters (the root of eq. 4 of Beskow divided by the number of values).
    validation_error
        The same over the validation part; None where there is none.
    part
        What was trained, such as a parameter or a network; empty for the complete model.
    """

    iteration: int
    training_error: float
    validation_error: float | None = None
    part: str = ""


Progress = Callable[[LogEntry], object]


class ControlModel(abc.ABC):
    """A model that predicts parameter tracks from phones.

    Attributes
    ----------
    parameter_names_
        The face parameters, in the order of the corpus.
    phone_set_
        The phone set of the corpus; phones of another set are refused.
    rate_
        Frames per second of the corpus, hertz.
    trained_on_
        What it was trained on: ``language``, ``phone_set``, ``utterances``,
        ``validation_utterances``, and what a caller adds, such as ``corpus``.
    log_
        The training log, one `LogEntry` for each iteration.
    """

    #: The name it is registered under.
    name: ClassVar[str]
    #: Its name in tables and figures.
    title: ClassVar[str]
    #: Whether `fit` learns from the corpus; False where it takes no more than names from it.
    learns: ClassVar[bool] = True

    parameter_names_: tuple[str, ...]
    phone_set_: PhoneSet
    rate_: float
    trained_on_: dict[str, Any]
    log_: tuple[LogEntry, ...]

    # -- what a model implements ---------------------------------------------------------------

    @abc.abstractmethod
    def _fit(
        self, corpus: Corpus, validation: Corpus | None, progress: Progress, checkpoint: Path | None
    ) -> None:
        """Learn from a corpus; the settings are checked and the attributes above are set.

        Call ``progress`` once an iteration. Frames with a missing value of a parameter do not
        count for that parameter. A model with a long training writes ``checkpoint`` regularly and
        resumes from one that fits.
        """

    @abc.abstractmethod
    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        """Return parameters ``(times, parameters)`` at ascending times ``(times,)`` in seconds.

        The phones are of the model's set, at least one. Parameters are never NaN, not even before
        the first phone and after the last.
        """

    @property
    @abc.abstractmethod
    def parameter_count(self) -> int:
        """Number of free parameters that are learned."""

    @property
    def look_ahead(self) -> float:
        """How far beyond a frame phones must be known, seconds; infinite: to the last phone."""
        return math.inf

    @property
    def look_back(self) -> float:
        """How far before a frame phones matter, seconds; infinite: from the first phone."""
        return math.inf

    @abc.abstractmethod
    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        """Return what was learned: values that JSON can hold, and arrays of numbers by name."""

    @abc.abstractmethod
    def _restore(self, values: Mapping[str, Any], arrays: Arrays) -> None:
        """Set the learned attributes from what `_state` returned; the attributes above are set."""

    # -- what every model has ------------------------------------------------------------------

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the settings of the model, as scikit-learn's estimators do.

        Parameters
        ----------
        deep
            No effect: no setting is a model itself.

        Returns
        -------
        dict[str, Any]
            The constructor's arguments by name.
        """
        return get_settings(self)

    @property
    def is_fitted(self) -> bool:
        """Whether the model is ready to predict."""
        return hasattr(self, "parameter_names_")

    def __repr__(self) -> str:
        text = describe_settings(self)
        if self.is_fitted:
            count = self.trained_on_.get("utterances")
            text += f", trained on {count} utterances" if count else f", for {self.phone_set_.name}"
        return text

    def __eq__(self, other: object) -> bool:
        """Whether both are of one class and have the same settings and learned the same."""
        if type(other) is not type(self):
            return NotImplemented
        if not (self.is_fitted and other.is_fitted):
            return self.is_fitted == other.is_fitted and self.get_params() == other.get_params()
        header, arrays = self._to_file()
        other_header, other_arrays = other._to_file()
        return (
            json.dumps(header) == json.dumps(other_header)
            and arrays.keys() == other_arrays.keys()
            and all(
                np.array_equal(array, other_arrays[key], equal_nan=array.dtype.kind == "f")
                for key, array in arrays.items()
            )
        )

    __hash__ = None  # type: ignore[assignment]  # Models change when they are fitted.

    def fit(
        self,
        corpus: Corpus,
        validation: Corpus | None = None,
        *,
        progress: Progress | None = None,
        checkpoint: str | os.PathLike[str] | None = None,
    ) -> Self:
        """Learn from a corpus, on one thread of linear algebra.

        The result does not depend on the number of cores. After an error the model is what it was
        before.

        Parameters
        ----------
        corpus
            The training part.
        validation
            Utterances whose error decides when to stop (Beskow section 4.1); without them training
            ends when the training error falls no more.
        progress
            Called with a `LogEntry` for every iteration.
        checkpoint
            A file in which a long training stores its state; training resumes from one that
            exists and fits.

        Returns
        -------
        ControlModel
            The model itself.

        Raises
        ------
        ConfigurationError
            If a setting has another type than it should, or is out of range.
        DataError
            If the corpus is empty, or differs from the validation part in phone set or parameters.
        RegistryError
            If the model is a plug-in that raises an error that is not a `MocapFitError`.

        Warns
        -----
        SmallCorpusWarning
            If there are fewer than 50 utterances, or the validation part is a single one.
        """
        check_settings(type(self), get_settings(self))
        if not len(corpus):
            raise DataError("the corpus has no utterance to train on")
        if validation is not None and (
            validation.parameter_names != corpus.parameter_names
            or validation.phone_set.name != corpus.phone_set.name
        ):
            raise DataError(
                "the validation part differs from the training part",
                found=f"{validation.phone_set.name}, {', '.join(validation.parameter_names)}",
                expected=f"{corpus.phone_set.name}, {', '.join(corpus.parameter_names)}",
            )
        if self.learns:
            _warn_of_few(corpus, validation)
        before = dict(vars(self))
        self.parameter_names_ = corpus.parameter_names
        self.phone_set_ = corpus.phone_set
        self.rate_ = corpus.utterances[0].read_tracks().rate if corpus.rate is None else corpus.rate
        self.trained_on_ = {
            "language": corpus.language,
            "phone_set": corpus.phone_set.name,
            "utterances": len(corpus),
            "validation_utterances": 0 if validation is None else len(validation),
        }
        self.log_ = ()
        entries: list[LogEntry] = []
        errors_of_caller: list[Exception] = []

        def log(entry: LogEntry) -> None:
            entries.append(entry)
            if progress is not None:
                try:
                    progress(entry)
                except Exception as error:
                    errors_of_caller.append(error)
                    raise

        path = None if checkpoint is None else Path(checkpoint)
        try:
            with self._guard(errors_of_caller), limit_to_one_thread():
                self._fit(corpus, validation, log, path)
        except BaseException:
            vars(self).clear()
            vars(self).update(before)
            raise
        self.log_ = (*self.log_, *entries)
        return self

    def predict_at(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        """Return face parameters at any times.

        Parameters
        ----------
        phones
            Phones of an utterance, in the model's phone set.
        times
            Times ``(times,)`` on the clock of the phones, seconds, ascending.

        Returns
        -------
        FloatArray
            Parameters, ``(times, parameters)``, no unit: 0 at rest, 1 the full gesture.

        Raises
        ------
        DataError
            If the model is not trained, there are no phones, or they are of another set.
        RegistryError
            If the model is a plug-in that raises an error that is not a `MocapFitError`.
        """
        self._check_fitted()
        self._check_phones(phones)
        times = np.asarray(times, dtype=np.float64)
        with self._guard(), limit_to_one_thread():
            values = np.asarray(self._predict(phones, times), dtype=np.float64)
            if values.shape != (len(times), len(self.parameter_names_)):
                raise ValueError(
                    f"{values.shape} values for {len(times)} times "
                    f"and {len(self.parameter_names_)} parameters"
                )
        return values

    def predict(
        self,
        phones: PhoneSequence,
        rate: float | None = None,
        *,
        start_time: float | None = None,
        frames: int | None = None,
    ) -> ParameterTracks:
        """Return the parameter tracks of an utterance.

        Parameters
        ----------
        phones
            Phones of the utterance, in the model's phone set.
        rate
            Frames per second, hertz; that of the training corpus by default.
        start_time
            Time of the first frame, seconds; the start of the first phone by default.
        frames
            Number of frames; all that begin before the end of the last phone by default.

        Returns
        -------
        ParameterTracks
            The predicted tracks.

        Raises
        ------
        DataError
            If the model is not trained, there are no phones, they are of another set, or the rate
            is not positive.
        RegistryError
            If the model is a plug-in that raises an error that is not a `MocapFitError`.
        """
        self._check_fitted()
        self._check_phones(phones)
        rate = self.rate_ if rate is None else rate
        if not math.isfinite(rate) or rate <= 0:
            raise DataError("the frame rate must be positive", found=f"{rate} Hz")
        start = phones[0].start if start_time is None else start_time
        if frames is None:
            frames = max(0, math.ceil((phones[-1].end - start) * rate - 1e-6))
        values = self.predict_at(phones, start + np.arange(frames) / rate)
        tracks = ParameterTracks(
            self.parameter_names_,
            rate,
            values,
            start_time=start,
            name=phones.name,
            provenance=phones.provenance,
        )
        settings = to_json(self.get_params())
        return tracks.add_step("predict", {"model": self.name, "settings": settings})

    def stream(self, rate: float | None = None) -> Stream:
        """Begin a live utterance: phones are pushed, frames are pulled as they become known.

        The frames are those of `predict`. A model with an infinite look-ahead returns them when
        the utterance has ended.

        Parameters
        ----------
        rate
            Frames per second, hertz; that of the training corpus by default.

        Returns
        -------
        Stream
            A new stream without phones.

        Raises
        ------
        DataError
            If the model is not trained, or the rate is not positive.
        """
        self._check_fitted()
        return WindowStream(self, self.rate_ if rate is None else rate)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the trained model as one file of arrays and JSON, completely or not at all.

        Parameters
        ----------
        path
            The file; an existing one is replaced.

        Raises
        ------
        DataError
            If the model is not trained.
        FileFormatError
            If the file cannot be written.
        RegistryError
            If the model is a plug-in that raises an error that is not a `MocapFitError`.
        """
        self._check_fitted()
        with self._guard():
            write_model_file(*self._to_file(), path)

    def _to_file(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        """Return the header and the arrays of the model's file."""
        values, arrays = self._state()
        header = {
            "model": self.name,
            "settings": to_json(self.get_params()),
            "parameter_names": list(self.parameter_names_),
            "phone_set": self.phone_set_.to_dict(),
            "rate": self.rate_,
            "trained_on": self.trained_on_,
            "log": [dataclasses.astuple(entry) for entry in self.log_],
            "learned": values,
        }
        return header, arrays

    @contextlib.contextmanager
    def _guard(self, errors_of_caller: Sequence[Exception] = ()) -> Iterator[None]:
        """Name the plug-in and its distribution where it raises anything but our errors."""
        name = getattr(self, "name", "")
        if name not in CONTROL_MODELS.names() or CONTROL_MODELS.get(name) is not type(self):
            yield
            return
        try:
            with CONTROL_MODELS.guard(name):
                yield
        except RegistryError as error:
            for caught in errors_of_caller:
                if error.__cause__ is caught:
                    raise caught from None
            raise

    def _check_fitted(self) -> None:
        if not self.is_fitted:
            raise DataError(
                f"the model '{self.name}' is not trained", advice="Call fit, or load a trained one."
            )

    def _check_phones(self, phones: PhoneSequence) -> None:
        if not len(phones):
            raise DataError(f"the utterance '{phones.name}' has no phones")
        expected = self.phone_set_.name
        if phones.phone_set and expected and phones.phone_set != expected:
            raise DataError(
                "the phones are of another set than those that the model was trained on",
                found=phones.phone_set,
                expected=expected,
                advice="Map them with mocap_fit.phones.map_phones, or take another model.",
            )
        unknown = sorted({s.phone for s in phones if self.phone_set_.parse(s.phone) is None})
        if unknown:
            raise DataError(
                f"the phone set '{expected}' of the model lacks phones of '{phones.name}'",
                found=", ".join(unknown),
                advice="Map them with mocap_fit.phones.map_phones.",
            )


def _warn_of_few(corpus: Corpus, validation: Corpus | None) -> None:
    """Warn of a small training part, or a validation part of one, and say what to expect."""
    texts = []
    if len(corpus) < _FEW_UTTERANCES:
        count = "1 utterance" if len(corpus) == 1 else f"{len(corpus)} utterances"
        texts.append(
            f"training on {count}: errors will be larger (with 5, 10 and 25 simulated sentences "
            "about 1.5, 1.3 and 1.1 times those with 50), and other sentences will give other "
            f"scores; compare models on {_FEW_UTTERANCES} or more"
        )
    if validation is not None and len(validation) == 1:
        texts.append(
            "the validation part is a single utterance: when training stops, and the error that it "
            "reports, depend on the draw; hold out five or more"
        )
    if texts:
        warnings.warn("; ".join(texts), SmallCorpusWarning, stacklevel=3)
