"""TOML and JSON of other people: values as a program expects them, or one kind of error.

The parsers of Python also take integers of any length, and nesting as deep as their stack, which
then fail wherever such a value is used, compared or printed.
"""

from __future__ import annotations

import json
import re
import tomllib
from typing import Any

_DEEPEST = 100
_INTEGERS = range(-(2**63), 2**64)
# A key of many parts, for which tomllib (3.13) takes time by the square of their number.
_DEEP_KEY = re.compile(
    r"""(?:^|[\n,{\[])[ \t]*+(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){100}"""
)


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML.

    Parameters
    ----------
    text
        The content of a file.

    Returns
    -------
    dict
        The tables and values.

    Raises
    ------
    ValueError
        If it is not TOML, an integer has more than 64 bits, or values are nested too deeply.
    """
    if _DEEP_KEY.search(text):
        raise _create_depth_error()
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise _create_depth_error() from None
    _check_values(content)
    return content


def parse_json(text: str | bytes) -> Any:
    """Parse JSON.

    Parameters
    ----------
    text
        The text; bytes are UTF-8.

    Returns
    -------
    object
        The value.

    Raises
    ------
    ValueError
        If it is not JSON, an integer has more than 64 bits, or values are nested too deeply.
    """
    try:
        content = json.loads(text)
    except RecursionError:
        raise _create_depth_error() from None
    _check_values(content)
    return content


def _check_values(content: object) -> None:
    # Level by level: functions that call themselves would meet the limit of the stack.
    level = [content]
    for _ in range(_DEEPEST):
        below: list[object] = []
        for value in level:
            if isinstance(value, dict):
                below += value.values()
            elif isinstance(value, list):
                below += value
            elif isinstance(value, int) and value not in _INTEGERS:
                raise ValueError("an integer has more than 64 bits")
        if not below:
            return
        level = below
    raise _create_depth_error()


def _create_depth_error() -> ValueError:
    return ValueError(f"values are nested more than {_DEEPEST} levels deep")
