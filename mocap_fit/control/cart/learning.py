"""From a corpus to trees: examples, growing, and how strongly to prune."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.cart.contexts import (
    GROUPS,
    KIND_OF_GROUP,
    Alphabet,
    ByteArray,
    group_of,
)
from mocap_fit.control.cart.examples import Examples
from mocap_fit.control.cart.growing import Asked, Grown, IntArray, room_for
from mocap_fit.control.cart.kernel import FIXED, ORDERED, SUBSET
from mocap_fit.control.cart.pruning import STRENGTHS, Judged, grow_pruned, judge, strengths_of
from mocap_fit.control.cart.questions import Attribute, Question
from mocap_fit.control.cart.tree import Made, Tree, finished
from mocap_fit.phones import PhoneSet
from mocap_fit.tracks import FloatArray

#: Bins that the numbers of a tree are divided into at most.
BINS = 32
#: Held-out targets that tell how strongly to prune all trees together.
ENOUGH = 15_000
#: Examples that a tree of many phones is grown from at most.
MOST_POOLED = 2_000


class TreeKey(NamedTuple):
    """Which tree.

    Parameters
    ----------
    of
        A phone as its set writes it; of a tree of many phones a group of `GROUPS`, ``vowels``,
        ``consonants``, or ``all``.
    parameter
        Which parameter, from 0.
    pooled
        Whether it is of many phones.
    with_sound
        Whether it was grown with questions that only sound can answer.
    """

    of: str
    parameter: int
    pooled: bool = False
    with_sound: bool = False


@dataclass(frozen=True)
class Growth:
    """How trees are grown; see the settings of `Cart`."""

    folds: int
    smallest: int
    least_gain: float
    phone_order: str
    pruning: str
    one_standard_error: bool
    seed: int


@dataclass(frozen=True, eq=False)
class _Sample:
    """What one tree is grown from."""

    key: TreeKey
    levels: ByteArray
    targets: FloatArray
    folds: IntArray
    asked: Asked
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
        What they are about, in the order of the columns.
    alphabet
        The phones as levels.
    growth
        How.
    """

    def __init__(
        self,
        examples: Examples,
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
            [alphabet.members(q.phone_class, q.phones) for q in questions], dtype=np.uint8
        )
        self._asked = Asked(of, np.array(kinds, dtype=np.int64), members, np.zeros(0, np.int64))
        groups = alphabet.groups()
        self._groups = np.array([1 + GROUPS.index(g) if g else 0 for g in groups], dtype=np.int64)
        # Where trees are grown that only judge: one room for all of them.
        most = max(len(examples.symbols), 1)
        self._room = room_for(most, max(alphabet.levels, BINS + 2))
        self._of_sound = np.array([q.attribute.needs_sound for q in questions], dtype=np.bool_)

    def samples(self, key_of: str, rows: IntArray, pooled: bool = False) -> list[_Sample]:
        """What the trees of a phone, or of many, are grown from: one for each parameter.

        A tree with questions about sound is added where half of the examples have sound.
        """
        found = self._samples(key_of, rows, pooled, False)
        audible = rows[np.isfinite(self.examples.energies[rows])]
        if self._of_sound.any() and 2 * len(audible) >= len(rows):
            found += self._samples(key_of, audible, pooled, True)
        return found

    def _samples(
        self, key_of: str, rows: IntArray, pooled: bool, with_sound: bool
    ) -> list[_Sample]:
        if len(rows) > MOST_POOLED and pooled:
            rows = rows[np.linspace(0, len(rows) - 1, MOST_POOLED).astype(np.int64)]
        asks = np.flatnonzero(~self._of_sound | with_sound)
        columns = self.examples.columns
        levels = np.zeros((len(columns), len(rows)), dtype=np.uint8)
        sizes = np.full(len(columns), self.alphabet.levels, dtype=np.int64)
        edges: dict[int, FloatArray] = {}
        by_parameter: list[int] = []
        for a, (column, is_phone) in enumerate(zip(columns, self._are_phones, strict=True)):
            if not is_phone:
                levels[a], edges[a] = binned(column[rows])
                sizes[a] = len(edges[a]) + 2
            elif column.ndim == 1:
                levels[a] = column[rows]
            else:
                by_parameter.append(a)
        asked = Asked(
            self._asked.attributes[asks],
            self._asked.kinds[asks],
            self._asked.members[asks],
            sizes,
        )
        found = []
        values = self.examples.targets[rows]
        # By name: whatever other trees there are.
        rng = np.random.default_rng([self.growth.seed, int(with_sound), *key_of.encode()])
        for p in range(values.shape[1]):
            for a in by_parameter:
                levels[a] = columns[a][rows, p]
            known = np.isfinite(values[:, p])
            count = int(known.sum())
            if not count:
                continue
            own = levels.copy() if count == len(known) else np.ascontiguousarray(levels[:, known])
            # The folds are drawn once a tree.
            folds = rng.permutation(np.arange(count) % self.growth.folds)
            key = TreeKey(key_of, p, pooled, with_sound)
            found.append(_Sample(key, own, values[known, p], folds, asked, asks, edges))
        return found

    def pruned(self, sample: _Sample, strength: float) -> Grown:
        """A tree, grown and pruned."""
        growth = self.growth
        return grow_pruned(
            sample.levels,
            sample.targets,
            sample.folds,
            sample.asked,
            strength,
            fold_count=growth.folds,
            smallest=growth.smallest,
            least_gain=growth.least_gain,
            phone_order=growth.phone_order,
        )

    def finished(self, samples: Sequence[_Sample], grown: Sequence[Grown]) -> list[Tree]:
        """Trees as they are kept."""
        made = [
            Made(tree, sample.numbers, sample.edges)
            for sample, tree in zip(samples, grown, strict=True)
        ]
        attributes, members = self._asked.attributes.tolist(), self._asked.members
        return finished(made, self.questions, attributes, members, self._groups)

    def judged(self, sample: _Sample, fold: int, strengths: FloatArray) -> Judged | None:
        """What the examples of one fold say of the trees that the others grow."""
        in_fold = np.count_nonzero(sample.folds == fold)
        if in_fold in (0, len(sample.folds)):
            return None
        growth = self.growth
        return judge(
            sample.levels,
            sample.targets,
            sample.folds,
            fold,
            sample.asked,
            strengths,
            fold_count=growth.folds,
            smallest=growth.smallest,
            least_gain=growth.least_gain,
            phone_order=growth.phone_order,
            room=self._room,
        )

    def judged_together(self, samples: Sequence[_Sample]) -> Judged:
        """What held-out examples of all trees say of each strength.

        Every tree holds out a fold, another one from tree to tree, and then the next, until
        `ENOUGH` targets have been held out or all folds have. Errors are in variances of the
        parameter, so that all parameters count alike.
        """
        variances = np.ones(self.examples.targets.shape[1])
        for p in range(len(variances)):
            values = self.examples.targets[:, p]
            values = values[np.isfinite(values)]
            variances[p] = values.var() if len(values) and values.var() > 0 else 1.0
        errors, squares, count = np.zeros(len(STRENGTHS)), np.zeros(len(STRENGTHS)), 0
        folds = self.growth.folds
        turns = [(i, turn) for turn in range(folds) for i in _spread(len(samples))]
        for i, turn in turns:
            judged = self.judged(samples[i], (i + turn) % folds, STRENGTHS)
            if judged is not None:
                variance = variances[samples[i].key.parameter]
                errors += judged.errors / variance
                squares += judged.squares / variance**2
                count += judged.count
            if count >= ENOUGH:
                break
        return Judged(STRENGTHS, errors, squares, count)

    def judged_alone(self, sample: _Sample) -> Judged:
        """What all folds of a tree say of the trees of its own sequence (Breiman et al. 3.4.2)."""
        tree = self.pruned(sample, -np.inf)
        own = np.unique(strengths_of(tree)[tree.questions >= 0])
        own = own[own > 0]
        # Between two steps of the sequence, as is usual; and the root alone.
        steps = np.concatenate([[0.0], np.sqrt(own[:-1] * own[1:]), own[-1:] * (1 + 1e-6)])
        parts = [self.judged(sample, fold, steps) for fold in range(self.growth.folds)]
        kept = [part for part in parts if part is not None]
        return Judged(
            steps,
            sum((part.errors for part in kept), np.zeros(len(steps))),
            sum((part.squares for part in kept), np.zeros(len(steps))),
            sum(part.count for part in kept),
        )


