"""Header and parameters of a C3D file (layout: the C3D user guide, https://www.c3d.org)."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from mocap_fit.errors import FileFormatError
from mocap_fit.io.c3d_parameters import (
    DEC,
    INTEL,
    MIPS,
    Parameter,
    Parameters,
    decode,
    read_parameters,
)

BLOCK = 512
"""Bytes."""

_KEY = 0x50
_LARGEST_SECTION = 2**20
"""Bytes of parameters that are read; the format allows 255 blocks, some files have more."""

# Some programs leave out the 83 that is added to the number of the processor.
_PROCESSORS = {code - less: code for code in (INTEL, DEC, MIPS) for less in (0, 83)}


def is_c3d(head: bytes) -> bool:
    """Return whether the first bytes are those of a C3D file.

    Parameters
    ----------
    head
        First bytes of a file.

    Returns
    -------
    bool
        Whether they are those of a C3D file.
    """
    # A PNG picture begins with 89 50.
    return len(head) >= 2 and 1 < head[0] < 0x80 and head[1] == _KEY


@dataclass(frozen=True, eq=False)
class Structure:
    """Header and parameters of a file.

    Parameters
    ----------
    path
        The file.
    size
        Its length, bytes.
    processor
        Code of the processor whose numbers it holds.
    header
        Its first 512 bytes.
    start
        Position of the parameters, bytes.
    data_start
        Position of the data, bytes.
    parameters
        Its parameters.
    damage
        What is wrong with the chain of parameters; None where nothing is.
    """

    path: Path
    size: int
    processor: int
    header: bytes
    start: int
    data_start: int
    parameters: Parameters
    damage: str | None

    @property
    def has_data(self) -> bool:
        """Whether the data can be where they are said to be."""
        in_parameters = self.start <= self.data_start < self.start + BLOCK
        return BLOCK <= self.data_start < self.size and not in_parameters

    @property
    def data_ends(self) -> list[int]:
        """Positions behind the data, bytes: other sections that may follow, and the file's end."""
        starts = [self.start]
        if self.get_value("ROTATION", "USED") > 0:
            starts.append(((self.get_count("ROTATION", "DATA_START") or 0) - 1) * BLOCK)
        return [*sorted(start for start in starts if start > self.data_start), self.size]

    def refuse(self, problem: str, value: object, expected: object = None) -> NoReturn:
        """Raise the error of a file that is damaged.

        Parameters
        ----------
        problem
            What is wrong.
        value
            What was there.
        expected
            What should have been there.

        Raises
        ------
        FileFormatError
            Always.
        """
        _refuse(self.path, problem, value, expected)

    def get_word(self, number: int) -> int:
        """Return a word of the header.

        Parameters
        ----------
        number
            Number of the word, from 1.

        Returns
        -------
        int
            The word, without a sign.
        """
        data = self.header[2 * number - 2 : 2 * number]
        return int(decode(data, 2, self.processor)[0]) % 2**16

    def get_float(self, number: int) -> float:
        """Return a float of the header.

        Parameters
        ----------
        number
            Number of its first word, from 1.

        Returns
        -------
        float
            The number, in any unit; NaN where it is infinite.
        """
        value = float(decode(self.header[2 * number - 2 : 2 * number + 2], 4, self.processor)[0])
        return value if math.isfinite(value) else math.nan

    def get_values(self, group: str, name: str) -> list[float]:
        """Return the numbers of a parameter and of its continuations, such as TIMES and TIMES2.

        Parameters
        ----------
        group
            Name of the group.
        name
            Name of the parameter.

        Returns
        -------
        list of float
            The numbers in the order of the file; none where it is absent or is text.
        """
        return [
            value
            for part in self._list_parts(group, name)
            if part.kind > 0
            for value in decode(part.data, part.kind, self.processor).tolist()
        ]

    def get_value(self, group: str, name: str) -> float:
        """Return the first number of a parameter.

        Parameters
        ----------
        group
            Name of the group.
        name
            Name of the parameter.

        Returns
        -------
        float
            The number, in any unit; NaN where there is none, or an infinite one.
        """
        value = next(iter(self.get_values(group, name)), math.nan)
        return value if math.isfinite(value) else math.nan

    def get_count(self, group: str, name: str) -> int | None:
        """Return a count, which is stored as a float, as one word or as two.

        Parameters
        ----------
        group
            Name of the group.
        name
            Name of the parameter.

        Returns
        -------
        int or None
            The count; None where it is absent.
        """
        values = self.get_values(group, name)
        if len(values) == 2 and self.parameters[group, name].kind == 2:
            low, high = (int(value) % 2**16 for value in values)
            return low + 2**16 * high
        value = self.get_value(group, name)
        if math.isnan(value):
            return None
        # A word has no sign.
        return int(value) + 2**16 if -(2**15) <= value < 0 else int(value)

    def get_texts(self, group: str, name: str) -> list[str]:
        """Return the texts of a parameter and of its continuations, such as LABELS and LABELS2.

        A parameter holds at most 255 texts; more are in parameters with a number behind the name.

        Parameters
        ----------
        group
            Name of the group.
        name
            Name of the parameter.

        Returns
        -------
        list of str
            The texts in the order of the file; none where it is absent or not text.
        """
        return [text for part in self._list_parts(group, name) for text in part.texts]

    def _list_parts(self, group: str, name: str) -> list[Parameter]:
        parts, continued = [], name
        while (group, continued) in self.parameters:
            parts.append(self.parameters[group, continued])
            continued = f"{name}{len(parts) + 1}"
        return parts


