"""``mocap-fit align``: sounds and their texts → one TextGrid of words and phones each."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mocap_fit.atomic_file import check_existing, check_targets, make_folder
from mocap_fit.errors import (
    ConfigurationError,
    DataError,
    FileFormatError,
    MissingFileError,
    MocapFitError,
    describe_error,
)
from mocap_fit.labels import to_labels, write_labels
from mocap_fit.labels.text import read_label_text
from mocap_fit.sound import SOUND_ENDINGS

if TYPE_CHECKING:
    from mocap_fit.synthesis import Aligner

_BESIDE = (".txt", ".lab")


def read_transcripts(
    sound_files: Sequence[Path], text: Path | None
) -> dict[Path, str | MocapFitError]:
    """Return what is said in each sound file.

    Parameters
    ----------
    sound_files
        The sounds.
    text
        For one sound, a file with its text; for many, a table with the name of the sound, a tab
        and its text a line (what follows a second tab is not read; a first line that names no
        sound is a heading); or a folder with NAME.txt or NAME.lab for each. None: those are
        beside the sounds.

    Returns
    -------
    dict[Path, str | MocapFitError]
        The text of each sound, or why there is none.

    Raises
    ------
    ConfigurationError
        If no sound has a text, or two have one name.
    FileFormatError
        If a text for all cannot be read, or a table has a line without a tab or two for one sound.
    """
    names = [file.stem for file in sound_files]
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
        if len(sound_files) == 1 and "\t" not in content:
            return {sound_files[0]: content}
        table: dict[str, str | MocapFitError] = dict(_parse_table(content, text, set(names)))
    else:
        if text is not None and not text.exists():
            raise MissingFileError("there is no such file or folder", path=str(text))
        table = {}
        for file in sound_files:
            folder = file.parent if text is None else text
            for ending in _BESIDE:
                beside = folder / f"{file.stem}{ending}"
                if file.stem not in table and beside.is_file():
                    try:
                        table[file.stem] = read_label_text(beside)
                    except MocapFitError as error:
                        table[file.stem] = error
    expected = "a line NAME<tab>TEXT for each, or NAME.txt or NAME.lab"
    spoken: dict[Path, str | MocapFitError] = {}
    for file in sound_files:
        spoken[file] = table.get(file.stem, "")
        if not str(spoken[file]).strip():
            spoken[file] = ConfigurationError("the sound has no text", path=file, expected=expected)
    without = [file.stem for file in sound_files if isinstance(spoken[file], ConfigurationError)]
    if len(without) == len(spoken):
        more = f" and {len(without) - 10} more" if len(without) > 10 else ""
        raise ConfigurationError(
            f"{len(without)} sounds have no text",
            path=None if text is None else str(text),
            found=", ".join(without[:10]) + more,
            expected=expected,
        )
    return spoken


def _parse_table(content: str, path: Path, names: set[str]) -> dict[str, str]:
    header = content.split("\n", 1)[0].split("\t")
    titles = [title.strip().casefold() for title in header]
    # A heading may say which column is the text, where it is not the second.
    has_heading = _get_stem(header[0]) not in names
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
        name = _get_stem(cells[0])
        if name in table:
            raise FileFormatError(f"'{name}' comes twice", path=str(path), line=number)
        table[name] = cells[column]
    return table


def _get_stem(cell: str) -> str:
    name = cell.strip()
    return name.rpartition(".")[0] if name.lower().endswith(SOUND_ENDINGS) else name


@dataclass(frozen=True, eq=False)
class AlignReport:
    """What a run of `align` has done.

    Parameters
    ----------
    out
        Folder of the labels.
    aligned
        One record per sound: ``utterance``, ``file``, ``phones`` (how many) and ``duration`` in
        seconds.
    errors
        Why sounds could not be aligned, by their names.
    """

    out: Path
    aligned: tuple[Mapping[str, Any], ...]
    errors: Mapping[str, str]

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON can hold it.

        Returns
        -------
        dict[str, Any]
            ``aligned`` and ``failed``.
        """
        failed = [{"utterance": name, "error": error} for name, error in self.errors.items()]
        return {"aligned": list(self.aligned), "failed": failed}

    def __repr__(self) -> str:
        total = len(self.aligned) + len(self.errors)
        return f"AlignReport({len(self.aligned)} of {total} sounds aligned, out={self.out})"


def align(
    sounds: Sequence[str | os.PathLike[str]],
    text: str | os.PathLike[str] | None = None,
    *,
    out: str | os.PathLike[str],
    dictionary: str | os.PathLike[str] | None = None,
    acoustic_model: str | os.PathLike[str] | None = None,
    phone_set: str | None = None,
    overwrite: bool = False,
    progress: Callable[[int, int, Exception | None], object] | None = None,
) -> AlignReport:
    """Align sounds to their texts and write ``OUT/NAME.TextGrid`` for each.

    A sound that cannot be aligned, has no text, or whose words are not in the dictionary, does not
    keep the others from it.

    Parameters
    ----------
    sounds
        Sound files.
    text
        For one sound, a file with its text; for many, a table ``NAME<tab>TEXT``, or a folder with
        NAME.txt or NAME.lab for each. By default those are beside the sounds.
    out
        Folder of the labels; created where it does not exist.
    dictionary
        A pronouncing dictionary in CMU's format; by default that of pocketsphinx.
    acoustic_model
        Folder of a model of pocketsphinx; by default its own for English.
    phone_set
        Name or file of the phone set that the model's phones are read as.
    overwrite
        Whether labels are replaced that are there already.
    progress
        Called after each sound with the number of sounds that are done, the number of all, and
        the error of this one or None.

    Returns
    -------
    AlignReport
        What was aligned; its ``errors`` names the sounds that were not.

    Raises
    ------
    MocapFitError
        If the texts or words of all sounds, or models, are missing; nothing is written then.
    """
    from mocap_fit.synthesis import Aligner

    texts = read_transcripts(list(map(Path, sounds)), None if text is None else Path(text))
    aligner = Aligner(dictionary, acoustic_model, phone_set)
    said = [words for words in texts.values() if isinstance(words, str)]
    spoken = {file: _check_words(aligner, words) for file, words in texts.items()}
    if said and not any(isinstance(words, str) for words in spoken.values()):
        # All that is missing at once.
        aligner.find_words("\n".join(said))
    folder = Path(out)
    targets = [folder / f"{file.stem}.TextGrid" for file in texts]
    check_targets(targets, [*texts, text, dictionary])
    check_existing(targets, "labels", overwrite=overwrite)
    make_folder(folder)
    aligned: list[Mapping[str, Any]] = []
    errors: dict[str, str] = {}
    for count, (sound_file, words) in enumerate(spoken.items(), start=1):
        fault = None
        try:
            phones = aligner.align(sound_file, _get_text(words))
        except Exception as error:
            fault = error
            errors[sound_file.stem] = describe_error(error, sound_file)
        else:
            file = folder / f"{sound_file.stem}.TextGrid"
            write_labels(to_labels(phones), file)
            figures = {"phones": len(phones), "duration": phones.duration}
            aligned.append({"utterance": sound_file.stem, "file": str(file), **figures})
        if progress is not None:
            progress(count, len(spoken), fault)
    return AlignReport(folder, tuple(aligned), errors)


def _check_words(aligner: Aligner, text: str | MocapFitError) -> str | MocapFitError:
    """Return a text whose words are in the dictionary, or the error."""
    if isinstance(text, str):
        try:
            aligner.find_words(text)
        except DataError as error:
            return error
    return text


def _get_text(text: str | MocapFitError) -> str:
    if isinstance(text, MocapFitError):
        raise text
    return text
