"""The utterances of a manifest: from its table of sentences, or one per recording."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from corpus_tools.conversion.manifest import NAME, Manifest, Splits
from mocap_fit.corpus import draw_fraction
from mocap_fit.edits import EDITS_ENDING
from mocap_fit.errors import ConfigurationError, from_os_error
from mocap_fit.plain_text import to_unicode

_COLUMNS = ("utterance", "split", "text", "speaker", "session")


@dataclass(frozen=True)
class Entry:
    """An utterance of the manifest.

    Parameters
    ----------
    id
        Name of the utterance.
    stem
        What its files have in place of ``{id}``: the same, if it is text.
    speaker
        Name of its speaker.
    session
        Name of its session; may be empty.
    split
        Name of the part of the corpus that it is in.
    text
        What is said; may be empty.
    reference
        Path or pattern of the reference pose under the root.
    start_time
        The first frame on the clock of the sound, seconds; None for what the recording says.
    """

    id: str
    stem: str
    speaker: str
    session: str
    split: str
    text: str
    reference: str
    start_time: float | None


def find_one_file(root: Path, pattern: str) -> Path | None:
    """Return the file under the root that a pattern names; None where there is none.

    Parameters
    ----------
    root
        The folder.
    pattern
        Path under it, with wildcards.

    Returns
    -------
    Path | None
        The file.

    Raises
    ------
    ConfigurationError
        If several match.
    """
    matches = sorted(path for path in root.glob(pattern) if path.is_file() and not _is_list(path))
    if len(matches) > 1:
        raise ConfigurationError(
            f"several files match '{pattern}'",
            found=", ".join(path.name for path in matches),
            expected="one",
            advice="Give the ending in the manifest.",
        )
    return matches[0] if matches else None


def _is_list(path: Path) -> bool:
    """Whether a file is an edit list, which has the name of its recording."""
    return path.name.endswith(EDITS_ENDING)


def list_recordings(manifest: Manifest, root: Path) -> tuple[str, ...]:
    """Return the names of the recordings that exist, sorted; one that matches twice comes twice.

    Parameters
    ----------
    manifest
        The manifest.
    root
        Folder that its paths are under.

    Returns
    -------
    tuple[str, ...]
        The names.
    """
    before, after = manifest.recordings.pattern.split("{id}")
    form = re.compile(re.escape(before) + "([^/]+?)" + re.escape(after).replace(r"\*", "[^/]*"))
    paths = (path for path in root.glob(f"{before}*{after}") if not _is_list(path))
    files = (path.relative_to(root).as_posix() for path in paths)
    matches = (form.fullmatch(file) for file in sorted(files))
    return tuple(match[1] for match in matches if match)


def list_entries(
    manifest: Manifest, root: Path, former: Mapping[str, str] | None = None
) -> tuple[Entry, ...]:
    """Return the utterances, by id: those of the table or, without one, one per recording.

    Parameters
    ----------
    manifest
        The manifest.
    root
        Folder that its paths are under.
    former
        Splits that were drawn before, by id. They stay; new utterances are drawn so that the test
        has its share of all.

    Returns
    -------
    tuple[Entry, ...]
        The utterances, sorted by their ids.

    Raises
    ------
    ConfigurationError
        If the table has unknown or doubled names, or there are no utterances.
    """
    table = root / manifest.sentences.file
    if table.is_file():
        rows = _read_rows(table)
    else:
        rows = [(0, {"utterance": name}) for name in list_recordings(manifest, root)]
    if not rows:
        raise ConfigurationError(
            "there are no utterances", path=root, expected=manifest.recordings.pattern
        )
    entries: dict[str, Entry] = {}
    for line, row in rows:
        where: dict[str, Any] = {"path": table, "line": line} if line else {"path": root}
        entry = _make_entry(manifest, row, where)
        if entry.id in entries:
            raise ConfigurationError(f"the utterance '{entry.id}' is there twice", **where)
        entries[entry.id] = entry
    return _draw_splits([entries[name] for name in sorted(entries)], manifest.splits, former or {})


def _draw_splits(
    entries: Sequence[Entry], splits: Splits, former: Mapping[str, str]
) -> tuple[Entry, ...]:
    """Draw a split for those that have none, by numbers that depend on their names alone."""
    names = [entry.id for entry in entries if not entry.split]
    new = sorted(
        (n for n in names if n not in former), key=lambda name: draw_fraction(name, splits.seed)
    )
    before = sum(former.get(name) == "test" for name in names)
    test = set(new[: max(0, round(splits.test_fraction * len(names)) - before)])
    drawn = {name: former.get(name) or ("test" if name in test else "train") for name in names}
    return tuple(replace(entry, split=entry.split or drawn[entry.id]) for entry in entries)


def _read_rows(table: Path) -> list[tuple[int, dict[str, str]]]:
    try:
        text = table.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise from_os_error(error, table, "table") from None
    lines = list(csv.reader(io.StringIO(text), delimiter="\t", quoting=csv.QUOTE_NONE))
    header = lines[0] if lines else []
    unknown = [name for name in header if name not in _COLUMNS]
    if "utterance" not in header or unknown or len(set(header)) < len(header):
        raise ConfigurationError(
            "the table's columns are not those of utterances",
            path=table,
            line=1,
            found=", ".join(header),
            expected=f"utterance and any of {', '.join(_COLUMNS[1:])}, tabs between them",
        )
    rows = []
    for number, cells in enumerate(lines[1:], 2):
        if cells and len(cells) != len(header):
            raise ConfigurationError(
                "a row is not as long as the header",
                path=table,
                line=number,
                found=f"{len(cells)} cells",
                expected=str(len(header)),
            )
        if cells:
            rows.append((number, dict(zip(header, cells, strict=True))))
    return rows


def _make_entry(manifest: Manifest, row: dict[str, str], where: dict[str, Any]) -> Entry:
    name, session = row["utterance"], row.get("session", "")
    if not NAME.fullmatch(name):
        raise ConfigurationError(
            "an utterance's name cannot be a file's name", found=repr(name), **where
        )
    speakers = {speaker.id: speaker for speaker in manifest.speakers}
    speaker = row.get("speaker") or (next(iter(speakers)) if len(speakers) == 1 else "")
    if speaker not in speakers:
        raise ConfigurationError(
            f"the speaker of '{name}' is not in the manifest",
            found=repr(speaker),
            expected=", ".join(speakers),
            **where,
        )
    reference, start_time = speakers[speaker].reference, manifest.start_time
    for special in manifest.sessions:
        if (special.speaker, special.id) == (speaker, session):
            reference = special.reference or reference
            start_time = start_time if special.start_time is None else special.start_time
    split, text = row.get("split", ""), row.get("text", "")
    return Entry(to_unicode(name), name, speaker, session, split, text, reference, start_time)
