"""What Praat reads of a text file: free-standing numbers, quoted strings and flags.

The names and signs around them are for people. Comments begin with an exclamation mark; what is in
square brackets ("intervals [3]:") is not read.
"""

from __future__ import annotations

import math
import os
import re
from typing import Literal

from mocap_fit.errors import FileFormatError, shorten
from mocap_fit.labels.text import LARGEST_TIME

_SKIPPED = re.compile(r"(?:[\s=]++|![^\n]*+|\[[^\]\n\"]*+\]?+)++")
_TOKEN = re.compile(r'"([^"]*+(?:""[^"]*+)*+)"|[^\s"=]++')
# As in Praat, what begins as a number is one; that it is not written as one is an error.
_BEGINS_NUMBER = re.compile(r"[-+]?\.?[0-9]|--undefined--|[-+]?(?:nan|inf)\b", re.IGNORECASE)
_NUMBER = re.compile(r"([-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)(%?)")
_DIGITS = re.compile(r"[0-9]{1,15}")

TokenKind = Literal["number", "text", "flag", "end"]


def parse_number(word: str) -> float | None:
    """Parse a number of Praat.

    Parameters
    ----------
    word
        Such as ``1e-05``, ``0.5%`` or ``1/3``.

    Returns
    -------
    float or None
        The number; None for ``--undefined--`` and what is no number.
    """
    value = 1.0
    numerator, slash, denominator = word.partition("/")
    for part in (denominator, numerator) if slash else (numerator,):
        match = _NUMBER.fullmatch(part)
        if match is None or value == 0:
            return None
        value = float(match[1]) / (100 if match[2] else 1) / value
    return value


class Tokens:
    """The numbers, strings and flags of a text, one after another.

    Parameters
    ----------
    text
        The text, with line feeds as line endings.
    path
        File for messages.
    """

    def __init__(self, text: str, path: str | os.PathLike[str]) -> None:
        self.text, self.path = text, path
        self._position = self._end = 0
        self.kind: TokenKind = "end"
        """Kind of the next token; ``end`` at the end of the text."""
        self.value = ""
        """The next token; a string without its quotation marks."""
        self.advance()

    def advance(self) -> str:
        """Go to the next token.

        Returns
        -------
        str
            The token that was the next one before.

        Raises
        ------
        FileFormatError
            If a quotation mark has no end.
        """
        before = self.value
        while True:
            skipped = _SKIPPED.match(self.text, self._end)
            self._position = self._end if skipped is None else skipped.end()
            match = _TOKEN.match(self.text, self._position)
            if match is None:
                if self._position < len(self.text):
                    raise self.create_error("a quotation mark has no end", None, '"')
                self.kind, self.value = "end", "the end of the file"
                return before
            self._end, self.value = match.end(), match[0]
            if match[1] is not None:
                self.kind, self.value = "text", match[1].replace('""', '"')
            elif _BEGINS_NUMBER.match(match[0]):
                self.kind = "number"
            elif match[0].startswith("<"):
                self.kind = "flag"
            else:
                continue
            return before

    def create_error(self, problem: str, value: object, expected: str) -> FileFormatError:
        """Return the error of the next token.

        Parameters
        ----------
        problem
            What is wrong.
        value
            What is there.
        expected
            What should be there.

        Returns
        -------
        FileFormatError
            The error to raise, with the line.
        """
        return FileFormatError(
            problem,
            path=self.path,
            line=self.text.count("\n", 0, self._position) + 1,
            found=value,
            expected=expected,
            advice="Open and save it in Praat, or mend the line.",
        )

    def take(self, kind: TokenKind, expected: str) -> str:
        """Return the next token and go on.

        Parameters
        ----------
        kind
            Kind that it must have.
        expected
            What should be there, for the message.

        Returns
        -------
        str
            The token.

        Raises
        ------
        FileFormatError
            If it is of another kind, or the text has ended.
        """
        if self.kind == "end":
            raise self.create_error("the file ends too early", self.value, expected)
        if self.kind != kind:
            shown = f"{self.kind} '{shorten(self.value, 40)}'"
            raise self.create_error("this TextGrid is damaged", shown, expected)
        return self.advance()

    def take_time(self, expected: str) -> float:
        """Return the next token as a time and go on.

        Parameters
        ----------
        expected
            What should be there, for the message.

        Returns
        -------
        float
            Time, seconds.

        Raises
        ------
        FileFormatError
            If it is not a time.
        """
        time = parse_number(self.value) if self.kind == "number" else math.nan
        if time is None or abs(time) > LARGEST_TIME:
            raise self.create_error("this is not a time", f"'{shorten(self.value, 40)}'", expected)
        self.take("number", expected)
        return time

    def take_count(self, expected: str) -> int:
        """Return the next token as a number of things and go on.

        Parameters
        ----------
        expected
            What should be there, for the message.

        Returns
        -------
        int
            The number.

        Raises
        ------
        FileFormatError
            If it is not a whole number.
        """
        if self.kind == "number" and not _DIGITS.fullmatch(self.value):
            value = f"'{shorten(self.value, 40)}'"
            raise self.create_error("this is not a number of entries", value, expected)
        return int(self.take("number", expected))
