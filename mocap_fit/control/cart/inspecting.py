"""What trees ask and why a target is what it is: in words, for people who look at a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mocap_fit.control.cart.contexts import KIND_OF_GROUP
from mocap_fit.control.cart.kernel import LEFT
from mocap_fit.control.cart.learning import TreeKey, chain
from mocap_fit.control.cart.model import Cart
from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSequence

# Phones that are listed before "and so many more".
_LISTED = 12
_UNITS = {"duration": " s", "energy": " dB"}


@dataclass(frozen=True)
class Answer:
    """A question on the way to a target.

    Parameters
    ----------
    question
        What was asked.
    found
        What the segment has: a phone, a number, ``yes`` or ``no``.
    taken
        The branch that was taken, in words.
    seen
        False where no training example of the node had it, and it went with its group or with
        most examples.
    count
        Examples on that branch.
    mean
        Of their targets.
    """

    question: str
    found: str
    taken: str
    seen: bool
    count: int
    mean: float


@dataclass(frozen=True)
class Reason:
    """What decided a target.

    Parameters
    ----------
    segment
        Which segment of the utterance, from 0.
    phone
        Its phone.
    centre
        Where the target stands, seconds.
    parameter
        Name of the face parameter.
    target
        What was selected.
    tree
        Whose tree it was, such as the phone, or ``vowel`` where the phone has no example; empty
        where there was none, and the target is rest.
    backed_off
        Whether it was not the phone's own.
    start
        What is expected of the phone before anything is asked: the mean at the root.
    answers
        The questions from the root to the leaf.
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
        own = f"no tree of its own: that of {self.tree}; " if self.backed_off else ""
        lines = [f"{head} ({own}{self.start:.3f} before any question)"]
        for answer in self.answers:
            new = "" if answer.seen else ", never seen here"
            lines.append(
                f"  {answer.question}: {answer.found}{new} -> {answer.taken}"
                f" ({answer.count} examples, mean {answer.mean:.3f})"
            )
        return "\n".join(lines)


def reasons(
    model: Cart,
    phones: PhoneSequence,
    *,
    segment: int | None = None,
    parameter: str | None = None,
) -> tuple[Reason, ...]:
    """What decided the targets of an utterance.

    Parameters
    ----------
    model
        Trained.
    phones
        The utterance.
    segment
        Only this segment, from 0.
    parameter
        Only this parameter.

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
    found = []
    for chosen in model.chosen(phones):
        name = model.parameter_names_[chosen.parameter]
        if segment not in (None, chosen.segment) or parameter not in (None, name):
            continue
        own = phones[chosen.segment]
        symbol = model.phone_set_.get_symbol(own, model.by_stress)
        if chosen.key is None:
            found.append(Reason(chosen.segment, symbol, own.centre, name, 0.0, "", True, 0.0, ()))
            continue
        tree = model.trees_[chosen.key]
        answers = []
        for node, after in zip(chosen.path, chosen.path[1:], strict=False):
            left, right = branches(model, chosen.key, node)
            value = chosen.values[model.attribute_of(int(tree.questions[node]))]
            answers.append(
                Answer(
                    question_at(model, chosen.key, node),
                    _found(model, chosen.key, node, value),
                    left if after == tree.children[node, LEFT] else right,
                    _was_seen(model, chosen.key, node, value),
                    int(tree.counts[after]),
                    float(tree.means[after]),
                )
            )
        found.append(
            Reason(
                chosen.segment,
                symbol,
                own.centre,
                name,
                float(tree.means[chosen.path[-1]]),
                chosen.key.of,
                chosen.key.of != symbol or chosen.key.pooled,
                float(tree.means[0]),
                tuple(answers),
            )
        )
    return tuple(found)


def importance(model: Cart) -> dict[str, dict[str, float]]:
    """How much each question matters for each parameter.

    Returns
    -------
    dict[str, dict[str, float]]
        By parameter, by question: the share of all that cuts lower the cross-validated error by
        (eq. 10), over the trees of all phones, the greatest first. Trees of many phones do not
        count, and of two trees of one phone the one with sound does.
    """
    found: dict[str, dict[str, float]] = {}
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
        found[name] = {question: share / total for question, share in ordered}
    return found


def find_tree(model: Cart, name: str, *, with_sound: bool | None = None) -> TreeKey:
    """The tree that a user names.

    Parameters
    ----------
    model
        Trained.
    name
        ``PHONE/PARAMETER``, such as ``P/lower_lip_depression``; for the phone also a group that
        was backed off to, such as ``vowel``.
    with_sound
        The one with questions about sound, or the one without; where both are there and it is not
        said, the one with.

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
    place = model.parameter_names_.index(parameter)
    sounds = (True, False) if with_sound is None else (with_sound,)
    spellings = [of]
    parsed = model.phone_set_.parse(of)
    if parsed is not None:
        # A stress that is not said is any that there is, the weakest first.
        named = chain(model.phone_set_, parsed[0], model.by_stress)
        spellings += [name for name, pooled in named if not pooled]
    for sound in sounds:
        for pooled in (False, True):
            for spelling in spellings:
                key = TreeKey(spelling, place, pooled, sound)
                if key in model.trees_:
                    return key
    known = sorted({key.of for key in model.trees_ if key.parameter == place})
    raise DataError(f"there is no tree of '{of}'", expected=f"one of {' '.join(known)}")


def question_at(model: Cart, key: TreeKey, node: int) -> str:
    """What a node asks, in words."""
    asked: int = model.trees_[key].questions[node]
    return model.questions_[asked].name


def branches(model: Cart, key: TreeKey, node: int) -> tuple[str, str]:
    """The answers that lead to the left and to the right, in words."""
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
    names = model.alphabet.names()
    seen = np.flatnonzero(tree.seen[node]).tolist()
    left = [names[level] for level in seen if tree.sides[node, level] == LEFT]
    right = [names[level] for level in seen if tree.sides[node, level] != LEFT]
    return _listed(left), _listed(right)


def _listed(names: list[str]) -> str:
    more = len(names) - _LISTED
    return " ".join(names) if more <= 1 else f"{' '.join(names[:_LISTED])} and {more} more"


def _found(model: Cart, key: TreeKey, node: int, value: float) -> str:
    question = model.questions_[model.trees_[key].questions[node]]
    if question.attribute.is_phone:
        return model.alphabet.names()[int(value)]
    unit = _UNITS.get(question.attribute.kind, "")
    return "unknown" if np.isnan(value) else f"{value:.3g}{unit}"


def _was_seen(model: Cart, key: TreeKey, node: int, value: float) -> bool:
    tree = model.trees_[key]
    if not model.questions_[tree.questions[node]].attribute.is_phone:
        return not np.isnan(value)
    return bool(tree.seen[node, int(value)])


def pooled_name(of: str) -> str:
    """What people call the phones of a tree of many."""
    return of if of in ("all", "vowels", "consonants") else _PLURALS.get(of, of)


_PLURALS = {group: group.replace("_", " ") + "s" for group in KIND_OF_GROUP} | {
    "no_speech": "no speech"
}
