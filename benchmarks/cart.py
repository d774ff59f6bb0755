"""CART: training time and held-out error of our trees and scikit-learn's, in one run.

    python benchmarks/cart.py [--quick] [--json] [--data DIR] [--grid CORPUS]

Three corpora: `made`, random phones with ten parameters and all 76 symbols, as large as time
allows, for the training time of 760 trees; `simulated`, the sentences and gestures of
`mocap-fit simulate`, the truth with 0.01 of noise on it; and, in the full form, `grid_s1`, 287 real
sentences (markerless video, automatic labels), where it is.

Ours is `fit` of the model `cart` with its defaults on a corpus in memory, so its time holds taking
the targets, answering the questions, growing, validating and pruning. The peer is
`DecisionTreeRegressor` (5 examples a leaf), on the same targets and the same questions as columns:
classes as 0 and 1, numbers in the same bins, and phones, for which scikit-learn has no questions,
as the mean target of each phone in the training part (better and faster here than a column for each
phone). It is pruned as its manual has it, by cost and complexity with ten folds: one tree and its
path for all examples, one for each fold, and the error of each fold along the whole path. The walk
along the path is compiled, so that the peer's time is that of scikit-learn's own growing; putting
the questions into columns is not counted.

Errors are those of the targets of the held-out part, as a share of what is left when every phone
has its mean target; the interval of the difference is paired by utterance. Times are the thread's
own (one core), of ours the median of three. With --quick the peer gets some of the trees, and its
time is scaled to all of them.
"""

import os

# ruff: noqa: E402
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"  # before numpy is imported, or it does not count

import argparse
import json
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from sklearn.tree import DecisionTreeRegressor

from mocap_fit.control.cart import Cart
from mocap_fit.control.cart.contexts import look_up_resistance
from mocap_fit.control.cart.examples import TrainingSegments, collect, read_corpus
from mocap_fit.control.cart.learning import divide_into_bins
from mocap_fit.corpus import Corpus, Utterance, open_corpus
from mocap_fit.phones import (
    ARTICULATORY_PARAMETERS,
    PhoneSegment,
    PhoneSequence,
    load_phone_set,
)
from mocap_fit.tracks import FloatArray, ParameterTracks

SEED, RATE, NOISE = 1, 60.0, 0.01
PEER = "scikit-learn, 10-fold cost-complexity"
# Trainings of ours, of whose times the median counts.
ROUNDS = 3
# Utterances, and with --quick; every how many trees the peer gets one.
MADE, SIMULATED = (1000, 600), (287, 150)
PEER_EVERY = {"made": (4, 4), "simulated": (1, 4), "grid_s1": (1, 1)}

# What the defaults are compared with in the full form.
WAYS: dict[str, dict[str, Any]] = {
    "defaults": {},
    "every gain above 0, not pruned": {
        "min_impurity_decrease": 0.0,
        "pruning": "none",
        "phone_order": "node",
    },
    "as the paper has it": {"min_impurity_decrease": 0.0, "pruning": "each", "phone_order": "node"},
    "phones ordered in each node": {"phone_order": "node"},
    "each tree its own strength": {"pruning": "each"},
    "one standard error": {"one_standard_error": True},
    "phone means": {"min_samples_leaf": 10**9},
}


