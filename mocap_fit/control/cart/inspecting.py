"""The questions of trees and the reasons of targets in words, for people who look at a model."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from mocap_fit.control.cart.contexts import KIND_OF_GROUP
from mocap_fit.control.cart.kernel import LEFT
from mocap_fit.control.cart.learning import list_alternatives
from mocap_fit.control.cart.model import Cart
from mocap_fit.control.cart.tree import TreeKey
from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSequence

# Phones that are listed before "and so many more".
_LISTED = 12
_UNITS = {"duration": " s", "energy": " dB"}


@dataclass(frozen=True)
class Answer:
    """The answer to a question on the way to a target.

    Parameters
    ----------
    question
        The question.
    value
        What the segment has: a phone or a number.
    branch
        The branch that was taken, in words.
    seen
        False where no training example of the node had it, and it went with its group or with
        most examples.
    count
        Number of examples on that branch.
    mean
        Mean of their targets, in the unit of the parameter.
    """

    question: str
    value: str
    branch: str
    seen: bool
    count: int
    mean: float


@dataclass(frozen=True)
class Reason:
    """The reason of a target.

    Parameters
    ----------
    segment
        Index of the segment in the utterance.
    phone
        Its phone.
    centre
        Time of the target, seconds.
    parameter
        Name of the face parameter.
    target
        The target that was selected, in the unit of the parameter.
    tree
        Whose tree it was, such as the phone, or ``vowel`` where the phone has no example; empty
        where there was none, and the target is rest.
    backed_off
        Whether it was not the tree of the phone.
    start
        Mean at the root, before any question, in the unit of the parameter.
    answers
        The answers from the root to the leaf.
    """

    segment: int
    phone: str
    centre: float
    parameter: str
    target: float
    tree: str
    backed_off: bool
    start: float
    answers: tuple[Answer, ...]

    def __str__(self) -> str:
        head = f"{self.phone} at {self.centre:.3f} s, {self.parameter}: {self.target:.3f}"
        if not self.tree:
            return f"{head} (no examples: rest)"
        other = f"no tree of its own: that of {self.tree}; " if self.backed_off else ""
        lines = [f"{head} ({other}{self.start:.3f} before any question)"]
        for answer in self.answers:
            new = "" if answer.seen else ", never seen here"
            lines.append(
                f"  {answer.question}: {answer.value}{new} -> {answer.branch}"
                f" ({answer.count} examples, mean {answer.mean:.3f})"
            )
        return "\n".join(lines)


def explain_targets(
    model: Cart, phones: PhoneSequence, *, segment: int | None = None, parameter: str | None = None
) -> tuple[Reason, ...]:
    """Explain the targets of an utterance.

    Parameters
    ----------
    model
        A trained model.
    phones
        The utterance.
    segment
        Index of the only segment to explain; by default all.
    parameter
        The only parameter to explain; by default all.

    Returns
    -------
    tuple[Reason, ...]
        One for each segment and parameter.

    Raises
    ------
    DataError
        If there is no such segment or parameter.
    """
    if segment is not None and not 0 <= segment < len(phones):
        raise DataError(
            "there is no such segment", found=segment, expected=f"0 to {len(phones) - 1}"
        )
    if parameter is not None and parameter not in model.parameter_names_:
        raise DataError(
            f"there is no parameter '{parameter}'",
            expected=f"one of {', '.join(model.parameter_names_)}",
        )
    reasons = []
    for selected in model.trace_targets(phones):
        name = model.parameter_names_[selected.parameter]
        if segment not in (None, selected.segment) or parameter not in (None, name):
            continue
        phone, key, path = phones[selected.segment], selected.key, selected.path
        symbol = model.phone_set_.get_symbol(phone, model.by_stress)
        head = (selected.segment, symbol, phone.centre, name)
        if key is None:
            reasons.append(Reason(*head, 0.0, "", True, 0.0, ()))
            continue
        tree = model.trees_[key]
        answers = [
            _answer(model, key, selected.values, node, after)
            for node, after in itertools.pairwise(path)
        ]
        reasons.append(
            Reason(
                *head,
                float(tree.means[path[-1]]),
                key.of,
                key.of != symbol or key.pooled,
                float(tree.means[0]),
                tuple(answers),
            )
        )
    return tuple(reasons)


def _answer(model: Cart, key: TreeKey, values: list[float], node: int, after: int) -> Answer:
    """Describe the step from a node to the one after it."""
    tree = model.trees_[key]
    question = model.questions_[tree.questions[node]]
    value = values[model.get_attribute(int(tree.questions[node]))]
    left, right = describe_branches(model, key, node)
    if question.attribute.is_phone:
        text, seen = model.alphabet.list_names()[int(value)], bool(tree.seen[node, int(value)])
    else:
        unit = _UNITS.get(question.attribute.kind, "")
        seen = not np.isnan(value)
        text = f"{value:.3g}{unit}" if seen else "unknown"
    branch = left if after == tree.children[node, LEFT] else right
    count, mean = int(tree.counts[after]), float(tree.means[after])
    return Answer(question.name, text, branch, seen, count, mean)


def compute_importances(model: Cart) -> dict[str, dict[str, float]]:
    """Compute how much each question matters for each parameter.

    Parameters
    ----------
    model
        A trained model.

    Returns
    -------
    dict[str, dict[str, float]]
        By parameter, by question: its share of the decrease of the cross-validated error by all
        cuts (eq. 10), over the trees of all phones, 0 to 1, the greatest first. Trees of many
        phones do not count, and of two trees of one phone the one with sound does.
    """
    importances: dict[str, dict[str, float]] = {}
    for p, name in enumerate(model.parameter_names_):
        shares = dict.fromkeys(dict.fromkeys(q.name for q in model.questions_), 0.0)
        for key, tree in model.trees_.items():
            if key.parameter != p or key.pooled:
                continue
            if not key.with_sound and key._replace(with_sound=True) in model.trees_:
                continue
            for node in np.flatnonzero(tree.questions >= 0).tolist():
                shares[model.questions_[tree.questions[node]].name] += float(tree.gains[node])
        total = sum(shares.values()) or 1.0
        ordered = sorted(shares.items(), key=lambda item: -item[1])
        importances[name] = {question: share / total for question, share in ordered}
    return importances


def find_tree(model: Cart, name: str, *, with_sound: bool | None = None) -> TreeKey:
    """Find the tree that a user names.

    Parameters
    ----------
    model
        A trained model.
    name
        ``PHONE/PARAMETER``, such as ``P/lower_lip_depression``; in place of the phone also a group
        of phones, such as ``vowel``.
    with_sound
        Whether the tree has questions about sound; by default the one that has, where there are
        two.

    Returns
    -------
    TreeKey
        A key of ``model.trees_``.

    Raises
    ------
    DataError
        If there is no such tree.
    """
    of, slash, parameter = name.rpartition("/")
    if not slash or parameter not in model.parameter_names_:
        raise DataError(
            f"'{name}' names no tree",
            expected=f"PHONE/PARAMETER with one of {', '.join(model.parameter_names_)}",
        )
    p = model.parameter_names_.index(parameter)
    sounds = (True, False) if with_sound is None else (with_sound,)
    spellings = [of]
    parsed = model.phone_set_.parse(of)
    if parsed is not None:
        # A stress that is not stated is any that there is, the weakest first.
        named = list_alternatives(model.phone_set_, parsed[0], model.by_stress)
        spellings += [name for name, pooled in named if not pooled]
    for sound in sounds:
        for pooled in (False, True):
            for spelling in spellings:
                key = TreeKey(spelling, p, pooled, sound)
                if key in model.trees_:
                    return key
    known = sorted({key.of for key in model.trees_ if key.parameter == p})
    raise DataError(f"there is no tree of '{of}'", expected=f"one of {' '.join(known)}")


def get_question_name(model: Cart, key: TreeKey, node: int) -> str:
    """Return the question of a node in words.

    Parameters
    ----------
    model
        A trained model.
    key
        The tree.
    node
        A node that is not a leaf.

    Returns
    -------
    str
        Without a question mark.
    """
    number: int = model.trees_[key].questions[node]
    return model.questions_[number].name


def describe_branches(model: Cart, key: TreeKey, node: int) -> tuple[str, str]:
    """Describe the answers that lead to the left and to the right.

    Parameters
    ----------
    model
        A trained model.
    key
        The tree.
    node
        A node that is not a leaf.

    Returns
    -------
    left, right
        Such as ``up to 0.1 s``, or a list of phones.
    """
    tree = model.trees_[key]
    question = model.questions_[tree.questions[node]]
    if not question.is_open:
        return "yes", "no"
    if not question.attribute.is_phone:
        unit = _UNITS.get(question.attribute.kind, "")
        bound = float(tree.bounds[node])
        if np.isinf(bound):
            return "known", "unknown"
        return f"up to {bound:.3g}{unit}", f"above {bound:.3g}{unit}"
    names = model.alphabet.list_names()
    seen = np.flatnonzero(tree.seen[node]).tolist()
    left = [names[level] for level in seen if tree.sides[node, level] == LEFT]
    right = [names[level] for level in seen if tree.sides[node, level] != LEFT]
    return _join(left), _join(right)


def _join(names: list[str]) -> str:
    more = len(names) - _LISTED
    return " ".join(names) if more <= 1 else f"{' '.join(names[:_LISTED])} and {more} more"


def name_pool(of: str) -> str:
    """Name the phones of a tree of many, for people.

    Parameters
    ----------
    of
        `TreeKey.of`.

    Returns
    -------
    str
        A plural.
    """
    return _PLURALS.get(of, of)


_PLURALS = {group: group.replace("_", " ") + "s" for group in KIND_OF_GROUP} | {
    "no_speech": "no speech"
}
