"""The arrays that trees are grown from and grown into, as the compiled kernel takes them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.tracks import FloatArray

IntArray = NDArray[np.int64]
ByteArray = NDArray[np.uint8]

#: A depth that no tree reaches.
UNLIMITED = int(np.iinfo(np.int64).max)


class Sample(NamedTuple):
    """The examples that one tree is grown from.

    Parameters
    ----------
    levels
        Level of each attribute, ``(attributes, examples)``.
    targets
        ``(examples,)``, in the unit of the parameter.
    folds
        The fold of each example, counted from 0, ``(examples,)``.
    """

    levels: ByteArray
    targets: FloatArray
    folds: IntArray


class QuestionTable(NamedTuple):
    """The questions of a tree as arrays, in the order in which they are tried.

    Parameters
    ----------
    attributes
        Row of the levels that each asks about, ``(questions,)``; equal ones are adjacent.
    kinds
        `FIXED`, `ORDERED` or `SUBSET`, ``(questions,)``.
    members
        1 for the levels that answer yes to a fixed question, ``(questions, levels)``.
    sizes
        Number of levels of each attribute, ``(attributes,)``.
    """

    attributes: IntArray
    kinds: IntArray
    members: ByteArray
    sizes: IntArray


class Rules(NamedTuple):
    """How a tree is grown; see the settings of `Cart`.

    Parameters
    ----------
    cv
        Number of folds.
    min_samples_split
        A node with fewer examples is a leaf.
    min_samples_leaf
        Each side of a cut has at least as many examples.
    max_depth
        A node so far below the root is a leaf.
    min_impurity_decrease
        A cut lowers the cross-validated error by more than so many variances of its node.
    by_node
        Whether phones are ordered anew in each node.
    """

    cv: int
    min_samples_split: int = 6
    min_samples_leaf: int = 1
    max_depth: int = UNLIMITED
    min_impurity_decrease: float = 0.0
    by_node: bool = False


class Nodes(NamedTuple):
    """A tree as it was grown; node 0 is the root, and children come after their parents.

    Parameters
    ----------
    questions
        Index of the question, ``(nodes,)``; -1 in a leaf.
    sides
        Where each level goes, ``(nodes, levels)``: `LEFT`, `RIGHT`, or `UNSEEN` where the node has
        no example of it.
    children
        Nodes to the left and to the right, ``(nodes, 2)``; -1 in a leaf.
    counts
        Number of examples, ``(nodes,)``.
    means
        Mean target (eq. 8), ``(nodes,)``.
    errors
        Sum of squared errors, ``(nodes,)``.
    validated
        Cross-validated sum of squared errors (eq. 9), ``(nodes,)``; infinite for one example.
    gains
        Decrease of the cross-validated error by the cut (eq. 10), ``(nodes,)``; 0 in a leaf.
    """

    questions: IntArray
    sides: ByteArray
    children: IntArray
    counts: IntArray
    means: FloatArray
    errors: FloatArray
    validated: FloatArray
    gains: FloatArray


def allocate_nodes(examples: int, levels: int) -> Nodes:
    """Allocate arrays for the largest tree that grows from some examples, not initialised.

    Parameters
    ----------
    examples
        Number of examples.
    levels
        The largest number of levels of an attribute.

    Returns
    -------
    Nodes
        Space for two nodes an example, and one more.
    """
    size = 2 * examples + 1
    return Nodes(
        np.empty(size, dtype=np.int64),
        np.empty((size, levels), dtype=np.uint8),
        np.empty((size, 2), dtype=np.int64),
        np.empty(size, dtype=np.int64),
        *(np.empty(size) for _ in range(4)),
    )
