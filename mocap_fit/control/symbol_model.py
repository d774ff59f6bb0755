"""The base class of models that learn something for every phone."""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mocap_fit.control.base import Arrays, ControlModel, LogEntry, Progress
from mocap_fit.control.symbols import Symbols, check_phone_set, plan_symbols
from mocap_fit.control.training import (
    PLANNED_PARAMETERS,
    TrainingUtterance,
    check_arrays,
    compute_rmse,
    load_utterances,
)
from mocap_fit.corpus import Corpus
from mocap_fit.phones import PhoneSet

Utterances = Sequence[TrainingUtterance]


@dataclass(eq=False, repr=False)
class SymbolModel(ControlModel):
    """A model that learns arrays, for the phones of a set with or without their stress.

    Attributes
    ----------
    symbols_
        The phones that it distinguishes.

    Parameters
    ----------
    phone_set
        The phone set that `parameter_count` supposes before training; a corpus of another set is
        then refused. Empty for any.
    stress
        Whether phones of different stress are different phones.
    """

    phone_set: str = ""
    stress: bool = True

    def _fit(
        self, corpus: Corpus, validation: Corpus | None, progress: Progress, checkpoint: Path | None
    ) -> None:
        check_phone_set(corpus, self.phone_set)
        self.symbols_: Symbols = Symbols.from_corpus(corpus, self.stress)
        data, held_out = (
            load_utterances(part, self.symbols_, self._max_pause) for part in (corpus, validation)
        )
        self._learn(data, held_out, progress, checkpoint)

    @abc.abstractmethod
    def _learn(
        self, data: Utterances, held_out: Utterances, progress: Progress, checkpoint: Path | None
    ) -> None:
        """Learn from utterances; those that are held out, if any, decide when to stop."""

    @property
    def _max_pause(self) -> float | None:
        """How far from speech silence counts in training, seconds; None for any distance."""
        return None

    @abc.abstractmethod
    def _count_per_parameter(self, phone_set: PhoneSet, symbols: Sequence[str]) -> int:
        """Return the number of free parameters of one face parameter."""

    @abc.abstractmethod
    def _list_shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shape of each learned array, by its attribute's name without the ``_``."""

    @property
    def parameter_count(self) -> int:
        """Number of free parameters; before training, of ten face parameters."""
        if self.is_fitted:
            symbols = self.symbols_.phone_set, self.symbols_.names
            return self._count_per_parameter(*symbols) * len(self.parameter_names_)
        symbols = plan_symbols(self.phone_set, self.stress)
        return self._count_per_parameter(*symbols) * PLANNED_PARAMETERS

    def _log_errors(self, data: Utterances, held_out: Utterances, progress: Progress) -> None:
        """Log the errors of a model that learns in one step."""
        error = self._compute_error(held_out) if held_out else None
        progress(LogEntry(1, self._compute_error(data), error))

    def _compute_error(self, data: Utterances) -> float:
        return compute_rmse((each.values, self._predict(each.phones, each.times)) for each in data)

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        arrays = {name: np.asarray(getattr(self, f"{name}_")) for name in self._list_shapes()}
        return self.symbols_.to_json(), arrays

    def _restore(self, values: Mapping[str, Any], arrays: Arrays) -> None:
        self.symbols_ = Symbols.from_json(self.phone_set_, self.stress, values)
        shapes = self._list_shapes()
        check_arrays(arrays, shapes)
        for name in shapes:
            setattr(self, f"{name}_", arrays[name])
