"""Check the structure of a C3D file before ezc3d opens it.

ezc3d trusts the header of a file; a damaged one can make it allocate any amount of memory, or end
the process. Here the header, the chain of parameters, and the size of the data section are checked
first (layout: the C3D user guide, https://www.c3d.org).
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np

from mocap_fit.errors import FileFormatError

BLOCK = 512
_KEY = 0x50
_INTEL, _DEC, _MIPS = 84, 85, 86
LONG = 65535
"""A last frame of this number means that the header's 16 bits did not suffice."""

_MOST_SAMPLES = 10_000
"""Analog samples or rotations a frame; ezc3d allocates memory for each."""

_NUMERIC = {1: "i1", 2: "i2", 4: "f4"}


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
    return len(head) >= 2 and 1 < head[0] < 0x80 and head[1] == _KEY


@dataclass
class _Structure:
    """Header and parameters of a file."""

    path: Path
    size: int
    header: bytes
    processor: int = _INTEL
    groups: dict[int, str] = field(default_factory=dict)
    values: dict[tuple[int, str], list[float]] = field(default_factory=dict)

    @property
    def order(self) -> str:
        return ">" if self.processor == _MIPS else "<"

    def refuse(self, problem: str, value: object, expected: object = None) -> NoReturn:
        """Raise the error of a file that is damaged."""
        advice = "The file is damaged; export or copy it again."
        raise FileFormatError(
            problem, path=self.path, found=value, expected=expected, advice=advice
        )

    def get_word(self, number: int) -> int:
        """Return a word of the header, counted from 1."""
        return int(struct.unpack_from(self.order + "H", self.header, 2 * (number - 1))[0])

    def get_values(self, group: str, name: str) -> list[float]:
        """Return the first values of a numeric parameter; none where it is absent."""
        numbers = [number for number, title in self.groups.items() if title == group]
        return next(filter(None, (self.values.get((number, name)) for number in numbers)), [])

    def get_value(self, group: str, name: str) -> float | None:
        """Return the first value of a numeric parameter."""
        return next(iter(self.get_values(group, name)), None)

    def get_count(self, group: str, name: str) -> int | None:
        """Return a count, which some files store as a signed number."""
        value = self.get_value(group, name)
        if value is None or not np.isfinite(value):
            return None
        return int(value) + 65536 if -32768 <= value < 0 else int(value)

    def count_trial_frames(self) -> int | None:
        """Return the number of frames by the first and the last of the trial."""
        ends = []
        for name in ("ACTUAL_START_FIELD", "ACTUAL_END_FIELD"):
            words = self.get_values("TRIAL", name)
            if len(words) < 2:
                return None
            # A frame number is two words.
            low, high = (int(word) & 0xFFFF for word in words[:2])
            ends.append(low + 65536 * high)
        return ends[1] - ends[0] + 1


@dataclass(frozen=True)
class Extent:
    """Location of the data in a C3D file.

    Parameters
    ----------
    start
        Size of the header and the parameters before the data, bytes.
    frames
        Number of frames.
    points
        Number of points of all kinds.
    frame_size
        Size of a frame, bytes: four numbers a point, and the analog samples.
    plain_floats
        Whether the numbers are little-endian floats.
    """

    start: int
    frames: int
    points: int
    frame_size: int
    plain_floats: bool