def made_corpus(utterances: int) -> Corpus:
    """Random phones whose targets are drawn towards their neighbours', the resistant ones less."""
    rng = np.random.default_rng(SEED)
    phone_set = load_phone_set("sv-sta")
    symbols = [s for s in phone_set.list_symbols() if not phone_set.is_silence(s)]
    vowels = [s for s in symbols if phone_set.is_vowel(s)]
    consonants = [s for s in symbols if phone_set.is_consonant(s)]
    often = {s: (4.0 + i) ** -0.5 for part in (vowels, consonants) for i, s in enumerate(part)}
    names = ARTICULATORY_PARAMETERS
    features = np.array([phone_set.get_features(s) for s in phone_set.list_symbols()])
    goals = features @ rng.normal(0, 0.25, (features.shape[1], len(names)))
    goals += rng.normal(0, 0.15, goals.shape)
    resists = np.array([look_up_resistance(phone_set, s, names) for s in phone_set.list_symbols()])
    strength = np.where(resists, 2.0, 0.5) * np.exp(rng.normal(0, 0.3, goals.shape))
    fading = np.exp(rng.normal(np.log(18.0), 0.3, goals.shape))
    place = {s: i for i, s in enumerate(phone_set.list_symbols())}
    found = []
    for number in range(utterances):
        said = [phone_set.silence]
        length = rng.integers(30, 60)
        while len(said) < length:
            row = vowels if phone_set.is_consonant(said[-1]) and rng.random() < 0.75 else consonants
            weights = np.array([often[s] for s in row])
            said.append(str(rng.choice(row, p=weights / weights.sum())))
        said.append(phone_set.silence)
        usual = [0.25 if phone_set.is_silence(s) else 0.08 for s in said]
        lengths = np.round(usual * np.exp(rng.normal(0, 0.3, len(said))), 3) + 0.02
        ends = np.cumsum(lengths)
        starts = np.concatenate([[0.0], ends[:-1]])
        segments = []
        for symbol, start, end in zip(said, starts, ends, strict=True):
            phone, stress = phone_set.parse(symbol)
            segments.append(PhoneSegment(float(start), float(end), phone, stress))
        centres = 0.5 * (starts + ends)
        at = np.array([place[s] for s in said])
        apart = np.abs(centres[:, None] - centres)[:, :, None]
        dominance = strength[at] * np.exp(-fading[at][:, None] * apart)
        targets = (dominance * goals[at]).sum(axis=1) / dominance.sum(axis=1)
        targets += rng.normal(0, 0.05, targets.shape)
        times = np.arange(int(ends[-1] * RATE)) / RATE
        values = np.stack([np.interp(times, centres, row) for row in targets.T], axis=1)
        name = f"m{number:04d}"
        phones = PhoneSequence(tuple(segments), phone_set=phone_set.name, name=name)
        found.append(Utterance.from_tracks(ParameterTracks(names, RATE, values, name=name), phones))
    return Corpus.from_utterances(found, phone_set)


def simulated_corpus(utterances: int) -> Corpus:
    """Simulate what `mocap-fit simulate` says and moves, without its markers."""
    from corpus_tools.simulation.articulation import Articulator
    from corpus_tools.simulation.durations import time_words
    from corpus_tools.simulation.sentences import load_language
    from mocap_fit.face import load_face

    language, face = load_language("sv"), load_face()
    rng = np.random.default_rng(SEED)
    articulator = Articulator(face, language.phone_set, rng)
    found = []
    for number, sentence in enumerate(language.draw_sentences(utterances, rng)):
        name = f"s{number:04d}"
        phones = time_words(sentence.words, language.phone_set, rng, name=name, start=0.2, end=0.2)
        times = np.arange(int(phones.duration * RATE)) / RATE
        values = articulator.say(phones, times, rng)
        values += rng.normal(0, NOISE, values.shape)
        split = "test" if number % 10 < 3 else "train"
        tracks = ParameterTracks(face.parameter_names, RATE, values, name=name)
        found.append(Utterance.from_tracks(tracks, phones, split=split))
    return Corpus.from_utterances(found, language.phone_set)


def real_corpus(data: Path, converted: Path | None) -> Corpus | None:
    """Convert the folder grid_s1 to a corpus; None where it is missing."""
    if converted is not None:
        return in_memory(open_corpus(converted))
    if not (data / "grid_s1").is_dir():
        return None
    from corpus_tools.conversion.convert import convert

    manifest = Path(__file__).parents[1] / "fixtures" / "manifests" / "grid_s1.toml"
    out = Path(tempfile.mkdtemp()) / "corpus"
    convert(manifest, root=data / "grid_s1", out=out)
    return in_memory(open_corpus(out))


def in_memory(corpus: Corpus) -> Corpus:
    """Copy a corpus, so that its files are not read again."""
    parts = [
        Utterance.from_tracks(u.read_tracks(), u.read_phones(), id=u.id, split=u.split)
        for u in corpus
    ]
    return Corpus.from_utterances(parts, corpus.phone_set)


