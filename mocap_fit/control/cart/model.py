"""CART: articulatory targets selected by regression trees (Krňoul & Železný section 5.1).

For each phone and each face parameter a tree predicts the target from the phone's context: who is
beside it, how long the segments are, how loud it is. The targets stand at the centres of the
segments, and a curve goes through them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mocap_fit.control.base import ControlModel, LogEntry, Progress
from mocap_fit.control.cart.closures import Closure, check_closures, learned_closures
from mocap_fit.control.cart.contexts import Alphabet, ContextReader, energies
from mocap_fit.control.cart.curves import INTERPOLATIONS, curve, smoothing_reach
from mocap_fit.control.cart.examples import (
    Examples,
    alphabet_of,
    collect,
    read_corpus,
    resistance,
)
from mocap_fit.control.cart.learning import Grower, Growth, TreeKey, chain, learn
from mocap_fit.control.cart.questions import (
    Question,
    check_phones_of,
    in_order,
    question_from_row,
    question_row,
    read_questions,
    standard_questions,
)
from mocap_fit.control.cart.stream import CentreStream
from mocap_fit.control.cart.tree import Forest, Tree, packed, unpacked
from mocap_fit.control.streaming import Stream
from mocap_fit.corpus import Corpus
from mocap_fit.errors import ConfigurationError, DataError, from_os_error
from mocap_fit.phones import ARTICULATORY_PARAMETERS, PhoneSequence
from mocap_fit.tracks import FloatArray

PHONE_ORDERS = ("tree", "node")
PRUNINGS = ("together", "each", "none")
RESISTANCES = ("phone-set", "learned")


@dataclass(frozen=True)
class Chosen:
    """What a target was selected by.

    Parameters
    ----------
    segment, parameter
        Which target, from 0.
    key
        The tree; None where there is none to back off to.
    path
        The nodes from its root to a leaf.
    values
        The attributes of the segment: levels of the alphabet, and numbers.
    """

    segment: int
    parameter: int
    key: TreeKey | None
    path: tuple[int, ...]
    values: list[float]


@dataclass(eq=False, repr=False)
class Cart(ControlModel):
    """Selection of articulatory targets by regression trees (Krňoul & Železný section 5.1).

    With ``least_gain = 0``, ``phone_order = "node"`` and ``pruning = "each"`` trees are grown and
    pruned as the paper has it; with ``pruning = "none"`` every cut stays that gains anything. The
    defaults are what held-out folds of training parts say is best. Squared errors of the targets
    (`benchmarks/cart.py`): on folds of the training part, in variances of the parameter, and on the
    test part, as a share of what is left when every phone has its mean target:

    =====================================  =======  =======  =========  =========
    way                                    grid_s1  grid_s1  simulated  simulated
                                           folds    test     folds      test
    =====================================  =======  =======  =========  =========
    every cut with a gain, not pruned      0.756    1.02     0.348      0.385
    as the paper has it                             0.740               0.329
    defaults, phones ordered in each node  0.585    0.728    0.276      0.323
    defaults                               0.585    0.728    0.277      0.324
    =====================================  =======  =======  =========  =========

    On random phones, whose targets are drawn from both sides alike, the order of the whole tree is
    9 % better than that of each node (0.549 and 0.603 of a test part).

    Parameters
    ----------
    smallest
        A node of so many examples or fewer is a leaf (N_min of the paper).
    folds
        How many parts the examples of a tree are divided into at random, once a tree (eq. 9).
    least_gain
        A cut lowers the cross-validated error by more than so many variances of its node. 0 is
        the paper's rule: by anything. The best of all cuts does so by chance alone: where targets
        were shuffled, at the root by 11 to 37 variances (20 in the middle), as its group of phones
        is the best of very many. What pruning leaves gains 7 to 12 and more; growing far beyond
        that costs time alone.
    pruning
        How strongly to prune (eq. 12). ``together``: one strength for all trees, the best on
        held-out folds of all. ``each``: every tree has its own, from its own ten folds, which a
        few hundred examples tell badly. ``none``: not at all.
    one_standard_error
        Prune as strongly as is possible within one standard error of the best.
    phone_order
        Groups of phones are cut from an order of phones by mean target: in the whole ``tree``, or
        in each ``node`` anew. The latter is the best order for the examples of a node, but these
        are few for each phone, and it follows their noise.
    by_stress
        Whether a vowel has a tree with stress and one without.
    questions
        A table of questions beside those of the paper (`questions` says how), as TOML text, or as
        the name of a file of it.
    resistance
        Who counts as resistant to coarticulation: what the ``phone-set`` says, or what is
        ``learned`` from the corpus, phones whose targets vary little. Of a parameter that is not
        one of the ten it is always learned.
    reach
        How many phones away the nearest resistant phone may be.
    interpolation
        ``cubic`` (monotone), ``linear`` or ``cosine``.
    smoothing
        Standard deviation of a bell that curves are smoothed with, seconds; 0: none.
    closures
        Guarantees for bilabial stops: a parameter and the value that it is not more open than,
        or ``learned``: the median of the corpus's bilabial stops.
    hold
        For which share of a bilabial stop, about its centre, the guarantee holds.
    seed
        Of the folds.
    """

    name: ClassVar[str] = "cart"
    title: ClassVar[str] = "CART"

    smallest: int = 5
    folds: int = 10
    least_gain: float = 6.0
    pruning: str = "together"
    one_standard_error: bool = False
    phone_order: str = "tree"
    by_stress: bool = True
    questions: str = ""
    resistance: str = "phone-set"
    reach: int = 4
    interpolation: str = "cubic"
    smoothing: float = 0.0
    closures: Mapping[str, Any] = field(default_factory=dict)
    hold: float = 0.5
    seed: int = 0

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the settings of the model, with the text of a table of questions for its path.

        Parameters
        ----------
        deep
            No effect: no setting is a model itself.

        Returns
        -------
        dict[str, Any]
            The constructor's arguments by name.
        """
        return super().get_params() | {
            "questions": self._table()[0],
            "closures": dict(self.closures),
        }

    def _table(self) -> tuple[str, str | None]:
        """The text of the user's questions, and the file that it is from."""
        if not self.questions or "\n" in self.questions or "[" in self.questions:
            return self.questions, None
        if self.is_fitted and hasattr(self, "_text"):
            return self._text, self.questions
        try:
            return Path(self.questions).read_text(encoding="utf-8"), self.questions
        except (OSError, UnicodeDecodeError) as error:
            raise from_os_error(error, self.questions, "table of questions") from None

    def _check(self) -> None:
        choices = (
            ("pruning", self.pruning, PRUNINGS),
            ("phone_order", self.phone_order, PHONE_ORDERS),
            ("resistance", self.resistance, RESISTANCES),
            ("interpolation", self.interpolation, INTERPOLATIONS),
        )
        for name, value, known in choices:
            if value not in known:
                raise ConfigurationError(
                    f"'{name}' is unknown", found=value, expected=f"one of {', '.join(known)}"
                )
        ranges = (
            ("smallest", self.smallest, 1, math.inf),
            ("folds", self.folds, 2, 100),
            ("least_gain", self.least_gain, 0.0, math.inf),
            ("reach", self.reach, 1, 20),
            ("smoothing", self.smoothing, 0.0, 1.0),
            ("hold", self.hold, 0.0, 1.0),
        )
        for name, number, least, most in ranges:
            if not (math.isfinite(number) and least <= number <= most):
                raise ConfigurationError(
                    f"'{name}' is not possible", found=number, expected=f"from {least} to {most}"
                )
        check_closures(self.closures, self.parameter_names_)

    # -- learning ------------------------------------------------------------------------------

    def _fit(
        self,
        corpus: Corpus,
        validation: Corpus | None,
        progress: Progress,
        checkpoint: Path | None,
    ) -> None:
        self._check()
        text, path = self._table()
        self._text = text
        own = check_phones_of(read_questions(text, path), self.phone_set_)
        questions = in_order((*standard_questions(), *own))
        phones, found = read_corpus(corpus)
        if not phones:
            raise DataError("the utterances of the corpus have no phones")
        alphabet = alphabet_of(phones, self.phone_set_)
        by_phone_set = np.array(
            [
                self.resistance == "phone-set" and name in ARTICULATORY_PARAMETERS
                for name in self.parameter_names_
            ]
        )
        resists = resistance(alphabet, self.parameter_names_, by_phone_set, phones, found)
        self._prepare(questions, alphabet, resists, by_phone_set)
        examples = collect(phones, found, self._reader, self.by_stress)
        growth = Growth(
            self.folds,
            self.smallest,
            self.least_gain,
            self.phone_order,
            self.pruning,
            self.one_standard_error,
            self.seed,
        )
        grower = Grower(examples, questions, self._reader.attributes, alphabet, growth)
        trees, judged = learn(grower, self.by_stress)
        self._plant(trees)
        #: Held-out squared error at each strength of pruning, `(strengths, 2)`; empty where none
        #: was sought for all trees. In variances of the parameter, per target.
        self.pruning_curve_: FloatArray = np.zeros((0, 2))
        if judged is not None and judged.count:
            self.pruning_curve_ = np.stack([judged.strengths, judged.errors / judged.count], axis=1)
        #: The strength of pruning of all trees; NaN where each has its own.
        self.strength_ = judged.best(self.one_standard_error) if judged is not None else math.nan
        self.closures_: dict[int, Closure] = learned_closures(
            self.closures,
            self.parameter_names_,
            examples.symbols,
            examples.targets,
            self.phone_set_,
        )
        self._report(examples, validation, progress)

    def _prepare(
        self,
        questions: tuple[Question, ...],
        alphabet: Alphabet,
        resists: NDArray[np.bool_],
        by_phone_set: NDArray[np.bool_],
    ) -> None:
        #: All questions, in the order in which they are tried.
        self.questions_ = questions
        attributes = tuple(dict.fromkeys(question.attribute for question in questions))
        self._of_attribute = [attributes.index(question.attribute) for question in questions]
        self._are_phones = [attribute.is_phone for attribute in attributes]
        self._resists, self._by_phone_set = resists, by_phone_set
        self._reader = ContextReader(
            attributes, alphabet, resists, self.parameter_names_, by_phone_set, self.reach
        )

    def _report(self, examples: Examples, validation: Corpus | None, progress: Progress) -> None:
        """Two lines for the log: every phone's mean as its target, and what the trees say."""
        own = [tree for key, tree in self.trees_.items() if not (key.pooled or key.with_sound)]
        count = max(sum(int(tree.counts[0]) for tree in own), 1)
        roots = sum(float(tree.errors[0]) for tree in own)
        leaves = sum(float(tree.errors[tree.questions < 0].sum()) for tree in own)
        roots_after, leaves_after = self._validated(validation)
        progress(LogEntry(0, math.sqrt(roots / count), roots_after, "targets"))
        progress(LogEntry(1, math.sqrt(leaves / count), leaves_after, "targets"))

    def _validated(self, validation: Corpus | None) -> tuple[float | None, float | None]:
        """Root mean square errors of the targets of a corpus, by the roots and by the leaves."""
        if validation is None:
            return None, None
        off: list[tuple[float, float]] = []
        for phones, found in zip(*read_corpus(validation), strict=True):
            for each in self.chosen(phones):
                target = found[each.segment, each.parameter]
                if each.key is not None and math.isfinite(target):
                    means = self.trees_[each.key].means
                    off.append((means[each.path[0]] - target, means[each.path[-1]] - target))
        if not off:
            return None, None
        roots, leaves = np.sqrt((np.array(off) ** 2).mean(axis=0))
        return float(roots), float(leaves)

    @property
    def alphabet(self) -> Alphabet:
        """The phones that the trees know, as levels."""
        return self._reader.alphabet

    def attribute_of(self, question: int) -> int:
        """Which attribute one of `questions_` is about, as `Chosen.values` counts them."""
        return self._of_attribute[question]

    # -- predicting ----------------------------------------------------------------------------

    def chosen(self, phones: PhoneSequence) -> Iterator[Chosen]:
        """What every target of an utterance is selected by, segment by segment.

        Yields
        ------
        Chosen
            One for each segment and parameter.
        """
        columns = self._reader.columns(phones)
        audible = np.isfinite(energies(phones))
        for i, segment in enumerate(phones):
            symbol = self.phone_set_.get_symbol(segment, self.by_stress)
            for p in range(len(self.parameter_names_)):
                key = self._key(symbol, p, bool(audible[i]))
                values = [
                    float(column[i] if column.ndim == 1 else column[i, p]) for column in columns
                ]
                path: tuple[int, ...] = ()
                if key is not None:
                    path = tuple(
                        self.trees_[key].path(self._of_attribute, self._are_phones, values)
                    )
                yield Chosen(i, p, key, path, values)

    def _key(self, symbol: str, parameter: int, audible: bool) -> TreeKey | None:
        if symbol not in self._chains:
            self._chains[symbol] = chain(self.phone_set_, symbol, self.by_stress)
        for of, pooled in self._chains[symbol]:
            key = TreeKey(of, parameter, pooled, True)
            if audible and key in self.trees_:
                return key
            key = key._replace(with_sound=False)
            if key in self.trees_:
                return key
        return None

    def targets(self, phones: PhoneSequence) -> FloatArray:
        """The selected targets of an utterance, `(segments, parameters)`.

        A phone for which nothing can be backed off to is at rest, 0.
        """
        audible = np.isfinite(energies(phones))
        symbols = [self.phone_set_.get_symbol(segment, self.by_stress) for segment in phones]
        rows = [
            self._row(symbol, heard)
            for symbol, heard in zip(symbols, audible.tolist(), strict=True)
        ]
        columns = self._reader.columns(phones)
        values = np.empty((len(phones), len(columns), len(self.parameter_names_)))
        for a, column in enumerate(columns):
            values[:, a] = column if column.ndim == 2 else column[:, None]
        return self._forest.answers(np.array(rows, dtype=np.int64), values)

    def _row(self, symbol: str, audible: bool) -> list[int]:
        """Which tree says each parameter of a phone; -1 for none."""
        if (symbol, audible) not in self._rows:
            keys = [self._key(symbol, p, audible) for p in range(len(self.parameter_names_))]
            numbers = {key: number for number, key in enumerate(self.trees_)}
            self._rows[symbol, audible] = [-1 if key is None else numbers[key] for key in keys]
        return self._rows[symbol, audible]

    def _plant(self, trees: dict[TreeKey, Tree]) -> None:
        """Take trees, and make ready what answers fast."""
        #: The trees, by phone and parameter.
        self.trees_ = trees
        self._chains: dict[str, list[tuple[str, bool]]] = {}
        self._rows: dict[tuple[str, bool], list[int]] = {}
        self._forest = Forest(
            list(trees.values()), self._of_attribute, self._are_phones, self._reader.alphabet.levels
        )

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        starts, ends = phones.starts, phones.ends
        centres = 0.5 * (starts + ends)
        held = None
        if self.closures_:
            is_stop = [
                "bilabial_stop" in self.phone_set_.get_classes(segment) for segment in phones
            ]
            half = np.where(is_stop, 0.5 * self.hold * (ends - starts), np.nan)
            # Not quite to the ends, where two stops that meet would have one knot.
            half = np.minimum(half, 0.499 * (ends - starts))
            half = np.maximum(half, 1e-3 * (ends - starts))
            held = np.stack([centres - half, centres + half], axis=1)
        return curve(
            centres,
            self.targets(phones),
            times,
            interpolation=self.interpolation,
            smoothing=self.smoothing,
            closures=self.closures_,
            held=held,
        )

    @property
    def parameter_count(self) -> int:
        """How many values the leaves of all trees hold."""
        return sum(tree.leaves for tree in self.trees_.values())

    @property
    def phones_ahead(self) -> int:
        """How many phones after a segment must be known for the curve up to its centre.

        `look_ahead` is infinite, as phones have no longest duration.
        """
        return self._reach_of(1) + (1 if self.interpolation == "cubic" else 0)

    def _reach_of(self, direction: int) -> int:
        """How many phones on the questions look, to the left (-1) or right (1)."""
        places = [1]
        for attribute in self._reader.attributes:
            if attribute.at * direction > 0:
                is_resistant = attribute.kind == "resistant"
                places.append(self.reach if is_resistant else abs(attribute.at))
        return max(places)

    def stream(self, rate: float | None = None) -> Stream:
        """Begin a live utterance; frames come when `phones_ahead` phones more are known."""
        self._check_fitted()
        return CentreStream(
            self.predict_at,
            self.rate_ if rate is None else rate,
            len(self.parameter_names_),
            self.phones_ahead,
            self._reach_of(-1) + 1,
            smoothing_reach(self.smoothing),
        )

    # -- keeping -------------------------------------------------------------------------------

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        values = {
            "questions": [question_row(question) for question in self.questions_],
            "alphabet": list(self._reader.alphabet.symbols),
            "by_phone_set": [bool(each) for each in self._by_phone_set],
            "trees": [list(key) for key in self.trees_],
            "closures": [[place, *closure] for place, closure in self.closures_.items()],
            "strength": None if math.isnan(self.strength_) else self.strength_,
        }
        arrays = packed(list(self.trees_.values()), self._reader.alphabet.levels)
        return values, {**arrays, "resistant": self._resists, "pruning_curve": self.pruning_curve_}

    def _restore(
        self, values: Mapping[str, Any], arrays: Mapping[str, np.ndarray[Any, Any]]
    ) -> None:
        alphabet = Alphabet(tuple(values["alphabet"]), self.phone_set_)
        questions = tuple(question_from_row(row) for row in values["questions"])
        resists, names = arrays["resistant"], self.parameter_names_
        if resists.shape != (alphabet.levels, len(names)):
            raise ValueError(f"resistance of {resists.shape} phones and parameters")
        self._prepare(questions, alphabet, resists, np.array(values["by_phone_set"], dtype=bool))
        self._text = self.questions
        trees = unpacked(arrays, alphabet.levels)
        if any(int(tree.questions.max()) >= len(questions) for tree in trees):
            raise ValueError("a tree asks a question that there is not")
        keys = [TreeKey(str(of), int(p), bool(a), bool(b)) for of, p, a, b in values["trees"]]
        self._plant(dict(zip(keys, trees, strict=True)))
        self.closures_ = {
            int(place): Closure(float(bound), int(opening))
            for place, bound, opening in values["closures"]
        }
        self.strength_ = math.nan if values["strength"] is None else float(values["strength"])
        self.pruning_curve_ = arrays["pruning_curve"]
        if self.pruning_curve_.shape[1:] != (2,) or np.isnan(self.pruning_curve_).any():
            raise ValueError(f"a pruning curve of {self.pruning_curve_.shape}")
