"""``mocap-fit select-sentences``: the sentences of a text that cover the most triphones."""

from __future__ import annotations

import csv
import io
import os
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from corpus_tools.cli import console
from corpus_tools.cli.console import Status
from mocap_fit.atomic_file import make_folder, write_text
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, from_os_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mocap_fit.phones.triphones import Codes, Selection, TriphoneTable

_BOUNDARY = "sil"
# How many of the missing words are shown; the file has them all.
_SHOWN = 10
_EDGES = re.compile(r"^[\W_]+|[\W_]+$")
_VARIANT = re.compile(r"\(\d+\)$")


@dataclass
class _Sentences:
    """What was read of the text: the sentences whose phones are known."""

    phones: dict[str, int] = field(default_factory=lambda: {_BOUNDARY: 0})
    texts: list[str] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    codes: list[Codes] = field(default_factory=list)
    missing: Counter[str] = field(default_factory=Counter)
    left_out: int = 0

    def number(self, phone: str) -> int:
        """The number of a phone, a new one where it is new."""
        return self.phones.setdefault(phone, len(self.phones))


def run(
    text: Path,
    *,
    count: int = 287,
    out: Path,
    dictionary: Path | None = None,
    phone_set: str | None = None,
    stress: bool = False,
    words: tuple[int, int] = (1, 1000),
    as_json: bool = False,
) -> Status:
    """Write the sentences of a text that cover the most of its triphones (Beskow section 3).

    ``OUT/sentences.txt`` has them, one a line; ``coverage.csv`` and ``coverage.png`` how much is
    covered with each more; ``missing_words.csv`` the words that the dictionary lacks.

    Parameters
    ----------
    text
        UTF-8. With a dictionary, one sentence a line; else each line is the sentence, a tab, and
        its phones with spaces between them.
    count
        How many sentences to take.
    out
        The folder to write to; made where it is not there.
    dictionary
        A word and its phones a line, as CMUdict has it; of several pronunciations the first is
        taken. Sentences with a word that it lacks are left out.
    phone_set
        A phone set's name or file: symbols that it does not have are an error.
    stress
        Whether a stressed vowel and an unstressed one are two phones; needs a phone set that
        says how stress is written. Without a phone set the symbols are taken as they are.
    words
        The fewest and the most words that a sentence may have.
    as_json
        Print what was done as one JSON object on stdout.

    Returns
    -------
    Status
        Always `DONE`; what cannot be done is raised.

    Raises
    ------
    MocapFitError
        If a file cannot be read, or no sentence is left.
    """
    from mocap_fit.drawing import save_figure
    from mocap_fit.phones.triphones import count_triphones, cover_triphones

    if count < 1 or not 1 <= words[0] <= words[1]:
        raise ConfigurationError(
            "so many sentences, or words of a sentence, cannot be",
            found=f"{count} sentences of {words[0]} to {words[1]} words",
            expected="1 or more, and the fewest words first",
        )
    found = _Sentences()
    if dictionary is None:
        _read_with_phones(text, words, found)
    else:
        _read_with_dictionary(text, dictionary, words, found)
    if not found.codes:
        raise DataError(
            "no sentence is left to choose from",
            path=text,
            found=f"{found.left_out} left out, {len(found.missing)} words not in the dictionary",
            advice="Look at the dictionary, and at how many words a sentence may have.",
        )
    codes, phones = _as_symbols(found, phone_set, stress, dictionary or text)
    table = count_triphones(codes, phones)
    with console.progress("selecting sentences", min(count, table.sentences)) as advance:
        chosen = cover_triphones(table, count, advance)
    make_folder(out)
    write_text(out / "sentences.txt", "".join(f"{found.texts[i]}\n" for i in chosen.sentences))
    rows = _coverage(found, table, chosen)
    write_text(out / "coverage.csv", _csv(rows))
    missing = [{"word": w, "count": n} for w, n in _most_first(found.missing)]
    if dictionary is not None:
        write_text(out / "missing_words.csv", _csv(missing, ("word", "count")))
    save_figure(out / "coverage.png", _figure, rows, table.kinds)
    _report(found, table, rows, missing, out, as_json)
    return Status.DONE


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The lines that are not empty, numbered from 1, with a bar that shows how far it is."""
    try:
        with path.open("rb") as stream:
            size, read, shown = max(os.fstat(stream.fileno()).st_size, 1), 0, 0
            with console.progress(f"reading {path.name} (per cent)", 100) as advance:
                for number, raw in enumerate(stream, 1):
                    line = raw.decode("utf-8").lstrip("\ufeff").strip()
                    read += len(raw)
                    while shown < 100 * read // size:
                        advance()
                        shown += 1
                    if line:
                        yield number, line
    except UnicodeDecodeError:
        raise FileFormatError(
            "the text is not UTF-8", path=path, line=number, advice="Save it as UTF-8."
        ) from None
    except (OSError, ValueError) as error:
        raise from_os_error(error, path) from None


def _read_with_phones(path: Path, words: tuple[int, int], found: _Sentences) -> None:
    for number, line in _lines(path):
        text, tab, phones = line.partition("\t")
        if not tab or not phones.split():
            raise FileFormatError(
                "a sentence has no phones",
                path=path,
                line=number,
                found=f"'{line}'",
                expected="the sentence, a tab, its phones with spaces between them",
                advice="Give a dictionary (word and phones) if the text has none.",
            )
        if words[0] <= len(text.split()) <= words[1]:
            _add(found, text, number, [found.number(phone) for phone in phones.split()])
        else:
            found.left_out += 1


def _read_with_dictionary(
    path: Path, dictionary: Path, words: tuple[int, int], found: _Sentences
) -> None:
    entries = _read_dictionary(dictionary, found)
    # What each word of the text is made of; few words make up most of a text.
    known: dict[str, tuple[list[int], list[str]] | None] = {}
    for number, line in _lines(path):
        phones: list[int] = []
        missing: list[str] = []
        count = 0
        for word in line.split():
            if word not in known:
                known[word] = _looked_up(word, entries)
            looked_up = known[word]
            if looked_up is not None:
                count += 1
                phones += looked_up[0]
                missing += looked_up[1]
        if not words[0] <= count <= words[1]:
            found.left_out += 1
        elif missing:
            found.missing.update(missing)
            found.left_out += 1
        else:
            _add(found, line, number, phones)


def _looked_up(word: str, entries: dict[str, list[int]]) -> tuple[list[int], list[str]] | None:
    """The phones of a word, and its parts that the dictionary lacks; None if it is no word."""
    token = _EDGES.sub("", word).casefold().replace("’", "'")
    if not token:
        return None
    parts = [token] if token in entries else [part for part in token.split("-") if part]
    phones = [phone for part in parts for phone in entries.get(part, [])]
    return phones, [part for part in parts if part not in entries]


def _read_dictionary(path: Path, found: _Sentences) -> dict[str, list[int]]:
    entries: dict[str, list[int]] = {}
    for number, line in _lines(path):
        if line.startswith((";;;", "##")):
            continue
        word, *phones = line.partition(" #")[0].split()
        if not phones:
            raise FileFormatError(
                "a word has no phones",
                path=path,
                line=number,
                found=f"'{line}'",
                expected="a word and its phones with spaces between them",
            )
        spelling = _VARIANT.sub("", word).casefold()
        if spelling not in entries:
            entries[spelling] = [found.number(phone) for phone in phones]
    return entries


def _add(found: _Sentences, text: str, line: int, phones: list[int]) -> None:
    import numpy as np

    if phones[0] == 0:
        phones = phones[1:]
    if phones and phones[-1] == 0:
        phones = phones[:-1]
    found.texts.append(text)
    found.lines.append(line)
    # A sentence is spoken between silences.
    found.codes.append(np.array([0, *phones, 0], dtype=np.int32))


def _as_symbols(
    found: _Sentences, phone_set: str | None, stress: bool, path: Path
) -> tuple[Iterator[Codes], int]:
    """The sentences with the phones of a set in place of the labels, and how many phones."""
    if phone_set is None:
        return iter(found.codes), len(found.phones)
    import numpy as np

    from mocap_fit.phones import PhoneSegment, load_phone_set

    chosen = load_phone_set(phone_set)
    numbers: dict[str, int] = {}
    row = np.empty(len(found.phones), dtype=np.int32)
    unknown: list[str] = []
    for label, position in found.phones.items():
        parsed = chosen.parse(chosen.silence if label == _BOUNDARY else label)
        if parsed is None:
            unknown.append(label)
            continue
        symbol = chosen.get_symbol(PhoneSegment(0, 1, *parsed), stress)
        row[position] = numbers.setdefault(symbol, len(numbers))
    if unknown:
        raise DataError(
            f"{len(unknown)} symbols are not in the phone set '{chosen.name}': {' '.join(unknown)}",
            path=path,
            advice="Give the set that the phones are written in, or add them to its file.",
        )
    return (row[codes] for codes in found.codes), len(numbers)


def _coverage(found: _Sentences, table: TriphoneTable, chosen: Selection) -> list[dict[str, Any]]:
    total = int(table.occurrences.sum())
    rows: list[dict[str, Any]] = []
    before = 0
    for rank, (sentence, covered, occurring) in enumerate(
        zip(chosen.sentences, chosen.covered, chosen.occurrences, strict=True), 1
    ):
        rows.append(
            {
                "rank": rank,
                "line": found.lines[sentence],
                "new_triphones": int(covered) - before,
                "covered_triphones": int(covered),
                "share_of_kinds": round(int(covered) / table.kinds, 6),
                "share_of_occurrences": round(int(occurring) / total, 6),
                "sentence": found.texts[sentence],
            }
        )
        before = int(covered)
    return rows


def _most_first(counts: Counter[str]) -> list[tuple[str, int]]:
    return sorted(counts.items(), key=lambda item: (-item[1], item[0]))


def _csv(rows: list[dict[str, Any]], names: tuple[str, ...] = ()) -> str:
    stream = io.StringIO()
    writer = csv.DictWriter(stream, names or tuple(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


def _figure(rows: list[dict[str, Any]], kinds: int) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axis = figure.add_subplot()
    ranks = [0, *(row["rank"] for row in rows)]
    for name, label, colour in (
        ("share_of_occurrences", "of all occurrences", "#0072B2"),
        ("share_of_kinds", f"of the {kinds:,} kinds", "#E69F00"),
    ):
        shares = [0.0, *(100 * row[name] for row in rows)]
        axis.plot(ranks, shares, color=colour, label=f"{label}: {shares[-1]:.1f} %")
    axis.set(xlabel="sentences", ylabel="triphones covered (%)", xlim=(0, ranks[-1]))
    axis.set_ylim(0, 100)
    axis.grid(visible=True)
    axis.legend(loc="best")
    return figure


def _report(
    found: _Sentences,
    table: TriphoneTable,
    rows: list[dict[str, Any]],
    missing: list[dict[str, Any]],
    out: Path,
    as_json: bool,
) -> None:
    if missing:
        named = ", ".join(f"{row['word']} ({row['count']})" for row in missing[:_SHOWN])
        more = ", …" if len(missing) > _SHOWN else ""
        console.say(f"{len(missing)} words are not in the dictionary: {named}{more}")
    last = rows[-1]
    if as_json:
        console.print_json(
            {
                "sentences": len(found.texts) + found.left_out,
                "left_out": found.left_out,
                "chosen": len(rows),
                "triphones": table.kinds,
                "covered": last["covered_triphones"],
                "share_of_kinds": last["share_of_kinds"],
                "share_of_occurrences": last["share_of_occurrences"],
                "missing_words": missing,
                "out": out,
            }
        )
        return
    console.screen().print(
        f"{len(rows)} of {len(found.texts):,} sentences ({found.left_out:,} left out) have "
        f"{last['covered_triphones']:,} of {table.kinds:,} triphones "
        f"({100 * last['share_of_kinds']:.1f} %), which are "
        f"{100 * last['share_of_occurrences']:.1f} % of all occurrences: {out}"
    )