def check_structure(path: Path) -> Extent:
    """Check a C3D file and locate its data.

    Parameters
    ----------
    path
        File to read.

    Returns
    -------
    Extent
        Location of the data.

    Raises
    ------
    FileFormatError
        If it is another kind of file, cut off, or its parts contradict each other.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(BLOCK)
        if not is_c3d(header):
            raise FileFormatError(
                "this is not a C3D file",
                path=path,
                found=header[:2].hex(" "),
                expected="02 50 as its first bytes",
                advice="Check that it is the file you mean.",
            )
        structure = _Structure(path, size, header)
        start = (header[0] - 1) * BLOCK
        if len(header) < BLOCK or size < start + 4:
            structure.refuse("the file is cut off in its header", f"{size} bytes")
        file.seek(start)
        structure.processor = file.read(4)[3]
        if structure.processor not in (_INTEL, _DEC, _MIPS):
            structure.refuse("the parameters do not name a known processor", structure.processor)
        data_start = (structure.get_word(9) - 1) * BLOCK
        if data_start < start + BLOCK or data_start > size:
            block = f"block {structure.get_word(9)}"
            structure.refuse("the data are not where the header says", block)
        # The parameters end where the data start, whatever number of blocks is noted.
        section = file.read(data_start - start - 4)
    _read_parameters(structure, section)
    return _check_counts(structure, data_start)


def _read_parameters(structure: _Structure, section: bytes) -> None:
    """Follow the chain of groups and parameters to its end."""
    position = 0
    while position + 2 <= len(section):
        length, group = struct.unpack_from("bb", section, position)
        if length == 0:
            break
        name = section[position + 2 : position + 2 + abs(length)].decode("latin-1").upper().strip()
        offset_at = position + 2 + abs(length)
        if group == 0 or offset_at + 2 > len(section):
            structure.refuse("a parameter leads out of its section", f"byte {position}")
        offset = int(struct.unpack_from(structure.order + "h", section, offset_at)[0])
        if group < 0:
            structure.groups[-group] = name
            end = offset_at + 2
        else:
            end = _read_parameter(structure, section, offset_at + 2, (group, name))
        if end >= len(section):
            structure.refuse("a parameter leads out of its section", name)
        end += 1 + section[end]
        if offset == 0:
            break
        if offset_at + offset != end or end > len(section):
            structure.refuse("the chain of parameters is broken", f"at {name}")
        position = end
    else:
        structure.refuse("the chain of parameters has no end", f"{len(section)} bytes")
    if not all((group in structure.groups) for group, _ in structure.values):
        structure.refuse("a parameter belongs to no group", "an unknown group")


def _read_parameter(
    structure: _Structure, section: bytes, position: int, key: tuple[int, str]
) -> int:
    """Store the values of a parameter, and return the position after them."""
    if position + 2 > len(section):
        structure.refuse("a parameter leads out of its section", key[1])
    kind, dimensions = struct.unpack_from("bB", section, position)
    data = position + 2 + dimensions
    # ezc3d does not survive a text without dimensions.
    if kind not in (-1, 1, 2, 4) or dimensions > 7 or (kind == -1 and dimensions == 0):
        structure.refuse("a parameter has an impossible type", key[1])
    end = data + abs(kind) * math.prod(section[position + 2 : data])
    if end > len(section):
        structure.refuse("a parameter is larger than its section", key[1])
    values: list[float] = []
    if kind > 0:
        order = "" if kind == 1 else structure.order
        array = np.frombuffer(section[data:end], dtype=np.dtype(order + _NUMERIC[kind]))
        if structure.processor == _DEC and kind == 4:
            words = np.frombuffer(section[data:end], dtype="<u2").reshape(-1, 2)
            array = words[:, ::-1].copy().reshape(-1).view("<f4") / 4
        values = array[:16].astype(np.float64).tolist()
    structure.values[key] = values
    return int(end)


def _check_counts(structure: _Structure, data_start: int) -> Extent:
    points, analog = structure.get_word(2), structure.get_word(3)
    first, last, per_frame = structure.get_word(4), structure.get_word(5), structure.get_word(10)
    if points == 0:
        structure.refuse("the file holds no points", "0 in its header")
    used = structure.get_count("POINT", "USED")
    if used is not None and used != points:
        structure.refuse("header and parameters contradict each other", used, f"{points} points")
    rate = structure.get_value("POINT", "RATE")
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        structure.refuse("the frame rate is out of range", f"{rate:g} Hz", "a number above 0")
    channels = structure.get_count("ANALOG", "USED") or 0
    if analog != channels * per_frame:
        numbers = f"{analog} analog numbers a frame"
        expected = f"{per_frame} of {channels} channels"
        structure.refuse("header and parameters contradict each other", numbers, expected)
    ratio = structure.get_count("ROTATION", "RATIO") or 0
    if max(per_frame, ratio) > _MOST_SAMPLES:
        samples = f"{max(per_frame, ratio)} samples a frame"
        structure.refuse("the header is damaged", samples, f"at most {_MOST_SAMPLES}")
    frames = last - first + 1
    if last == LONG:
        counts = [structure.get_count("POINT", name) for name in ("LONG_FRAMES", "FRAMES")]
        counts.append(structure.count_trial_frames())
        frames = max((count for count in counts if count is not None), default=frames)
    if frames < 1:
        structure.refuse("the recording has no frames", f"first {first}, last {last}")
    # The byte with the sign of the scale: negative for data stored as floats.
    sign = structure.header[{_INTEL: 15, _DEC: 13, _MIPS: 12}[structure.processor]]
    floats = bool(sign & 0x80)
    frame_size = (4 * points + analog) * (4 if floats else 2)
    needed = data_start + frames * frame_size
    if structure.size < needed:
        structure.refuse("the file is cut off in its data", f"{structure.size} bytes", needed)
    plain = floats and structure.processor == _INTEL
    return Extent(data_start, frames, points, frame_size, plain)
