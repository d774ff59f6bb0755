"""Results as JSON text: in files, and on the command line."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from typing import Any

from mocap_fit.atomic_file import write_text


def format_json(value: object) -> str:
    """Return a value as JSON text: ASCII, and null where a number is not finite.

    Parameters
    ----------
    value
        Nested mappings, sequences, numpy arrays, paths, texts, numbers.

    Returns
    -------
    str
        The text, indented.
    """
    return json.dumps(_to_plain(value), indent=2, allow_nan=False)


def write_json(path: str | os.PathLike[str], value: object) -> None:
    """Write a value to a JSON file, complete or not at all.

    Parameters
    ----------
    path
        The file; one that exists is replaced.
    value
        As `format_json` takes it: nested mappings, sequences, arrays, numbers.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    write_text(path, format_json(value) + "\n")


def _to_plain(value: Any) -> Any:
    """Return the value in the types of JSON."""
    if isinstance(value, Mapping):
        return {str(key): _to_plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_to_plain(item) for item in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):  # a numpy array or number
        return _to_plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
