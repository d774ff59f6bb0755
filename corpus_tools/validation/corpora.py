"""Checks of a corpus: its files, its table, its provenance, and what lies between utterances."""

from __future__ import annotations

import hashlib
import itertools
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, TypeVar

import numpy as np

from corpus_tools.validation import geometry
from corpus_tools.validation.findings import Finding, Location
from corpus_tools.validation.parameters import check_closures
from corpus_tools.validation.reading import FOLDERS, Checked, describe_failure, read_utterance
from corpus_tools.validation.subject import Context, Subject, Summary, check_subject
from corpus_tools.validation.tables import check_table, read_frame
from corpus_tools.validation.thresholds import Thresholds
from mocap_fit.corpus import DESCRIPTION_FILE, Corpus, Utterance, open_corpus
from mocap_fit.errors import MocapFitError
from mocap_fit.face import load_face
from mocap_fit.fitting import load_layout
from mocap_fit.tracks import Provenance
from mocap_fit.tracks.parquet_file import read_description
from mocap_fit.utterance import UTTERANCES_FILE

# Files that are no part of a corpus and yet no rest: others keep notes beside their data.
_ALLOWED = re.compile(r"readme.*|licen[cs]e.*|.*\.md|.*\.txt", re.IGNORECASE)
# Beginnings of the conversion's remarks that MF126, MF143 and MF144 judge by thresholds.
_JUDGED = ("the head's pose is not known in", "the recording goes on", "the start time")
_Loaded = TypeVar("_Loaded")
# So many recordings of a folder tell what is usual in it.
_TELLING = 4


@dataclass(frozen=True, eq=False)
class Opened:
    """A corpus and what its utterances are compared with.

    Parameters
    ----------
    corpus
        The corpus.
    context
        What its utterances are compared with.
    wanted
        Folders that must have a file of every utterance.
    folder
        The folder of the corpus.
    shown
        The folder, as the user named it.
    """

    corpus: Corpus
    context: Context
    wanted: tuple[str, ...]
    folder: Path
    shown: str


def open_for_checks(folder: Path, context: Context) -> tuple[Opened | None, list[Finding]]:
    """Open a corpus and check what is about all of it.

    Parameters
    ----------
    folder
        As the user named it.
    context
        The thresholds; its layout, face, phone set and rate take the place of the corpus's own
        where they are given.

    Returns
    -------
    opened
        None where it cannot be opened.
    findings
        Of its table, files and provenance.
    """
    shown = str(folder)
    findings: list[Finding] = []
    table = os.path.join(shown, UTTERANCES_FILE)
    try:
        frame, _ = read_frame(folder / UTTERANCES_FILE, ("utterances",))
        findings += check_table(frame, "utterances", (), Location(table))
    except MocapFitError:
        # Opening the corpus says the same, and more.
        pass
    try:
        corpus = open_corpus(folder)
    except MocapFitError as error:
        file = error.path or os.path.join(shown, DESCRIPTION_FILE)
        findings.append(describe_failure(error, str(file)))
        return None, findings
    layout, rig = context.layout, context.rig
    description = Location(os.path.join(shown, DESCRIPTION_FILE))
    if layout is None and corpus.layout:
        layout, more = _load(load_layout, "layout", folder, corpus.layout, description)
        findings += more
    if rig is None and corpus.face:
        rig, more = _load(load_face, "face", folder, corpus.face, description)
        findings += more
    elif rig is None:
        text = "the corpus does not name its face"
        expected = "the bounds of its parameters, and its lips"
        findings.append(Finding("MF003", description.at("face"), text, expected))
    context = replace(
        context,
        layout=layout,
        rig=rig,
        phone_set=context.phone_set or corpus.phone_set,
        rate=context.rate or corpus.rate or _estimate_rate(corpus),
    )
    wanted = _list_wanted(folder, corpus)
    findings += _check_files(folder, shown, corpus)
    findings += _check_splits(corpus, shown, context.limits)
    findings += check_provenance(corpus.provenance, (), description)
    return Opened(corpus, context, wanted, folder, shown), findings


