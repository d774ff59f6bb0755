"""How much a file may unpack to.

A few bytes can claim gigabytes: compressed arrays, counts in headers. A reader asks `check_size`
before it unpacks or allocates what a file claims to hold.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat

from mocap_fit.errors import ConfigurationError, FileFormatError, from_os_error

VARIABLE = "MOCAP_FIT_MAX_SIZE"
"""The environment variable with the largest size, such as ``8GB``; processes inherit it."""

_DEFAULT = "2GB"
_SIZE = re.compile(r"(\d{1,15}(?:\.\d{1,6})?) ?([kmgt]?)(i?)b?", re.IGNORECASE | re.ASCII)


def measure_file(path: str | os.PathLike[str]) -> int:
    """Return the length of an ordinary file, which can be read more than once.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    int
        Bytes.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is a folder, a pipe or a device.
    """
    try:
        about = os.stat(path)
    except (OSError, ValueError) as error:
        raise from_os_error(error, path) from None
    if stat.S_ISDIR(about.st_mode):
        raise FileFormatError(
            "this is a folder", path=path, expected="a file", advice="Name a file in it."
        )
    if not stat.S_ISREG(about.st_mode):
        raise FileFormatError(
            "this is not an ordinary file",
            path=path,
            advice="Pipes and devices cannot be read twice: write it to a file first.",
        )
    return about.st_size


def sum_file(path: str | os.PathLike[str]) -> str:
    """Compute the SHA-256 of an ordinary file.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    str
        The sum, as hexadecimal digits.

    Raises
    ------
    FileFormatError
        If there is no such file, or it is a folder, a pipe or a device.
    """
    measure_file(path)
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def parse_size(text: str) -> int:
    """Return a size in bytes.

    Parameters
    ----------
    text
        Such as ``8GB`` (1000 MB), ``500 MiB`` or ``4096``.

    Returns
    -------
    int
        Bytes.

    Raises
    ------
    ConfigurationError
        If it is not a size above 0.
    """
    match = _SIZE.fullmatch(text.strip())
    base = 1024 if match is not None and match[3] else 1000
    size = int(float(match[1]) * base ** " kmgt".index(match[2].lower() or " ")) if match else 0
    if size < 1:
        raise ConfigurationError("this is not a size", found=text, expected="such as 8GB or 500MB")
    return size


def get_largest_size() -> int:
    """Return how much a file may unpack to: what `VARIABLE` says, or 2 GB.

    Returns
    -------
    int
        Bytes.

    Raises
    ------
    ConfigurationError
        If the variable does not hold a size.
    """
    return parse_size(os.environ.get(VARIABLE) or _DEFAULT)


def check_size(
    claimed_bytes: int,
    *,
    path: str | os.PathLike[str],
    available_bytes: int | None = None,
    noun: str = "file",
) -> None:
    """Refuse a file that claims more than it can hold, or more than may be unpacked.

    Parameters
    ----------
    claimed_bytes
        What the file says that it holds, in memory.
    path
        The file.
    available_bytes
        What it has room for, such as its length without the header; None where it is compressed.
    noun
        What claims it in messages, such as ``array 'weights'``.

    Raises
    ------
    FileFormatError
        If the claim is above `available_bytes`, or above the limit.
    """
    if available_bytes is not None and claimed_bytes > available_bytes:
        raise FileFormatError(
            f"the {noun} is shorter than its header says",
            path=path,
            found=format_size(available_bytes),
            expected=format_size(claimed_bytes),
            advice="It may be cut off or damaged: export or copy it again.",
        )
    largest = get_largest_size()
    if claimed_bytes > largest:
        raise FileFormatError(
            f"the {noun} claims to be larger than what may be read",
            path=path,
            found=format_size(claimed_bytes),
            expected=f"at most {format_size(largest)}",
            advice=f"If it really is so large, allow it: --max-size 8GB, or {VARIABLE}=8GB.",
        )


def format_size(size: int) -> str:
    """Return a size in words.

    Parameters
    ----------
    size
        Bytes; of any magnitude.

    Returns
    -------
    str
        Such as ``2,500,000 bytes``.
    """
    return f"{size:,} bytes" if size < 10**18 else "more than 10^18 bytes"