class Task(NamedTuple):
    """What a tree of the peer is trained on and asked."""

    parameter: int
    questions: FloatArray
    targets: FloatArray
    asked: FloatArray
    truth: FloatArray
    rows: NDArray[np.int64]


def segments_of(
    corpus: Corpus, model: Cart
) -> tuple[TrainingSegments, NDArray[np.int64], FloatArray]:
    """Collect all segments of a corpus, the utterance of each, and the targets of a model."""
    phones, found = read_corpus(corpus)
    owner = np.repeat(np.arange(len(phones)), [len(sequence) for sequence in phones])
    selected = np.concatenate([model.select_targets(sequence) for sequence in phones])
    return collect(phones, found, model._reader, model.by_stress), owner, selected


def named(train: TrainingSegments, test: TrainingSegments) -> list[tuple[str, int]]:
    """Phones and parameters that have targets in both parts, those with few examples first."""
    found = []
    for symbol in np.unique(train.symbols):
        counts = [
            np.isfinite(part.targets[part.symbols == symbol]).sum(axis=0) for part in (train, test)
        ]
        for p in np.flatnonzero((counts[0] > 0) & (counts[1] > 0)).tolist():
            found.append((int(counts[0][p]), str(symbol), p))
    return [(symbol, p) for _, symbol, p in sorted(found)]


def task(model: Cart, train: TrainingSegments, test: TrainingSegments, symbol: str, p: int) -> Task:
    """Collect the targets and questions of a phone and a parameter, as columns."""
    rows, new = (
        np.flatnonzero((part.symbols == symbol) & np.isfinite(part.targets[:, p]))
        for part in (train, test)
    )
    has_sound = 2 * np.isfinite(train.energies[rows]).sum() >= len(rows)
    targets = train.targets[rows, p]
    columns = []
    for question, a in zip(model.questions_, model._attributes, strict=True):
        if question.attribute.needs_sound and not has_sound:
            continue
        mine, theirs = (
            part.columns[a][own] if part.columns[a].ndim == 1 else part.columns[a][own, p]
            for part, own in ((train, rows), (test, new))
        )
        if not question.is_open:
            members = model.alphabet.mark_members(question.phone_class, question.phones)
            columns.append((members[mine], members[theirs]))
        elif question.attribute.is_phone:
            counts = np.bincount(mine, minlength=model.alphabet.levels)
            means = np.bincount(mine, targets, len(counts)) / np.maximum(counts, 1)
            means = np.where(counts > 0, means, targets.mean())
            columns.append((means[mine], means[theirs]))
        else:
            levels, edges = divide_into_bins(mine)
            others = np.searchsorted(edges, theirs, side="left")
            columns.append((levels, np.where(np.isfinite(theirs), others, len(edges) + 1)))
    before, after = (np.stack(part, axis=1) for part in zip(*columns, strict=True))
    before, after = before.astype(np.float32), after.astype(np.float32)
    return Task(p, before, targets, after, test.targets[new, p], new)


@numba.njit(error_model="numpy")
def path_alphas(left, right, cost):
    """Of each node the alpha at which the path of least cost and complexity cuts it off."""
    count = len(left)
    parent, standing = np.full(count, -1), np.zeros(count, np.bool_)
    below, leaves = cost.copy(), np.ones(count)
    for node in range(count):
        if left[node] >= 0:
            parent[left[node]], parent[right[node]] = node, node
            standing[node], below[node], leaves[node] = True, 0.0, 0.0
    for node in range(count - 1, 0, -1):
        below[parent[node]] += below[node]
        leaves[parent[node]] += leaves[node]
    alphas, reached, waiting = np.full(count, -1.0), 0.0, np.empty(count, np.int64)
    while standing[0]:
        weakest, least = -1, np.inf
        for node in range(count):
            if standing[node]:
                alpha = (cost[node] - below[node]) / (leaves[node] - 1.0)
                if weakest < 0 or alpha < least:
                    weakest, least = node, alpha
        reached = max(reached, least)
        waiting[0], size = weakest, 1
        while size > 0:
            size -= 1
            node = waiting[size]
            if standing[node]:
                standing[node], alphas[node] = False, reached
                waiting[size], waiting[size + 1] = left[node], right[node]
                size += 2
        more, fewer, node = cost[weakest] - below[weakest], leaves[weakest] - 1.0, weakest
        while node >= 0:
            below[node] += more
            leaves[node] -= fewer
            node = parent[node]
    return alphas


