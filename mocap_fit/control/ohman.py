"""Öhman's model of coarticulation (Beskow section 4.3), trained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from mocap_fit.control.base import ControlModel, Progress
from mocap_fit.control.levenberg_marquardt import Equations
from mocap_fit.control.parameter_training import train_parameter
from mocap_fit.control.training import (
    PLANNED_PARAMETERS,
    Checkpoint,
    IntArray,
    Recording,
    Symbols,
    check_finite,
    check_phone_set,
    check_settings,
    phone_means,
    planned_symbols,
    recordings,
)
from mocap_fit.corpus import Corpus
from mocap_fit.phones import PhoneSequence
from mocap_fit.tracks import FloatArray

# How large the coarticulation factor of a consonant is at the start.
_FACTOR = 0.5
# A target lies no farther from the mean of the data than so many times the farthest value; that of
# a consonant with almost no influence could be anywhere.
_WIDEST = 2.0


@dataclass(eq=False)
class Ohman(ControlModel):
    """A track from vowel to vowel, and consonants superimposed on it (eqs. 15-17).

    A vowel and articulatory parameter has a target; a consonant has a target and a factor w in
    [0, 1], which tells how far it pulls the vowel track there. Silence counts with the consonants.
    All blends are cubic: 0 at the centre of the gesture before, 1 at the own, 0 at the next, and
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
    hold
        Seconds, as said above; None for peaks at the centres alone.
    pause
        Frames of silence farther than this from speech do not count in training, seconds; long
        pauses would bend what there is for speech. None counts all, as the paper does.
    """

    phone_set: str = ""
    stress: bool = True
    iterations: int = 30
    tolerance: float = 1e-4
    patience: int = 3
    prior: float = 0.1
    hold: float | None = 0.07
    pause: float | None = 0.2

    name: ClassVar[str] = "ohman"
    title: ClassVar[str] = "Öhman"

    def _fit(
        self,
        corpus: Corpus,
        validation: Corpus | None,
        progress: Progress,
        checkpoint: Path | None,
    ) -> None:
        check_settings(self, iterations=1, tolerance=0, patience=1, prior=0)
        given = [name for name in ("hold", "pause") if getattr(self, name) is not None]
        check_settings(self, **dict.fromkeys(given, 0))
        check_phone_set(corpus, self.phone_set)
        self.symbols_: Symbols = Symbols.of(corpus, self.stress)
        data = recordings(corpus, self.symbols_, self.pause)
        held = () if validation is None else recordings(validation, self.symbols_, self.pause)
        kept = Checkpoint(checkpoint, self.name, self.settings, (data, held))
        blends = self._blends_of(data), self._blends_of(held)
        shape = (len(self.parameter_names_), len(self.symbols_))
        #: `(parameters, phones)`: targets of vowels and consonants.
        self.targets_: FloatArray = np.zeros(shape)
        #: `(parameters, phones)`: factors w of the consonants; 0 for vowels.
        self.factors_: FloatArray = np.zeros(shape)
        #: `(parameters,)`: mean of the data, the track of a corpus that has no vowel.
        self.middle_: FloatArray = np.zeros(shape[0])
        means = phone_means(data, len(self.symbols_))
        for position, name in enumerate(self.parameter_names_):
            training, test = (
                Errors.of(part, blend, position)
                for part, blend in zip((data, held), blends, strict=True)
            )
            found = self._trained(name, means[:, position], training, test, kept, progress)
            self.targets_[position], self.factors_[position] = found[:2]
            self.middle_[position] = found[2, 0]

    def _blends_of(self, data: Sequence[Recording]) -> Blends:
        """The blends of all frames, one recording after the other."""
        vowel = vowels(self.symbols_)
        found = [Blends(*[sparse.csr_array((0, len(vowel)))] * 2)]
        for each in data:
            held = peaks(each.phones, self.hold)
            found.append(blends(each.positions, held, each.times, vowel, self.symbols_.seen))
        return Blends(*(sparse.vstack(part, format="csr") for part in zip(*found, strict=True)))

    def _trained(
        self,
        name: str,
        means: FloatArray,
        training: Errors,
        test: Errors,
        kept: Checkpoint,
        progress: Progress,
    ) -> FloatArray:
        """Of one articulatory parameter, `(3, phones)`: targets, factors, the mean of the data."""
        # Targets begin at the phones' means, and count from the mean of the data.
        values = training.values
        middle, scale = (float(values.mean()), float(values.std())) if len(values) else (0.0, 0.0)
        training, test = training.less(middle), test.less(middle)
        vowel = vowels(self.symbols_)
        phones = len(vowel)
        start = np.concatenate([means - middle, np.where(vowel, 0.0, _FACTOR)])
        pull = self.prior * np.concatenate([np.ones(phones), np.full(phones, scale**2 or 1.0)])
        # Vowels have no factor.
        far = np.full(phones, _WIDEST * float(np.abs(training.values).max(initial=0.0)))
        bounds = np.concatenate([-far, np.zeros(phones)]), np.concatenate([far, 1.0 - vowel])
        found = train_parameter(name, training, test, start, pull, bounds, self, kept, progress)
        targets, factors = np.split(found, 2)
        return np.stack([targets + middle, factors, np.full(phones, middle)])

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        positions = self.symbols_.positions(phones)
        track, consonants = blends(
            positions, peaks(phones, self.hold), times, vowels(self.symbols_), self.symbols_.seen
        )
        targets = self.targets_.T - self.middle_
        factors = self.factors_.T
        vowel_track = track @ targets
        values = (
            vowel_track - (consonants @ factors) * vowel_track + consonants @ (factors * targets)
        )
        return np.asarray(self.middle_ + values)

    @property
    def parameter_count(self) -> int:
        """One a vowel, two another phone: 1040 for the paper's 48 and 28 and ten parameters."""
        if self.is_fitted:
            phone_set, names = self.symbols_.phone_set, self.symbols_.names
        else:
            phone_set, names = planned_symbols(self.phone_set, self.stress)
        parameters = len(self.parameter_names_) if self.is_fitted else PLANNED_PARAMETERS
        return (2 * len(names) - sum(map(phone_set.is_vowel, names))) * parameters

    def free_parameters(self) -> dict[str, FloatArray]:
        """What was learned: ``target``, and ``w`` of consonants, `(parameters, phones)` each.

        In the order of `symbols_`; those of phones that the corpus had not are as they began. A
        vowel has no w, which is NaN.
        """
        self._check_fitted()
        without = np.where(vowels(self.symbols_), np.nan, self.factors_)
        return {"target": self.targets_, "w": without}

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        arrays = {"targets": self.targets_, "factors": self.factors_, "middle": self.middle_}
        return self.symbols_.state(), arrays

    def _restore(
        self, values: Mapping[str, Any], arrays: Mapping[str, np.ndarray[Any, Any]]
    ) -> None:
        self.symbols_ = Symbols.restored(self.phone_set_, self.stress, values)
        shape = (len(self.parameter_names_), len(self.symbols_))
        check_finite(arrays, {"targets": shape, "factors": shape, "middle": shape[:1]})
        self.targets_, self.factors_ = arrays["targets"], arrays["factors"]
        self.middle_ = arrays["middle"]


