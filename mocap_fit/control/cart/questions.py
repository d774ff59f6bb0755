"""The questions of a tree: what is asked about a segment and the phones beside it.

An attribute is what a segment has: the phone to its left, its duration. A question divides the
segments by an attribute: yes or no by a class of phones or a list of them, or a group of phones or
a bound that growing finds. The questions are those of Krňoul section 5.1; a table (TOML) adds a
wider context and questions of one's own::

    [[question]]                 # the phone two to the left; the best group is found
    ask = "phone"
    at = -2

    [[question]]                 # a class of the phone two to the right
    ask = "class"
    at = 2
    class = "vowel"

    [[question]]                 # a group of one's own
    name = "left phone is a close rounded vowel"
    ask = "phone"
    at = -1
    phones = ["O:", "U:"]

    [[question]]                 # also duration, energy, stress, resistant
    ask = "feature"
    at = 1
    feature = "rounded"

``at`` counts phones: 0 is the segment itself, -1 the phone before it, 1 the one after it. For
``resistant`` it is the nearest (1) or the second nearest (2) to the right, and so on; negative to
the left.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from mocap_fit.errors import ConfigurationError
from mocap_fit.phones import FEATURE_NAMES, QUESTION_CLASSES, PhoneSet

Kind = Literal["phone", "resistant", "duration", "energy", "stress", "feature"]
KINDS = ("phone", "resistant", "duration", "energy", "stress", "feature")
#: Attributes that are phones; the others are numbers.
PHONE_KINDS = ("phone", "resistant")
# The farthest phone that may be asked about.
_FARTHEST = 20
_FIELDS = {"name", "ask", "at", "class", "phones", "feature"}


@dataclass(frozen=True)
class Attribute:
    """What a segment has, and can be asked about.

    Parameters
    ----------
    kind
        ``phone``, ``resistant`` (the nearest phone that resists coarticulation in the tree's
        parameter), ``duration`` (s), ``energy`` (dB, at the segment's centre), ``stress``
        (0, 0.5, 1) or ``feature`` (one of the phone set's).
    at
        Of which phone: 0 the segment itself, -1 the one before it, 1 the one after it. Of a
        resistant one: the nearest in that direction, the second nearest.
    feature
        Which feature.
    """

    kind: Kind
    at: int
    feature: str = ""

    @property
    def is_phone(self) -> bool:
        """Whether it is a phone, and no number."""
        return self.kind in PHONE_KINDS

    @property
    def needs_sound(self) -> bool:
        """Whether it is known only where there is sound."""
        return self.kind == "energy"

    @property
    def name(self) -> str:
        """What people call it."""
        what = f"feature {self.feature}" if self.kind == "feature" else self.kind
        side = "left" if self.at < 0 else "right"
        if self.kind == "resistant":
            order = "nearest" if abs(self.at) == 1 else f"{_ordinal(abs(self.at))} nearest"
            return f"{order} resistant phone to the {side}"
        whose = {0: "segment", -1: "left phone", 1: "right phone"}.get(
            self.at, f"{_ordinal(abs(self.at))} phone to the {side}"
        )
        if self.kind == "phone":
            return whose
        return f"{what} of the {whose}"


@dataclass(frozen=True)
class Question:
    """Something that is asked about an attribute.

    Parameters
    ----------
    attribute
        What is asked about.
    phone_class
        Asks whether the phone is of this class (`QUESTION_CLASSES`).
    phones
        Asks whether the phone is one of these.
    label
        A name of one's own.

    With neither a class nor phones it is open: growing finds the group of phones, or the bound.
    """

    attribute: Attribute
    phone_class: str = ""
    phones: tuple[str, ...] = ()
    label: str = ""

    @property
    def is_open(self) -> bool:
        """Whether growing finds where to divide."""
        return not (self.phone_class or self.phones)

    @property
    def name(self) -> str:
        """What people call it."""
        if self.label:
            return self.label
        if self.phone_class:
            return f"{self.attribute.name} is {_CLASS_WORDS[self.phone_class]}"
        if self.phones:
            return f"{self.attribute.name} is one of {' '.join(self.phones)}"
        return self.attribute.name


_CLASS_WORDS = {
    "vowel": "a vowel",
    "no_speech": "no speech",
    "bilabial_stop": "a bilabial stop",
    "labiodental": "labiodental",
    "fricative": "a fricative",
}


def standard_questions() -> tuple[Question, ...]:
    """The questions of Krňoul section 5.1."""
    found: list[Question] = []
    for at in (-1, 1):
        phone = Attribute("phone", at)
        found += [Question(phone, phone_class=name) for name in QUESTION_CLASSES]
        found.append(Question(phone))
    found += [Question(Attribute("resistant", at)) for at in (-1, 1)]
    found += [Question(Attribute("duration", at)) for at in (0, -1, 1)]
    found.append(Question(Attribute("energy", 0)))
    return tuple(found)


def in_order(questions: Iterable[Question]) -> tuple[Question, ...]:
    """Questions without repetition, those about one attribute together, classes before groups.

    Of two questions that divide equally well, growing takes the one that comes first: a class says
    more about phones that were never seen there than a group that was found.
    """
    given = tuple(dict.fromkeys(questions))
    attributes = list(dict.fromkeys(question.attribute for question in given))
    return tuple(sorted(given, key=lambda q: (attributes.index(q.attribute), q.is_open)))


def read_questions(text: str, path: str | None = None) -> tuple[Question, ...]:
    """Read a table of questions.

    Parameters
    ----------
    text
        The table, TOML.
    path
        The file it is from, for messages.

    Raises
    ------
    ConfigurationError
        If it is no TOML, or a question cannot be asked.
    """
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(
            "the table of questions is not TOML", path=path, found=error
        ) from None
    rows = content.pop("question", [])
    if content or not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ConfigurationError(
            "the table of questions is not understood",
            path=path,
            found=", ".join(content) or "'question' is no list of tables",
            expected="tables [[question]]",
        )
    return tuple(_question(row, number, path) for number, row in enumerate(rows, start=1))


def _question(row: Mapping[str, Any], number: int, path: str | None) -> Question:
    def refuse(problem: str, found: object = None, expected: object = None) -> ConfigurationError:
        return ConfigurationError(
            f"question {number} of the table cannot be asked: {problem}",
            path=path,
            found=found,
            expected=expected,
        )

    unknown = sorted(row.keys() - _FIELDS)
    if unknown:
        raise refuse(
            f"there is no setting '{unknown[0]}'", expected=f"some of {', '.join(sorted(_FIELDS))}"
        )
    ask, at, label = row.get("ask"), row.get("at", 0), row.get("name", "")
    if ask not in (*KINDS, "class"):
        raise refuse("'ask' is unknown", found=ask, expected=f"one of {', '.join(KINDS)}, class")
    if isinstance(at, bool) or not isinstance(at, int) or abs(at) > _FARTHEST:
        raise refuse(
            "'at' is no place",
            found=at,
            expected=f"a whole number from -{_FARTHEST} to {_FARTHEST}",
        )
    if at == 0 and ask in ("phone", "class", "resistant"):
        raise refuse(
            "a tree is of one phone, and knows it", found="at = 0", expected="a phone beside it"
        )
    if not isinstance(label, str):
        raise refuse("'name' is no text", found=label)
    phone_class, phones, feature = row.get("class", ""), row.get("phones", []), row.get("feature")
    if (ask == "class") != bool(phone_class) or (phone_class and phone_class not in _CLASS_WORDS):
        raise refuse(
            "the class of phones is not stated or unknown",
            found=phone_class or f'ask = "{ask}" without class',
            expected=f'ask = "class" with one of {", ".join(QUESTION_CLASSES)}',
        )
    if "phones" in row and (
        ask not in PHONE_KINDS
        or not isinstance(phones, list)
        or not phones
        or not all(isinstance(phone, str) for phone in phones)
    ):
        raise refuse("'phones' is no list of phones", found=phones, expected='such as ["P", "B"]')
    features = tuple(name for name in FEATURE_NAMES if name != "stress")
    if (ask == "feature") != (feature is not None) or (
        ask == "feature" and feature not in features
    ):
        raise refuse(
            "the feature is not stated or unknown",
            found=feature,
            expected=f'ask = "feature" with one of {", ".join(features)}',
        )
    kind: Kind = "phone" if ask == "class" else ask
    return Question(Attribute(kind, at, feature or ""), phone_class, tuple(phones), label)


def check_phones_of(questions: Iterable[Question], phone_set: PhoneSet) -> tuple[Question, ...]:
    """Questions whose phones are written as the set writes them.

    Raises
    ------
    ConfigurationError
        If a question names a phone that the set lacks.
    """
    checked: list[Question] = []
    for question in questions:
        symbols: list[str] = []
        for phone in question.phones:
            parsed = phone_set.parse(phone)
            if parsed is None:
                raise ConfigurationError(
                    f"the question '{question.name}' asks for a phone that the phone set lacks",
                    found=phone,
                    expected=f"phones of '{phone_set.name}'",
                )
            symbols.append(parsed[0])
        checked.append(
            Question(question.attribute, question.phone_class, tuple(symbols), question.label)
        )
    return tuple(checked)


def question_row(question: Question) -> dict[str, Any]:
    """A question as values that JSON can hold."""
    attribute = question.attribute
    return {
        "kind": attribute.kind,
        "at": attribute.at,
        "feature": attribute.feature,
        "class": question.phone_class,
        "phones": list(question.phones),
        "label": question.label,
    }


def question_from_row(row: Mapping[str, Any]) -> Question:
    """The question that `question_row` described."""
    attribute = Attribute(row["kind"], int(row["at"]), row["feature"])
    return Question(attribute, row["class"], tuple(row["phones"]), row["label"])


def _ordinal(number: int) -> str:
    return {1: "first", 2: "second", 3: "third"}.get(number, f"{number}th")