@numba.njit(error_model="numpy")
def answers(left, right, feature, threshold, value, alphas, asked, chosen):
    """Answers of the trees of the path, `(alphas, asked)`; the alphas that are chosen ascend."""
    found = np.empty((len(chosen), len(asked)))
    for i in range(len(asked)):
        node, place = 0, len(chosen) - 1
        while place >= 0:
            while place >= 0 and (left[node] < 0 or alphas[node] <= chosen[place]):
                found[place, i] = value[node]
                place -= 1
            if place >= 0:
                goes = asked[i, feature[node]] <= threshold[node]
                node = left[node] if goes else right[node]
    return found


class PeerTree:
    """A tree of scikit-learn and its path."""

    def __init__(self, questions: FloatArray, targets: FloatArray) -> None:
        grown = DecisionTreeRegressor(min_samples_leaf=5, random_state=0)
        tree = grown.fit(questions, targets).tree_
        share = tree.weighted_n_node_samples / tree.weighted_n_node_samples[0]
        self._tree = (tree.children_left, tree.children_right)
        self._asks = (tree.feature, tree.threshold, tree.value[:, 0, 0])
        self.alphas = path_alphas(*self._tree, tree.impurity * share)

    def answers(self, asked: FloatArray, chosen: FloatArray) -> FloatArray:
        """Of the trees of the path at these alphas, `(alphas, asked)`."""
        return answers(*self._tree, *self._asks, self.alphas, asked, chosen)


def peer(task: Task) -> tuple[PeerTree, float]:
    """Grow a tree, and find the alpha of the least error over ten folds."""
    count = len(task.targets)
    whole = PeerTree(task.questions, task.targets)
    own = np.unique(whole.alphas[whole.alphas >= 0])
    if not len(own):
        return whole, 0.0
    chosen = np.concatenate([[0.0], np.sqrt(own[:-1] * own[1:]), own[-1:] * (1 + 1e-9)])
    errors = np.zeros(len(chosen))
    fold = np.random.default_rng(SEED).permutation(np.arange(count) % 10)
    for part in range(min(10, count)):
        out = fold == part
        tree = PeerTree(task.questions[~out], task.targets[~out])
        found = tree.answers(task.questions[out], chosen)
        errors += ((found - task.targets[out]) ** 2).sum(axis=1)
    return whole, float(chosen[errors.argmin()])


