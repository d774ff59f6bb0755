"""``mocap-fit select-sentences``: the sentences of a text that cover the most triphones."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mocap_fit.atomic_file import check_targets, make_folder, write_text
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, from_os_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mocap_fit.phones.triphones import Codes, Selection, TriphoneTable

_BOUNDARY = "sil"
_EDGES = re.compile(r"^[\W_]+|[\W_]+$")
_VARIANT = re.compile(r"\(\d+\)$")


@dataclass
class _Sentences:
    """The sentences of a text whose phones are known."""

    phones: dict[str, int] = field(default_factory=lambda: {_BOUNDARY: 0})
    texts: list[str] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    codes: list[Codes] = field(default_factory=list)
    missing: Counter[str] = field(default_factory=Counter)
    left_out: int = 0

    def number(self, phone: str) -> int:
        """Return the number of a phone, the next one where it is new."""
        return self.phones.setdefault(phone, len(self.phones))


@dataclass(frozen=True, eq=False)
class SelectionReport:
    """What a run of `select_sentences` has done.

    Parameters
    ----------
    sentences
        Number of sentences of the text.
    left_out
        Number of sentences that could not be chosen: words unknown, too short or too long.
    triphones
        Number of kinds of triphones in the others.
    chosen
        One record per chosen sentence, in the order of the choice: ``rank``, ``line``,
        ``new_triphones``, ``covered_triphones``, ``share_of_kinds``, ``share_of_occurrences``
        and ``sentence``.
    missing_words
        Words that the dictionary lacks and how often they occur, the most frequent first.
    out
        Folder of the files.
    """

    sentences: int
    left_out: int
    triphones: int
    chosen: tuple[Mapping[str, Any], ...]
    missing_words: tuple[Mapping[str, Any], ...]
    out: Path

    def to_dict(self) -> dict[str, Any]:
        """Return counts and shares as JSON can hold them.

        Returns
        -------
        dict[str, Any]
            The coverage of all chosen sentences together, and the missing words.
        """
        last = self.chosen[-1]
        return {
            "sentences": self.sentences,
            "left_out": self.left_out,
            "chosen": len(self.chosen),
            "triphones": self.triphones,
            "covered": last["covered_triphones"],
            "share_of_kinds": last["share_of_kinds"],
            "share_of_occurrences": last["share_of_occurrences"],
            "missing_words": list(self.missing_words),
            "out": str(self.out),
        }

    def __repr__(self) -> str:
        share = 100 * self.chosen[-1]["share_of_kinds"]
        return (
            f"SelectionReport({len(self.chosen)} of {self.sentences} sentences with {share:.1f} % "
            f"of {self.triphones} triphones, out={self.out})"
        )


Progress = Callable[[str, int, int], object]


def select_sentences(
    text: str | os.PathLike[str],
    *,
    out: str | os.PathLike[str],
    count: int = 287,
    dictionary: str | os.PathLike[str] | None = None,
    phone_set: str | None = None,
    stress: bool = False,
    words: tuple[int, int] = (1, 1000),
    progress: Progress | None = None,
) -> SelectionReport:
    """Write the sentences of a text that cover the most of its triphones (Beskow section 3).

    ``OUT/sentences.txt`` has them, one a line; ``coverage.csv`` and ``coverage.png`` how much is
    covered with each more; ``missing_words.csv`` the words that the dictionary lacks.

    Parameters
    ----------
    text
        UTF-8. With a dictionary, one sentence a line; else each line is the sentence, a tab, and
        its phones with spaces between them.
    out
        Folder of the files; created where it does not exist.
    count
        Number of sentences.
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
    progress
        Called with what is being done, the number of steps done, and of all.

    Returns
    -------
    SelectionReport
        The chosen sentences and their coverage.

    Raises
    ------
    MocapFitError
        If a file cannot be read, or no sentence is left.
    """
    import pandas as pd

    from mocap_fit.drawing import save_figure
    from mocap_fit.phones.triphones import count_triphones, cover_triphones

    if count < 1 or not 1 <= words[0] <= words[1]:
        raise ConfigurationError(
            "so many sentences, or words of a sentence, cannot be",
            found=f"{count} sentences of {words[0]} to {words[1]} words",
            expected="1 or more, and the fewest words first",
        )
    source, folder = Path(text), Path(out)
    lexicon = None if dictionary is None else Path(dictionary)
    pool = _Sentences()
    if lexicon is None:
        _read_with_phones(source, words, pool, progress)
    else:
        _read_with_dictionary(source, lexicon, words, pool, progress)
    if not pool.codes:
        raise DataError(
            "no sentence is left to choose from",
            path=source,
            found=f"{pool.left_out} left out, {len(pool.missing)} words not in the dictionary",
            advice="Look at the dictionary, and at how many words a sentence may have.",
        )
    codes, phones = _to_symbols(pool, phone_set, stress, lexicon or source)
    table = count_triphones(codes, phones)
    total, selected = min(count, table.sentences), 0

    def advance() -> None:
        nonlocal selected
        selected += 1
        if progress is not None:
            progress("selecting sentences", selected, total)

    chosen = cover_triphones(table, count, advance)
    names = ("sentences.txt", "coverage.csv", "missing_words.csv", "coverage.png")
    check_targets([folder / name for name in names], [source, dictionary, phone_set])
    make_folder(folder)
    write_text(folder / "sentences.txt", "".join(f"{pool.texts[i]}\n" for i in chosen.sentences))
    rows = _compute_coverage(pool, table, chosen)
    write_text(folder / "coverage.csv", pd.DataFrame(rows).to_csv(index=False, lineterminator="\n"))
    words_by_count = sorted(pool.missing.items(), key=lambda item: (-item[1], item[0]))
    missing = [{"word": word, "count": times} for word, times in words_by_count]
    if lexicon is not None:
        frame = pd.DataFrame(missing, columns=["word", "count"])
        write_text(folder / "missing_words.csv", frame.to_csv(index=False, lineterminator="\n"))
    save_figure(folder / "coverage.png", _draw_coverage, rows, table.kinds)
    sentences = len(pool.texts) + pool.left_out
    return SelectionReport(
        sentences, pool.left_out, table.kinds, tuple(rows), tuple(missing), folder
    )


def _read_lines(path: Path, progress: Progress | None) -> Iterator[tuple[int, str]]:
    """Yield the lines that are not empty, numbered from 1."""
    try:
        with path.open("rb") as stream:
            size, read, shown = max(os.fstat(stream.fileno()).st_size, 1), 0, 0
            for number, raw in enumerate(stream, 1):
                line = raw.decode("utf-8").lstrip("\ufeff").strip()
                read += len(raw)
                if progress is not None and 100 * read // size > shown:
                    shown = 100 * read // size
                    progress(f"reading {path.name} (per cent)", shown, 100)
                if line:
                    yield number, line
    except UnicodeDecodeError:
        raise FileFormatError(
            "the text is not UTF-8", path=path, line=number, advice="Save it as UTF-8."
        ) from None
    except (OSError, ValueError) as error:
        raise from_os_error(error, path) from None


def _read_with_phones(
    path: Path, words: tuple[int, int], pool: _Sentences, progress: Progress | None
) -> None:
    for number, line in _read_lines(path, progress):
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
            _add_sentence(pool, text, number, [pool.number(phone) for phone in phones.split()])
        else:
            pool.left_out += 1


def _read_with_dictionary(
    path: Path,
    dictionary: Path,
    words: tuple[int, int],
    pool: _Sentences,
    progress: Progress | None,
) -> None:
    entries = _read_dictionary(dictionary, pool, progress)
    # Phones and missing parts of each word; few words make up most of a text.
    known: dict[str, tuple[list[int], list[str]] | None] = {}
    for number, line in _read_lines(path, progress):
        phones: list[int] = []
        missing: list[str] = []
        count = 0
        for word in line.split():
            if word not in known:
                known[word] = _look_up(word, entries)
            pronunciation = known[word]
            if pronunciation is not None:
                count += 1
                phones += pronunciation[0]
                missing += pronunciation[1]
        if not words[0] <= count <= words[1]:
            pool.left_out += 1
        elif missing:
            pool.missing.update(missing)
            pool.left_out += 1
        else:
            _add_sentence(pool, line, number, phones)


def _look_up(word: str, entries: dict[str, list[int]]) -> tuple[list[int], list[str]] | None:
    """Return the phones of a word and its parts that are missing; None if it is no word."""
    token = _EDGES.sub("", word).casefold().replace("’", "'")
    if not token:
        return None
    parts = [token] if token in entries else [part for part in token.split("-") if part]
    phones = [phone for part in parts for phone in entries.get(part, [])]
    return phones, [part for part in parts if part not in entries]


def _read_dictionary(
    path: Path, pool: _Sentences, progress: Progress | None
) -> dict[str, list[int]]:
    entries: dict[str, list[int]] = {}
    for number, line in _read_lines(path, progress):
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
            entries[spelling] = [pool.number(phone) for phone in phones]
    return entries


def _add_sentence(pool: _Sentences, text: str, line: int, phones: list[int]) -> None:
    import numpy as np

    if phones[0] == 0:
        phones = phones[1:]
    if phones and phones[-1] == 0:
        phones = phones[:-1]
    pool.texts.append(text)
    pool.lines.append(line)
    # A sentence is spoken between silences.
    pool.codes.append(np.array([0, *phones, 0], dtype=np.int32))


def _to_symbols(
    pool: _Sentences, phone_set: str | None, stress: bool, path: Path
) -> tuple[Iterator[Codes], int]:
    """Return the sentences in the phones of a set, and the number of different phones."""
    if phone_set is None:
        return iter(pool.codes), len(pool.phones)
    import numpy as np

    from mocap_fit.phones import PhoneSegment, load_phone_set

    chosen = load_phone_set(phone_set)
    numbers: dict[str, int] = {}
    row = np.empty(len(pool.phones), dtype=np.int32)
    unknown: list[str] = []
    for label, position in pool.phones.items():
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
    return (row[codes] for codes in pool.codes), len(numbers)


def _compute_coverage(
    pool: _Sentences, table: TriphoneTable, chosen: Selection
) -> list[dict[str, Any]]:
    total = int(table.occurrences.sum())
    covered = [int(count) for count in chosen.covered]
    occurring = [int(count) for count in chosen.occurrences]
    return [
        {
            "rank": i + 1,
            "line": pool.lines[sentence],
            "new_triphones": covered[i] - (covered[i - 1] if i else 0),
            "covered_triphones": covered[i],
            "share_of_kinds": round(covered[i] / table.kinds, 6),
            "share_of_occurrences": round(occurring[i] / total, 6),
            "sentence": pool.texts[sentence],
        }
        for i, sentence in enumerate(chosen.sentences)
    ]


def _draw_coverage(rows: list[dict[str, Any]], kinds: int) -> Figure:
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
    axis.set(xlabel="sentences", ylabel="triphones covered (%)")
    axis.set(xlim=(0, ranks[-1]), ylim=(0, 100))
    axis.grid(visible=True)
    axis.legend(loc="best")
    return figure
