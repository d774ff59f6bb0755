"""Files that are written completely or not at all."""

from __future__ import annotations

import contextlib
import glob
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from mocap_fit.errors import (
    ConfigurationError,
    FileFormatError,
    MocapFitError,
    from_os_error,
)
from mocap_fit.plain_text import to_unicode


@contextlib.contextmanager
def write_atomically(path: str | os.PathLike[str], noun: str = "file") -> Iterator[Path]:
    """Write a file under a temporary name and rename it when no error occurred.

    Parameters
    ----------
    path
        The file; an existing one is replaced.
    noun
        What the file is called in messages.

    Yields
    ------
    Path
        The temporary name, in the same folder. Nothing is left of it after an error.

    Raises
    ------
    FileFormatError
        If the file cannot be written, or another file that an `OSError` names cannot be read.
    MissingFileError
        If another file that an `OSError` names does not exist.
    """
    target = Path(path)
    partial = target.with_name(f".{target.name}.{os.getpid()}.partial")
    try:
        yield partial
        os.replace(partial, target)
    except MocapFitError:
        raise
    except OSError as error:
        # Errors of writing name no file, or the temporary one.
        other = error.filename
        if isinstance(other, str | os.PathLike) and Path(other) not in (partial, target):
            raise from_os_error(error, other) from None
        raise FileFormatError(
            f"the {noun} cannot be written",
            path=path,
            found=error.strerror or error,
            advice="Check that the folder exists and may be written to.",
        ) from None
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def remove_partials(path: str | os.PathLike[str]) -> None:
    """Remove what processes that were killed have left of a file that they were writing.

    Parameters
    ----------
    path
        The file.
    """
    target = Path(path)
    # On Windows there is no question about a process that does not also end it.
    partials = target.parent.glob(f".{glob.escape(target.name)}.*.partial")
    for partial in partials if os.name != "nt" else ():
        number = partial.name.removesuffix(".partial").rpartition(".")[2]
        try:
            os.kill(int(number), 0)
        except ProcessLookupError:
            with contextlib.suppress(OSError):
                partial.unlink()
        except (ValueError, OverflowError, OSError):
            continue


def write_text(path: str | os.PathLike[str], text: str, noun: str = "file") -> None:
    """Write a text file in UTF-8, completely or not at all.

    Parameters
    ----------
    path
        The file; an existing one is replaced.
    text
        The content; lines end as they end here.
    noun
        What the file is called in messages.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    with write_atomically(path, noun) as partial:
        partial.write_text(to_unicode(text), encoding="utf-8", newline="\n")


def check_targets(
    targets: Iterable[str | os.PathLike[str]], inputs: Iterable[str | os.PathLike[str] | None]
) -> None:
    """Refuse to write over a file that is read, by whatever name or link.

    Parameters
    ----------
    targets
        Files that will be written.
    inputs
        Files that are read; None, and names of what is no file, are passed over.

    Raises
    ------
    ConfigurationError
        If a target is one of them.
    """
    read = {_identify(path): path for path in inputs if path is not None}
    read.pop(None, None)
    for target in targets:
        identity = _identify(target)
        if identity in read:
            raise ConfigurationError(
                "this file is read, and would be written over",
                path=target,
                found=f"it is {os.fspath(read[identity])}",
                advice="Give another name or folder for what is written.",
            )


def check_existing(
    targets: Iterable[str | os.PathLike[str]], noun: str, *, overwrite: bool
) -> None:
    """Refuse to replace files that somebody may have corrected by hand.

    Parameters
    ----------
    targets
        Files that will be written.
    noun
        What they are called in messages, such as ``labels``.
    overwrite
        Whether the user wants them replaced.

    Raises
    ------
    ConfigurationError
        If one exists and they are not to be replaced.
    """
    present = [] if overwrite else [path for path in map(Path, targets) if os.path.lexists(path)]
    if present:
        raise ConfigurationError(
            f"there are {noun} of that name already",
            path=present[0],
            found=f"{len(present)} such files",
            advice="Give another folder, or replace them with --overwrite.",
        )


def _identify(path: str | os.PathLike[str]) -> tuple[int, int] | None:
    try:
        about = os.stat(path)
    except (OSError, ValueError):
        return None
    return about.st_dev, about.st_ino


def make_folder(path: str | os.PathLike[str]) -> None:
    """Make a folder and its parents where they do not exist.

    Parameters
    ----------
    path
        The folder.

    Raises
    ------
    ConfigurationError
        If a file is in the way, or the folder may not be made.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(
            "the folder cannot be made",
            path=path,
            found="a file of that name" if folder.is_file() else error.strerror,
            advice="Give the name of another folder.",
        ) from None
