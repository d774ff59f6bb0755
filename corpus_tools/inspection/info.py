"""``mocap-fit info``: what files hold."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from corpus_tools.inspection.contents import describe_contents
from corpus_tools.inspection.descriptions import describe_shipped
from corpus_tools.validation.reading import list_files
from mocap_fit.corpus import DESCRIPTION_FILE
from mocap_fit.errors import describe_error
from mocap_fit.io import ReadOptions


@dataclass(frozen=True, eq=False)
class Info:
    """What files hold.

    Parameters
    ----------
    contents
        One record per file, in their order; that of a bad file has ``file`` and ``error``.
    """

    contents: tuple[Mapping[str, Any], ...]

    @property
    def errors(self) -> dict[str, str]:
        """Why files cannot be read, by their paths."""
        return {each["file"]: each["error"] for each in self.contents if "error" in each}

    def __repr__(self) -> str:
        kinds = ((each["file"], each.get("content") or each["error"]) for each in self.contents)
        return f"Info({', '.join(f'{file}: {kind}' for file, kind in kinds)})"


def info(
    files: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] = (),
    *,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
    rename: Mapping[str, str] | None = None,
    progress: Callable[[Mapping[str, Any], Exception | None], object] | None = None,
) -> Info:
    """Describe files; a bad one does not keep the others from being described.

    Parameters
    ----------
    files
        Recordings, labels, sound, trained models, corpora, layouts, phone sets, manifests, rig
        files, edit lists, and folders of such files; also names of shipped layouts and phone sets.
        Without any, what is shipped is described.
    rate
        Frame rate of the recordings, hertz, in place of what the files say.
    unit
        Unit of length of the files, such as ``m``, in place of what they say.
    subject
        Subject whose markers are read, where files name several.
    rename
        New names of markers by those in the files.
    progress
        Called after every file with its record, and its error or None.

    Returns
    -------
    Info
        Records of the files.
    """
    options = ReadOptions(rate, unit, subject, rename or {})
    listed = [files] if isinstance(files, (str, os.PathLike)) else files
    contents: list[Mapping[str, Any]] = []
    if not listed:
        contents.append(describe_shipped())
        if progress is not None:
            progress(contents[0], None)
    for file in (file for path in listed for file in _list_files(path)):
        fault: Exception | None = None
        try:
            content: Mapping[str, Any] = describe_contents(file, options)
        except Exception as error:
            fault = error
            content = {"file": os.fspath(file), "error": describe_error(error, file)}
        contents.append(content)
        if progress is not None:
            progress(content, fault)
    return Info(tuple(contents))


def _list_files(path: str | os.PathLike[str]) -> Sequence[str | os.PathLike[str]]:
    """Return a folder that is no corpus, and its files as `validate` takes them; or the path."""
    folder = Path(path)
    if not folder.is_dir() or (folder / DESCRIPTION_FILE).is_file():
        return [path]
    files, unknown = list_files(folder)
    return [path, *sorted([*files, *unknown])]
