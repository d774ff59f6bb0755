"""Baselines that a control model must beat: the mean, phone means, a ridge regression."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mocap_fit.control.base import ControlModel, LogEntry, Progress
from mocap_fit.control.training import (
    PLANNED_PARAMETERS,
    IntArray,
    Recording,
    Symbols,
    check_finite,
    check_phone_set,
    mean_values,
    phone_means,
    planned_symbols,
    recordings,
    root_mean_square,
)
from mocap_fit.corpus import Corpus, draw_fraction
from mocap_fit.errors import ConfigurationError
from mocap_fit.phones import PhoneSequence
from mocap_fit.tracks import FloatArray

_Arrays = Mapping[str, np.ndarray[Any, Any]]

# Penalties that are tried, in frames: a phone heard at one place in so many frames counts half.
_PENALTIES: tuple[float, ...] = tuple(10.0 ** (0.5 * k) for k in range(1, 9))
_FOLDS = 3


@dataclass(eq=False)
class Mean(ControlModel):
    """The mean of every parameter over the corpus, whatever is said. It has no settings."""

    name: ClassVar[str] = "mean"
    title: ClassVar[str] = "Mean"

    def _fit(
        self,
        corpus: Corpus,
        validation: Corpus | None,
        progress: Progress,
        checkpoint: Path | None,
    ) -> None:
        values = [utterance.read_tracks().values for utterance in corpus]
        self.mean_: FloatArray = mean_values(np.concatenate(values))
        there = [] if validation is None else [u.read_tracks().values for u in validation]
        progress(
            LogEntry(
                1,
                root_mean_square((v, self.mean_) for v in values),
                root_mean_square((v, self.mean_) for v in there) if there else None,
            )
        )

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        return np.tile(self.mean_, (len(times), 1))

    @property
    def parameter_count(self) -> int:
        """One a face parameter."""
        return len(self.parameter_names_) if self.is_fitted else PLANNED_PARAMETERS

    @property
    def look_ahead(self) -> float:
        """No phones are needed."""
        return 0.0

    @property
    def look_back(self) -> float:
        """No phones matter."""
        return 0.0

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        return {}, {"mean": self.mean_}

    def _restore(self, values: Mapping[str, Any], arrays: _Arrays) -> None:
        check_finite(arrays, {"mean": (len(self.parameter_names_),)})
        self.mean_ = arrays["mean"]


@dataclass(eq=False)
class PhoneMean(ControlModel):
    """The mean of every phone at the centre of its segments, and straight lines in between.

    Parameters
    ----------
    phone_set
        Counts the parameters before training; a corpus of another set is then refused.
    stress
        Whether phones of different stress are different phones.
    """

    phone_set: str = ""
    stress: bool = True

    name: ClassVar[str] = "phone-mean"
    title: ClassVar[str] = "Phone means"

    def _fit(
        self,
        corpus: Corpus,
        validation: Corpus | None,
        progress: Progress,
        checkpoint: Path | None,
    ) -> None:
        check_phone_set(corpus, self.phone_set)
        self.symbols_: Symbols = Symbols.of(corpus, self.stress)
        data = recordings(corpus, self.symbols_)
        self.targets_: FloatArray = phone_means(data, len(self.symbols_))
        progress(
            LogEntry(
                1,
                self._error(data),
                None if validation is None else self._error(recordings(validation, self.symbols_)),
            )
        )

    def _error(self, data: Sequence[Recording]) -> float:
        return root_mean_square((r.values, self._predict(r.phones, r.times)) for r in data)

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        centres = 0.5 * (phones.starts + phones.ends)
        targets = self.targets_[self.symbols_.positions(phones)]
        return np.stack([np.interp(times, centres, column) for column in targets.T], axis=1)

    @property
    def parameter_count(self) -> int:
        """One a phone and face parameter."""
        if self.is_fitted:
            return len(self.symbols_) * len(self.parameter_names_)
        return len(planned_symbols(self.phone_set, self.stress)[1]) * PLANNED_PARAMETERS

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        return self.symbols_.state(), {"targets": self.targets_}

    def _restore(self, values: Mapping[str, Any], arrays: _Arrays) -> None:
        self.symbols_ = Symbols.restored(self.phone_set_, self.stress, values)
        check_finite(arrays, {"targets": (len(self.symbols_), len(self.parameter_names_))})
        self.targets_ = arrays["targets"]


@dataclass(eq=False)
class Ridge(ControlModel):
    """A ridge regression on the phones heard at every frame of a context.

    Parameters
    ----------
    phone_set
        Counts the parameters before training; a corpus of another set is then refused.
    stress
        Whether phones of different stress are different phones.
    context
        How many frames to each side, at the rate of the corpus.
    penalty
        On the squares of the weights; 0 to take the best of several on the validation part, or,
        where there is none, on thirds of the training part in turn.
    """

    phone_set: str = ""
    stress: bool = True
    context: int = 12
    penalty: float = 0.0

    name: ClassVar[str] = "ridge"
    title: ClassVar[str] = "Ridge regression"

    def _fit(
        self,
        corpus: Corpus,
        validation: Corpus | None,
        progress: Progress,
        checkpoint: Path | None,
    ) -> None:
        if self.context < 0 or not 0 <= self.penalty < math.inf:
            raise ConfigurationError(
                "the ridge regression has an impossible setting",
                found=f"context {self.context}, penalty {self.penalty}",
                expected="0 or more",
            )
        check_phone_set(corpus, self.phone_set)
        self.symbols_: Symbols = Symbols.of(corpus, self.stress)
        data = recordings(corpus, self.symbols_)
        held = None if validation is None else recordings(validation, self.symbols_)
        self.penalty_: float = self.penalty or self._best_penalty(corpus, data, held)
        sums = _Sums(data, self._columns, self._width)
        self.weights_: FloatArray = sums.solved(self.penalty_)
        progress(LogEntry(1, self._error(data), None if held is None else self._error(held)))

    @property
    def _width(self) -> int:
        return 1 + (2 * self.context + 1) * len(self.symbols_)

    def _best_penalty(
        self, corpus: Corpus, data: Sequence[Recording], held: Sequence[Recording] | None
    ) -> float:
        if held is not None:
            parts = [(list(data), list(held))]
        else:
            folds = [int(draw_fraction(utterance.id, 0) * _FOLDS) for utterance in corpus]
            pairs = list(zip(folds, data, strict=True))
            parts = [
                ([r for at, r in pairs if at != fold], [r for at, r in pairs if at == fold])
                for fold in range(_FOLDS)
            ]
        errors = np.zeros(len(_PENALTIES))
        for training, test in parts:
            if not training or not test:
                continue
            sums = _Sums(training, self._columns, self._width)
            for position, penalty in enumerate(_PENALTIES):
                self.weights_ = sums.solved(penalty)
                errors[position] += self._error(test) ** 2
        return _PENALTIES[int(np.argmin(errors))]

    def _error(self, data: Sequence[Recording]) -> float:
        return root_mean_square((r.values, self._predict(r.phones, r.times)) for r in data)

    def _columns(self, phones: PhoneSequence, times: FloatArray) -> IntArray:
        """The columns that are 1 at each time, `(times, 1 + 2 * context + 1)`; the first always."""
        offsets = np.arange(-self.context, self.context + 1)
        positions = self.symbols_.positions(phones)
        # What nothing labels is silence.
        silence = self.symbols_.position(self.phone_set_.silence)
        found = phones.at(times[:, None] + offsets / self.rate_)
        heard = np.where(found >= 0, positions[found], silence)
        columns = 1 + np.arange(len(offsets)) * len(self.symbols_) + heard
        return np.concatenate([np.zeros((len(times), 1), dtype=np.int64), columns], axis=1)

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        columns = self._columns(phones, times)
        values = np.zeros((len(times), self.weights_.shape[1]))
        for column in columns.T:
            values += self.weights_[column]
        return values

    @property
    def parameter_count(self) -> int:
        """One a frame of the context, phone and face parameter; a constant a face parameter."""
        if self.is_fitted:
            return int(self.weights_.size)
        symbols = planned_symbols(self.phone_set, self.stress)[1]
        return (1 + (2 * self.context + 1) * len(symbols)) * PLANNED_PARAMETERS

    @property
    def look_ahead(self) -> float:
        """The context, seconds."""
        return float(self.context / self.rate_)

    @property
    def look_back(self) -> float:
        """The context, seconds."""
        return float(self.context / self.rate_)

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        return (
            {**self.symbols_.state(), "penalty": self.penalty_},
            {"weights": self.weights_},
        )

    def _restore(self, values: Mapping[str, Any], arrays: _Arrays) -> None:
        self.symbols_ = Symbols.restored(self.phone_set_, self.stress, values)
        self.penalty_ = float(values["penalty"])
        check_finite(arrays, {"weights": (self._width, len(self.parameter_names_))})
        self.weights_ = arrays["weights"]


class _Sums:
    """The normal equations of a regression whose features are 0 or 1, a parameter each.

    Parameters that miss the same frames share theirs.
    """

    def __init__(self, data: Sequence[Recording], columns: Any, width: int) -> None:
        from scipy import sparse

        active = [columns(each.phones, each.times) for each in data]
        values = np.concatenate([each.values for each in data])
        indices = np.concatenate(active)
        rows, ones = indices.shape
        features = sparse.csr_matrix(
            (np.ones(indices.size), indices.ravel(), np.arange(0, indices.size + 1, ones)),
            shape=(rows, width),
        )
        self._parts: list[tuple[list[int], FloatArray, FloatArray]] = []
        self._parameters = values.shape[1]
        there = np.isfinite(values)
        groups: dict[bytes, list[int]] = {}
        for parameter in range(values.shape[1]):
            groups.setdefault(np.packbits(there[:, parameter]).tobytes(), []).append(parameter)
        for group in groups.values():
            kept = features[there[:, group[0]]]
            wanted = values[there[:, group[0]]][:, group]
            self._parts.append((group, (kept.T @ kept).toarray(), kept.T @ wanted))

    def solved(self, penalty: float) -> FloatArray:
        """The weights for a penalty on their squares, `(features, parameters)`."""
        from scipy.linalg import cho_factor, cho_solve

        result = np.zeros((len(self._parts[0][1]), self._parameters))
        for group, squares, products in self._parts:
            if not squares.any():
                continue
            # The first column is the constant, which has no penalty but what makes it sure.
            penalties = np.full(len(squares), penalty)
            penalties[0] = 1e-9 * squares[0, 0]
            factor = cho_factor(squares + np.diag(penalties), overwrite_a=True)
            result[:, group] = cho_solve(factor, products)
        return result
