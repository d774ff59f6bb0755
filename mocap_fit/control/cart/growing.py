"""Growing, pruning and judging one tree (Krňoul & Železný eq. 8 to 12; Breiman et al. chapter 3).

A cut is worth what its branch lowers the cross-validated error by, for each of the branch's cuts,
in variances of their nodes: that is its strength. Cutting off the weakest branch, and the next,
gives the sequence of trees T_k of eq. 12, from the grown tree to its root; an alpha names a tree
of the sequence, as ``ccp_alpha`` does in scikit-learn. Which one predicts best is asked of examples
that took no part: a fold is held out, the tree is grown and pruned from the others, and its errors
on that fold are added up.

The gains that a tree was grown by cannot answer this: each is the best of a hundred cuts, chosen by
the examples that it is judged by, and therefore too large.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mocap_fit.control.cart.arrays import Nodes, QuestionTable, Rules, Sample, allocate_nodes
from mocap_fit.control.cart.kernel import grow_and_prune
from mocap_fit.tracks import FloatArray

#: Alphas that are tried for all trees together, in variances; with the last hardly a cut remains.
ALPHAS = np.concatenate([[0.0], np.geomspace(1.0, 100.0, 27)])


@dataclass(frozen=True, eq=False)
class PruningCurve:
    """What held-out examples say of each alpha.

    Parameters
    ----------
    alphas
        ``(alphas,)``, ascending, in variances of nodes.
    errors
        Sum of the squared errors of the held-out examples at each, ``(alphas,)``, in the unit of
        the targets squared.
    squares
        Sum of the squares of these squared errors, ``(alphas,)``, in the unit of the targets to
        the fourth power.
    count
        Number of held-out examples.
    """

    alphas: FloatArray
    errors: FloatArray
    squares: FloatArray
    count: int

    @property
    def standard_errors(self) -> FloatArray:
        """Standard error of the mean squared error at each alpha, ``(alphas,)``."""
        mean = self.errors / max(self.count, 1)
        variance = np.maximum(self.squares / max(self.count, 1) - mean**2, 0.0)
        return np.sqrt(variance / max(self.count, 1))

    def select_alpha(self, one_standard_error: bool = False) -> float:
        """Return the alpha of the least error (eq. 12), the greatest of several.

        Parameters
        ----------
        one_standard_error
            Whether to take the greatest alpha within one standard error of the least.

        Returns
        -------
        float
            In variances of nodes; the last one where nothing was held out.
        """
        if not self.count:
            return float(self.alphas[-1])
        mean = self.errors / self.count
        least = int(np.flatnonzero(mean <= mean.min() * (1 + 1e-12))[-1])
        limit = mean[least] + (self.standard_errors[least] if one_standard_error else 0.0)
        return float(self.alphas[np.flatnonzero(mean <= limit * (1 + 1e-12))[-1]])


_NONE = np.zeros(0)


def grow(sample: Sample, table: QuestionTable, rules: Rules, alpha: float = -np.inf) -> Nodes:
    """Grow a tree and prune it.

    Parameters
    ----------
    sample
        The examples.
    table
        The questions.
    rules
        How it is grown.
    alpha
        Weaker cuts are removed, no unit (variances of nodes); by default none is.

    Returns
    -------
    Nodes
        At least one.
    """
    nodes: Any = allocate_nodes(len(sample.targets), int(table.sizes.max()))
    count = grow_and_prune(sample, -1, table, rules, alpha, _NONE, _NONE, _NONE, nodes)
    return Nodes(*(array[:count].copy() for array in nodes))


def judge(
    sample: Sample,
    fold: int,
    table: QuestionTable,
    rules: Rules,
    alphas: FloatArray,
    workspace: Nodes | None = None,
) -> PruningCurve | None:
    """Grow a tree without one fold, and let that fold judge how strongly to prune it.

    Parameters
    ----------
    sample
        The examples.
    fold
        The fold that is held out.
    table
        The questions.
    rules
        How the tree is grown.
    alphas
        Strengths of pruning, ascending, in variances of nodes, ``(alphas,)``.
    workspace
        Arrays of `allocate_nodes` that are large enough, to be overwritten.

    Returns
    -------
    PruningCurve | None
        Errors on the fold; None where no example is in it, or all are.
    """
    examples, count = len(sample.folds), int(np.count_nonzero(sample.folds == fold))
    if count in (0, examples):
        return None
    if workspace is None:
        workspace = allocate_nodes(examples, int(table.sizes.max()))
    errors, squares = np.zeros(len(alphas)), np.zeros(len(alphas))
    grow_and_prune(sample, fold, table, rules, np.inf, alphas, errors, squares, workspace)
    return PruningCurve(alphas, errors, squares, count)
