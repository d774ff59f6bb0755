"""Cohen and Massaro's model of coarticulation (Beskow section 4.2), trained."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mocap_fit.control import dominance
from mocap_fit.control.base import ControlModel, Progress
from mocap_fit.control.dominance import FREE_PARAMETERS, Frames
from mocap_fit.control.levenberg_marquardt import Equations
from mocap_fit.control.parameter_training import train_parameter
from mocap_fit.control.training import (
    PLANNED_PARAMETERS,
    Checkpoint,
    Recording,
    Symbols,
    check_finite,
    check_phone_set,
    check_settings,
    planned_symbols,
    recordings,
)
from mocap_fit.corpus import Corpus
from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSequence
from mocap_fit.tracks import FloatArray

# Training measures time in tenths of a second, about the length of a phone: then theta, phi and c
# have little to do with each other. What is learned is kept for seconds.
_UNIT = 0.1
# Logarithms of alpha, theta, phi and c at the start, and how far they may go:
_START = (0.0, 0.3, 0.3, 0.2)
# of a target, and of those four.
_BOUNDS = (
    (-math.inf, (-12.0, -8.0, -8.0, -1.6)),
    (math.inf, (12.0, 6.0, 6.0, 1.4)),
)
_PREDICTED_AT_ONCE = 4096


@dataclass(eq=False)
class CohenMassaro(ControlModel):
    """Targets of all segments, weighted with dominances that rise and fall (eqs. 7-8).

    Every phone and articulatory parameter has five free parameters: the target T, the height alpha,
    the fall-offs theta before the centre and phi after it, and the exponent c. Each articulatory
    parameter is trained on its own, by Levenberg-Marquardt (the paper used Gauss-Newton), from
    targets that fit the start's dominances best.

    Parameters
    ----------
    phone_set
        Counts the parameters before training; a corpus of another set is then refused.
    stress
        Whether phones of different stress are different phones, as in the paper.
    iterations
        At most so many for each articulatory parameter.
    tolerance
        Ends when an iteration makes the error less by a smaller part of it than this.
    patience
        Ends when the error on the validation part was not the least for so many iterations; what
        was learned is then that of the least.
    prior
        How many frames' worth a free parameter is held at where it began; it tells what becomes of
        phones that are seldom heard. 0 is the paper's error as it is.
    """

    phone_set: str = ""
    stress: bool = True
    iterations: int = 30
    tolerance: float = 1e-3
    patience: int = 3
    prior: float = 1.0

    name: ClassVar[str] = "cohen-massaro"
    title: ClassVar[str] = "Cohen-Massaro"

    def _fit(
        self,
        corpus: Corpus,
        validation: Corpus | None,
        progress: Progress,
        checkpoint: Path | None,
    ) -> None:
        check_settings(self, iterations=1, tolerance=0, patience=1, prior=0)
        check_phone_set(corpus, self.phone_set)
        self.symbols_: Symbols = Symbols.of(corpus, self.stress)
        data = recordings(corpus, self.symbols_)
        held = () if validation is None else recordings(validation, self.symbols_)
        kept = Checkpoint(checkpoint, self.name, self.settings, (data, held))
        prepared = [_prepared(each) for each in data], [_prepared(each) for each in held]
        count = len(self.parameter_names_)
        #: `(parameters, phones, 5)`: target, and logarithms of alpha, theta, phi, c, for seconds.
        self.free_: FloatArray = np.zeros((count, len(self.symbols_), 5))
        for position, name in enumerate(self.parameter_names_):
            training = _Track(data, prepared[0], position, len(self.symbols_))
            test = _Track(held, prepared[1], position, len(self.symbols_))
            self.free_[position] = self._trained(name, training, test, kept, progress)

    def _trained(
        self, name: str, training: _Track, test: _Track, kept: Checkpoint, progress: Progress
    ) -> FloatArray:
        """The free parameters of one articulatory parameter, `(phones, 5)`."""
        phones = training.phones
        start = np.tile([0.0, *_START], (phones, 1))
        start[:, 0] = training.best_targets(start, self.prior)
        # A logarithm that is 1 from its start weighs as much as a frame one deviation off.
        pull = self.prior * np.array([1.0, *[training.scale() ** 2] * 4])
        bounds = [np.tile([far, *logarithms], phones) for far, logarithms in _BOUNDS]
        found = train_parameter(
            name,
            training,
            test,
            start.ravel(),
            np.tile(pull, phones),
            (bounds[0], bounds[1]),
            self,
            kept,
            progress,
        )
        free = found.reshape(-1, 5).copy()
        # theta t^c with t in seconds instead of tenths.
        free[:, 2:4] -= np.exp(free[:, 4:]) * math.log(_UNIT)
        return free

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        positions = self.symbols_.positions(phones)
        centres = 0.5 * (phones.starts + phones.ends)
        values = np.empty((len(times), len(self.parameter_names_)))
        for begin in range(0, len(times), _PREDICTED_AT_ONCE):
            part = slice(begin, begin + _PREDICTED_AT_ONCE)
            frames = Frames.of(positions, centres, times[part])
            for column, free in enumerate(self.free_):
                values[part, column] = dominance.trajectory(free, frames)
        return values

    def dominances(self, phones: PhoneSequence, times: FloatArray, parameter: str) -> FloatArray:
        """The dominance of every segment (eq. 7; Figure 2).

        Parameters
        ----------
        phones
            An utterance of at most 100 segments.
        times
            `(times,)`, seconds.
        parameter
            Which articulatory parameter.

        Returns
        -------
        FloatArray
            `(times, segments)`, as parts of the largest alpha.

        Raises
        ------
        DataError
            If the model is not trained, the phones are not its own, or there are too many.
        """
        self._check_fitted()
        self._check_phones(phones)
        if parameter not in self.parameter_names_:
            raise DataError(
                f"the model has no parameter '{parameter}'",
                expected=f"one of {', '.join(self.parameter_names_)}",
            )
        frames = Frames.of(
            self.symbols_.positions(phones), 0.5 * (phones.starts + phones.ends), times
        )
        if frames.logarithms.shape[1] != len(phones) or frames.first.any():
            raise DataError(
                "there are too many segments", found=len(phones), expected="100 at most"
            )
        free = self.free_[self.parameter_names_.index(parameter)]
        highest = float(free[self.symbols_.seen, 1].max())
        return np.asarray(np.exp(dominance.log_dominances(free, frames) - highest))

    def free_parameters(self) -> dict[str, FloatArray]:
        """What was learned, by name: target, alpha, theta, phi, c (times in seconds).

        Returns
        -------
        dict[str, FloatArray]
            `(parameters, phones)` each, in the order of `symbols_`; those of phones that the
            corpus had not are as they began.
        """
        self._check_fitted()
        values = [self.free_[:, :, 0], *np.exp(np.moveaxis(self.free_[:, :, 1:], 2, 0))]
        return dict(zip(FREE_PARAMETERS, values, strict=True))

    @property
    def parameter_count(self) -> int:
        """Five a phone and articulatory parameter: 3800 for the paper's 76 and ten."""
        if self.is_fitted:
            return int(self.free_.size)
        return 5 * len(planned_symbols(self.phone_set, self.stress)[1]) * PLANNED_PARAMETERS

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        return self.symbols_.state(), {"free": self.free_}

    def _restore(
        self, values: Mapping[str, Any], arrays: Mapping[str, np.ndarray[Any, Any]]
    ) -> None:
        self.symbols_ = Symbols.restored(self.phone_set_, self.stress, values)
        check_finite(arrays, {"free": (len(self.parameter_names_), len(self.symbols_), 5)})
        self.free_ = arrays["free"]


