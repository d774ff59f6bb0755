"""Names of phones in context, as HTK and HTS write them, and of the states of their models.

``l-c+r`` is the phone ``c`` between ``l`` and ``r``; ``a^l-c+r=b@…/A:…`` is the same phone in its
full context. ``[3]`` behind a name is a state of its model, and ``s3`` one on a level of its own.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

from mocap_fit.labels.types import Label

_TRIPHONE = re.compile(r"[^-+\s]++-[^+\s]++\+[^+\s]++")
_LEFT = re.compile(r"([^-+\s]++)-([^+\s]++)")
_RIGHT = re.compile(r"([^-+\s]++)\+([^+\s]++)")
# The name with its left context, and the right context.
_IN_CONTEXT = re.compile(r"([^-+\s][^+\s]*+)(?:\+([^+\s]++))?")
_IN_FULL_CONTEXT = re.compile(r"[^^]*+\^([^+]++)\+([^=]*+)=.*+", re.DOTALL)
_STATE = re.compile(r"(.*)\[([0-9]{1,3})\]", re.DOTALL)
_STATE_ALONE = re.compile(r"s[0-9]{1,3}")


def has_states(entries: Sequence[Label]) -> bool:
    """Return whether all names are those of states (``s2``, ``s3``, …).

    Parameters
    ----------
    entries
        Labels of the lowest level.

    Returns
    -------
    bool
        Whether all are; False without labels.
    """
    return bool(entries) and all(_STATE_ALONE.fullmatch(entry.text) for entry in entries)


def merge_states(entries: Sequence[Label]) -> list[Label]:
    """Merge the states of each phone, where every name ends with the number of a state.

    Parameters
    ----------
    entries
        Labels in the order of time.

    Returns
    -------
    list of Label
        The phones, without the scores of their states; the same labels where a name has no state.
    """
    matches = [_STATE.fullmatch(entry.text) for entry in entries]
    merged: list[Label] = []
    number = 0
    for entry, match in zip(entries, matches, strict=True):
        if match is None:
            return list(entries)
        before = merged[-1] if merged else None
        follows = before is not None and (before.text, before.end) == (match[1], entry.start)
        if before is not None and follows and int(match[2]) > number:
            merged[-1] = Label(before.start, entry.end, before.text)
        else:
            merged.append(Label(entry.start, entry.end, match[1]))
        number = int(match[2])
    return merged


def extract_centres(entries: Sequence[Label]) -> list[Label]:
    """Replace names in context by the phone in the middle.

    Names such as ``a+b`` count as contexts only in a tier that has one on both sides, ``l-c+r``,
    or two that agree, ``a+b`` before ``a-b``.

    Parameters
    ----------
    entries
        Labels of phones.

    Returns
    -------
    list of Label
        The same labels; unchanged where there are no contexts.
    """
    names = [entry.text for entry in entries]
    if any(_IN_FULL_CONTEXT.fullmatch(name) for name in names):
        pattern = _IN_FULL_CONTEXT
    elif any(_TRIPHONE.fullmatch(n) for n in names) or any(map(_has_agreement, names, names[1:])):
        pattern = _IN_CONTEXT
    else:
        return list(entries)
    parts = [pattern.fullmatch(name) for name in names]
    known = {match[2] for match in parts if match is not None}
    centres = []
    expected = None
    for entry, match in zip(entries, parts, strict=True):
        centre = entry.text
        if match is not None:
            centre = _extract_centre(match[1], expected, known)
        expected = None if match is None else match[2]
        centres.append(Label(entry.start, entry.end, centre, entry.extra))
    return centres


def _has_agreement(before: str, after: str) -> bool:
    right, left = _RIGHT.fullmatch(before), _LEFT.fullmatch(after)
    return right is not None and left is not None and right.groups() == left.groups()


def _extract_centre(name: str, expected: str | None, known: Collection[str | None]) -> str:
    """Return a name without its left context; either may hold a hyphen, as TIMIT's ``ax-h``."""
    if expected and f"-{name}".endswith(f"-{expected}"):
        return expected
    _, hyphen, centre = name.partition("-")
    return centre if hyphen and name not in known else name
