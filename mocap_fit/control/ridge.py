"""The normal equations of a ridge regression on features that are 0 or 1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from mocap_fit.control.symbols import IntArray
from mocap_fit.control.training import TrainingUtterance
from mocap_fit.phones import PhoneSequence
from mocap_fit.tracks import FloatArray


class RidgeEquations(NamedTuple):
    """The normal equations of a regression whose features are 0 or 1.

    Parameters
    ----------
    shape
        Shape of the weights: number of features, number of parameters.
    parts
        For each group of parameters that miss the same frames: their positions, the matrix X'X
        ``(features, features)`` and the products X'y ``(features, group)``.
    """

    shape: tuple[int, int]
    parts: list[tuple[list[int], FloatArray, FloatArray]]

    @classmethod
    def from_utterances(
        cls,
        data: Sequence[TrainingUtterance],
        find_features: Callable[[PhoneSequence, FloatArray], IntArray],
        width: int,
    ) -> RidgeEquations:
        """Return the sum of the equations of all frames.

        Parameters
        ----------
        data
            The utterances.
        find_features
            A function of phones and times, seconds, that returns the features that are 1 at each
            time, ``(times, ones)``.
        width
            Number of features.

        Returns
        -------
        RidgeEquations
            The equations.
        """
        from scipy import sparse

        values = np.concatenate([each.values for each in data])
        indices = np.concatenate([find_features(each.phones, each.times) for each in data])
        rows, ones = indices.shape
        features = sparse.csr_matrix(
            (np.ones(indices.size), indices.ravel(), np.arange(0, indices.size + 1, ones)),
            shape=(rows, width),
        )
        valid = np.isfinite(values)
        groups: dict[bytes, list[int]] = {}
        for parameter in range(values.shape[1]):
            groups.setdefault(np.packbits(valid[:, parameter]).tobytes(), []).append(parameter)
        parts = []
        for group in groups.values():
            used = features[valid[:, group[0]]]
            targets = values[valid[:, group[0]]][:, group]
            parts.append((group, (used.T @ used).toarray(), used.T @ targets))
        return cls((width, values.shape[1]), parts)

    def solve(self, l2: float) -> FloatArray:
        """Return the weights that minimise squared errors and penalty.

        Parameters
        ----------
        l2
            Strength of the penalty on the squares of the weights, above 0.

        Returns
        -------
        FloatArray
            Weights, ``(features, parameters)``.
        """
        from scipy.linalg import cho_factor, cho_solve

        weights = np.zeros(self.shape)
        for group, squares, products in self.parts:
            if not squares.any():
                continue
            # The constant has no penalty but what makes the equations definite.
            penalties = np.full(len(squares), l2)
            penalties[0] = 1e-9 * squares[0, 0]
            factor = cho_factor(squares + np.diag(penalties), overwrite_a=True)
            weights[:, group] = cho_solve(factor, products)
        return weights
