"""Names of tracks from the labels of a file, by the same rules in every format.

A subject's prefix (``Ann:chin``) goes where all named tracks share it; labels that a program gave
to what nobody named (``*110``, ``Unlabeled 3``, blank ones) have no say. With several subjects the
prefixes stay; where two subjects have a marker of the same name, the caller says which subject is
meant, and only that subject's tracks are read. A blank label becomes ``unlabelled N``. Of equal
labels the second becomes ``NAME_2``: the tracks can be read, and `find_doubled` says which names
nobody should rely on.
"""

from __future__ import annotations

import difflib
import re
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from mocap_fit.errors import DataError, FileFormatError, MocapFitWarning
from mocap_fit.tracks import Tracks

_UNLABELLED = re.compile(r"(?:\*|uname\*|unlabell?ed|unidentified|unnamed)[ _*\-]*[0-9]*", re.I)

_AnyTracks = TypeVar("_AnyTracks", bound=Tracks)


@dataclass(frozen=True)
class TrackNames:
    """Names of the tracks that are read from a file.

    Parameters
    ----------
    labels
        A label for every track of the file, for messages.
    names
        Names of the tracks that are read.
    columns
        Which tracks of the file these are, from 0.
    subject
        The subject whose prefix was left out.
    renamed
        Names that were made up because a label came twice, with that label.
    from_caller
        Whether the names are those of the caller.
    """

    labels: tuple[str, ...]
    names: tuple[str, ...]
    columns: tuple[int, ...]
    subject: str | None = None
    renamed: Mapping[str, str] = field(default_factory=dict)
    from_caller: bool = False


def name_tracks(
    labels: Sequence[str],
    names: Sequence[str] | None = None,
    *,
    path: Path,
    subject: str | None = None,
    noun: str = "marker",
    line: int | None = None,
) -> TrackNames:
    """Determine the names of tracks from the labels of a file, or from the caller.

    Parameters
    ----------
    labels
        Labels in the file, without those of angles, forces and the like.
    names
        Names of the caller for the tracks that are read; None for those of the file.
    path
        File for messages.
    subject
        Subject of the caller: only its tracks are read.
    noun
        Word for a track in messages.
    line
        Line for messages.

    Returns
    -------
    TrackNames
        The names, and which tracks of the file have them.

    Raises
    ------
    FileFormatError
        If two subjects have equal names, the file has no such subject, or the caller's names are
        too few, too many, blank or not unique.

    Warns
    -----
    MocapFitWarning
        If labels are equal, or a subject is wanted and no label has one.
    """
    texts = [str(label).strip() for label in labels]
    parts = [split_subject(text) for text in texts]
    columns = tuple(range(len(texts)))
    if subject is not None:
        columns = _find_subject(parts, subject.strip(), path, noun, line)
    if names is not None:
        chosen = _check_names(names, len(columns), path, noun, line)
        return TrackNames(tuple(texts), chosen, columns, from_caller=True)
    named = [parts[column] for column in columns if not _is_unlabelled(parts[column][1])]
    owners = {owner for owner, _ in named}
    shared = owners.pop() if len(owners) == 1 else None
    if shared is None:
        _check_subjects(named, path, noun, line)
    chosen, renamed = _make_unique(
        [
            (parts[column][1] if parts[column][0] == shared else texts[column])
            or f"unlabelled {column + 1}"
            for column in columns
        ]
    )
    if renamed:
        _warn_of_equal_labels(renamed, path, noun, line)
    return TrackNames(tuple(texts), chosen, columns, shared, renamed)


def rename_tracks(
    tracks: _AnyTracks,
    rename: Mapping[str, str],
    *,
    path: Path | None = None,
    missing_ok: bool = False,
) -> _AnyTracks:
    """Return tracks with other names, all exchanged at the same time.

    Parameters
    ----------
    tracks
        Markers, poses or parameters.
    rename
        New names by the present ones.
    path
        File for messages.
    missing_ok
        Whether a name that is not there is passed over if the new one already is.

    Returns
    -------
    Tracks
        Tracks of the same kind, with a step of provenance.

    Raises
    ------
    DataError
        If there is no such name, or a new one is blank or already used.
    """
    changes = {str(old).strip(): str(new).strip() for old, new in rename.items()}
    if missing_ok:
        changes = {
            old: new
            for old, new in changes.items()
            if old in tracks.names or new not in tracks.names
        }
    if not changes:
        return tracks
    missing = [old for old in changes if old not in tracks.names]
    if missing:
        raise DataError(
            f"there is no {tracks.noun} '{missing[0]}' to rename",
            path=path,
            found=list(tracks.names),
            advice=suggest_names(missing[0], tracks.names) or "Give a name that is there.",
        )
    if not all(changes.values()):
        raise DataError(f"the new name of a {tracks.noun} is blank", path=path)
    names = tuple(changes.get(name, name) for name in tracks.names)
    name, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise DataError(
            f"two {tracks.plural} would be called '{name}'",
            path=path,
            advice=f"Rename the {tracks.noun} that has the name now as well.",
        )
    return tracks.replace(names=names).add_step("rename", {"names": changes})


