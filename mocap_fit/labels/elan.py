"""ELAN's .eaf: tiers of annotations, by themselves in time or parts of others.

An annotation that refers to another has its time; several that refer to one share it evenly.
Slots of time without a value lie evenly between those beside them in the tier. Documents with a
DOCTYPE are refused, and with it entities, which can unpack to any size or name other files.
"""

from __future__ import annotations

import os
import warnings
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from mocap_fit.errors import DataError, FileFormatError, MocapFitWarning, shorten
from mocap_fit.labels.text import LABEL_SIZE, parse_seconds, read_head_lines, read_label_bytes
from mocap_fit.labels.types import Label, Labels, Tier
from mocap_fit.size_limit import check_size

description = "ELAN .eaf, times in milliseconds"
extensions = (".eaf",)

_ROOT = "ANNOTATION_DOCUMENT"
_MILLISECONDS = 1000.0


@dataclass
class _Annotation:
    """An annotation: two slots of time, or another annotation that it is a part of."""

    tier: int
    line: int
    slots: tuple[str, str] | None
    parent: str
    previous: str
    text: list[str] = field(default_factory=list)
    times: tuple[float, float] | None = None


class _Document:
    """What a document says, read from first to last without building a tree."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = path
        # Seconds, NaN where the slot has no value; in the order of time, as ELAN writes them.
        self.slots: dict[str, float] = {}
        self.tiers: list[str] = []
        self.annotations: dict[str, _Annotation] = {}
        self.offset = 0.0
        # Whether the medium that gives the offset is a sound; None without one.
        self._is_sound: bool | None = None
        self._current: _Annotation | None = None
        self._in_value = False
        self._depth = 0
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start_element
        self.parser.EndElementHandler = self._end_element
        self.parser.CharacterDataHandler = self._add_text
        self.parser.StartDoctypeDeclHandler = self._refuse_doctype

    def create_error(self, problem: str, value: object, expected: str) -> FileFormatError:
        line = self.parser.CurrentLineNumber
        return FileFormatError(problem, path=self.path, line=line, found=value, expected=expected)

    def _refuse_doctype(self, *_: object) -> None:
        raise self.create_error("the document has a DOCTYPE", "<!DOCTYPE", "none, as ELAN writes")

    def _get(self, attributes: dict[str, str], name: str) -> str:
        if name not in attributes:
            raise self.create_error(f"the attribute {name} is missing", None, f'{name}="…"')
        return attributes[name]

    def _start_element(self, tag: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        if self._depth == 1 and tag != _ROOT:
            raise self.create_error("this is not a document of ELAN", f"<{tag}>", f"<{_ROOT}>")
        if tag == "HEADER":
            self._check_units(attributes.get("TIME_UNITS", "milliseconds"))
        elif tag == "MEDIA_DESCRIPTOR":
            self._add_medium(attributes)
        elif tag == "TIME_SLOT":
            value = attributes.get("TIME_VALUE")
            time = np.nan if value is None else self._parse(value)
            self.slots[self._get(attributes, "TIME_SLOT_ID")] = time
        elif tag == "TIER":
            self.tiers.append(self._get(attributes, "TIER_ID"))
        elif tag in ("ALIGNABLE_ANNOTATION", "REF_ANNOTATION"):
            self._add_annotation(tag, attributes)
        elif tag == "ANNOTATION_VALUE":
            self._in_value = True

    def _end_element(self, tag: str) -> None:
        self._depth -= 1
        if tag == "ANNOTATION_VALUE":
            self._in_value = False
        elif tag in ("ALIGNABLE_ANNOTATION", "REF_ANNOTATION"):
            self._current = None

    def _add_text(self, text: str) -> None:
        if self._in_value and self._current is not None:
            self._current.text.append(text)

    def _parse(self, value: str) -> float:
        return parse_seconds(value, self.path, self.parser.CurrentLineNumber, _MILLISECONDS)

    def _check_units(self, units: str) -> None:
        if units != "milliseconds":
            raise self.create_error("the times have another unit", units, "milliseconds")

    def _add_medium(self, attributes: dict[str, str]) -> None:
        # Times are those of ELAN's player, which skips the origin of the sound.
        is_sound = attributes.get("MIME_TYPE", "").startswith("audio")
        if self._is_sound is None or (is_sound and not self._is_sound):
            self.offset = self._parse(attributes.get("TIME_ORIGIN", "0"))
            self._is_sound = is_sound

    def _add_annotation(self, tag: str, attributes: dict[str, str]) -> None:
        name = self._get(attributes, "ANNOTATION_ID")
        if name in self.annotations:
            raise self.create_error("the annotation comes twice", shorten(name, 40), "each once")
        if not self.tiers:
            raise self.create_error("the annotation is in no tier", shorten(name, 40), "<TIER>")
        slots = None
        if tag == "ALIGNABLE_ANNOTATION":
            keys = ("TIME_SLOT_REF1", "TIME_SLOT_REF2")
            slots = (self._get(attributes, keys[0]), self._get(attributes, keys[1]))
            for slot in slots:
                if slot not in self.slots:
                    value = shorten(slot, 40)
                    raise self.create_error("there is no such slot of time", value, "a TIME_SLOT")
        parent = "" if slots else self._get(attributes, "ANNOTATION_REF")
        previous = attributes.get("PREVIOUS_ANNOTATION", "")
        line = self.parser.CurrentLineNumber
        self._current = _Annotation(len(self.tiers) - 1, line, slots, parent, previous)
        self.annotations[name] = self._current


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether the first element is that of an ELAN document.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like one.
    """
    return any(f"<{_ROOT}" in line for line in read_head_lines(path, 65536)[:50])


