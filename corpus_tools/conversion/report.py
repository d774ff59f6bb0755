"""What is told of a conversion: lines on stderr, a summary for people, JSON for programs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from corpus_tools.cli import console
from corpus_tools.conversion.manifest import Entry
from corpus_tools.conversion.utterance import Outcome
from mocap_fit.phones import UnknownPhone

_PLACES = 5
_LISTED = 5
_WARNINGS = 10
_FIGURES = (
    "frames",
    "fitted",
    "duration",
    "phones",
    "residual_mm",
    "head_residual_mm",
    "sync",
    "checks",
    "kept",
)


def lines_of(outcomes: Mapping[str, Outcome], left: Sequence[str] = ()) -> list[str]:
    """What is said on stderr: every bad utterance once, with why, and what was warned about.

    `left` are recordings that are in no row of the table of sentences.

    What is wrong with many for the same reason, such as a missing reference pose, is one line;
    symbols that are not in the phone set are one list for all.
    """
    warned = [(name, line) for name in sorted(outcomes) for line in outcomes[name].warnings]
    lines = [f"warning: {name}: {line}" for name, line in warned[:_WARNINGS]]
    if len(warned) > _WARNINGS:
        lines.append(
            f"warning: {len(warned) - _WARNINGS} more: the column checks of the table has them"
        )
    reasons: dict[str, list[str]] = {}
    for name in sorted(outcomes):
        outcome = outcomes[name]
        if outcome.error is not None and not outcome.unknown:
            reasons.setdefault(outcome.error, []).append(name)
    for reason, names in reasons.items():
        lines.append(f"error: {_some(names)}: {reason}")
    if left:
        lines.append(
            f"warning: {len(left)} recordings are not in the table of sentences: {_some(left)}"
        )
    unknown = [phone for name in sorted(outcomes) for phone in outcomes[name].unknown]
    if unknown:
        bad = [name for name in sorted(outcomes) if outcomes[name].unknown]
        lines.append(
            f"error: {_some(bad)}: {_all_unknown(unknown)}. Correct the labels, or say what to "
            "read them as in the manifest, [labels] table"
        )
    return lines


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more


def _all_unknown(phones: Sequence[UnknownPhone]) -> str:
    counts: Counter[str] = Counter()
    places: dict[str, list[tuple[str, float]]] = {}
    for phone in phones:
        counts[phone.symbol] += phone.count
        places.setdefault(phone.symbol, []).extend(phone.occurrences)
    listed = "; ".join(
        str(UnknownPhone(symbol, counts[symbol], tuple(where[:_PLACES])))
        for symbol, where in sorted(places.items())
    )
    return f"{len(places)} symbols are not in the phone set: {listed}"


def tell(entries: Sequence[Entry], outcomes: Mapping[str, Outcome]) -> dict[str, Any]:
    """All that is known, as JSON can hold it."""
    rows = []
    seconds: dict[str, float] = {}
    for entry in entries:
        outcome = outcomes[entry.id]
        about = {
            "id": entry.id,
            "speaker": entry.speaker,
            "session": entry.session,
            "split": entry.split,
        }
        known = {key: outcome.figures[key] for key in _FIGURES if key in outcome.figures}
        rows.append(
            {**about, **known} if outcome.error is None else about | {"error": outcome.error}
        )
        for part, length in outcome.seconds.items():
            seconds[part] = seconds.get(part, 0.0) + length
    good = [row for row in rows if "error" not in row]
    return {
        "converted": sum(not row["kept"] for row in good),
        "kept": sum(row["kept"] for row in good),
        "bad": len(rows) - len(good),
        "utterances": rows,
        # Summed over the processes.
        "seconds_of_work": seconds,
    }


def show(
    entries: Sequence[Entry], outcomes: Mapping[str, Outcome], about: Mapping[str, Any]
) -> None:
    """Print the summary for people."""
    told = tell(entries, outcomes)
    rows = [row for row in told["utterances"] if "error" not in row]
    bad = [row for row in told["utterances"] if "error" in row]
    screen = console.screen()

    def say(line: str) -> None:
        screen.print(console.printable(line), soft_wrap=True)

    if rows:
        splits = Counter(row["split"] for row in rows)
        parts = ", ".join(f"{count} {name}" for name, count in sorted(splits.items()))
        speakers = len({row["speaker"] for row in rows})
        sessions = len({(row["speaker"], row["session"]) for row in rows})
        minutes = sum(row["duration"] for row in rows) / 60
        frames, fitted = (sum(row[key] for row in rows) for key in ("frames", "fitted"))
        residual, head = (
            float(np.median([row[key] for row in rows]))
            for key in ("residual_mm", "head_residual_mm")
        )
        say(
            f"{parts}; {minutes:.1f} minutes, {sum(row['phones'] for row in rows)} phones, "
            f"{speakers} {_plural('speaker', speakers)}, {sessions} {_plural('session', sessions)}"
        )
        say(
            f"{fitted} of {frames} frames fitted, median residual {residual:.2f} mm "
            f"(head {head:.2f} mm)"
        )
        say(_sync([row["sync"] for row in rows]))
        noted = sum(bool(row["checks"]) for row in rows)
        if noted:
            say(f"{noted} with something to look at: the column checks of the table says what")
    if about["removed"]:
        say(f"removed, as they are bad or not in the manifest: {_some(about['removed'])}")
    if bad:
        say(f"left out, {len(bad)}: {_some([row['id'] for row in bad])}")
    done = f"{len(rows)} of {len(entries)} utterances are in the corpus"
    former = f", {told['kept']} of them from before" if told["kept"] else ""
    say(f"{done}{former}: {about['out']}")


def _sync(found: Sequence[Mapping[str, Any]]) -> str:
    """How recordings lie on the clock of the sound."""
    kinds = Counter(each["kind"] for each in found)
    parts = []
    drifts = [each["drift_ppm"] for each in found if each["kind"] == "pulses"]
    if drifts:
        missing = sum(each["missing"] for each in found if each["kind"] == "pulses")
        parts.append(
            f"{len(drifts)} by pulses ({missing} pulses missing), drift {np.median(drifts):+.1f} "
            f"ppm ({min(drifts):+.1f} to {max(drifts):+.1f})"
        )
    guesses = [each["correlation"] for each in found if each["is_estimate"]]
    if guesses:
        parts.append(
            f"{len(guesses)} ESTIMATED by lips and energy, correlation {np.median(guesses):.2f}"
        )
    if kinds["none"]:
        parts.append(f"{kinds['none']} by their start time")
    return "on the clock of the sound: " + "; ".join(parts)


def _plural(noun: str, count: int) -> str:
    return noun if count == 1 else f"{noun}s"
