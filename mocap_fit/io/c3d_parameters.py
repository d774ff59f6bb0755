"""The chain of parameters in a C3D file (layout: the C3D user guide, https://www.c3d.org).

The chain is followed by its pointers. Descriptions are not read, so that neither their length nor
their absence matters. Parameters may stand before their group; those of no group are left out.
Where a pointer leads nowhere, the chain goes on behind the entry if another one begins there.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.io.text import decode_line

INTEL, DEC, MIPS = 84, 85, 86
"""Codes of the processors whose numbers a file may hold."""

_NUMERIC = {1: "u1", 2: "i2", 4: "f4"}
_NAME = re.compile(rb"[ -~]+")


@dataclass(frozen=True)
class Parameter:
    """A parameter as it is stored.

    Parameters
    ----------
    kind
        Bytes of a number; -1 for text.
    dimensions
        Size of each dimension, of which the first runs fastest; none for a single value.
    data
        The values.
    """

    kind: int
    dimensions: tuple[int, ...]
    data: bytes

    @property
    def texts(self) -> list[str]:
        """The texts; none where it holds numbers."""
        length = self.dimensions[0] if self.dimensions else 1
        if self.kind != -1 or length == 0:
            return []
        texts = (self.data[at : at + length] for at in range(0, len(self.data), length))
        return [decode_line(text.split(b"\0")[0]).strip() for text in texts]


Parameters = Mapping[tuple[str, str], Parameter]
"""Parameters by the names of their group and themselves, in upper case."""


def decode(data: bytes, kind: int, processor: int) -> NDArray[Any]:
    """Return numbers as a processor stores them.

    Parameters
    ----------
    data
        Bytes of the numbers.
    kind
        Bytes of a number: 1, 2 or 4; the last are floats.
    processor
        Code of the processor.

    Returns
    -------
    ndarray
        The numbers, ``(numbers,)``, in any unit.
    """
    if kind == 4 and processor == DEC:
        # The words of a float stand the other way round, and its exponent is larger by 2.
        words = np.frombuffer(data, dtype="<u2").reshape(-1, 2)
        with np.errstate(all="ignore"):
            return words[:, ::-1].copy().reshape(-1).view("<f4") / np.float32(4)
    return np.frombuffer(data, dtype=(">" if processor == MIPS else "<") + _NUMERIC[kind])


def read_parameters(section: bytes, processor: int) -> tuple[Parameters, str | None]:
    """Read the parameters of a section.

    Parameters
    ----------
    section
        The section without its first four bytes.
    processor
        Code of the processor.

    Returns
    -------
    parameters : dict
        The parameters.
    damage : str or None
        What is wrong with the chain; None where nothing is.
    """
    groups: dict[int, str] = {}
    entries: list[tuple[int, str, Parameter]] = []
    damage, position = None, 0
    filled = len(section.rstrip(b"\0"))
    if not _is_entry(section, 0):
        return {}, "it has no beginning"
    while True:
        length, number = struct.unpack_from("bb", section, position)
        pointer_at = position + 2 + abs(length)
        name = section[position + 2 : pointer_at].decode("latin-1").upper().strip("\0 ")
        offset = int(decode(section[pointer_at : pointer_at + 2], 2, processor)[0]) % 2**16
        target, end = pointer_at + offset, pointer_at + 2
        if number < 0:
            groups.setdefault(-number, name)
        else:
            parameter, end = _cut_parameter(section, end, target if offset else len(section))
            if parameter is not None:
                entries.append((number, name, parameter))
            else:
                damage = damage or f"{name} is larger than its room, or of an unknown type"
        if offset == 0:
            break
        # Behind the values stands a description with its length, if anything does.
        described = end + 1 + (section[end] if end < len(section) else 0)
        is_usual = target in (end, described)
        if target > position and _is_entry(section, target, is_usual):
            position = target
        elif is_usual or described >= filled:
            break
        else:
            damage = damage or f"the pointer of {name} leads nowhere"
            if not _is_entry(section, described):
                break
            position = described
    return {(groups[key], name): each for key, name, each in entries if key in groups}, damage


def _is_entry(section: bytes, position: int, any_name: bool = False) -> bool:
    """Return whether a group or a parameter begins at a position."""
    if position + 4 >= len(section):
        return False
    length, number = struct.unpack_from("bb", section, position)
    end = position + 2 + abs(length)
    is_named = any_name or _NAME.fullmatch(section, position + 2, end) is not None
    return length != 0 and number != 0 and end + 2 < len(section) and is_named


def _cut_parameter(section: bytes, position: int, target: int) -> tuple[Parameter | None, int]:
    """Return the parameter whose type is at a position, or None, and where it ends."""
    if position + 2 > len(section):
        return None, position
    kind, count = struct.unpack_from("bB", section, position)
    data = position + 2 + count
    dimensions = tuple(section[position + 2 : data])
    end = data + abs(kind) * math.prod(dimensions)
    if kind not in (-1, 1, 2, 4) or end > min(target, len(section)):
        return None, position
    return Parameter(kind, dimensions, section[data:end]), end
