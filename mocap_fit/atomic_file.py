"""Files that are written whole or not at all."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from mocap_fit.errors import FileFormatError


@contextlib.contextmanager
def whole_file(path: str | os.PathLike[str], noun: str = "file") -> Iterator[Path]:
    """Give a name beside a file to write to, and make it the file when all went well.

    Parameters
    ----------
    path
        The file; one that exists is replaced.
    noun
        What it is called when it cannot be written.

    Yields
    ------
    Path
        The name to write to. Whatever goes wrong, nothing is left of it.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    target = Path(path)
    partial = target.with_name(f".{target.name}.{os.getpid()}.partial")
    try:
        yield partial
        os.replace(partial, target)
    except OSError as error:
        raise FileFormatError(
            f"the {noun} cannot be written",
            path=path,
            found=os.strerror(error.errno) if error.errno else error,
            advice="Check that the folder exists and may be written to.",
        ) from None
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