def vowels(symbols: Symbols) -> NDArray[np.bool_]:
    """Which symbols are vowels, `(symbols,)`."""
    return np.array([symbols.phone_set.is_vowel(name) for name in symbols.names])


class Blends(NamedTuple):
    """How much every phone counts at every frame.

    Parameters
    ----------
    track
        `(frames, phones)`, sparse: the vowels' parts of the vowel track (eq. 17); a row adds up
        to 1.
    consonants
        `(frames, phones)`, sparse: k of every consonant (eq. 16), added up over its segments.
    """

    track: Any
    consonants: Any


def blends(
    positions: IntArray,
    peaks: FloatArray,
    times: FloatArray,
    is_vowel: NDArray[np.bool_],
    seen: NDArray[np.bool_],
) -> Blends:
    """The blends of an utterance.

    Parameters
    ----------
    positions
        `(segments,)`: the phone of each segment.
    peaks
        `(segments, 2)`: from when until when each is at its peak, ascending.
    times
        `(frames,)`.
    is_vowel, seen
        `(phones,)`: which phones are vowels, and which the corpus had.
    """
    consonants = _matrix(*_blended(positions, peaks, times), len(is_vowel))
    consonants = consonants @ sparse.diags_array((~is_vowel).astype(float), format="csr")
    own = np.flatnonzero(is_vowel[positions])
    if len(own):
        track = _matrix(*_blended(positions[own], peaks[own], times), len(is_vowel))
    else:
        known = np.flatnonzero(is_vowel & seen)
        columns = np.tile(known, (len(times), 1))
        track = _matrix(columns, np.full(columns.shape, 1.0 / max(len(known), 1)), len(is_vowel))
    return Blends(track, consonants)


