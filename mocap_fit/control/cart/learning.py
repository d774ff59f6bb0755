"""From a corpus to trees: examples, growing, and how strongly to prune."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.cart.arrays import (
    ByteArray,
    IntArray,
    Nodes,
    QuestionTable,
    Rules,
    Sample,
    allocate_nodes,
)
from mocap_fit.control.cart.contexts import GROUPS, KIND_OF_GROUP, Alphabet, get_group
from mocap_fit.control.cart.examples import TrainingSegments
from mocap_fit.control.cart.growing import ALPHAS, PruningCurve, grow, judge
from mocap_fit.control.cart.kernel import FIXED, ORDERED, SUBSET, compute_alphas
from mocap_fit.control.cart.questions import Attribute, Question
from mocap_fit.control.cart.tree import GrownTree, Tree, TreeKey, finish_trees
from mocap_fit.phones import PhoneSet
from mocap_fit.tracks import FloatArray

#: The largest number of bins that a number is divided into.
MAX_BINS = 32
#: Held-out targets that are enough to find the alpha of all trees together. On two corpora with
#: four seeds each the error of new sentences is at most 0.4 % above that with all targets (with
#: 1,500 up to 4 %, with 150 up to 9 %), and `fit` takes a quarter to half of the time.
MAX_JUDGED = 15_000
#: The largest number of examples that a tree of many phones is grown from.
MAX_POOLED = 2_000


@dataclass(frozen=True)
class Growth:
    """How trees are grown and pruned; see the settings of `Cart`.

    Parameters
    ----------
    rules
        For one tree.
    pruning
        ``together``, ``each`` or ``none``.
    one_standard_error
        Whether to prune as strongly as is possible within one standard error of the best.
    random_state
        Seed of the folds.
    """

    rules: Rules
    pruning: str
    one_standard_error: bool
    random_state: int


@dataclass(frozen=True, eq=False)
class _TreeData:
    """What one tree is grown from: its examples and questions, and what their numbers mean."""

    key: TreeKey
    sample: Sample
    table: QuestionTable
    numbers: IntArray
    edges: Mapping[int, FloatArray]


class Grower:
    """Grows the trees of a corpus.

    Parameters
    ----------
    examples
        All segments.
    questions
        All questions, those about one attribute together.
    attributes
        The attributes that they are about, in the order of the columns.
    alphabet
        The phones as levels.
    growth
        How trees are grown and pruned.
    """

    def __init__(
        self,
        examples: TrainingSegments,
        questions: Sequence[Question],
        attributes: Sequence[Attribute],
        alphabet: Alphabet,
        growth: Growth,
    ) -> None:
        self.examples = examples
        self.questions = tuple(questions)
        self.alphabet = alphabet
        self.growth = growth
        self._are_phones = [attribute.is_phone for attribute in attributes]
        of = np.array([attributes.index(q.attribute) for q in questions], dtype=np.int64)
        kinds = [
            FIXED if not q.is_open else SUBSET if q.attribute.is_phone else ORDERED
            for q in questions
        ]
        members = np.array(
            [alphabet.mark_members(q.phone_class, q.phones) for q in questions], dtype=np.uint8
        )
        none = np.zeros(0, np.int64)
        self._table = QuestionTable(of, np.array(kinds, dtype=np.int64), members, none)
        groups = alphabet.list_groups()
        self._groups = np.array([1 + GROUPS.index(g) if g else 0 for g in groups], dtype=np.int64)
        # One workspace for all trees that are grown only to be judged.
        most = max(len(examples.symbols), 1)
        self._workspace = allocate_nodes(most, max(alphabet.levels, MAX_BINS + 2))
        self._of_sound = np.array([q.attribute.needs_sound for q in questions], dtype=np.bool_)

    def _prepare(self, key_of: str, rows: IntArray, pooled: bool = False) -> list[_TreeData]:
        """Prepare the trees of a phone, or of many: one for each parameter.

        A tree with questions about sound is added where half of the examples have sound.
        """
        prepared = self._prepare_trees(key_of, rows, pooled, False)
        audible = rows[np.isfinite(self.examples.energies[rows])]
        if self._of_sound.any() and 2 * len(audible) >= len(rows):
            prepared += self._prepare_trees(key_of, audible, pooled, True)
        return prepared

    def _prepare_trees(
        self, key_of: str, rows: IntArray, pooled: bool, with_sound: bool
    ) -> list[_TreeData]:
        if len(rows) > MAX_POOLED and pooled:
            rows = rows[np.linspace(0, len(rows) - 1, MAX_POOLED).astype(np.int64)]
        numbers = np.flatnonzero(~self._of_sound | with_sound)
        columns = self.examples.columns
        levels = np.zeros((len(columns), len(rows)), dtype=np.uint8)
        sizes = np.full(len(columns), self.alphabet.levels, dtype=np.int64)
        edges: dict[int, FloatArray] = {}
        by_parameter: list[int] = []
        for a, (column, is_phone) in enumerate(zip(columns, self._are_phones, strict=True)):
            if not is_phone:
                levels[a], edges[a] = divide_into_bins(column[rows])
                sizes[a] = len(edges[a]) + 2
            elif column.ndim == 1:
                levels[a] = column[rows]
            else:
                by_parameter.append(a)
        attributes, kinds, members, _ = self._table
        table = QuestionTable(attributes[numbers], kinds[numbers], members[numbers], sizes)
        prepared = []
        values = self.examples.targets[rows]
        # Seeded by the name: the same folds whatever other trees there are.
        seed = [self.growth.random_state, int(with_sound), *key_of.encode()]
        rng = np.random.default_rng(seed)
        for p in range(values.shape[1]):
            for a in by_parameter:
                levels[a] = columns[a][rows, p]
            known = np.isfinite(values[:, p])
            count = int(known.sum())
            if not count:
                continue
            used = levels.copy() if count == len(known) else np.ascontiguousarray(levels[:, known])
            # The folds are drawn once a tree.
            folds = rng.permutation(np.arange(count) % self.growth.rules.cv)
            key = TreeKey(key_of, p, pooled, with_sound)
            sample = Sample(used, values[known, p], folds)
            prepared.append(_TreeData(key, sample, table, numbers, edges))
        return prepared

    def prepare(self, by_stress: bool) -> list[_TreeData]:
        """Prepare all trees: those of the phones, then those of many phones.

        Parameters
        ----------
        by_stress
            Whether a phone has a tree for each level of stress.

        Returns
        -------
        list
            What each tree is grown from.
        """
        symbols = self.examples.symbols
        prepared: list[_TreeData] = []
        for symbol in np.unique(symbols):
            prepared += self._prepare(str(symbol), np.flatnonzero(symbols == symbol))
        return prepared + self._prepare_pooled(
            {(data.key.of, data.key.parameter) for data in prepared}, by_stress
        )

    def _prepare_pooled(self, grown: set[tuple[str, int]], by_stress: bool) -> list[_TreeData]:
        """Prepare trees of many phones, for the phones of the set that have no examples."""
        phone_set, symbols = self.alphabet.phone_set, self.examples.symbols
        members: dict[str, list[str]] = {}
        for symbol in map(str, np.unique(symbols)):
            group = get_group(phone_set, symbol)
            if group != "no_speech":
                for name in {group, f"{KIND_OF_GROUP[group]}s", "all"}:
                    members.setdefault(name, []).append(symbol)
        rows = {name: np.flatnonzero(np.isin(symbols, phones)) for name, phones in members.items()}
        # Any sound may come in a set that computes its phones.
        needed = set(members) if phone_set.compute is not None else set()
        if phone_set.compute is None:
            targets = self.examples.targets
            has: dict[str, NDArray[np.bool_]] = {
                name: np.any(np.isfinite(targets[of]), axis=0) for name, of in rows.items()
            }
            for symbol in phone_set.list_symbols(by_stress):
                names = list_alternatives(phone_set, symbol, by_stress)
                alone = [of for of, pooled in names if not pooled]
                pools = [of for of, pooled in names if pooled and of in members]
                for p in range(targets.shape[1]):
                    if not any((of, p) in grown for of in alone):
                        # The first that has an example.
                        needed |= set([of for of in pools if has[of][p]][:1])
        prepared: list[_TreeData] = []
        for name in sorted(needed, key=[*GROUPS, "vowels", "consonants", "all"].index):
            prepared += self._prepare(name, rows[name], pooled=True)
        return prepared

    def finish(self, prepared: Sequence[_TreeData], nodes: Sequence[Nodes]) -> list[Tree]:
        """Convert grown trees to those of a model.

        Parameters
        ----------
        prepared
            What each was grown from.
        nodes
            The trees.

        Returns
        -------
        list[Tree]
            In the same order.
        """
        grown = [
            GrownTree(tree, data.numbers, data.edges)
            for data, tree in zip(prepared, nodes, strict=True)
        ]
        attributes, members = self._table.attributes.tolist(), self._table.members
        return finish_trees(grown, self.questions, attributes, members, self._groups)

    def _judge(self, data: _TreeData, fold: int, alphas: FloatArray) -> PruningCurve | None:
        """Let one fold judge the tree that the others grow; None where it cannot."""
        return judge(data.sample, fold, data.table, self.growth.rules, alphas, self._workspace)

    def judge_together(self, prepared: Sequence[_TreeData]) -> PruningCurve:
        """Let held-out examples of all trees judge each of `ALPHAS`.

        Every tree holds out a fold, the next tree the next fold, because small trees lack the last
        folds; then every tree its next, until `MAX_JUDGED` targets have been held out or all folds
        have. Errors are in variances of the parameter, so that all parameters count alike.

        Parameters
        ----------
        prepared
            What each tree is grown from.

        Returns
        -------
        PruningCurve
            Of all trees together.
        """
        variances = np.ones(self.examples.targets.shape[1])
        for p in range(len(variances)):
            values = self.examples.targets[:, p]
            values = values[np.isfinite(values)]
            variances[p] = values.var() if len(values) and values.var() > 0 else 1.0
        errors, squares, count = np.zeros(len(ALPHAS)), np.zeros(len(ALPHAS)), 0
        cv = self.growth.rules.cv
        turns = [(i, turn) for turn in range(cv) for i in _spread(len(prepared))]
        for i, turn in turns:
            curve = self._judge(prepared[i], (i + turn) % cv, ALPHAS)
            if curve is not None:
                variance = variances[prepared[i].key.parameter]
                errors += curve.errors / variance
                squares += curve.squares / variance**2
                count += curve.count
            if count >= MAX_JUDGED:
                break
        return PruningCurve(ALPHAS, errors, squares, count)

    def judge_alone(self, data: _TreeData) -> PruningCurve:
        """Let all folds of a tree judge the trees of its own sequence (Breiman et al. 3.4.2).

        Parameters
        ----------
        data
            What the tree is grown from.

        Returns
        -------
        PruningCurve
            At the geometric means of adjacent alphas of the sequence, from 0 to beyond the last.
        """
        nodes = grow(data.sample, data.table, self.growth.rules)
        strong = compute_alphas(len(nodes.counts), nodes.children, nodes.counts, nodes.validated)
        steps = np.unique(strong[nodes.questions >= 0])
        steps = steps[steps > 0]
        # Beyond the last step the root is alone.
        alphas = np.concatenate([[0.0], np.sqrt(steps[:-1] * steps[1:]), steps[-1:] * (1 + 1e-6)])
        curves = [self._judge(data, fold, alphas) for fold in range(self.growth.rules.cv)]
        parts = [curve for curve in curves if curve is not None]
        return PruningCurve(
            alphas,
            sum((part.errors for part in parts), np.zeros(len(alphas))),
            sum((part.squares for part in parts), np.zeros(len(alphas))),
            sum(part.count for part in parts),
        )


def grow_forest(grower: Grower, by_stress: bool) -> tuple[dict[TreeKey, Tree], PruningCurve | None]:
    """Grow and prune all trees.

    Parameters
    ----------
    grower
        The examples and the rules.
    by_stress
        Whether a phone has a tree for each level of stress.

    Returns
    -------
    trees
        By key.
    curve
        Held-out errors by alpha, where it is the same for all trees.
    """
    growth = grower.growth
    prepared = grower.prepare(by_stress)
    curve, alpha = None, -np.inf
    if growth.pruning == "together":
        curve = grower.judge_together([data for data in prepared if not data.key.pooled])
        alpha = curve.select_alpha(growth.one_standard_error)
    grown: list[Nodes] = []
    for data in prepared:
        if growth.pruning == "each":
            alpha = grower.judge_alone(data).select_alpha(growth.one_standard_error)
        grown.append(grow(data.sample, data.table, growth.rules, alpha))
    finished = grower.finish(prepared, grown)
    trees = {data.key: tree for data, tree in zip(prepared, finished, strict=True)}
    # A tree that asks nothing of the sound is the one without it, or as good.
    silent = [
        key
        for key, tree in trees.items()
        if key.with_sound
        and not any(grower.questions[q].attribute.needs_sound for q in tree.questions if q >= 0)
    ]
    for key in silent:
        del trees[key]
    return trees, curve


def list_alternatives(phone_set: PhoneSet, symbol: str, by_stress: bool) -> list[tuple[str, bool]]:
    """List whose trees predict a target of a phone: its own, or the first of these that there is.

    A phone without examples takes the trees of the phone with another stress, then of the group of
    similar phones (`GROUPS`), then of all vowels or all consonants, then of all phones. Silence
    without examples is rest.

    Parameters
    ----------
    phone_set
        The set of the phone.
    symbol
        The phone.
    by_stress
        Whether a phone has a tree for each level of stress.

    Returns
    -------
    list[tuple[str, bool]]
        `TreeKey.of` and `TreeKey.pooled`.
    """
    phone = phone_set.get_phone(symbol)
    names = [(symbol, False)]
    if by_stress and phone.takes_stress:
        written = (phone_set.stress.write(phone.symbol, level) for level in phone_set.stress.levels)
        names += [(other, False) for other in written if other != symbol]
    group = get_group(phone_set, phone.symbol)
    names.append((group, True))
    if group != "no_speech":
        names += [(f"{KIND_OF_GROUP[group]}s", True), ("all", True)]
    return names


def divide_into_bins(values: FloatArray) -> tuple[ByteArray, FloatArray]:
    """Divide numbers into at most `MAX_BINS` bins of about equal counts.

    Parameters
    ----------
    values
        ``(examples,)``, seconds, dB, or no unit; NaN is unknown.

    Returns
    -------
    levels
        The bin of each, ``(examples,)``; what is unknown comes after the last bin.
    edges
        The bounds between the bins, ``(bins - 1,)``, in the unit of the values.
    """
    is_known = np.isfinite(values)
    ordered = np.sort(values[is_known])
    # Where one number ends and the next begins; of many such places as many as there are bins.
    steps = np.flatnonzero(ordered[1:] > ordered[:-1])
    if len(steps) >= MAX_BINS:
        even = np.arange(1, MAX_BINS) * len(ordered) / MAX_BINS
        near = np.minimum(np.searchsorted(steps + 1, even), len(steps) - 1)
        steps = np.unique(steps[near])
    edges = 0.5 * (ordered[steps] + ordered[steps + 1])
    levels = np.searchsorted(edges, values, side="left")
    return np.where(is_known, levels, len(edges) + 1).astype(np.uint8), edges


def _spread(count: int) -> list[int]:
    """List the numbers below a count in an order whose beginning is spread over all of them."""
    step = max(round(count * 0.618), 1)
    while np.gcd(step, count) > 1:
        step += 1
    return [(i * step) % count for i in range(count)]