def find_doubled(tracks: Tracks) -> dict[str, str]:
    """Find names of which nobody knows which track they mean, because a label came twice.

    Parameters
    ----------
    tracks
        Tracks with the provenance of their reader.

    Returns
    -------
    dict
        The label by each name that stands for it: ``{"RTHI": "RTHI", "RTHI_2": "RTHI"}``. A label
        of which the caller renamed one is settled, and not there.
    """
    doubled: dict[str, str] = {}
    for step in tracks.provenance:
        if step.name == "read":
            for name, label in step.arguments.get("renamed", {}).items():
                doubled |= {label: label, name: label}
        elif step.name == "rename":
            settled = {doubled.get(name) for name in step.arguments["names"]}
            doubled = {name: label for name, label in doubled.items() if label not in settled}
    return doubled


def suggest_names(name: str, names: Sequence[str]) -> str | None:
    """Suggest the names that are most like one that is not there.

    Parameters
    ----------
    name
        The name that is not there.
    names
        The names that are.

    Returns
    -------
    str or None
        A sentence with one to three names; None where none is like it.
    """
    plain = {to_plain(other): other for other in reversed(names)}
    close = difflib.get_close_matches(to_plain(name), plain, 3)
    return f"Did you mean {' or '.join(plain[match] for match in close)}?" if close else None


def to_plain(name: str) -> str:
    """Return a name without its subject, case, blanks and punctuation, to compare it.

    Parameters
    ----------
    name
        The name.

    Returns
    -------
    str
        What is left; the name itself where nothing is.
    """
    return re.sub(r"[\W_]+", "", name.rpartition(":")[2].casefold()) or name


def split_subject(label: str) -> tuple[str | None, str]:
    """Split a label into its subject and the rest.

    Parameters
    ----------
    label
        Such as ``Ann:chin``.

    Returns
    -------
    subject : str or None
        None where there is no prefix.
    rest : str
        The label without it.
    """
    owner, colon, rest = label.partition(":")
    owner, rest = owner.strip(), rest.strip()
    return (owner, rest) if colon and owner and rest else (None, label)


def _is_unlabelled(label: str) -> bool:
    return not label or _UNLABELLED.fullmatch(label) is not None


def _find_subject(
    parts: Sequence[tuple[str | None, str]],
    subject: str,
    path: Path,
    noun: str,
    line: int | None,
) -> tuple[int, ...]:
    """Return the tracks of a subject; all of them where no label has a subject."""
    columns = tuple(column for column, (owner, _) in enumerate(parts) if owner == subject)
    if columns:
        return columns
    subjects = dict.fromkeys(owner for owner, _ in parts if owner is not None)
    if not subjects:
        warnings.warn(
            f"{path}: no {noun} name has a subject; all are read as those of '{subject}'",
            MocapFitWarning,
            stacklevel=4,
        )
        return tuple(range(len(parts)))
    raise FileFormatError(
        "the file has no such subject",
        path=path,
        line=line,
        found=list(subjects),
        expected=f"'{subject}'",
        advice=suggest_names(subject, list(subjects)) or "Give one of the file's subjects.",
    )


def _check_subjects(
    named: Sequence[tuple[str | None, str]], path: Path, noun: str, line: int | None
) -> None:
    """Refuse two subjects with equal names."""
    owners: dict[str, str] = {}
    for owner, name in named:
        if owner is not None and owners.setdefault(name, owner) != owner:
            raise FileFormatError(
                f"two subjects have a {noun} of the same name",
                path=path,
                line=line,
                found=f"'{name}' of {owners[name]} and of {owner}",
                expected="one subject",
                advice=f"Say whose are read: --subject {owner}, or subject='{owner}' in Python.",
            )


def _make_unique(names: Sequence[str]) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return unique names, and the names that were made up with what they stand for."""
    used, numbers = set(names), dict.fromkeys(names, 1)
    seen: set[str] = set()
    unique, renamed = [], {}
    for name in names:
        new = name
        while new in (seen if new == name else used):
            numbers[name] += 1
            new = f"{name}_{numbers[name]}"
        if new != name:
            renamed[new] = name
        seen.add(new)
        used.add(new)
        unique.append(new)
    return tuple(unique), renamed


def _warn_of_equal_labels(
    renamed: Mapping[str, str], path: Path, noun: str, line: int | None
) -> None:
    listed = [f"'{label:.40}' (now also '{name:.44}')" for name, label in renamed.items()]
    location = f"{path}" if line is None else f"{path}, line {line}"
    warnings.warn(
        f"{location}: {noun} names come more than once: {', '.join(listed[:5])}"
        f"{', …' if len(listed) > 5 else ''}",
        MocapFitWarning,
        stacklevel=4,
    )


def _check_names(
    names: Sequence[str], count: int, path: Path, noun: str, line: int | None
) -> tuple[str, ...]:
    """Return the names of the caller, each in its own right."""
    details: dict[str, Any] = {"path": path, "line": line}
    if len(names) != count:
        raise FileFormatError(
            f"the file has another number of {noun} names than were given",
            found=f"{count} in the file",
            expected=f"{len(names)}, as given",
            advice="Give a name for each, in the order of the file.",
            **details,
        )
    chosen = tuple(str(name).strip() for name in names)
    positions: dict[str, int] = {}
    for position, name in enumerate(chosen):
        if not name:
            raise FileFormatError(
                f"the name given for {noun} {position + 1} is blank",
                advice="Give a name for each.",
                **details,
            )
        if positions.setdefault(name, position) < position:
            raise FileFormatError(
                f"two of the given {noun} names are the same",
                found=f"'{name}' as {noun} {positions[name] + 1} and {position + 1}",
                expected="unique names",
                **details,
            )
    return chosen
