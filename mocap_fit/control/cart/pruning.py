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
from mocap_fit.control.cart.gains import compiled
from mocap_fit.control.cart.growing import Asked, Grown, IntArray
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
    variances = tree.validated / tree.counts
    inner = tree.questions >= 0
    if not inner.any():
        return np.full(len(inner), -np.inf)
    found: FloatArray = _weakest_first(
        tree.children, np.where(np.isfinite(tree.validated), tree.validated, 0.0), variances
    )
    return found


@compiled
def _weakest_first(children, errors, variances):  # type: ignore[no-untyped-def]
    nodes = len(errors)
    parents = np.full(nodes, -1, np.int64)
    standing = np.zeros(nodes, np.bool_)
    # Of each branch: the errors of its leaves, and the variances of its cuts.
    below, price = errors.copy(), np.zeros(nodes)
    for node in range(nodes):
        if children[node, 0] >= 0:
            parents[children[node, 0]] = node
            parents[children[node, 1]] = node
            standing[node] = True
            below[node], price[node] = 0.0, variances[node]
    for node in range(nodes - 1, 0, -1):
        below[parents[node]] += below[node]
        price[parents[node]] += price[node]
    strengths = np.full(nodes, -np.inf)
    waiting = np.empty(nodes, np.int64)
    reached = -np.inf
    while standing[0]:
        weakest, least = -1, np.inf
        for node in range(nodes):
            if standing[node]:
                strength = (errors[node] - below[node]) / price[node]
                if weakest < 0 or strength < least:
                    weakest, least = node, strength
        reached = max(reached, least)
        waiting[0], left = weakest, 1
        while left > 0:
            left -= 1
            node = waiting[left]
            if standing[node]:
                standing[node], strengths[node] = False, reached
                waiting[left], waiting[left + 1] = children[node, 0], children[node, 1]
                left += 2
        more, less, node = errors[weakest] - below[weakest], price[weakest], weakest
        while node >= 0:
            below[node] += more
            price[node] -= less
            node = parents[node]
    return strengths


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


def judge(
    tree: Grown,
    levels: ByteArray,
    targets: FloatArray,
    examples: IntArray,
    asked: Asked,
    strengths: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Errors of held-out examples at each strength.

    Parameters
    ----------
    tree
        Grown without them.
    levels, targets
        `(attributes, examples)` and `(examples,)`.
    examples
        Which were held out.
    asked
        The questions.
    strengths
        `(strengths,)`, ascending.

    Returns
    -------
    errors, squares
        `(strengths,)` each: squared errors added up, and their squares.
    """
    errors, squares = np.zeros(len(strengths)), np.zeros(len(strengths))
    _judge(
        levels,
        targets,
        examples,
        asked.attributes,
        tree.questions,
        tree.sides,
        tree.children,
        _larger_sides(tree),
        tree.means,
        strengths_of(tree),
        strengths,
        errors,
        squares,
    )
    return errors, squares


def _larger_sides(tree: Grown) -> IntArray:
    """Of each node, the side with more examples; 0 in a leaf."""
    counts = tree.counts[tree.children]
    return np.where(tree.questions >= 0, counts[:, 1] > counts[:, 0], 0).astype(np.int64)


@compiled
def _judge(  # type: ignore[no-untyped-def]  # numba infers the types
    levels,
    targets,
    examples,
    of_attribute,
    questions,
    sides,
    children,
    larger,
    means,
    strong,
    strengths,
    errors,
    squares,
):
    for example in examples:
        node, place = 0, len(strengths) - 1
        while place >= 0:
            off = means[node] - targets[example]
            # Of all trees whose strength is above the node's, the example ends here.
            while place >= 0 and not strong[node] >= strengths[place]:
                errors[place] += off * off
                squares[place] += off**4
                place -= 1
            if place >= 0:
                side = sides[node, levels[of_attribute[questions[node]], example]]
                node = children[node, larger[node] if side > 1 else side]
