"""What a conversion has done: messages, and everything as JSON can hold it."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from corpus_tools.batch import ItemResult
from corpus_tools.conversion.entries import Entry
from mocap_fit.corpus import Corpus, open_corpus
from mocap_fit.phones import UnknownPhone

_TIMES = 5
_LISTED = 5
_WARNINGS = 10
_SYMBOLS = 30
_COUNTS = ("frames", "fitted", "duration", "phones")
_FIGURES = (*_COUNTS, "residual_mm", "head_residual_mm", "sync", "checks")


@dataclass(frozen=True, eq=False)
class ConversionReport:
    """What a run of `convert` has done.

    Parameters
    ----------
    out
        Folder of the corpus.
    layout
        Name of the marker layout; empty where no reference pose could be used.
    entries
        The utterances of the manifest.
    results
        Result of each utterance, by its id.
    unlisted
        Names of recordings that are in no row of the table of sentences.
    removed
        Utterances of an earlier conversion that are not in the corpus any more.
    seconds
        Time of the run, in seconds.
    """

    out: Path
    layout: str
    entries: Sequence[Entry]
    results: Mapping[str, ItemResult]
    unlisted: Sequence[str]
    removed: Sequence[str]
    seconds: float

    @property
    def corpus(self) -> Corpus:
        """The corpus, opened."""
        return open_corpus(self.out)

    @property
    def errors(self) -> dict[str, str]:
        """Why utterances were left out, by their ids."""
        return {name: r.error for name, r in self.results.items() if r.error is not None}

    @property
    def messages(self) -> list[str]:
        """Warnings and errors, one line each; every bad utterance is named once."""
        return format_messages(self.results, self.unlisted)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON can hold it.

        Returns
        -------
        dict[str, Any]
            Counts, a record per utterance, and times in seconds.
        """
        rows = [self._to_row(entry) for entry in self.entries]
        work: Counter[str] = Counter()
        for entry in self.entries:
            work.update(self.results[entry.id].seconds)
        good = [row for row in rows if "error" not in row]
        return {
            "out": str(self.out),
            "layout": self.layout,
            "removed": list(self.removed),
            "seconds": self.seconds,
            "converted": sum(not row["kept"] for row in good),
            "kept": sum(row["kept"] for row in good),
            "bad": len(rows) - len(good),
            "utterances": rows,
            # Summed over the processes.
            "seconds_of_work": work,
        }

    def _to_row(self, entry: Entry) -> dict[str, Any]:
        result = self.results[entry.id]
        row = {key: getattr(entry, key) for key in ("id", "speaker", "session", "split")}
        if result.error is not None:
            return {**row, "error": result.error}
        figures = {key: result.figures[key] for key in _FIGURES if key in result.figures}
        return {**row, **figures, "kept": result.cached}

    def __repr__(self) -> str:
        good = len(self.entries) - len(self.errors)
        return f"ConversionReport({good} of {len(self.entries)} utterances, out={self.out})"


def format_messages(results: Mapping[str, ItemResult], unlisted: Sequence[str] = ()) -> list[str]:
    """Return warnings and errors, one line each; every bad utterance is named once, with why.

    What is wrong with many for the same reason, such as a missing reference pose, is one line;
    symbols that are not in the phone set are one list for all.

    Parameters
    ----------
    results
        Result of each utterance, by its id.
    unlisted
        Names of recordings that are in no row of the table of sentences.

    Returns
    -------
    list[str]
        The lines.
    """
    warned: defaultdict[str, list[tuple[str, str]]] = defaultdict(list)
    for name in sorted(results):
        for line in results[name].warnings:
            warned[results[name].causes.get(line, line)].append((name, line))
    lines = [_format_cause("warning", c, each) for c, each in list(warned.items())[:_WARNINGS]]
    if len(warned) > _WARNINGS:
        lines.append(
            f"warning: {len(warned) - _WARNINGS} more: the column checks of the table has them"
        )
    reasons: defaultdict[str, list[tuple[str, str]]] = defaultdict(list)
    unknown: list[UnknownPhone] = []
    without: list[str] = []
    for name in sorted(results):
        result = results[name]
        if result.details:
            unknown += result.details
            without.append(name)
        elif result.error is not None:
            cause = result.causes.get(result.error, result.error)
            reasons[cause].append((name, result.error))
    lines += [_format_cause("error", cause, each) for cause, each in reasons.items()]
    if unlisted:
        lines.append(
            f"warning: {len(unlisted)} recordings are not in the table of sentences: "
            f"{list_names(unlisted)}"
        )
    if unknown:
        lines.append(
            f"error: {list_names(without)}: {_list_unknown(unknown)}. Correct the labels, or say "
            "what to read them as in the manifest, [labels] table"
        )
    return lines


def _format_cause(kind: str, cause: str, members: Sequence[tuple[str, str]]) -> str:
    """Return a line about what one utterance says, or several for the same cause."""
    if len(members) == 1:
        return f"{kind}: {members[0][0]}: {members[0][1]}"
    return f"{kind}: {len(members)} utterances ({list_names([n for n, _ in members])}): {cause}"


def list_names(names: Sequence[str]) -> str:
    """Return the first few names, and how many more there are.

    Parameters
    ----------
    names
        The names.

    Returns
    -------
    str
        The list in words.
    """
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more


def _list_unknown(phones: Sequence[UnknownPhone]) -> str:
    counts: Counter[str] = Counter()
    where: defaultdict[str, list[tuple[str, float]]] = defaultdict(list)
    for phone in phones:
        counts[phone.symbol] += phone.count
        where[phone.symbol] += phone.occurrences
    listed = "; ".join(
        str(UnknownPhone(symbol, counts[symbol], tuple(times[:_TIMES])))
        for symbol, times in sorted(where.items())[:_SYMBOLS]
    )
    if len(where) > _SYMBOLS:
        listed += f"; and {len(where) - _SYMBOLS} more"
    return f"{len(where)} symbols are not in the phone set: {listed}"