class _Track:
    """One articulatory parameter over all recordings: its errors, its normal equations.

    A point is `(5 * phones,)`: the five of the first phone, then those of the next.
    """

    def __init__(
        self, data: Sequence[Recording], frames: Sequence[Frames], position: int, phones: int
    ) -> None:
        self.phones = phones
        self._frames = frames
        self._values = [each.values[:, position] for each in data]
        self._there = [np.isfinite(values) for values in self._values]
        self.count = int(sum(np.count_nonzero(there) for there in self._there))
        kernel = dominance.compiled_kernel()
        self._trajectory = dominance.trajectory if kernel is None else kernel.trajectory
        self._jacobian = dominance.jacobian if kernel is None else kernel.jacobian

    def scale(self) -> float:
        """Standard deviation of the values; 1 where it is 0 or there are none."""
        values = np.concatenate(
            [v[there] for v, there in zip(self._values, self._there, strict=True)]
        )
        found = float(values.std()) if len(values) else 0.0
        return found or 1.0

    def error(self, point: FloatArray) -> float:
        """Sum of squares over the frames that have a value (eq. 5)."""
        free, total = point.reshape(-1, 5), 0.0
        for frames, values, there in zip(self._frames, self._values, self._there, strict=True):
            apart = (self._trajectory(free, frames) - values)[there]
            total += float(apart @ apart)
        return total

    def equations(self, point: FloatArray) -> Equations:
        """The normal equations of all free parameters, `5 * phones` of them."""
        squares = np.zeros((5 * self.phones, 5 * self.phones))
        slope, total, free = np.zeros(5 * self.phones), 0.0, point.reshape(-1, 5)
        for frames, values, there in zip(self._frames, self._values, self._there, strict=True):
            found, derivatives = self._jacobian(free, frames)
            apart = found - values
            if not there.all():
                apart, derivatives = apart[there], derivatives[there]
            own = (5 * frames.phones[:, None] + np.arange(5)).ravel()
            squares[np.ix_(own, own)] += derivatives.T @ derivatives
            slope[own] += derivatives.T @ apart
            total += float(apart @ apart)
        return Equations(squares, slope, total)

    def best_targets(self, free: FloatArray, pull: float) -> FloatArray:
        """The targets that fit best where the dominances are given, `(phones,)`."""
        squares, products = np.zeros((self.phones, self.phones)), np.zeros(self.phones)
        for frames, values, there in zip(self._frames, self._values, self._there, strict=True):
            shares = self._jacobian(free, frames)[1][there, ::5]
            own = frames.phones
            squares[np.ix_(own, own)] += shares.T @ shares
            products[own] += shares.T @ values[there]
        middle = float(products.sum() / max(squares.sum(), 1e-300))
        # Held a little at the mean, so that every phone has a target.
        least = max(pull, 1e-6 * float(np.diag(squares).max(initial=0.0)), 1e-12)
        squares[np.diag_indices(self.phones)] += least
        return np.asarray(np.linalg.solve(squares, products + least * middle))


def _prepared(recording: Recording) -> Frames:
    centres = 0.5 * (recording.phones.starts + recording.phones.ends)
    return Frames.of(recording.positions, centres / _UNIT, recording.times / _UNIT)
