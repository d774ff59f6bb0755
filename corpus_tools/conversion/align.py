"""``mocap-fit align``: sound and what is said → a TextGrid of words and phones each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from corpus_tools.cli import console
from corpus_tools.cli.console import Status
from mocap_fit.atomic_file import make_folder
from mocap_fit.errors import ConfigurationError, FileFormatError, MissingFileError, MocapFitError
from mocap_fit.labels import to_labels, write_labels
from mocap_fit.labels.text import read_label_text

_BESIDE = (".txt", ".lab")


def transcripts(wavs: Sequence[Path], text: Path | None) -> dict[Path, str]:
    """What is said in each wav file.

    Parameters
    ----------
    wavs
        The sounds.
    text
        For one sound, a file with its text; for many, a table with the name of the sound, a tab
        and its text a line (what follows a second tab is not read; a first line that names no
        sound is a heading); or a folder with NAME.txt or NAME.lab for each. None: those lie
        beside the sounds.

    Raises
    ------
    ConfigurationError
        If sounds have no text, all are listed, or two have one name.
    FileFormatError
        If a file cannot be read, or a table has a line without a tab or two for one sound.
    """
    names = [wav.stem for wav in wavs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ConfigurationError(
            "two sounds have one name and would overwrite each other's labels",
            found=", ".join(twice),
            advice="Rename one, or align them into two folders.",
        )
    # A pipe is no file, and has a text all the same.
    if text is not None and text.exists() and not text.is_dir():
        content = read_label_text(text)
        if len(wavs) == 1 and "\t" not in content:
            return {wavs[0]: content}
        table = _table(content, text, set(names))
    else:
        if text is not None and not text.exists():
            raise MissingFileError("there is no such file or folder", path=str(text))
        table = {}
        for wav in wavs:
            folder = wav.parent if text is None else text
            beside = (folder / f"{wav.stem}{ending}" for ending in _BESIDE)
            found = next((path for path in beside if path.is_file()), None)
            if found is not None:
                table[wav.stem] = read_label_text(found)
    without = [name for name in names if not table.get(name, "").strip()]
    if without:
        more = f" and {len(without) - 10} more" if len(without) > 10 else ""
        raise ConfigurationError(
            f"{len(without)} sounds have no text",
            path=None if text is None else str(text),
            found=", ".join(without[:10]) + more,
            expected="a line NAME<tab>TEXT for each, or NAME.txt or NAME.lab",
        )
    return {wav: table[wav.stem] for wav in wavs}


def _table(content: str, path: Path, names: set[str]) -> dict[str, str]:
    header = content.split("\n", 1)[0].split("\t")
    titles = [title.strip().casefold() for title in header]
    # A heading may say which column is the text, where it is not the second.
    has_heading = _stem(header[0]) not in names
    column = titles.index("text") if has_heading and "text" in titles else 1
    table: dict[str, str] = {}
    for number, line in enumerate(content.split("\n"), start=1):
        if not line.strip() or (number == 1 and has_heading and len(header) > 1):
            continue
        cells = line.split("\t")
        if len(cells) <= column:
            raise FileFormatError(
                "the line has no tab between name and text",
                path=str(path),
                line=number,
                found=f"'{line}'",
                expected="NAME<tab>TEXT",
            )
        name = _stem(cells[0])
        if name in table:
            raise FileFormatError(f"'{name}' comes twice", path=str(path), line=number)
        table[name] = cells[column]
    return table


def _stem(cell: str) -> str:
    return cell.strip().removesuffix(".wav")


def run(
    wavs: Sequence[Path],
    text: Path | None,
    out: Path,
    *,
    dictionary: Path | None = None,
    acoustic_model: Path | None = None,
    phone_set: str | None = None,
) -> dict[str, Any]:
    """Align sounds to their texts and write OUT/NAME.TextGrid of each.

    A sound that cannot be aligned is reported and left out, and the rest goes on. Words that are
    not in the dictionary are asked for first, of all texts at once.

    Parameters
    ----------
    wavs
        The sounds.
    text
        As for `transcripts`.
    out
        The folder; made where it is not there.
    dictionary, acoustic_model, phone_set
        As for `mocap_fit.synthesis.Aligner`.

    Returns
    -------
    dict
        ``aligned``: a list of ``utterance``, ``file``, ``phones`` (how many) and ``duration``;
        ``failed``: a list of ``utterance`` and ``error``.

    Raises
    ------
    MocapFitError
        If texts, words or models are missing; nothing is written then.
    """
    from mocap_fit.synthesis import Aligner

    spoken = transcripts(wavs, text)
    aligner = Aligner(dictionary, acoustic_model, phone_set)
    aligner.words("\n".join(spoken.values()))
    make_folder(out)
    aligned: list[Mapping[str, Any]] = []
    failed: list[Mapping[str, Any]] = []
    with console.progress("aligning", len(spoken)) as advance:
        for wav, words in spoken.items():
            try:
                phones = aligner.align(wav, words)
            except MocapFitError as error:
                console.report(error)
                failed.append({"utterance": wav.stem, "error": str(error)})
            else:
                file = out / f"{wav.stem}.TextGrid"
                write_labels(to_labels(phones), file)
                aligned.append(
                    {
                        "utterance": wav.stem,
                        "file": str(file),
                        "phones": len(phones),
                        "duration": phones.duration,
                    }
                )
            advance()
    return {"aligned": aligned, "failed": failed}


def report(result: Mapping[str, Any], out: Path, *, as_json: bool = False) -> Status:
    """Print what `run` gave, for people or as JSON.

    Returns
    -------
    Status
        `BAD_DATA` if any sound could not be aligned.
    """
    aligned, failed = result["aligned"], result["failed"]
    if as_json:
        console.print_json(result)
    else:
        seconds = sum(one["duration"] for one in aligned)
        phones = sum(one["phones"] for one in aligned)
        console.screen().print(
            f"{len(aligned)} of {len(aligned) + len(failed)} sounds aligned: {phones} phones in "
            f"{seconds:.1f} s. Labels are in {out}.",
            soft_wrap=True,
        )
    return Status.BAD_DATA if failed else Status.DONE