def read(path: str | os.PathLike[str], *, rate: float | None = None) -> tuple[Labels, ...]:
    """Read an ELAN document.

    Parameters
    ----------
    path
        File to read.
    rate
        Sampling rate, hertz; not used.

    Returns
    -------
    tuple of Labels
        The only utterance of the file.

    Raises
    ------
    FileFormatError
        If it is not a document of ELAN, or an annotation has no time.

    Warns
    -----
    MocapFitWarning
        If ELAN plays the sound from a later time on; the times are those of the sound.
    """
    content = read_label_bytes(path)
    # Nearly every element is a slot of time or an annotation and its value.
    check_size(content.count(b"<") * LABEL_SIZE // 2, path=path)
    document = _Document(path)
    try:
        document.parser.Parse(content, True)
    except expat.ExpatError as error:
        raise FileFormatError(
            "this is not whole XML",
            path=path,
            line=error.lineno,
            found=expat.ErrorString(error.code),
            advice="Export it again from ELAN.",
        ) from None
    except (LookupError, ValueError) as error:
        raise FileFormatError("the encoding is not known", path=path, found=error) from None
    _set_aligned_times(document)
    _set_part_times(document)
    entries: list[list[Label]] = [[] for _ in document.tiers]
    for annotation in document.annotations.values():
        if annotation.times is None:
            slots, parent = " to ".join(annotation.slots or ()), shorten(annotation.parent, 40)
            raise FileFormatError(
                "the annotation has no time",
                path=path,
                line=annotation.line,
                found=f"slots {slots}" if slots else f"a part of '{parent}'",
                expected="TIME_VALUE of its slots, or annotations with times around or above it",
            )
        start, end = annotation.times
        text = "".join(annotation.text)
        entries[annotation.tier].append(Label(start + document.offset, end + document.offset, text))
    tiers = [
        Tier(name, tuple(sorted(labels, key=lambda label: label.start)))
        for name, labels in zip(document.tiers, entries, strict=True)
    ]
    if document.offset:
        warnings.warn(
            f"{os.fspath(path)}: ELAN plays the sound from {document.offset:g} s on (TIME_ORIGIN); "
            "this was added to the times, which are now those of the sound.",
            MocapFitWarning,
            stacklevel=2,
        )
    end = max((label.end for labels in entries for label in labels), default=0.0)
    return (Labels(tuple(tiers), 0.0, end, name=Path(path).stem),)


def _set_aligned_times(document: _Document) -> None:
    """Set the times of annotations with slots; those without a value lie evenly between others."""
    order = {slot: index for index, slot in enumerate(document.slots)}
    chains: list[list[_Annotation]] = [[] for _ in document.tiers]
    for annotation in document.annotations.values():
        if annotation.slots is not None:
            chains[annotation.tier].append(annotation)
    for chain in chains:
        chain.sort(key=lambda annotation: [order[slot] for slot in annotation.slots or ()])
        slots = list(dict.fromkeys(slot for one in chain for slot in one.slots or ()))
        times = np.array([document.slots[slot] for slot in slots])
        known = np.flatnonzero(np.isfinite(times))
        if not len(known):
            continue
        filled = np.interp(np.arange(len(times)), known, times[known], left=np.nan, right=np.nan)
        at = dict(zip(slots, filled.tolist(), strict=True))
        for annotation in chain:
            start, end = (at[slot] for slot in annotation.slots or ())
            if np.isfinite(start) and np.isfinite(end):
                annotation.times = start, end


def _set_part_times(document: _Document) -> None:
    """Set the times of annotations that refer to others, from these on to their parts."""
    parts: dict[str, dict[int, dict[str, _Annotation]]] = {}
    for name, annotation in document.annotations.items():
        if annotation.slots is None:
            tiers = parts.setdefault(annotation.parent, {})
            tiers.setdefault(annotation.tier, {})[name] = annotation
    waiting = deque(name for name, one in document.annotations.items() if one.times is not None)
    while waiting:
        name = waiting.popleft()
        times = document.annotations[name].times
        assert times is not None
        for siblings in parts.pop(name, {}).values():
            chain = _order_siblings(siblings)
            marks = np.linspace(*times, len(chain) + 1).tolist()
            for index, sibling in enumerate(chain):
                siblings[sibling].times = marks[index], marks[index + 1]
                waiting.append(sibling)


def _order_siblings(siblings: dict[str, _Annotation]) -> list[str]:
    """Return the names in the order that each says of the one before it."""
    after = {one.previous: name for name, one in siblings.items() if one.previous in siblings}
    ordered = [name for name, one in siblings.items() if one.previous not in siblings]
    chain: list[str] = []
    for name in ordered:
        current: str | None = name
        while current is not None:
            chain.append(current)
            current = after.pop(current, None)
    # Those that refer to each other in a circle stay in the order of the file.
    return chain if len(chain) == len(siblings) else list(siblings)


def to_text(
    utterances: Sequence[Labels], path: str | os.PathLike[str], *, rate: float | None = None
) -> str:
    """Refuse to write: ELAN imports TextGrids.

    Parameters
    ----------
    utterances
        Not used.
    path
        File for the message.
    rate
        Sampling rate, hertz; not used.

    Returns
    -------
    str
        Nothing is returned.

    Raises
    ------
    DataError
        In every case.
    """
    raise DataError(
        "documents of ELAN are read, and not written",
        path=path,
        advice="Write a TextGrid, which ELAN imports.",
    )