def learn(grower: Grower, by_stress: bool) -> tuple[dict[TreeKey, Tree], Judged | None]:
    """Grow and prune all trees.

    Parameters
    ----------
    grower
        What from, and how.
    by_stress
        Whether a phone has a tree for each level of stress.

    Returns
    -------
    trees
        By key.
    judged
        What told how strongly to prune, where it was one strength for all.
    """
    growth, symbols = grower.growth, grower.examples.symbols
    samples: list[_Sample] = []
    for symbol in np.unique(symbols):
        samples += grower.samples(str(symbol), np.flatnonzero(symbols == symbol))
    samples += _pooled_samples(grower, {(s.key.of, s.key.parameter) for s in samples}, by_stress)
    judged, strength = None, -np.inf
    if growth.pruning == "together":
        judged = grower.judged_together([s for s in samples if not s.key.pooled])
        strength = judged.best(growth.one_standard_error)
    grown: list[Grown] = []
    for sample in samples:
        if growth.pruning == "each":
            strength = grower.judged_alone(sample).best(growth.one_standard_error)
        grown.append(grower.pruned(sample, strength))
    finished_trees = grower.finished(samples, grown)
    trees = {sample.key: tree for sample, tree in zip(samples, finished_trees, strict=True)}
    # A tree that asks nothing of the sound is the one without it, or as good.
    silent = [
        key
        for key, tree in trees.items()
        if key.with_sound
        and not any(grower.questions[q].attribute.needs_sound for q in tree.questions if q >= 0)
    ]
    for key in silent:
        del trees[key]
    return trees, judged


