"""Cohen and Massaro's model of coarticulation (Beskow section 4.2), trained."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from mocap_fit.control import dominance
from mocap_fit.control.base import Progress
from mocap_fit.control.checkpoint import Checkpoint
from mocap_fit.control.dominance import FREE_PARAMETERS, Frames
from mocap_fit.control.levenberg_marquardt import NormalEquations
from mocap_fit.control.parameterwise_model import ParameterwiseModel, Penalty
from mocap_fit.control.symbol_model import Utterances
from mocap_fit.control.training import TrainingUtterance
from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

# Training measures time in tenths of a second, about the length of a phone: then theta, phi and c
# depend little on each other. What is learned is stored for seconds.
_UNIT = 0.1
# Logarithms of alpha, theta, phi and c at the start, and the bounds of
_START = (0.0, 0.3, 0.3, 0.2)
# a target and of those four.
_BOUNDS = ((-math.inf, -12.0, -8.0, -8.0, -1.6), (math.inf, 12.0, 6.0, 6.0, 1.4))
_FRAMES_AT_ONCE = 4096


@dataclass(eq=False, repr=False)
class CohenMassaro(ParameterwiseModel):
    """Targets of all segments, weighted with dominances that rise and fall (eqs. 7-8).

    Every phone and articulatory parameter has five free parameters: the target T, the height alpha,
    the slopes theta before the centre and phi after it, and the exponent c. Each articulatory
    parameter is trained on its own, by Levenberg-Marquardt (the paper used Gauss-Newton), from
    the targets that fit best with the dominances of the start.

    Parameters
    ----------
    phone_set
        The phone set that it is created for; empty for any.
    stress
        Whether phones of different stress are different phones, as in the paper.
    max_iter
        Largest number of iterations for each articulatory parameter.
    tol
        Training ends when an iteration reduces the error by less than this share of it.
    patience
        Training ends after so many iterations without a smaller error on the validation part.
    l2
        Strength of the L2 penalty on the distance of the free parameters from their start, in
        frames: on targets in their unit, and on the logarithms of the other four times the
        standard deviation of the parameter. It decides about phones that are seldom spoken. 0 is
        the paper's error.
    """

    name: ClassVar[str] = "cohen-massaro"
    title: ClassVar[str] = "Cohen-Massaro"

    def _learn(
        self, data: Utterances, held_out: Utterances, progress: Progress, checkpoint: Path | None
    ) -> None:
        stored = Checkpoint(checkpoint, self.name, self.get_params(), (data, held_out))
        phones = len(self.symbols_)
        frames = [_prepare_frames(each) for each in data]
        held_out_frames = [_prepare_frames(each) for each in held_out]
        #: Target, and logarithms of alpha, theta, phi, c for seconds, ``(parameters, phones, 5)``.
        self.free_: FloatArray = np.zeros((len(self.parameter_names_), phones, 5))
        bounds = np.tile(_BOUNDS[0], phones), np.tile(_BOUNDS[1], phones)
        for position, name in enumerate(self.parameter_names_):
            training = TrackResiduals(data, frames, position, phones)
            test = TrackResiduals(held_out, held_out_frames, position, phones)
            penalty = _build_penalty(training, self.l2)
            point = self._minimise(name, training, test, penalty, bounds, progress, stored)
            free = point.reshape(-1, 5).copy()
            # theta t^c with t in seconds instead of tenths.
            free[:, 2:4] -= np.exp(free[:, 4:]) * math.log(_UNIT)
            self.free_[position] = free

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        positions = self.symbols_.indices(phones)
        centres = 0.5 * (phones.starts + phones.ends)
        values = np.empty((len(times), len(self.parameter_names_)))
        for begin in range(0, len(times), _FRAMES_AT_ONCE):
            chunk = slice(begin, begin + _FRAMES_AT_ONCE)
            frames = Frames.from_segments(positions, centres, times[chunk])
            for column, free in enumerate(self.free_):
                values[chunk, column] = dominance.compute_trajectory(free, frames)
        return values

    def compute_dominances(
        self, phones: PhoneSequence, times: FloatArray, parameter: str
    ) -> FloatArray:
        """Return the dominance of every segment (eq. 7; Figure 2).

        Parameters
        ----------
        phones
            An utterance of at most 100 segments.
        times
            Times, ``(times,)``, seconds.
        parameter
            Name of the articulatory parameter.

        Returns
        -------
        FloatArray
            Dominances as shares of the largest alpha, ``(times, segments)``, 0 to 1.

        Raises
        ------
        DataError
            If the model is not trained, the phones are of another set, there is no such
            parameter, or there are too many segments.
        """
        self._check_fitted()
        self._check_phones(phones)
        if parameter not in self.parameter_names_:
            raise DataError(
                f"the model has no parameter '{parameter}'",
                expected=f"one of {', '.join(self.parameter_names_)}",
            )
        centres = 0.5 * (phones.starts + phones.ends)
        frames = Frames.from_segments(self.symbols_.indices(phones), centres, times)
        if frames.logarithms.shape[1] != len(phones) or frames.first.any():
            raise DataError(
                "there are too many segments", found=len(phones), expected="100 at most"
            )
        free = self.free_[self.parameter_names_.index(parameter)]
        highest = float(free[self.symbols_.seen, 1].max())
        return np.asarray(np.exp(dominance.compute_log_dominances(free, frames) - highest))

    def get_free_parameters(self) -> dict[str, FloatArray]:
        """Return what was learned, by name: target, alpha, theta, phi, c.

        Returns
        -------
        dict[str, FloatArray]
            ``(parameters, phones)`` each, in the order of `symbols_`, with times in seconds; those
            of phones that the corpus lacks are as they began.

        Raises
        ------
        DataError
            If the model is not trained.
        """
        self._check_fitted()
        values = [self.free_[:, :, 0], *np.exp(np.moveaxis(self.free_[:, :, 1:], 2, 0))]
        return dict(zip(FREE_PARAMETERS, values, strict=True))

    def _count_per_parameter(self, phone_set: PhoneSet, symbols: Sequence[str]) -> int:
        # 3800 for the paper's 76 symbols and ten parameters.
        return 5 * len(symbols)

    def _list_shapes(self) -> dict[str, tuple[int, ...]]:
        return {"free": (len(self.parameter_names_), len(self.symbols_), 5)}


class TrackResiduals:
    """The errors of one articulatory parameter over all utterances, and their normal equations.

    A point is the five free parameters of the first phone, then those of the next,
    ``(5 * phones,)``.

    Parameters
    ----------
    data
        The utterances.
    frames
        Their frames, with times in the unit of training.
    position
        Which articulatory parameter, from 0.
    phones
        Number of phones of the model.
    """

    def __init__(
        self, data: Utterances, frames: Sequence[Frames], position: int, phones: int
    ) -> None:
        from mocap_fit.control import dominance_kernel

        self.phones = phones
        columns = [each.values[:, position] for each in data]
        valid = [np.isfinite(values) for values in columns]
        self._parts = list(zip(frames, columns, valid, strict=True))
        self.count = int(sum(map(np.count_nonzero, valid)))
        self._equations = dominance_kernel

    @property
    def std(self) -> float:
        """Standard deviation of the values; 1 where it is 0 or there are none."""
        values = np.concatenate([values[valid] for _, values, valid in self._parts])
        return (float(values.std()) if len(values) else 0.0) or 1.0

    def cost(self, point: FloatArray) -> float:
        """Return the sum of squares over the frames that have a value (eq. 5).

        Parameters
        ----------
        point
            Free parameters, ``(5 * phones,)``.

        Returns
        -------
        float
            The sum in squared units of the parameter.
        """
        free, total = point.reshape(-1, 5), 0.0
        for frames, values, valid in self._parts:
            differences = (self._equations.compute_trajectory(free, frames) - values)[valid]
            total += float(differences @ differences)
        return total

    def compute_equations(self, point: FloatArray) -> NormalEquations:
        """Return the normal equations.

        Parameters
        ----------
        point
            Free parameters, ``(5 * phones,)``.

        Returns
        -------
        NormalEquations
            Of the squared errors around the point.
        """
        hessian = np.zeros((5 * self.phones, 5 * self.phones))
        gradient, total, free = np.zeros(5 * self.phones), 0.0, point.reshape(-1, 5)
        for frames, values, valid in self._parts:
            trajectory, derivatives = self._equations.jacobian(free, frames)
            differences = trajectory - values
            if not valid.all():
                differences, derivatives = differences[valid], derivatives[valid]
            used = (5 * frames.phones[:, None] + np.arange(5)).ravel()
            hessian[np.ix_(used, used)] += derivatives.T @ derivatives
            gradient[used] += derivatives.T @ differences
            total += float(differences @ differences)
        return NormalEquations(hessian, gradient, total)

    def fit_targets(self, free: FloatArray, l2: float) -> FloatArray:
        """Return the targets that fit best with given dominances.

        Parameters
        ----------
        free
            Free parameters, ``(phones, 5)``, no unit; the targets are not used.
        l2
            Strength of the penalty on the distance from the mean, frames. A phone that is not
            spoken gets the mean in any case.

        Returns
        -------
        FloatArray
            Targets, ``(phones,)``.
        """
        hessian, products = np.zeros((self.phones, self.phones)), np.zeros(self.phones)
        for frames, values, valid in self._parts:
            shares = self._equations.jacobian(free, frames)[1][valid, ::5]
            used = frames.phones
            hessian[np.ix_(used, used)] += shares.T @ shares
            products[used] += shares.T @ values[valid]
        # The shares of a frame add up to 1, so that this is the mean of the values.
        mean = float(products.sum() / max(hessian.sum(), 1e-300))
        least = max(l2, 1e-6 * float(np.diag(hessian).max(initial=0.0)), 1e-12)
        hessian[np.diag_indices(self.phones)] += least
        return np.asarray(np.linalg.solve(hessian, products + least * mean))


def _build_penalty(training: TrackResiduals, l2: float) -> Penalty:
    """Return the start and the penalty on the distance from it."""
    start = np.tile([0.0, *_START], (training.phones, 1))
    start[:, 0] = training.fit_targets(start, l2)
    # A logarithm that is 1 from its start weighs as much as a frame one deviation off.
    weights = l2 * np.array([1.0, *[training.std**2] * 4])
    return Penalty(start.ravel(), np.tile(weights, training.phones))


def _prepare_frames(utterance: TrainingUtterance) -> Frames:
    """Return the frames of an utterance with times in the unit of training."""
    centres = 0.5 * (utterance.phones.starts + utterance.phones.ends)
    return Frames.from_segments(utterance.positions, centres / _UNIT, utterance.times / _UNIT)