def read_structure(path: Path) -> Structure:
    """Read the header and the parameters of a C3D file.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    Structure
        Header and parameters.

    Raises
    ------
    FileFormatError
        If it is another kind of file, or cut off before its data.
    """
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        header = file.read(BLOCK)
        if not is_c3d(header):
            raise FileFormatError(
                "this is not a C3D file",
                path=path,
                found=header[:2].hex(" "),
                expected="02 50 as its first bytes",
                advice="Check that it is the file you mean.",
            )
        start = (header[0] - 1) * BLOCK
        file.seek(start)
        lead = file.read(4)
        if len(header) < BLOCK or len(lead) < 4:
            _refuse(path, "the file is cut off in its header", f"{size} bytes")
        if lead[3] not in _PROCESSORS:
            _refuse(path, "the parameters do not name a known processor", lead[3], "84, 85 or 86")
        section = file.read(_LARGEST_SECTION)
    base = Structure(path, size, _PROCESSORS[lead[3]], header, start, 0, {}, None)
    word = base.get_word(9)
    first = _add_parameters(base, section, word)
    if first.damage is None and first.has_data:
        return first
    # Two other places say where the data start.
    blocks = (first.get_count("POINT", "DATA_START") or 0, header[0] + lead[2])
    others = [_add_parameters(base, section, block) for block in blocks]
    possible = [structure for structure in (first, *others) if structure.has_data]
    if not possible:
        base.refuse("the data are not where the header says", f"block {word}")
    return next((each for each in possible if each.damage is None), possible[0])


def _add_parameters(base: Structure, section: bytes, block: int) -> Structure:
    """Return a structure whose data start in a block, with the parameters before them."""
    data_start = (block - 1) * BLOCK
    # Whatever number of blocks is noted.
    available = data_start - base.start - 4
    parameters, damage = read_parameters(
        section[:available] if available > 0 else section, base.processor
    )
    return replace(base, data_start=data_start, parameters=parameters, damage=damage)


def _refuse(path: Path, problem: str, value: object, expected: object = None) -> NoReturn:
    advice = "The file is damaged; export or copy it again."
    raise FileFormatError(problem, path=path, found=value, expected=expected, advice=advice)
