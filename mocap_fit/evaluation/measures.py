"""Error measures between target and predicted tracks, after Beskow section 5.

What is measured (definitions 1; `DEFINITIONS` counts up when one of them changes):

- Frames: those of the scored utterances whose time lies in a labelled segment, grouped by its
  phone: ``all`` is every segment but silence, ``vowels`` and ``consonants`` are what their names
  say. A frame without a target value does not count for that parameter.
- RMSE: root of the mean square difference over all frames of a group, of all utterances together,
  as per cent of the parameter's range. The range is the largest less the smallest target value
  over the frames of ``all``, so that one range serves the three groups and every model.
- Correlation: Pearson's, over the same frames.
- Average: the mean over the parameters. A parameter whose target never changes has no range and
  no correlation, and does not count.

The sums that both measures need are stored by utterance, so that resampling utterances costs a
matrix product and no second look at the tracks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

DEFINITIONS = 1
GROUP_LABELS = {"all": "all but silence", "vowels": "vowels", "consonants": "consonants"}
GROUPS = tuple(GROUP_LABELS)
# What is summed over frames: 1, squared error, target, prediction, their squares, their product.
_COUNT, _ERROR, _TARGET, _PREDICTED, _TARGETS, _PREDICTEDS, _PRODUCT = range(7)
SUMS = 7


@dataclass(frozen=True)
class Difference:
    """The first model's average error less the second's, paired by utterance.

    Parameters
    ----------
    first, second
        Names of the models.
    group
        Of the frames, one of `GROUPS`.
    value
        The difference, per cent of the range.
    low, high
        Its 95 % interval, per cent of the range.
    p
        Its two-sided p-value, 0 to 1.
    """

    first: str
    second: str
    group: str
    value: float
    low: float
    high: float
    p: float


def mark_groups(phones: PhoneSequence, phone_set: PhoneSet, times: FloatArray) -> NDArray[np.bool_]:
    """Mark the frames of each of `GROUPS`.

    Parameters
    ----------
    phones
        Phones of the utterance.
    phone_set
        Their phone set.
    times
        Times of the frames, ``(frames,)``, seconds.

    Returns
    -------
    ndarray
        ``(groups, frames)``, true where a frame belongs to a group.
    """
    # Where nothing is labelled `at` returns -1, the last of these.
    kinds = np.array([*(phone_set.get_phone(segment).kind for segment in phones), "silence"])
    kind = kinds[phones.at(times)]
    return np.stack([kind != "silence", kind == "vowel", kind == "consonant"])


def sum_utterance(
    target: FloatArray, predicted: FloatArray, groups: NDArray[np.bool_], centre: FloatArray
) -> FloatArray:
    """Add up what the measures need over the frames of an utterance.

    Parameters
    ----------
    target
        ``(frames, parameters)``, in the unit of each parameter; NaN is missing.
    predicted
        ``(frames, parameters)``, in the unit of each parameter.
    groups
        ``(groups, frames)``, from `mark_groups`.
    centre
        Subtracted from both, so that sums of squares do not lose digits, ``(parameters,)``, in the
        unit of each parameter.

    Returns
    -------
    ndarray
        ``(groups, parameters, 7)``: the count, and sums in powers of the unit.
    """
    seen = np.isfinite(target)
    y = np.where(seen, target - centre, 0.0)
    z = np.where(seen, predicted - centre, 0.0)
    pieces = np.stack([seen.astype(np.float64), (z - y) ** 2, y, z, y * y, z * z, y * z], axis=2)
    return np.asarray(np.einsum("gf,fps->gps", groups.astype(np.float64), pieces))


def compute_scores(sums: FloatArray, ranges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute RMSE and correlation from sums.

    Parameters
    ----------
    sums
        ``(..., parameters, 7)``, added up over utterances: the count, and sums in powers of the
        unit.
    ranges
        Ranges of the targets, ``(parameters,)``, in the unit of each parameter.

    Returns
    -------
    rmse
        ``(..., parameters)``, per cent of the range; NaN without frames or range.
    correlation
        ``(..., parameters)``, -1 to 1; NaN where target or prediction does not change.
    """
    count = sums[..., _COUNT]
    with np.errstate(divide="ignore", invalid="ignore"):
        rmse = 100.0 * np.sqrt(sums[..., _ERROR] / count) / ranges
        y, z = sums[..., _TARGET] / count, sums[..., _PREDICTED] / count
        target = np.maximum(sums[..., _TARGETS] / count - y * y, 0.0)
        predicted = np.maximum(sums[..., _PREDICTEDS] / count - z * z, 0.0)
        correlation = (sums[..., _PRODUCT] / count - y * z) / np.sqrt(target * predicted)
    # What is left of a constant is the rounding of its sum of squares.
    flat = (target <= 1e-12 * sums[..., _TARGETS]) | (predicted <= 1e-12 * sums[..., _PREDICTEDS])
    rmse = np.where((ranges > 0) & (count > 0), rmse, np.nan)
    return rmse, np.clip(np.where(flat, np.nan, correlation), -1.0, 1.0)


def average(values: FloatArray) -> FloatArray:
    """Average over the last axis, ignoring NaN.

    Parameters
    ----------
    values
        ``(..., parameters)``, in any unit.

    Returns
    -------
    ndarray
        ``(...)``, in the same unit; NaN where nothing is a number.
    """
    seen = np.isfinite(values)
    total = np.where(seen, values, 0.0).sum(axis=-1)
    with np.errstate(invalid="ignore"):
        return np.asarray(total / np.where(seen.any(axis=-1), seen.sum(axis=-1), np.nan))


def draw_resamples(utterances: int, resamples: int, seed: int) -> FloatArray:
    """Draw bootstrap samples of the utterances.

    Parameters
    ----------
    utterances
        Number of utterances.
    resamples
        Number of samples.
    seed
        Seed of the random generator.

    Returns
    -------
    ndarray
        How often each utterance is in each sample, ``(resamples, utterances)``, no unit.
    """
    rng = np.random.default_rng(seed)
    counts = rng.multinomial(utterances, np.full(utterances, 1.0 / utterances), size=resamples)
    return np.asarray(counts, dtype=np.float64)


def compute_interval(samples: FloatArray, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
    """Compute a confidence interval: percentiles of bootstrap samples (Efron & Tibshirani 1993).

    Parameters
    ----------
    samples
        ``(resamples, ...)``, in any unit.
    level
        Part of the samples within the interval, 0 to 1.

    Returns
    -------
    low, high
        ``(...)``, in the same unit; NaN where a sample is NaN.
    """
    seen = np.isfinite(samples)
    known = np.where(seen.all(axis=0), samples, 0.0)
    low, high = np.quantile(known, [(1 - level) / 2, (1 + level) / 2], axis=0)
    unknown = ~seen.all(axis=0)
    return np.where(unknown, np.nan, low), np.where(unknown, np.nan, high)


def compute_p_value(samples: FloatArray) -> float:
    """Compute the two-sided p-value of a paired difference from its bootstrap samples.

    Twice the smaller share of samples on either side of 0 (Efron & Tibshirani 1993, section 15.4),
    and at least one in the number of samples, which is the least that they can show.

    Parameters
    ----------
    samples
        Differences, ``(resamples,)``, in any unit; NaN is ignored.

    Returns
    -------
    float
        0 to 1; NaN without samples.
    """
    seen = samples[np.isfinite(samples)]
    if not seen.size:
        return float("nan")
    smaller = min(float(np.mean(seen <= 0)), float(np.mean(seen >= 0)))
    return min(1.0, max(2.0 * smaller, 1.0 / seen.size))
