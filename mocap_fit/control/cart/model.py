"""CART: articulatory targets selected by regression trees (Krňoul & Železný section 5.1).

For each phone and each face parameter a tree predicts the target from the phone's context: the
phones beside it, how long the segments are, how loud it is. The targets are at the centres of the
segments, and a curve goes through them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveInt

from mocap_fit.control.base import Arrays, ControlModel, LogEntry, Progress
from mocap_fit.control.cart.arrays import UNLIMITED, Rules
from mocap_fit.control.cart.closures import Closure, check_closures, learn_closures
from mocap_fit.control.cart.contexts import Alphabet, ContextReader, read_energies
from mocap_fit.control.cart.curves import interpolate
from mocap_fit.control.cart.examples import (
    TrainingSegments,
    collect,
    find_resistant,
    make_alphabet,
    read_corpus,
)
from mocap_fit.control.cart.learning import Grower, Growth, grow_forest, list_alternatives
from mocap_fit.control.cart.questions import (
    Question,
    list_standard_questions,
    normalise_questions,
    order_questions,
    read_questions,
)
from mocap_fit.control.cart.stream import CentreStream
from mocap_fit.control.cart.tree import Forest, Selection, Tree, TreeKey, pack_trees, unpack_trees
from mocap_fit.control.streaming import Stream
from mocap_fit.corpus import Corpus
from mocap_fit.errors import DataError
from mocap_fit.phones import ARTICULATORY_PARAMETERS, PhoneSequence
from mocap_fit.settings_file import read_settings_text
from mocap_fit.tracks import FloatArray


@dataclass(eq=False, repr=False)
class Cart(ControlModel):
    """Selection of articulatory targets by regression trees (Krňoul & Železný section 5.1).

    With ``min_impurity_decrease=0``, ``phone_order="node"`` and ``pruning="each"`` trees are grown
    and pruned as in the paper; with ``pruning="none"`` every cut remains that gains anything. The
    defaults are the best on held-out folds of training parts. Squared errors of the targets
    (`benchmarks/cart.py`): on folds of the training part, in variances of the parameter, and on the
    test part, as a share of the error when every phone has its mean target:

    =====================================  =======  =======  =========  =========
    way                                    grid_s1  grid_s1  simulated  simulated
                                           folds    test     folds      test
    =====================================  =======  =======  =========  =========
    every cut with a gain, not pruned      0.756    1.02     0.348      0.385
    as in the paper                                 0.740               0.329
    defaults, phones ordered in each node  0.585    0.728    0.276      0.323
    defaults                               0.585    0.728    0.277      0.324
    =====================================  =======  =======  =========  =========

    On random phones, whose targets are drawn from both sides alike, the order of the tree is
    9 % better than that of each node (0.549 and 0.603 of a test part).

    Parameters
    ----------
    min_samples_split
        A node with fewer examples is a leaf; the paper's N_min is one less.
    min_samples_leaf
        Each side of a cut has at least so many examples.
    max_depth
        The largest number of questions from the root to a leaf; None for any.
    cv
        Number of folds that the examples of a tree are divided into at random, once a tree (eq. 9).
    min_impurity_decrease
        A cut lowers the cross-validated error by more than so many variances of its node, no unit.
        0 is the paper's rule. The best of all cuts does so by chance alone: where targets were
        shuffled, at the root by 11 to 37 variances (20 in the middle), as its group of phones is
        the best of very many. What pruning leaves gains 7 to 12 and more; growing far beyond that
        only costs time.
    pruning
        How strongly to prune (eq. 12). ``together``: one alpha for all trees, the best on held-out
        folds of all. ``each``: an alpha for every tree from its ten folds, which a few hundred
        examples tell badly. ``none``: not at all.
    one_standard_error
        Whether to prune as strongly as is possible within one standard error of the best.
    phone_order
        Groups of phones are cut from an order of phones by mean target: in the whole ``tree``, or
        in each ``node`` anew. The latter is the best order for the examples of a node, but these
        are few for each phone, and it follows their noise.
    by_stress
        Whether a vowel has a tree with stress and one without.
    questions
        A table of questions beside those of the paper (`mocap_fit.control.cart.questions` says
        how), as TOML text, or the path of such a file.
    resistance
        Which phones resist coarticulation: those of the ``phone-set``, or ``learned`` from the
        corpus: phones whose targets vary little. Of a parameter that is not one of the ten it is
        always learned.
    reach
        How many phones away the nearest resistant phone may be.
    interpolation
        ``cubic`` (monotone), ``linear`` or ``cosine``.
    smoothing
        Standard deviation of the Gaussian that curves are smoothed with, seconds; 0 for none.
    closures
        Guarantees for bilabial stops: by parameter the value that it is not more open than, or
        ``learned``: the median of the corpus's bilabial stops.
    hold
        The part of a bilabial stop, about its centre, for which the guarantee holds, 0 to 1.
    random_state
        Seed of the folds.
    """

    name: ClassVar[str] = "cart"
    title: ClassVar[str] = "CART"

    min_samples_split: Annotated[int, Field(ge=2)] = 6
    min_samples_leaf: PositiveInt = 1
    max_depth: PositiveInt | None = None
    cv: Annotated[int, Field(ge=2, le=100)] = 10
    min_impurity_decrease: NonNegativeFloat = 6.0
    pruning: Literal["together", "each", "none"] = "together"
    one_standard_error: bool = False
    phone_order: Literal["tree", "node"] = "tree"
    by_stress: bool = True
    questions: str = ""
    resistance: Literal["phone-set", "learned"] = "phone-set"
    reach: Annotated[int, Field(ge=1, le=20)] = 4
    interpolation: Literal["cubic", "linear", "cosine"] = "cubic"
    smoothing: Annotated[float, Field(ge=0, le=1)] = 0.0
    closures: Mapping[str, Any] = field(default_factory=dict)
    hold: Annotated[float, Field(ge=0, le=1)] = 0.5
    random_state: NonNegativeInt = 0

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
            "questions": self._read_table()[0],
            "closures": dict(self.closures),
        }

    def _read_table(self) -> tuple[str, str | None]:
        """Read the text of the user's questions, and the path of its file."""
        if not self.questions or "\n" in self.questions or "[" in self.questions:
            return self.questions, None
        if self.is_fitted and hasattr(self, "_text"):
            return self._text, self.questions
        return read_settings_text(self.questions, "table of questions"), self.questions

    # -- learning ------------------------------------------------------------------------------

    def _fit(
        self, corpus: Corpus, validation: Corpus | None, progress: Progress, checkpoint: Path | None
    ) -> None:
        check_closures(self.closures, self.parameter_names_)
        text, path = self._read_table()
        self._text = text
        added = normalise_questions(read_questions(text, path), self.phone_set_)
        questions = order_questions((*list_standard_questions(), *added))
        phones, targets = read_corpus(corpus)
        if not phones:
            raise DataError("the utterances of the corpus have no phones")
        alphabet = make_alphabet(phones, self.phone_set_)
        by_phone_set = np.array(
            [
                self.resistance == "phone-set" and name in ARTICULATORY_PARAMETERS
                for name in self.parameter_names_
            ]
        )
        resistant = find_resistant(alphabet, self.parameter_names_, by_phone_set, phones, targets)
        self._prepare(questions, alphabet, resistant, by_phone_set)
        examples = collect(phones, targets, self._reader, self.by_stress)
        rules = Rules(
            self.cv,
            self.min_samples_split,
            self.min_samples_leaf,
            UNLIMITED if self.max_depth is None else self.max_depth,
            float(self.min_impurity_decrease),
            self.phone_order == "node",
        )
        growth = Growth(rules, self.pruning, self.one_standard_error, self.random_state)
        grower = Grower(examples, questions, self._reader.attributes, alphabet, growth)
        trees, curve = grow_forest(grower, self.by_stress)
        self._plant(trees)
        #: Alphas and the held-out squared error at each, in variances of the parameter and per
        #: target, ``(alphas, 2)``; empty where they are not the same for all trees.
        self.pruning_curve_: FloatArray = np.zeros((0, 2))
        if curve is not None and curve.count:
            self.pruning_curve_ = np.stack([curve.alphas, curve.errors / curve.count], axis=1)
        #: Strength of the pruning of all trees, in variances; NaN where it is not the same.
        self.ccp_alpha_ = math.nan
        if curve is not None:
            self.ccp_alpha_ = curve.select_alpha(self.one_standard_error)
        self.closures_: dict[int, Closure] = learn_closures(
            self.closures,
            self.parameter_names_,
            examples.symbols,
            examples.targets,
            self.phone_set_,
        )
        self._log_errors(examples, validation, progress)

    def _prepare(
        self,
        questions: tuple[Question, ...],
        alphabet: Alphabet,
        resistant: NDArray[np.bool_],
        by_phone_set: NDArray[np.bool_],
    ) -> None:
        """Set what reads the attributes of segments."""
        #: All questions, in the order in which they are tried.
        self.questions_ = questions
        attributes = tuple(dict.fromkeys(question.attribute for question in questions))
        self._attributes = [attributes.index(question.attribute) for question in questions]
        self._are_phones = [attribute.is_phone for attribute in attributes]
        self._reader = ContextReader(
            attributes, alphabet, resistant, self.parameter_names_, by_phone_set, self.reach
        )

    def _log_errors(
        self, examples: TrainingSegments, validation: Corpus | None, progress: Progress
    ) -> None:
        """Log two errors: with every phone's mean as its target, and of the trees."""
        trees = [tree for key, tree in self.trees_.items() if not (key.pooled or key.with_sound)]
        count = max(sum(int(tree.counts[0]) for tree in trees), 1)
        roots = sum(float(tree.errors[0]) for tree in trees)
        leaves = sum(float(tree.errors[tree.questions < 0].sum()) for tree in trees)
        roots_after, leaves_after = self._validate(validation)
        progress(LogEntry(0, math.sqrt(roots / count), roots_after, "targets"))
        progress(LogEntry(1, math.sqrt(leaves / count), leaves_after, "targets"))

    def _validate(self, validation: Corpus | None) -> tuple[float | None, float | None]:
        """Compute root mean square errors of targets, by the roots and by the leaves."""
        if validation is None:
            return None, None
        off: list[tuple[float, float]] = []
        for phones, targets in zip(*read_corpus(validation), strict=True):
            for each in self.trace_targets(phones):
                target = targets[each.segment, each.parameter]
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

    def get_attribute(self, question: int) -> int:
        """Return the index of the attribute that a question is about.

        Parameters
        ----------
        question
            Index of one of `questions_`.

        Returns
        -------
        int
            Index of a value of `Selection.values`.
        """
        return self._attributes[question]

    # -- predicting ----------------------------------------------------------------------------

    def trace_targets(self, phones: PhoneSequence) -> Iterator[Selection]:
        """Trace how every target of an utterance is selected, segment by segment.

        Parameters
        ----------
        phones
            The utterance, in the model's phone set.

        Yields
        ------
        Selection
            One for each segment and parameter.
        """
        columns = self._reader.read_columns(phones)
        audible = np.isfinite(read_energies(phones))
        for i, segment in enumerate(phones):
            symbol = self.phone_set_.get_symbol(segment, self.by_stress)
            for p in range(len(self.parameter_names_)):
                key = self._find_key(symbol, p, bool(audible[i]))
                values = [
                    float(column[i] if column.ndim == 1 else column[i, p]) for column in columns
                ]
                path: list[int] = []
                if key is not None:
                    path = self.trees_[key].find_path(self._attributes, self._are_phones, values)
                yield Selection(i, p, key, tuple(path), values)

    def _find_key(self, symbol: str, parameter: int, audible: bool) -> TreeKey | None:
        """Find the tree of a phone and a parameter, or the one to back off to."""
        if symbol not in self._alternatives:
            names = list_alternatives(self.phone_set_, symbol, self.by_stress)
            self._alternatives[symbol] = names
        for of, pooled in self._alternatives[symbol]:
            key = TreeKey(of, parameter, pooled, True)
            if audible and key in self.trees_:
                return key
            key = key._replace(with_sound=False)
            if key in self.trees_:
                return key
        return None

    def select_targets(self, phones: PhoneSequence) -> FloatArray:
        """Select the targets of an utterance.

        Parameters
        ----------
        phones
            The utterance, in the model's phone set.

        Returns
        -------
        ndarray
            ``(segments, parameters)``, in the unit of each parameter. A phone for which no tree
            can be found is at rest, 0.
        """
        audible = np.isfinite(read_energies(phones))
        symbols = [self.phone_set_.get_symbol(segment, self.by_stress) for segment in phones]
        rows = [
            self._find_trees(symbol, has_sound)
            for symbol, has_sound in zip(symbols, audible.tolist(), strict=True)
        ]
        columns = self._reader.read_columns(phones)
        values = np.empty((len(phones), len(columns), len(self.parameter_names_)))
        for a, column in enumerate(columns):
            values[:, a] = column if column.ndim == 2 else column[:, None]
        return self._forest.predict(np.array(rows, dtype=np.int64), values)

    def _find_trees(self, symbol: str, audible: bool) -> list[int]:
        """Find the tree of each parameter of a phone; -1 for none."""
        if (symbol, audible) not in self._rows:
            keys = [self._find_key(symbol, p, audible) for p in range(len(self.parameter_names_))]
            numbers = {key: number for number, key in enumerate(self.trees_)}
            self._rows[symbol, audible] = [-1 if key is None else numbers[key] for key in keys]
        return self._rows[symbol, audible]

    def _plant(self, trees: dict[TreeKey, Tree]) -> None:
        """Set the trees, and what predicts with all of them."""
        #: The trees, by phone and parameter.
        self.trees_ = trees
        self._alternatives: dict[str, list[tuple[str, bool]]] = {}
        self._rows: dict[tuple[str, bool], list[int]] = {}
        self._forest = Forest(
            list(trees.values()), self._attributes, self._are_phones, self.alphabet.levels
        )

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        starts, ends = phones.starts, phones.ends
        centres = 0.5 * (starts + ends)
        held = None
        if self.closures_:
            classes = [self.phone_set_.get_classes(segment) for segment in phones]
            is_stop = ["bilabial_stop" in each for each in classes]
            half = np.where(is_stop, 0.5 * self.hold * (ends - starts), np.nan)
            # Not quite to the ends, where two adjacent stops would have one knot.
            half = np.minimum(half, 0.499 * (ends - starts))
            half = np.maximum(half, 1e-3 * (ends - starts))
            held = np.stack([centres - half, centres + half], axis=1)
        return interpolate(
            centres,
            self.select_targets(phones),
            times,
            interpolation=self.interpolation,
            smoothing=self.smoothing,
            closures=self.closures_,
            held=held,
        )

    @property
    def parameter_count(self) -> int:
        """Number of leaves of all trees."""
        return sum(tree.leaves for tree in self.trees_.values())

    @property
    def phones_ahead(self) -> int:
        """Number of phones after a segment that the curve up to its centre depends on.

        `look_ahead` is infinite, as phones have no longest duration.
        """
        return self._count_neighbours(1) + (1 if self.interpolation == "cubic" else 0)

    def _count_neighbours(self, direction: int) -> int:
        """Count how many phones away questions look, to the left (-1) or right (1)."""
        distances = [1]
        for attribute in self._reader.attributes:
            if attribute.at * direction > 0:
                is_resistant = attribute.kind == "resistant"
                distances.append(self.reach if is_resistant else abs(attribute.at))
        return max(distances)

    def stream(self, rate: float | None = None) -> Stream:
        """Begin a live utterance; frames come when `phones_ahead` phones more are known.

        Parameters
        ----------
        rate
            Frames per second, hertz; by default those of the training corpus.

        Returns
        -------
        Stream
            Phones are pushed, frames pulled.
        """
        self._check_fitted()
        behind = self._count_neighbours(-1) + 1
        return CentreStream(self, self.rate_ if rate is None else rate, behind)

    # -- saving --------------------------------------------------------------------------------

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        reader = self._reader
        values = {
            "questions": [question.to_dict() for question in self.questions_],
            "alphabet": list(self.alphabet.symbols),
            "by_phone_set": [bool(each) for each in reader.by_phone_set],
            "trees": [list(key) for key in self.trees_],
            "closures": [[p, *closure] for p, closure in self.closures_.items()],
            "ccp_alpha": None if math.isnan(self.ccp_alpha_) else self.ccp_alpha_,
        }
        arrays = pack_trees(list(self.trees_.values()), self.alphabet.levels)
        learned = {"resistant": reader.resistant, "pruning_curve": self.pruning_curve_}
        return values, {**arrays, **learned}

    def _restore(self, values: Mapping[str, Any], arrays: Arrays) -> None:
        alphabet = Alphabet(tuple(values["alphabet"]), self.phone_set_)
        questions = tuple(Question.from_dict(row) for row in values["questions"])
        resistant, names = arrays["resistant"], self.parameter_names_
        if resistant.shape != (alphabet.levels, len(names)):
            raise ValueError(f"resistance of {resistant.shape} phones and parameters")
        self._prepare(questions, alphabet, resistant, np.array(values["by_phone_set"], dtype=bool))
        self._text = self.questions
        trees = unpack_trees(arrays, alphabet.levels)
        if any(int(tree.questions.max()) >= len(questions) for tree in trees):
            raise ValueError("a tree has a question that is not in the list")
        keys = [TreeKey(str(of), int(p), bool(a), bool(b)) for of, p, a, b in values["trees"]]
        self._plant(dict(zip(keys, trees, strict=True)))
        self.closures_ = {
            int(p): Closure(float(bound), int(opening)) for p, bound, opening in values["closures"]
        }
        self.ccp_alpha_ = math.nan if values["ccp_alpha"] is None else float(values["ccp_alpha"])
        self.pruning_curve_ = arrays["pruning_curve"]
        if self.pruning_curve_.shape[1:] != (2,) or np.isnan(self.pruning_curve_).any():
            raise ValueError(f"a pruning curve of {self.pruning_curve_.shape}")