def chain(phone_set: PhoneSet, symbol: str, by_stress: bool) -> list[tuple[str, bool]]:
    """Whose trees say a target of a phone: its own, or the first that there is.

    A phone without examples takes the trees of the phone with another stress, then of the group of
    phones that are alike (`GROUPS`), then of all vowels or all consonants, then of all phones.
    Silence without examples is rest.

    Returns
    -------
    list[tuple[str, bool]]
        `TreeKey.of` and `TreeKey.pooled`.
    """
    phone = phone_set.get_phone(symbol)
    found = [(symbol, False)]
    if by_stress and phone.takes_stress:
        written = (phone_set.stress.write(phone.symbol, level) for level in phone_set.stress.levels)
        found += [(other, False) for other in written if other != symbol]
    group = group_of(phone_set, phone.symbol)
    found.append((group, True))
    if group != "no_speech":
        found += [(f"{KIND_OF_GROUP[group]}s", True), ("all", True)]
    return found


def _pooled_samples(grower: Grower, grown: set[tuple[str, int]], by_stress: bool) -> list[_Sample]:
    """Samples of many phones, for those phones of the set that have no examples of their own."""
    phone_set = grower.alphabet.phone_set
    groups = {s: group_of(phone_set, s) for s in map(str, np.unique(grower.examples.symbols))}
    members: dict[str, list[str]] = {}
    for symbol, group in groups.items():
        if group != "no_speech":
            for name in {group, f"{KIND_OF_GROUP[group]}s", "all"}:
                members.setdefault(name, []).append(symbol)
    if phone_set.compute is not None:
        # Any sound may come.
        wanted = set(members)
    else:
        targets, symbols = grower.examples.targets, grower.examples.symbols
        has: dict[str, NDArray[np.bool_]] = {
            name: np.any(np.isfinite(targets[np.isin(symbols, own)]), axis=0)
            for name, own in members.items()
        }
        wanted = set()
        for symbol in phone_set.list_symbols(by_stress):
            names = chain(phone_set, symbol, by_stress)
            own = [of for of, pooled in names if not pooled]
            pools = [of for of, pooled in names if pooled and of in members]
            for p in range(targets.shape[1]):
                if not any((of, p) in grown for of in own):
                    # The first that can say something.
                    wanted |= set([of for of in pools if has[of][p]][:1])
    found: list[_Sample] = []
    for name in sorted(wanted, key=[*GROUPS, "vowels", "consonants", "all"].index):
        rows = np.flatnonzero(np.isin(grower.examples.symbols, members[name]))
        found += grower.samples(name, rows, pooled=True)
    return found


def binned(values: FloatArray) -> tuple[ByteArray, FloatArray]:
    """Numbers as levels.

    Parameters
    ----------
    values
        `(examples,)`; NaN is unknown.

    Returns
    -------
    levels
        `(examples,)`: which of at most `BINS` bins; what is unknown comes after the last.
    edges
        The bounds between the bins.
    """
    is_known = np.isfinite(values)
    ordered = np.sort(values[is_known])
    # Where one number ends and the next begins; of many such places as many as there are bins.
    steps = np.flatnonzero(ordered[1:] > ordered[:-1])
    if len(steps) >= BINS:
        wanted = np.arange(1, BINS) * len(ordered) / BINS
        near = np.minimum(np.searchsorted(steps + 1, wanted), len(steps) - 1)
        steps = np.unique(steps[near])
    edges = 0.5 * (ordered[steps] + ordered[steps + 1])
    levels = np.searchsorted(edges, values, side="left")
    return np.where(is_known, levels, len(edges) + 1).astype(np.uint8), edges


def _spread(count: int) -> list[int]:
    """The numbers below a count, in an order whose beginning is spread over all of them."""
    step = max(round(count * 0.618), 1)
    while np.gcd(step, count) > 1:
        step += 1
    return [(i * step) % count for i in range(count)]
