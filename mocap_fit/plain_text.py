"""Text of other people, safe to show and to store: names of files, markers and labels."""

from __future__ import annotations

import re
import unicodedata

# What a terminal or a browser obeys instead of showing it: control characters, signs that turn
# the direction of writing, halves of characters, separators of lines, what is not assigned.
_HIDDEN = {"Cc", "Cf", "Cs", "Cn", "Co", "Zl", "Zp"}
_UNUSUAL = re.compile(r"[^\n\t -~]")
_SURROGATE = re.compile("[\ud800-\udfff]")


def escape_controls(text: str) -> str:
    r"""Escape the characters that are obeyed and not shown, but for the ends of lines and tabs.

    Parameters
    ----------
    text
        Any text.

    Returns
    -------
    str
        The text with ``\x1b`` and the like for them.
    """

    def escape(match: re.Match[str]) -> str:
        if unicodedata.category(match[0]) not in _HIDDEN:
            return match[0]
        return match[0].encode("unicode_escape").decode()

    return _UNUSUAL.sub(escape, text)


def to_unicode(name: str) -> str:
    """Return the name of a file as text that every file can store.

    Parameters
    ----------
    name
        A name; Python reads bytes of it that are not UTF-8 as halves of characters.

    Returns
    -------
    str
        The name with ``%FF`` and the like for such bytes.
    """
    return _SURROGATE.sub(lambda match: f"%{ord(match[0]) & 0xFF:02X}", name)
