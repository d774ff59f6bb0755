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

The sums that both measures need are kept by utterance, so that resampling utterances costs a
matrix product and no second look at the tracks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.tracks import FloatArray

DEFINITIONS = 1
GROUPS = ("all", "vowels", "consonants")
# What is summed over frames: 1, squared error, target, prediction, their squares, their product.
_COUNT, _ERROR, _TARGET, _PREDICTED, _TARGETS, _PREDICTEDS, _PRODUCT = range(7)
SUMS = 7


def frame_groups(
    phones: PhoneSequence, phone_set: PhoneSet, times: FloatArray
) -> NDArray[np.bool_]:
    """Which frames belong to which of `GROUPS`, `(groups, frames)`."""
    kinds = [phone_set.get_phone(segment).kind for segment in phones]
    members = np.zeros((len(GROUPS), len(phones) + 1), dtype=bool)
    for i, kind in enumerate(kinds):
        members[:, i] = (kind != "silence", kind == "vowel", kind == "consonant")
    # Where nothing is labelled `at` says -1, the last column.
    return members[:, phones.at(times)]


def utterance_sums(
    target: FloatArray, predicted: FloatArray, groups: NDArray[np.bool_], centre: FloatArray
) -> FloatArray:
    """Sums over the frames of an utterance, `(groups, parameters, SUMS)`.

    Parameters
    ----------
    target, predicted
        `(frames, parameters)`; NaN in the target is missing.
    groups
        `(groups, frames)`, from `frame_groups`.
    centre
        `(parameters,)`: taken from both, so that sums of squares keep their digits.
    """
    seen = np.isfinite(target)
    y = np.where(seen, target - centre, 0.0)
    z = np.where(seen, predicted - centre, 0.0)
    pieces = np.stack([seen.astype(np.float64), (z - y) ** 2, y, z, y * y, z * z, y * z], axis=2)
    return np.asarray(np.einsum("gf,fps->gps", groups.astype(np.float64), pieces))


def scores(sums: FloatArray, ranges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """RMSE in per cent and correlation from sums.

    Parameters
    ----------
    sums
        `(..., parameters, SUMS)`, added up over utterances.
    ranges
        `(parameters,)`, of the targets.

    Returns
    -------
    rmse
        `(..., parameters)`, per cent of the range; NaN without frames or range.
    correlation
        `(..., parameters)`; NaN where target or prediction does not change.
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
    """Mean over the last axis, of what is a number; NaN where nothing is."""
    seen = np.isfinite(values)
    total = np.where(seen, values, 0.0).sum(axis=-1)
    with np.errstate(invalid="ignore"):
        return np.asarray(total / np.where(seen.any(axis=-1), seen.sum(axis=-1), np.nan))


def resample_counts(utterances: int, resamples: int, seed: int) -> FloatArray:
    """How often each utterance is in each bootstrap sample, `(resamples, utterances)`."""
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(utterances, np.full(utterances, 1.0 / utterances), size=resamples)
    return np.asarray(drawn, dtype=np.float64)


def interval(samples: FloatArray, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
    """The middle part of bootstrap samples along the first axis; NaN where one has no number."""
    seen = np.isfinite(samples)
    known = np.where(seen.all(axis=0), samples, 0.0)
    low, high = np.quantile(known, [(1 - level) / 2, (1 + level) / 2], axis=0)
    nothing = ~seen.all(axis=0)
    return np.where(nothing, np.nan, low), np.where(nothing, np.nan, high)


def two_sided_p(samples: FloatArray) -> float:
    """How probable a difference of nil is, by bootstrap samples of the difference.

    Twice the smaller share of samples on either side of nil; never under one in the number of
    samples, which is as little as they can tell.
    """
    seen = samples[np.isfinite(samples)]
    if not seen.size:
        return float("nan")
    smaller = min(float(np.mean(seen <= 0)), float(np.mean(seen >= 0)))
    return min(1.0, max(2.0 * smaller, 1.0 / seen.size))