def compared(name: str, train: Corpus, test: Corpus, quick: bool) -> dict[str, Any]:
    """Ours and the peer on one corpus."""
    ours = []
    for _ in range(ROUNDS):
        began = time.thread_time()
        model = Cart().fit(train)
        ours.append(time.thread_time() - began)
    mine, _, _ = segments_of(train, model)
    new, owner, selected = segments_of(test, model)
    every = PEER_EVERY[name][quick]
    todo = named(mine, new)
    # Evenly over phones with many examples and with few.
    taken = [task(model, mine, new, *each) for each in todo[every // 2 :: every]]
    peer(taken[0])
    theirs = 0.0
    utterances = len(test)
    of_ours, of_peer, of_mean = (np.zeros(utterances) for _ in range(3))
    for each in taken:
        began = time.thread_time()
        tree, alpha = peer(each)
        theirs += time.thread_time() - began
        answer = tree.answers(each.asked, np.array([alpha]))[0]
        whose = owner[each.rows]
        of_peer += np.bincount(whose, (answer - each.truth) ** 2, utterances)
        said = selected[each.rows, each.parameter]
        of_ours += np.bincount(whose, (said - each.truth) ** 2, utterances)
        of_mean += np.bincount(whose, (each.targets.mean() - each.truth) ** 2, utterances)
    theirs *= len(todo) / len(taken)
    difference = (of_ours - of_peer) * utterances / of_mean.sum()
    half = 1.96 * difference.std(ddof=1) / np.sqrt(utterances)
    return {
        "corpus": name,
        "trees": len(todo),
        "trees_of_peer": len(taken),
        "examples": int(np.isfinite(mine.targets).sum()),
        "seconds": statistics.median(ours),
        "seconds_of_peer": theirs,
        "times_faster": theirs / statistics.median(ours),
        "error": of_ours.sum() / of_mean.sum(),
        "error_of_peer": of_peer.sum() / of_mean.sum(),
        "ratio_of_errors": of_ours.sum() / of_peer.sum(),
        "difference": difference.mean(),
        "interval": [difference.mean() - half, difference.mean() + half],
        "no_worse": bool(difference.mean() - half <= 0),
        "leaves": model.parameter_count / len(model.trees_),
        "ccp_alpha": model.ccp_alpha_,
    }


def ways(train: Corpus, test: Corpus) -> list[dict[str, Any]]:
    """Held-out error and size of trees of each of `WAYS`."""
    found = []
    for name, settings in WAYS.items():
        began = time.thread_time()
        model = Cart(**settings).fit(train)
        seconds = time.thread_time() - began
        new, _, selected = segments_of(test, model)
        error = float(np.nansum((selected - new.targets) ** 2))
        leaves = model.parameter_count / len(model.trees_)
        found.append({"way": name, "error": error, "leaves": leaves, "seconds": seconds})
    for row in found:
        row["error"] /= found[-1]["error"] if row is not found[-1] else 1.0
    found[-1]["error"] = 1.0
    return found


def run(quick: bool, data: Path, converted: Path | None) -> dict[str, Any]:
    """All that is measured."""
    corpora: list[tuple[str, Corpus, Corpus]] = []
    made = made_corpus(MADE[quick])
    corpora.append(("made", *made.hold_out(0.2, SEED)))
    simulated = simulated_corpus(SIMULATED[quick])
    corpora.append(("simulated", simulated.get_split("train"), simulated.get_split("test")))
    real = None if quick else real_corpus(data, converted)
    if real is not None:
        corpora.append(("grid_s1", real.get_split("train"), real.get_split("test")))
    began = time.perf_counter()
    Cart().fit(simulated.select([u.id for u in simulated][:5]))
    found: dict[str, Any] = {
        "peer": PEER,
        "first_use_seconds": time.perf_counter() - began,
        "corpora": [],
    }
    for name, train, test in corpora:
        found["corpora"].append(compared(name, train, test, quick))
    if not quick:
        found["ways"] = {name: ways(train, test) for name, train, test in corpora}
    return found


def show(found: dict[str, Any]) -> None:
    """Tables for people."""
    print(
        f"peer: {found['peer']}; first use, compiling included: "
        f"{found['first_use_seconds']:.1f} s\n"
    )
    head = ("corpus", "trees", "targets", "ours s", "peer s", "faster", "error", "peer's", "ratio")
    print(("{:10}" + "{:>9}" * 8).format(*head) + "   difference (95 %)")
    for row in found["corpora"]:
        low, high = row["interval"]
        print(
            f"{row['corpus']:10}{row['trees']:9}{row['examples']:9}{row['seconds']:9.2f}"
            f"{row['seconds_of_peer']:9.1f}{row['times_faster']:8.1f}x{row['error']:9.4f}"
            f"{row['error_of_peer']:9.4f}{row['ratio_of_errors']:9.3f}"
            f"   {row['difference']:+.4f} ({low:+.4f} to {high:+.4f})"
        )
    for name, rows in found.get("ways", {}).items():
        print(f"\n{name}: the ways of growing and pruning")
        for row in rows:
            print(
                f"  {row['way']:34}{row['error']:8.4f}{row['leaves']:8.1f} leaves"
                f"{row['seconds']:8.2f} s"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    place = os.environ.get("MOCAP_FIT_DATA", Path(__file__).parents[1] / "../shared/data")
    parser.add_argument("--data", type=Path, default=Path(place))
    parser.add_argument("--grid", type=Path, help="grid_s1, converted already")
    given = parser.parse_args()
    result = run(given.quick, given.data, given.grid)
    if given.json:
        print(json.dumps(result, indent=2))
    else:
        show(result)
