"""The questions of a tree: what is asked about a segment and the phones beside it.

An attribute is what a segment has, such as the phone to its left, or its duration. A question
divides the segments by an attribute: yes or no by a class of phones or a list of them, or by a
group of phones or a bound that growing finds. The questions are those of Krňoul section 5.1; a
table (TOML) adds a wider context and the user's questions::

    [[question]]                 # the phone two to the left; the best group is found
    ask = "phone"
    at = -2

    [[question]]                 # a class of the phone two to the right
    ask = "class"
    at = 2
    class = "vowel"

    [[question]]                 # a group of the user's
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

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from mocap_fit.errors import ConfigurationError
from mocap_fit.parsing import parse_toml
from mocap_fit.phones import FEATURE_NAMES, QUESTION_CLASSES, PhoneSet

Kind = Literal["phone", "resistant", "duration", "energy", "stress", "feature"]
KINDS = ("phone", "resistant", "duration", "energy", "stress", "feature")
#: Attributes that are phones; the others are numbers.
PHONE_KINDS = ("phone", "resistant")
# The farthest phone that a question may be about.
_FARTHEST = 20
_FIELDS = {"name", "ask", "at", "class", "phones", "feature"}


@dataclass(frozen=True)
class Attribute:
    """What a segment has and questions can be about.

    Parameters
    ----------
    kind
        ``phone``, ``resistant`` (the nearest phone that resists coarticulation in the tree's
        parameter), ``duration`` (s), ``energy`` (dB, at the segment's centre), ``stress``
        (0, 0.5, 1) or ``feature`` (one of the phone set's).
    at
        The phone: 0 the segment itself, -1 the one before it, 1 the one after it. Of a resistant
        one: the nearest in that direction, the second nearest.
    feature
        The feature of the phone set.
    """

    kind: Kind
    at: int
    feature: str = ""

    @property
    def is_phone(self) -> bool:
        """Whether it is a phone, not a number."""
        return self.kind in PHONE_KINDS

    @property
    def needs_sound(self) -> bool:
        """Whether only sound can tell it."""
        return self.kind == "energy"

    @property
    def name(self) -> str:
        """Its name for people."""
        what = f"feature {self.feature}" if self.kind == "feature" else self.kind
        side = "left" if self.at < 0 else "right"
        if self.kind == "resistant":
            order = "nearest" if abs(self.at) == 1 else f"{_write_ordinal(abs(self.at))} nearest"
            return f"{order} resistant phone to the {side}"
        whose = {0: "segment", -1: "left phone", 1: "right phone"}.get(
            self.at, f"{_write_ordinal(abs(self.at))} phone to the {side}"
        )
        if self.kind == "phone":
            return whose
        return f"{what} of the {whose}"


@dataclass(frozen=True)
class Question:
    """A question about an attribute; open, where growing finds the group of phones or the bound.

    Parameters
    ----------
    attribute
        The attribute.
    phone_class
        Whether the phone is of this class (`mocap_fit.phones.QUESTION_CLASSES`); empty for an open
        question.
    phones
        Whether the phone is one of these; empty for an open question.
    label
        The user's name of the question.
    """

    attribute: Attribute
    phone_class: str = ""
    phones: tuple[str, ...] = ()
    label: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Convert the question to values that JSON can hold.

        Returns
        -------
        dict[str, Any]
            What `from_dict` takes.
        """
        attribute = self.attribute
        return {
            "kind": attribute.kind,
            "at": attribute.at,
            "feature": attribute.feature,
            "class": self.phone_class,
            "phones": list(self.phones),
            "label": self.label,
        }

    @classmethod
    def from_dict(cls, row: Mapping[str, Any]) -> Question:
        """Restore a question.

        Parameters
        ----------
        row
            What `to_dict` returned.

        Returns
        -------
        Question
            The same.
        """
        attribute = Attribute(row["kind"], int(row["at"]), row["feature"])
        is_feature = attribute.kind == "feature"
        if attribute.kind not in KINDS or (is_feature and attribute.feature not in FEATURE_NAMES):
            raise ValueError(f"a question about {attribute}")
        return cls(attribute, row["class"], tuple(row["phones"]), row["label"])

    @property
    def is_open(self) -> bool:
        """Whether growing finds where to divide."""
        return not (self.phone_class or self.phones)

    @property
    def name(self) -> str:
        """Its name for people."""
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


def list_standard_questions() -> tuple[Question, ...]:
    """List the questions of Krňoul section 5.1.

    Returns
    -------
    tuple[Question, ...]
        Those about one attribute together.
    """
    questions: list[Question] = []
    for at in (-1, 1):
        phone = Attribute("phone", at)
        questions += [Question(phone, phone_class=name) for name in QUESTION_CLASSES]
        questions.append(Question(phone))
    questions += [Question(Attribute("resistant", at)) for at in (-1, 1)]
    questions += [Question(Attribute("duration", at)) for at in (0, -1, 1)]
    questions.append(Question(Attribute("energy", 0)))
    return tuple(questions)


def order_questions(questions: Iterable[Question]) -> tuple[Question, ...]:
    """Order questions as they are tried: by attribute, classes before groups, none twice.

    Of two questions that divide equally well, growing takes the one that comes first: a class says
    more about phones that were never seen there than a group that was fitted.

    Parameters
    ----------
    questions
        In any order.

    Returns
    -------
    tuple[Question, ...]
        Those about one attribute together.
    """
    unique = tuple(dict.fromkeys(questions))
    attributes = list(dict.fromkeys(question.attribute for question in unique))
    return tuple(sorted(unique, key=lambda q: (attributes.index(q.attribute), q.is_open)))


def read_questions(text: str, path: str | None = None) -> tuple[Question, ...]:
    """Read a table of questions.

    Parameters
    ----------
    text
        The table, TOML.
    path
        The file that it is from, for messages.

    Returns
    -------
    tuple[Question, ...]
        In the order of the table.

    Raises
    ------
    ConfigurationError
        If it is not TOML, or a question is not understood.
    """
    try:
        content = parse_toml(text)
    except ValueError as error:
        raise ConfigurationError(
            "the table of questions is not TOML", path=path, found=error
        ) from None
    rows = content.pop("question", [])
    if content or not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ConfigurationError(
            "the table of questions is not understood",
            path=path,
            found=", ".join(content) or "'question' is not a list of tables",
            expected="tables [[question]]",
        )
    return tuple(_read_question(row, number, path) for number, row in enumerate(rows, start=1))


def _read_question(row: Mapping[str, Any], number: int, path: str | None) -> Question:
    """Read one question of a table."""

    def make_error(
        problem: str, value: object = None, expected: object = None
    ) -> ConfigurationError:
        return ConfigurationError(
            f"question {number} of the table is not understood: {problem}",
            path=path,
            found=value,
            expected=expected,
        )

    unknown = sorted(row.keys() - _FIELDS)
    if unknown:
        raise make_error(
            f"there is no setting '{unknown[0]}'", expected=f"some of {', '.join(sorted(_FIELDS))}"
        )
    ask, at, label = row.get("ask"), row.get("at", 0), row.get("name", "")
    if ask not in (*KINDS, "class"):
        raise make_error(
            "'ask' is unknown", value=ask, expected=f"one of {', '.join(KINDS)}, class"
        )
    if isinstance(at, bool) or not isinstance(at, int) or abs(at) > _FARTHEST:
        raise make_error(
            "'at' is not the position of a phone",
            value=at,
            expected=f"a whole number from -{_FARTHEST} to {_FARTHEST}",
        )
    if at == 0 and ask in ("phone", "class", "resistant"):
        raise make_error(
            "a tree is of one phone, which needs no question",
            value="at = 0",
            expected="a phone beside it",
        )
    if not isinstance(label, str):
        raise make_error("'name' is not a text", value=label)
    phone_class, phones, feature = row.get("class", ""), row.get("phones", []), row.get("feature")
    if (ask == "class") != bool(phone_class) or (phone_class and phone_class not in _CLASS_WORDS):
        raise make_error(
            "the class of phones is not stated or unknown",
            value=phone_class or f'ask = "{ask}" without class',
            expected=f'ask = "class" with one of {", ".join(QUESTION_CLASSES)}',
        )
    if "phones" in row and (
        ask not in PHONE_KINDS
        or not isinstance(phones, list)
        or not phones
        or not all(isinstance(phone, str) for phone in phones)
    ):
        raise make_error(
            "'phones' is not a list of phones", value=phones, expected='such as ["P", "B"]'
        )
    features = tuple(name for name in FEATURE_NAMES if name != "stress")
    if (ask == "feature") != (feature is not None) or (
        ask == "feature" and feature not in features
    ):
        raise make_error(
            "the feature is not stated or unknown",
            value=feature,
            expected=f'ask = "feature" with one of {", ".join(features)}',
        )
    kind: Kind = "phone" if ask == "class" else ask
    return Question(Attribute(kind, at, feature or ""), phone_class, tuple(phones), label)


def normalise_questions(questions: Iterable[Question], phone_set: PhoneSet) -> tuple[Question, ...]:
    """Write the phones of questions as a phone set writes them.

    Parameters
    ----------
    questions
        Some of them about lists of phones.
    phone_set
        The set of the corpus.

    Returns
    -------
    tuple[Question, ...]
        In the same order.

    Raises
    ------
    ConfigurationError
        If a question names a phone that the set lacks.
    """
    normalised: list[Question] = []
    for question in questions:
        symbols: list[str] = []
        for phone in question.phones:
            parsed = phone_set.parse(phone)
            if parsed is None:
                raise ConfigurationError(
                    f"the question '{question.name}' is about a phone that the phone set lacks",
                    found=phone,
                    expected=f"phones of '{phone_set.name}'",
                )
            symbols.append(parsed[0])
        normalised.append(dataclasses.replace(question, phones=tuple(symbols)))
    return tuple(normalised)


def _write_ordinal(number: int) -> str:
    return {1: "first", 2: "second", 3: "third"}.get(number, f"{number}th")