def locate_utterance(opened: Opened, utterance: Utterance) -> Location:
    """Return the location of an utterance as such.

    Parameters
    ----------
    opened
        The corpus.
    utterance
        The utterance.

    Returns
    -------
    Location
        The file of its tracks.
    """
    return Location(os.path.join(opened.shown, "tracks", f"{utterance.id}.parquet"), utterance.id)


def check_utterance(opened: Opened, utterance: Utterance) -> Checked:
    """Read an utterance and check it; only the summary of its data stays in memory.

    Parameters
    ----------
    opened
        The corpus.
    utterance
        The utterance.

    Returns
    -------
    findings
        What is wrong.
    summaries
        What the checks of the whole corpus need of it.
    """
    limits = opened.context.limits
    subject, findings = read_utterance(utterance, opened.shown, opened.wanted, limits)
    parameters = subject.parameters
    if parameters is not None:
        location = subject.get_location("parameters")
        if parameters.names != opened.corpus.parameter_names:
            expected = ", ".join(opened.corpus.parameter_names)
            findings.append(Finding("MF311", location, ", ".join(parameters.names), expected))
        steps = limits.corpus.steps
        findings += check_provenance(parameters.provenance, steps, location)
    findings += _check_conversion(opened.folder, subject)
    table = Location(os.path.join(opened.shown, UTTERANCES_FILE), utterance.id, "checks")
    remarks = [remark for remark in utterance.checks if not remark.startswith(_JUDGED)]
    findings += [Finding("MF514", table, remark) for remark in remarks]
    more, summary = check_subject(subject, opened.context)
    return findings + more, [summary]


def check_provenance(
    provenance: Provenance, steps: Sequence[str], location: Location
) -> Iterator[Finding]:
    """Find a provenance that is missing, lacks a step, or names paths of one computer.

    Parameters
    ----------
    provenance
        The steps that led to the data.
    steps
        Names of the steps that must be there.
    location
        The file and the utterance.

    Yields
    ------
    Finding
        What is wrong.
    """
    if not provenance:
        wanted = f" with {', '.join(steps)}" if steps else ""
        yield Finding("MF509", location, "no step", f"the steps that led here{wanted}")
        return
    names = [step.name for step in provenance]
    lacking = [name for name in steps if name not in names]
    if lacking:
        text = f"the steps are {', '.join(names)}"
        yield Finding("MF510", location.at(", ".join(lacking)), text, f"{', '.join(lacking)} too")
    for step in provenance:
        for path in _check_texts(step.arguments):
            if PurePosixPath(path).is_absolute() or PureWindowsPath(path).is_absolute():
                yield Finding("MF511", location.at(step.name), path, "a relative path")


def _check_conversion(folder: Path, subject: Subject) -> Iterator[Finding]:
    """Find files of an utterance that were made from others, or changed since."""
    name = subject.name
    noted: dict[str, Mapping[str, Any]] = {}
    for part, (_, ending, data) in FOLDERS.items():
        if ending != "parquet" or data not in subject.files:
            continue
        described = read_description(folder / part / f"{name}.parquet") or {}
        steps = described.get("provenance") or [{}]
        if isinstance(steps[-1], dict) and steps[-1].get("step") == "convert":
            noted[data] = steps[-1].get("arguments", {})
    first = noted.get("parameters")
    if first is None:
        return
    for data, arguments in noted.items():
        if arguments.get("inputs") != first.get("inputs"):
            where = Location(subject.files[data], name, "inputs")
            text = f"the {data} were made from other files than the parameters"
            yield Finding("MF504", where, text, "one conversion")
    if "sound" in subject.files and "audio" in first:
        with open(folder / "audio" / f"{name}.wav", "rb") as stream:
            content = hashlib.file_digest(stream, "sha256").hexdigest()
        if content != first["audio"]:
            where = Location(subject.files["sound"], name, "content")
            text = "the sound is not the one that was converted"
            yield Finding("MF504", where, text, "a file that was not changed since")


