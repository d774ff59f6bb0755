"""Pruning: which of a tree's cuts stay (Krňoul & Železný eq. 12; Breiman et al. chapter 3).

A cut is worth what its branch lowers the cross-validated error by, for each of the branch's cuts,
in variances of their nodes: that is its strength. Cutting off the weakest branch, and the next,
gives the sequence of trees T_k of eq. 12, from the grown tree to its root; a strength names a tree
of the sequence. Which one predicts best is asked of examples that took no part: a fold is held
out, the tree is grown and pruned from the others, and its errors on that fold are added up.

The gains that a tree was grown by cannot tell: each is the best of a hundred cuts, chosen by the
examples that it is judged by, and so too good.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mocap_fit.control.cart.contexts import ByteArray
from mocap_fit.control.cart.growing import (
    Asked,
    Grown,
    IntArray,
    cut_to,
    grow,
    room_for,
)
from mocap_fit.control.cart.kernel import HAS_NUMBA, UNSEEN, grow_and_prune, weakest_first
from mocap_fit.tracks import FloatArray

#: Strengths that are tried for all trees together; with the last hardly a cut stays.
STRENGTHS = np.concatenate([[0.0], np.geomspace(1.0, 100.0, 27)])


@dataclass(frozen=True, eq=False)
class Judged:
    """What held-out examples say of each strength.

    Parameters
    ----------
    strengths
        `(strengths,)`, ascending.
    errors
        `(strengths,)`: squared errors of the held-out examples, added up.
    squares
        `(strengths,)`: the squares of these squared errors, added up.
    count
        How many examples were held out.
    """

    strengths: FloatArray
    errors: FloatArray
    squares: FloatArray
    count: int

    @property
    def standard_errors(self) -> FloatArray:
        """Of the mean squared error at each strength, `(strengths,)`."""
        mean = self.errors / max(self.count, 1)
        spread = np.maximum(self.squares / max(self.count, 1) - mean**2, 0.0)
        return np.sqrt(spread / max(self.count, 1))

    def best(self, one_standard_error: bool = False) -> float:
        """The strength of the least error (eq. 12), of several the greatest.

        Parameters
        ----------
        one_standard_error
            The greatest strength whose error is within one standard error of the least.
        """
        if not self.count:
            return float(self.strengths[-1])
        mean = self.errors / self.count
        least = int(np.flatnonzero(mean <= mean.min() * (1 + 1e-12))[-1])
        limit = mean[least] + (self.standard_errors[least] if one_standard_error else 0.0)
        return float(self.strengths[np.flatnonzero(mean <= limit * (1 + 1e-12))[-1]])


def strengths_of(tree: Grown) -> FloatArray:
    """How strong each cut of a tree is.

    Returns
    -------
    FloatArray
        `(nodes,)`: the strength up to which a node keeps its cut; minus infinity in a leaf. None
        is stronger than a cut above it.
    """
    found: FloatArray = weakest_first(
        len(tree.questions), tree.children, tree.counts, tree.validated
    )
    return found


def pruned(tree: Grown, strength: float) -> Grown:
    """The tree of the sequence that a strength names: cuts weaker than it are gone."""
    stays = (tree.questions >= 0) & (strengths_of(tree) >= strength)
    kept = np.zeros(len(stays), dtype=np.bool_)
    kept[0] = True
    # No cut is stronger than one above it: what stays hangs together.
    kept[tree.children[stays]] = True
    numbers = np.cumsum(kept) - 1
    children = np.where(stays[:, None], numbers[tree.children], -1)
    questions = np.where(stays, tree.questions, -1)
    gains = np.where(stays, tree.gains, 0.0)
    changed = tree._replace(questions=questions, children=children, gains=gains)
    arrays: Any = changed
    return Grown(*(array[kept] for array in arrays))


def grow_pruned(
    levels: ByteArray,
    targets: FloatArray,
    folds: IntArray,
    asked: Asked,
    strength: float,
    *,
    fold_count: int,
    smallest: int,
    least_gain: float,
    phone_order: str,
    use_numba: bool = True,
) -> Grown:
    """Grow a tree and prune it.

    Parameters
    ----------
    levels, targets, folds, asked, fold_count, smallest, least_gain, phone_order, use_numba
        As for `grow`.
    strength
        As for `pruned`.
    """
    if use_numba and HAS_NUMBA:
        everyone, nobody = np.arange(len(folds)), np.zeros(0, dtype=np.int64)
        room, none = room_for(len(folds), int(asked.sizes.max())), np.zeros(0)
        how = (fold_count, smallest, least_gain, phone_order == "node", strength)
        nodes = grow_and_prune(
            levels, targets, folds, everyone, nobody, *asked, *how, none, none, none, *room
        )
        return cut_to(room, nodes)
    tree = grow(
        levels,
        targets,
        folds,
        asked,
        fold_count=fold_count,
        smallest=smallest,
        least_gain=least_gain,
        phone_order=phone_order,
        use_numba=False,
    )
    return pruned(tree, strength)


def judge(
    levels: ByteArray,
    targets: FloatArray,
    folds: IntArray,
    fold: int,
    asked: Asked,
    strengths: FloatArray,
    *,
    fold_count: int,
    smallest: int,
    least_gain: float,
    phone_order: str,
    use_numba: bool = True,
    room: Grown | None = None,
) -> Judged:
    """Grow a tree without one fold, and let that fold say how strongly to prune it.

    Parameters
    ----------
    levels, targets, folds, asked, fold_count, smallest, least_gain, phone_order, use_numba
        As for `grow`; at least one example is not in the fold.
    fold
        Which is held out.
    strengths
        `(strengths,)`, ascending.
    room
        Arrays of `room_for` that are large enough, to be written over.
    """
    errors, squares = np.zeros(len(strengths)), np.zeros(len(strengths))
    out = np.flatnonzero(folds == fold)
    if use_numba and HAS_NUMBA:
        chosen = np.flatnonzero(folds != fold)
        if room is None:
            room = room_for(len(chosen), int(asked.sizes.max()))
        how = (fold_count, smallest, least_gain, phone_order == "node", np.inf)
        judged = (strengths, errors, squares)
        grow_and_prune(levels, targets, folds, chosen, out, *asked, *how, *judged, *room)
        return Judged(strengths, errors, squares, len(out))
    tree = grow(
        levels,
        targets,
        folds,
        asked,
        fold_count=fold_count,
        smallest=smallest,
        least_gain=least_gain,
        phone_order=phone_order,
        held_out=fold,
        use_numba=False,
    )
    for place, strength in enumerate(strengths):
        off = _answers(pruned(tree, strength), levels[:, out], asked) - targets[out]
        errors[place], squares[place] = (off**2).sum(), (off**4).sum()
    return Judged(strengths, errors, squares, len(out))


def _answers(tree: Grown, levels: ByteArray, asked: Asked) -> FloatArray:
    """What a tree says of examples; who has a level that a node never saw goes with the most."""
    node = np.zeros(levels.shape[1], dtype=np.int64)
    while (tree.questions[node] >= 0).any():
        attribute = asked.attributes[tree.questions[node]]
        side = tree.sides[node, levels[attribute, np.arange(len(node))]].astype(np.int64)
        counts = tree.counts[tree.children[node]]
        side = np.where(side == UNSEEN, counts[:, 1] > counts[:, 0], side)
        after = tree.children[node, np.minimum(side, 1)]
        node = np.where(tree.questions[node] >= 0, after, node)
    return tree.means[node]
