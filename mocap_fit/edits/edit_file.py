"""Files of edit lists: ``RECORDING.edits.toml`` beside the recording, or elsewhere.

A list names its recording by the SHA-256 of the file::

    format_version = 1
    recording = "take_01.tsv"
    sha256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"

    [[edits]]
    edit = "swap"
    markers = ["lip_upper", "lip_lower"]
    start = 1.0
    end = 1.5
"""

from __future__ import annotations

import os
from pathlib import Path

from mocap_fit.atomic_file import write_text
from mocap_fit.edits.edit_list import EditList
from mocap_fit.errors import ConfigurationError
from mocap_fit.plain_text import to_unicode
from mocap_fit.settings_file import load_settings
from mocap_fit.size_limit import sum_file

EDITS_ENDING = ".edits.toml"
"""What follows the name of the recording's file."""

_NOUN = "edit list"


def locate_edits(
    recording: str | os.PathLike[str], edits: str | os.PathLike[str] | None = None
) -> Path | None:
    """Return where the edit list of a recording is.

    Parameters
    ----------
    recording
        The recording.
    edits
        The edit list, or the folder of the lists; beside the recording where left out.

    Returns
    -------
    Path or None
        The list; None where the recording has none.
    """
    path = Path(recording)
    if edits is not None and not Path(edits).is_dir():
        return Path(edits)
    folder = path.parent if edits is None else Path(edits)
    beside = folder / f"{path.name}{EDITS_ENDING}"
    return beside if beside.is_file() else None


def read_edits(path: str | os.PathLike[str]) -> EditList:
    """Read an edit list, whatever recording it is for.

    Parameters
    ----------
    path
        The TOML file.

    Returns
    -------
    EditList
        The list.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it cannot be read.
    ConfigurationError
        If it is not TOML, an edit is unknown, or a value is missing or impossible; the message
        says where.
    """
    return load_settings(EditList, path, noun=_NOUN)


def load_edits(
    recording: str | os.PathLike[str], edits: str | os.PathLike[str] | None = None
) -> EditList | None:
    """Load the edit list of a recording, and check that it is for this one.

    Parameters
    ----------
    recording
        The recording.
    edits
        The edit list, or the folder of the lists; beside the recording where left out.

    Returns
    -------
    EditList or None
        The list; None where the recording has none.

    Raises
    ------
    ConfigurationError
        If it is wrong, or for another recording.
    FileFormatError
        If it or the recording cannot be read.
    """
    path = locate_edits(recording, edits)
    if path is None:
        return None
    result = read_edits(path)
    digest = sum_file(recording)
    if digest != result.sha256:
        raise ConfigurationError(
            "the edit list was made for another recording",
            path=path,
            found=f"{os.fspath(recording)} with the SHA-256 {digest}",
            expected=f"{result.recording or 'a file'} with {result.sha256}",
            advice="If the recording was exported again, look whether the edits still hold, and "
            "put the new sum into the list; else remove the list.",
        )
    return result


def start_edits(recording: str | os.PathLike[str]) -> EditList:
    """Return an empty edit list for a recording.

    Parameters
    ----------
    recording
        The recording.

    Returns
    -------
    EditList
        The list; its method ``add`` returns longer ones.

    Raises
    ------
    FileFormatError
        If the recording cannot be read.
    """
    return EditList(recording=to_unicode(Path(recording).name), sha256=sum_file(recording))


def write_edits(edits: EditList, path: str | os.PathLike[str]) -> None:
    """Write an edit list, completely or not at all.

    Parameters
    ----------
    edits
        The list.
    path
        The TOML file; an existing one is replaced.

    Raises
    ------
    FileFormatError
        If it cannot be written.
    """
    import tomli_w

    write_text(path, tomli_w.dumps(edits.model_dump(mode="json", exclude_none=True)), _NOUN)