def _check_texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        for item in value.values():
            yield from _check_texts(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _check_texts(item)


def check_between(
    summaries: Sequence[Summary], limits: Thresholds, splits: bool
) -> Iterator[Finding]:
    """Compare utterances with each other: shapes, clocks, lips, rates of sound, duplicates.

    Parameters
    ----------
    summaries
        Of all utterances.
    limits
        What counts as wrong.
    splits
        Whether they are in splits.

    Yields
    ------
    Finding
        What is wrong.
    """
    for members in _group_by(summaries, lambda s: (s.speaker, s.session)):
        shapes = [member.shape for member in members if member.shape is not None]
        yield from geometry.check_sessions(shapes, limits)
        yield from _check_offset(members, limits)
    for members in _group_by(summaries, lambda s: s.speaker):
        spans = np.array([m.lips for m in members if m.lips is not None]).reshape(-1, 2)
        closures = [closure for member in members for closure in member.closures]
        yield from check_closures(closures, spans, limits)
    if not splits:
        yield from _check_rates(summaries, limits)
    yield from _check_sampling(summaries)
    yield from _check_duplicates(summaries, limits, splits)


def _group_by(
    summaries: Iterable[Summary], key: Callable[[Summary], Any]
) -> Iterable[list[Summary]]:
    groups: dict[Any, list[Summary]] = {}
    for summary in summaries:
        groups.setdefault(key(summary), []).append(summary)
    return groups.values()


def _check_offset(members: Sequence[Summary], limits: Thresholds) -> Iterator[Finding]:
    rules = limits.time
    usable = [m.offset for m in members if m.offset and m.offset[1] >= rules.offset_correlation]
    if len(usable) < rules.offset_utterances:
        return
    # Single estimates are a syllable off; their middle is not.
    middle = float(np.median([offset for offset, _ in usable]))
    if abs(middle) > rules.offset:
        session = " ".join(part for part in (members[0].speaker, members[0].session) if part)
        where = Location(os.path.dirname(os.path.dirname(members[0].location.file)), "", session)
        late = f"{abs(middle):.3f} s {'late' if middle > 0 else 'early'}"
        text = f"frames are {late}, by {len(usable)} utterances"
        yield Finding("MF147", where, text, f"at most {rules.offset} s")


def _check_rates(summaries: Sequence[Summary], limits: Thresholds) -> Iterator[Finding]:
    """Find recordings of a folder whose rate is not that of most others."""
    usable = [summary for summary in summaries if "rate" in summary.figures]
    if len(usable) < _TELLING:
        return
    usual = float(np.median([summary.figures["rate"] for summary in usable]))
    others = [s for s in usable if abs(s.figures["rate"] / usual - 1) > limits.time.rate]
    # Of a mixture of recordings none is wrong.
    if len(others) <= len(usable) // _TELLING:
        for summary in others:
            rate = summary.figures["rate"]
            yield Finding("MF141", summary.location, f"{rate:g} Hz", f"{usual:g} Hz, as the others")


def _check_sampling(summaries: Sequence[Summary]) -> Iterator[Finding]:
    rates = [s.figures["sound_rate"] for s in summaries if "sound_rate" in s.figures]
    if not rates:
        return
    values, counts = np.unique(rates, return_counts=True)
    usual = float(values[int(np.argmax(counts))])
    for summary in summaries:
        rate = summary.figures.get("sound_rate", usual)
        if rate != usual:
            yield Finding("MF403", summary.sound_location, f"{rate:g} Hz", f"{usual:g} Hz")


def _check_duplicates(
    summaries: Sequence[Summary], limits: Thresholds, splits: bool
) -> Iterator[Finding]:
    reported: set[tuple[str, str]] = set()
    for kind, code in (("recording", "MF505"), ("parameters", "MF505"), ("sound", "MF506")):
        printed = [summary for summary in summaries if kind in summary.prints]
        for members in _group_by(printed, lambda summary: summary.prints[kind]):  # noqa: B023
            for one, other in itertools.pairwise(members):
                across = splits and one.split != other.split
                pair = (one.name, other.name)
                if pair in reported and (not across or code == "MF505"):
                    continue
                reported.add(pair)
                where = Location(other.location.file, other.name, one.name)
                text = f"the {kind} of '{other.name}' is that of '{one.name}'"
                text += f" ('{one.split}' and '{other.split}')" if across else ""
                yield Finding(code if across else "MF508", where, text, "each once")
    if not splits:
        return
    usable = [s for s in summaries if len(s.text.split()) >= limits.corpus.shortest_text]
    for members in _group_by(usable, lambda s: " ".join(re.findall(r"\w+", s.text.casefold()))):
        if len({member.split for member in members}) > 1:
            first = members[0]
            other = next(member for member in members if member.split != first.split)
            where = Location(other.location.file, other.name, first.name)
            text = f"'{first.text}' is said in '{first.split}' and in '{other.split}'"
            yield Finding("MF507", where, text, "each text in one split")


def _load(
    load: Callable[[str | Path], _Loaded], noun: str, folder: Path, name: str, location: Location
) -> tuple[_Loaded | None, list[Finding]]:
    """Load the layout or the face that a corpus names, in its folder or shipped."""
    try:
        return load(folder / name if (folder / name).is_file() else name), []
    except MocapFitError as error:
        problem = f"the {noun} '{name}' is not known: {error.problem}"
        return None, [Finding("MF003", location.at(noun), problem)]


def _estimate_rate(corpus: Corpus) -> float | None:
    """Return the median rate of the utterances: on the sound's clock they differ by millionths."""
    rates = []
    for utterance in corpus:
        file = corpus.folder / "tracks" / f"{utterance.id}.parquet"  # type: ignore[operator]
        rate = (read_description(file) or {}).get("rate")
        if isinstance(rate, int | float) and rate > 0:
            rates.append(float(rate))
    return float(np.median(rates)) if len(rates) >= 3 else None


def _list_wanted(folder: Path, corpus: Corpus) -> tuple[str, ...]:
    """Folders that must have a file of every utterance: a part that most have, all must have."""
    wanted = []
    for name, (_, ending, _) in FOLDERS.items():
        count = sum((folder / name / f"{u.id}.{ending}").is_file() for u in corpus)
        if name in ("tracks", "phones") or 2 * count > len(corpus):
            wanted.append(name)
    return tuple(wanted)


def _check_files(folder: Path, shown: str, corpus: Corpus) -> Iterator[Finding]:
    ids = {utterance.id for utterance in corpus}
    for path in sorted(folder.rglob("*")):
        if not path.is_file():
            continue
        inside = path.relative_to(folder)
        name = os.path.join(shown, *inside.parts)
        if path.name.endswith(".partial"):
            yield Finding("MF513", Location(name), "a file that was not written to its end")
            continue
        if any(part.startswith(".") for part in inside.parts) or len(inside.parts) == 1:
            continue
        content = FOLDERS.get(inside.parts[0])
        if content is None or len(inside.parts) > 2 or _ALLOWED.fullmatch(path.name):
            continue
        expected = f"a file in .{content[1]} for each of the {len(ids)} utterances"
        if path.stem not in ids:
            text = f"there is no utterance '{path.stem}'"
            yield Finding("MF502", Location(name), text, expected)
        elif path.suffix != f".{content[1]}":
            yield Finding("MF502", Location(name), f"a file in {path.suffix}", expected)


def _check_splits(corpus: Corpus, shown: str, limits: Thresholds) -> Iterator[Finding]:
    lacking = [name for name in limits.corpus.splits if name not in corpus.splits]
    if lacking:
        where = Location(os.path.join(shown, UTTERANCES_FILE), "", ", ".join(lacking))
        text = f"the splits are {', '.join(corpus.splits) or 'none'}"
        yield Finding("MF512", where, text, ", ".join(limits.corpus.splits))