def peaks(phones: PhoneSequence, hold: float | None) -> FloatArray:
    """From when until when each segment is at its peak, `(segments, 2)`, seconds.

    Parameters
    ----------
    phones
        The segments.
    hold
        How long after a start and before an end at most; None for the centre.
    """
    starts, ends = phones.starts, phones.ends
    half = 0.5 * (ends - starts)
    inside = half if hold is None else np.minimum(half, hold)
    return np.stack([starts + inside, np.maximum(ends - inside, starts + inside)], axis=1)


def smoothstep(part: FloatArray) -> FloatArray:
    """The cubic that goes from 0 at 0 to 1 at 1 and is level at both."""
    return np.asarray(part * part * (3.0 - 2.0 * part))


def _blended(
    positions: IntArray, peaks: FloatArray, times: FloatArray
) -> tuple[IntArray, FloatArray]:
    """The phones of the peaks around each time, and their blends, `(frames, 2)` each."""
    starts, ends = peaks.T
    before = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, len(starts) - 1)
    after = np.minimum(before + 1, len(starts) - 1)
    between = after > before
    apart = np.where(between, starts[after] - ends[before], 1.0)
    part = smoothstep(np.clip((times - ends[before]) / apart, 0.0, 1.0)) * between
    columns = np.stack([positions[before], positions[after]], axis=1)
    return columns, np.stack([1.0 - part, part], axis=1)


def _matrix(columns: IntArray, shares: FloatArray, phones: int) -> Any:
    frames, width = columns.shape
    rows = np.repeat(np.arange(frames), width)
    return sparse.coo_array(
        (shares.ravel(), (rows, columns.ravel())), shape=(frames, phones)
    ).tocsr()


@dataclass(frozen=True, eq=False)
class Errors:
    """One articulatory parameter over all frames that have a value: errors, normal equations.

    A point is the targets of vowels and consonants, `(phones,)`, then the factors w.
    """

    values: FloatArray
    blends: Blends

    @classmethod
    def of(cls, data: Sequence[Recording], blends: Blends, position: int) -> Errors:
        """The parameter at a position."""
        values = np.concatenate([np.zeros(0), *(each.values[:, position] for each in data)])
        there = np.isfinite(values)
        if there.all():
            return cls(values, blends)
        return cls(values[there], Blends(blends.track[there], blends.consonants[there]))

    @property
    def count(self) -> int:
        """How many frames there are."""
        return len(self.values)

    def less(self, middle: float) -> Errors:
        """The same from another zero."""
        return Errors(self.values - middle, self.blends)

    def _parts(self, point: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The vowel track, what the consonants leave of it, and the errors, `(frames,)` each."""
        targets, factors = np.split(point, 2)
        track = self.blends.track @ targets
        left = 1.0 - self.blends.consonants @ factors
        pulled = self.blends.consonants @ (factors * targets)
        return track, left, left * track + pulled - self.values

    def error(self, point: FloatArray) -> float:
        """Sum of squares (eq. 5)."""
        apart = self._parts(point)[2]
        return float(apart @ apart)

    def equations(self, point: FloatArray) -> Equations:
        """The normal equations, with the derivatives of eqs. 18-20."""
        track, left, apart = self._parts(point)
        targets, factors = np.split(point, 2)
        vowel_track, consonants = self.blends
        by_targets = _rows(left) @ vowel_track + consonants @ _rows(factors)
        by_factors = consonants @ _rows(targets) - _rows(track) @ consonants
        derivatives = sparse.hstack([by_targets, by_factors], format="csr")
        squares = (derivatives.T @ derivatives).toarray()
        return Equations(squares, derivatives.T @ apart, float(apart @ apart))


def _rows(values: FloatArray) -> Any:
    """A matrix that multiplies rows from the left, or columns from the right."""
    return sparse.diags_array(values, format="csr")
