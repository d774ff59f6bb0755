"""Öhman's model of coarticulation (Beskow section 4.3), trained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import NonNegativeFloat
from scipy import sparse

from mocap_fit.control.base import Progress
from mocap_fit.control.blending import Blends, compute_blends, find_peaks
from mocap_fit.control.checkpoint import Checkpoint
from mocap_fit.control.levenberg_marquardt import NormalEquations
from mocap_fit.control.parameterwise_model import ParameterwiseModel, Penalty
from mocap_fit.control.symbol_model import Utterances
from mocap_fit.control.training import compute_phone_means
from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

# The coarticulation factor of a consonant at the start.
_FACTOR = 0.5
# The largest distance of a target from the mean of the data, in distances of the farthest value;
# the target of a consonant with almost no influence could be anywhere.
_WIDEST = 2.0


@dataclass(eq=False, repr=False)
class Ohman(ParameterwiseModel):
    """A track from vowel to vowel, and consonants superimposed on it (eqs. 15-17).

    A vowel and articulatory parameter has a target; a consonant has a target and a factor w in
    [0, 1], the share by which it pulls the vowel track there. Silence counts with the consonants.
    All blends are cubic: 0 at the centre of the gesture before, 1 at its own, 0 at the next, and
    level at all three. The vowel track's neighbours are vowels, a consonant's are phones of any
    kind, so that in a cluster one consonant hands over to the next.

    What the paper leaves open: a segment longer than twice `hold`, such as a pause, is at its peak
    from `hold` after its start until `hold` before its end, not at its centre alone. Before the
    first vowel the track stands at its target, and after the last at that one's; before the first
    peak, and after the last one, that phone stands at its full influence. In an utterance without a
    vowel the track is the mean of the targets of all vowels that the corpus has, and without any
    the mean of the data.

    The parameters of one articulatory parameter are found together, by Levenberg-Marquardt.

    Parameters
    ----------
    phone_set
        Name of the phone set of its corpora; empty for any.
    stress
        Whether a phone with and without stress has parameters of each, as in the paper.
    max_iter
        Largest number of steps for an articulatory parameter.
    tol
        Share of the error; training ends when a step reduces it by less.
    patience
        Steps without a smaller error on the validation part after which training ends.
    l2
        Strength of the L2 penalty on the distance from the start, in frames: on targets in their
        unit, and on factors times the standard deviation of the parameter.
    hold
        Largest distance of a peak from both ends of its segment, seconds; None for peaks at the
        centres alone.
    pause
        Frames of silence farther than this from speech do not count in training, seconds: long
        pauses would distort the rest. None counts all, as the paper does.
    """

    tol: NonNegativeFloat = 1e-4
    l2: NonNegativeFloat = 0.1
    hold: NonNegativeFloat | None = 0.07
    pause: NonNegativeFloat | None = 0.2

    name: ClassVar[str] = "ohman"
    title: ClassVar[str] = "Öhman"

    @property
    def _max_pause(self) -> float | None:
        return self.pause

    def _learn(
        self, data: Utterances, held_out: Utterances, progress: Progress, checkpoint: Path | None
    ) -> None:
        stored = Checkpoint(checkpoint, self.name, self.get_params(), (data, held_out))
        blends = self._stack_blends(data), self._stack_blends(held_out)
        shape = (len(self.parameter_names_), len(self.symbols_))
        #: Targets of vowels and consonants, ``(parameters, phones)``.
        self.targets_: FloatArray = np.zeros(shape)
        #: Factors w of the consonants, ``(parameters, phones)``; 0 for vowels.
        self.factors_: FloatArray = np.zeros(shape)
        #: Mean of the data, ``(parameters,)``: the track of a corpus without vowels.
        self.middle_: FloatArray = np.zeros(shape[0])
        means = compute_phone_means(data, len(self.symbols_))
        vowels = self.symbols_.are_vowels
        for position, name in enumerate(self.parameter_names_):
            training, test = (
                BlendResiduals.from_utterances(part, blend, position)
                for part, blend in zip((data, held_out), blends, strict=True)
            )
            values = training.values
            # Targets are relative to the mean of the data.
            middle = float(values.mean()) if len(values) else 0.0
            variance = float(values.std()) ** 2 if len(values) else 0.0
            training, test = training.subtract(middle), test.subtract(middle)
            penalty = Penalty(
                np.concatenate([means[:, position] - middle, np.where(vowels, 0.0, _FACTOR)]),
                self.l2 * np.repeat([1.0, variance or 1.0], len(vowels)),
            )
            widest = _WIDEST * float(np.abs(training.values).max(initial=0.0))
            upper = np.concatenate([np.full(len(vowels), widest), 1.0 - vowels])
            lower = np.concatenate([np.full(len(vowels), -widest), np.zeros(len(vowels))])
            bounds = lower, upper
            point = self._minimise(name, training, test, penalty, bounds, progress, stored)
            targets, self.factors_[position] = np.split(point, 2)
            self.targets_[position], self.middle_[position] = targets + middle, middle

    def _compute_blends(self, phones: PhoneSequence, times: FloatArray) -> Blends:
        symbols = self.symbols_
        peaks = find_peaks(phones, self.hold)
        return compute_blends(
            symbols.indices(phones), peaks, times, symbols.are_vowels, symbols.seen
        )

    def _stack_blends(self, data: Utterances) -> Blends:
        """Return the blends of all frames, one utterance after the other."""
        empty = Blends(*[sparse.csr_array((0, len(self.symbols_)))] * 2)
        parts = [empty, *(self._compute_blends(each.phones, each.times) for each in data)]
        return Blends(*(sparse.vstack(part, format="csr") for part in zip(*parts, strict=True)))

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        track, consonants = self._compute_blends(phones, times)
        targets = self.targets_.T - self.middle_
        factors = self.factors_.T
        vowel_track = track @ targets
        values = (
            vowel_track - (consonants @ factors) * vowel_track + consonants @ (factors * targets)
        )
        return np.asarray(self.middle_ + values)

    def _count_per_parameter(self, phone_set: PhoneSet, symbols: Sequence[str]) -> int:
        # One for a vowel, two for another phone: 1040 for the paper's 48, 28 and ten parameters.
        return 2 * len(symbols) - sum(map(phone_set.is_vowel, symbols))

    def get_free_parameters(self) -> dict[str, FloatArray]:
        """Return what was learned: ``target``, and the factors ``w`` of consonants.

        Returns
        -------
        dict[str, FloatArray]
            ``(parameters, phones)`` each, in the order of `symbols_`; those of phones that the
            corpus lacks are as they began. A vowel has no w, which is NaN.

        Raises
        ------
        DataError
            If the model is not trained.
        """
        self._check_fitted()
        factors = np.where(self.symbols_.are_vowels, np.nan, self.factors_)
        return {"target": self.targets_, "w": factors}

    def _list_shapes(self) -> dict[str, tuple[int, ...]]:
        shape = (len(self.parameter_names_), len(self.symbols_))
        return {"targets": shape, "factors": shape, "middle": shape[:1]}


@dataclass(frozen=True, eq=False)
class BlendResiduals:
    """The errors of one articulatory parameter over all frames, and their normal equations.

    A point is the targets of vowels and consonants, ``(phones,)``, then the factors w.

    Parameters
    ----------
    values
        The parameter at the frames that have a value, ``(frames,)``.
    blends
        The blends of those frames.
    """

    values: FloatArray
    blends: Blends

    @classmethod
    def from_utterances(cls, data: Utterances, blends: Blends, position: int) -> BlendResiduals:
        """Return the errors of one articulatory parameter.

        Parameters
        ----------
        data
            The utterances.
        blends
            The blends of all their frames.
        position
            Which parameter, from 0.

        Returns
        -------
        BlendResiduals
            Of the frames that have a value.
        """
        values = np.concatenate([np.zeros(0), *(each.values[:, position] for each in data)])
        valid = np.isfinite(values)
        if valid.all():
            return cls(values, blends)
        return cls(values[valid], Blends(blends.track[valid], blends.consonants[valid]))

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self.values)

    def subtract(self, middle: float) -> BlendResiduals:
        """Return the same with another origin.

        Parameters
        ----------
        middle
            What is subtracted from the values, in the unit of the parameter.

        Returns
        -------
        BlendResiduals
            With the same blends.
        """
        return BlendResiduals(self.values - middle, self.blends)

    def _compute_parts(self, point: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the vowel track, the share that consonants leave of it, and the errors."""
        targets, factors = np.split(point, 2)
        track = self.blends.track @ targets
        left = 1.0 - self.blends.consonants @ factors
        pulled = self.blends.consonants @ (factors * targets)
        return track, left, left * track + pulled - self.values

    def cost(self, point: FloatArray) -> float:
        """Return the sum of squares (eq. 5).

        Parameters
        ----------
        point
            Targets and factors, ``(2 * phones,)``.

        Returns
        -------
        float
            The sum in squared units of the parameter.
        """
        differences = self._compute_parts(point)[2]
        return float(differences @ differences)

    def compute_equations(self, point: FloatArray) -> NormalEquations:
        """Return the normal equations, with the derivatives of eqs. 18-20.

        Parameters
        ----------
        point
            Targets and factors, ``(2 * phones,)``.

        Returns
        -------
        NormalEquations
            Of the squared errors around the point.
        """
        track, left, differences = self._compute_parts(point)
        targets, factors = np.split(point, 2)
        vowel_track, consonants = self.blends
        by_targets = _to_diagonal(left) @ vowel_track + consonants @ _to_diagonal(factors)
        by_factors = consonants @ _to_diagonal(targets) - _to_diagonal(track) @ consonants
        derivatives = sparse.hstack([by_targets, by_factors], format="csr")
        return NormalEquations(
            (derivatives.T @ derivatives).toarray(),
            derivatives.T @ differences,
            float(differences @ differences),
        )


def _to_diagonal(values: FloatArray) -> Any:
    """Return a sparse matrix that multiplies rows from the left, or columns from the right."""
    return sparse.diags_array(values, format="csr")
