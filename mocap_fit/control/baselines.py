"""Baselines that a control model must beat: the mean, phone means, a ridge regression."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import NonNegativeInt, PositiveFloat

from mocap_fit.control.base import Arrays, ControlModel, LogEntry, Progress
from mocap_fit.control.ridge import RidgeEquations
from mocap_fit.control.symbol_model import SymbolModel, Utterances
from mocap_fit.control.symbols import IntArray
from mocap_fit.control.training import (
    PLANNED_PARAMETERS,
    check_arrays,
    compute_means,
    compute_phone_means,
    compute_rmse,
)
from mocap_fit.corpus import Corpus, draw_fraction
from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

# Penalties to choose from: 10^0.5 to 10^4.
_GRID = tuple(10.0 ** (0.5 * k) for k in range(1, 9))
_FOLDS = 3


@dataclass(eq=False, repr=False)
class Mean(ControlModel):
    """The mean of every parameter over the corpus, whatever the phones. It has no settings."""

    name: ClassVar[str] = "mean"
    title: ClassVar[str] = "Mean"

    def _fit(
        self, corpus: Corpus, validation: Corpus | None, progress: Progress, checkpoint: Path | None
    ) -> None:
        values = [utterance.read_tracks().values for utterance in corpus]
        self.mean_: FloatArray = compute_means(np.concatenate(values))
        error = compute_rmse((each, self.mean_) for each in values)
        validation_error = None
        if validation is not None:
            validation_error = compute_rmse(
                (u.read_tracks().values, self.mean_) for u in validation
            )
        progress(LogEntry(1, error, validation_error))

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        return np.tile(self.mean_, (len(times), 1))

    @property
    def parameter_count(self) -> int:
        """One for each face parameter."""
        return len(self.parameter_names_) if self.is_fitted else PLANNED_PARAMETERS

    @property
    def look_ahead(self) -> float:
        """Zero seconds: no phones are needed."""
        return 0.0

    @property
    def look_back(self) -> float:
        """Zero seconds: no phones matter."""
        return 0.0

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        return {}, {"mean": self.mean_}

    def _restore(self, values: Mapping[str, Any], arrays: Arrays) -> None:
        check_arrays(arrays, {"mean": (len(self.parameter_names_),)})
        self.mean_ = arrays["mean"]


@dataclass(eq=False, repr=False)
class PhoneMean(SymbolModel):
    """The mean of every phone at the centre of its segments, and straight lines in between.

    Parameters
    ----------
    phone_set
        The phone set that it is created for; empty for any.
    stress
        Whether phones of different stress are different phones.
    """

    name: ClassVar[str] = "phone-mean"
    title: ClassVar[str] = "Phone means"

    def _learn(
        self, data: Utterances, held_out: Utterances, progress: Progress, checkpoint: Path | None
    ) -> None:
        self.targets_: FloatArray = compute_phone_means(data, len(self.symbols_))
        self._log_errors(data, held_out, progress)

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        centres = 0.5 * (phones.starts + phones.ends)
        targets = self.targets_[self.symbols_.indices(phones)]
        return np.stack([np.interp(times, centres, column) for column in targets.T], axis=1)

    def _count_per_parameter(self, phone_set: PhoneSet, symbols: Sequence[str]) -> int:
        return len(symbols)

    def _list_shapes(self) -> dict[str, tuple[int, ...]]:
        return {"targets": (len(self.symbols_), len(self.parameter_names_))}


@dataclass(eq=False, repr=False)
class Ridge(SymbolModel):
    """A ridge regression on the phones at every frame of a context.

    Parameters
    ----------
    phone_set
        The phone set that it is created for; empty for any.
    stress
        Whether phones of different stress are different phones.
    context
        Number of frames to each side, at the rate of the corpus.
    l2
        Strength of the L2 penalty: how often a phone must occur at a position of the context to
        get half its weight. None selects the best of 10^0.5 to 10^4 on the validation part, or,
        where there is none, by cross-validation on thirds of the training part.
    """

    context: NonNegativeInt = 12
    l2: PositiveFloat | None = None

    name: ClassVar[str] = "ridge"
    title: ClassVar[str] = "Ridge regression"

    def _learn(
        self, data: Utterances, held_out: Utterances, progress: Progress, checkpoint: Path | None
    ) -> None:
        #: The strength of the penalty.
        self.l2_: float = self._select_l2(data, held_out) if self.l2 is None else self.l2
        #: Weights, ``(features, parameters)``; the first feature is the constant 1.
        self.weights_: FloatArray = self._build_equations(data).solve(self.l2_)
        self._log_errors(data, held_out, progress)

    def _build_equations(self, data: Utterances) -> RidgeEquations:
        return RidgeEquations.from_utterances(data, self._find_features, self._width)

    @property
    def _width(self) -> int:
        return self._count_per_parameter(self.symbols_.phone_set, self.symbols_.names)

    def _select_l2(self, data: Utterances, held_out: Utterances) -> float:
        """Return the penalty of the least error on what is not trained on."""
        if held_out:
            parts = [(data, held_out)]
        else:
            folds = [int(draw_fraction(each.id, 0) * _FOLDS) for each in data]
            pairs = list(zip(folds, data, strict=True))
            parts = [
                ([u for fold, u in pairs if fold != test], [u for fold, u in pairs if fold == test])
                for test in range(_FOLDS)
            ]
        errors = np.zeros(len(_GRID))
        for training, test in parts:
            if training and test:
                equations = self._build_equations(training)
                for i, l2 in enumerate(_GRID):
                    self.weights_ = equations.solve(l2)
                    errors[i] += self._compute_error(test) ** 2
        return float(_GRID[int(np.argmin(errors))])

    def _find_features(self, phones: PhoneSequence, times: FloatArray) -> IntArray:
        """Return the features that are 1 at each time, ``(times, 2 * context + 2)``."""
        offsets = np.arange(-self.context, self.context + 1)
        positions = self.symbols_.indices(phones)
        # Where nothing is labelled is silence.
        silence = self.symbols_.index(self.phone_set_.silence)
        segments = phones.at(times[:, None] + offsets / self.rate_)
        symbols = np.where(segments >= 0, positions[segments], silence)
        features = 1 + np.arange(len(offsets)) * len(self.symbols_) + symbols
        return np.concatenate([np.zeros((len(times), 1), dtype=np.int64), features], axis=1)

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        values = np.zeros((len(times), self.weights_.shape[1]))
        for feature in self._find_features(phones, times).T:
            values += self.weights_[feature]
        return values

    def _count_per_parameter(self, phone_set: PhoneSet, symbols: Sequence[str]) -> int:
        return 1 + (2 * self.context + 1) * len(symbols)

    @property
    def look_ahead(self) -> float:
        """The context, seconds."""
        return float(self.context / self.rate_)

    @property
    def look_back(self) -> float:
        """The context, seconds."""
        return float(self.context / self.rate_)

    def _list_shapes(self) -> dict[str, tuple[int, ...]]:
        return {"weights": (self._width, len(self.parameter_names_))}

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        values, arrays = super()._state()
        return {**values, "l2": self.l2_}, arrays

    def _restore(self, values: Mapping[str, Any], arrays: Arrays) -> None:
        super()._restore(values, arrays)
        self.l2_ = float(values["l2"])
