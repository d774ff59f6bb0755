"""Cross-validated errors in closed form (Krňoul & Železný eq. 9 and 10).

The examples of a node are in folds, drawn once a tree. Of fold v with n_v examples, whose
deviations from the node's mean add up to E_v, the predictor that was trained without it lies
E_v / (n - n_v) below that mean. Its squared errors, added up over the folds, are ::

    R_CV = R + sum over v of E_v² (2 n - n_v) / (n - n_v)²

where R is the plain squared error of the node. So counts and sums of a node by fold are enough:
no predictor is trained ten times. Errors are sums of squares and are not divided by the root's
number of examples; eq. 9 has it in every node, so that errors of nodes add up.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mocap_fit.tracks import FloatArray


def surpluses(counts: FloatArray, sums: FloatArray) -> FloatArray:
    """What the cross-validated errors of nodes are above their plain squared errors.

    Parameters
    ----------
    counts, sums
        `(..., folds)`.

    Returns
    -------
    FloatArray
        `(...,)`; infinite also for nodes without examples.
    """
    count = counts.sum(axis=-1, keepdims=True)
    mean = sums.sum(axis=-1, keepdims=True) / np.maximum(count, 1.0)
    rest = count - counts
    impossible = (rest < 0.5).any(axis=-1)
    off = sums - counts * mean
    added = (off * off * (count + rest) / np.maximum(rest, 1.0) ** 2).sum(axis=-1)
    return np.where(impossible, np.inf, added)


def cross_validated_error(targets: FloatArray, folds: np.ndarray[Any, Any]) -> float:
    """The cross-validated squared error of a node (eq. 9, times the root's N).

    Parameters
    ----------
    targets
        `(examples,)`.
    folds
        `(examples,)`: the fold of each, from 0.
    """
    if not len(targets):
        return math.inf
    deviations = targets - targets.mean()
    counts = np.bincount(folds).astype(np.float64)
    sums = np.bincount(folds, deviations).astype(np.float64)
    return float(deviations @ deviations + surpluses(counts, sums))


def cross_validated_gain(
    targets: FloatArray, folds: np.ndarray[Any, Any], is_left: np.ndarray[Any, Any]
) -> float:
    """By how much a cut lowers the cross-validated error (eq. 10, times the root's N).

    Parameters
    ----------
    targets, folds
        `(examples,)`, as in `cross_validated_error`.
    is_left
        `(examples,)`: who goes to the left.

    Returns
    -------
    float
        Minus infinity where one side cannot be cross-validated.
    """
    sides = [cross_validated_error(targets[side], folds[side]) for side in (is_left, ~is_left)]
    whole = cross_validated_error(targets, folds)
    return -math.inf if math.inf in sides else whole - sum(sides)
