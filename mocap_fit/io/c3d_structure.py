"""A look at a C3D file's own plan before ezc3d opens it.

ezc3d believes what a file says of itself; a damaged one can make it ask for any amount of memory,
or end the whole program. Here the header, the chain of parameters, and the size of the data
section are checked first (layout: the C3D user guide, https://www.c3d.org).
"""

from __future__ import annotations

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
"""Analog samples or rotations a frame; ezc3d makes room for each, whether it is there or not."""

_NUMERIC = {1: "i1", 2: "i2", 4: "f4"}


def looks_like_c3d(head: bytes) -> bool:
    """Whether the first bytes are those of a C3D file."""
    return len(head) >= 2 and 1 < head[0] < 0x80 and head[1] == _KEY


@dataclass
class _Plan:
    """What a file says of itself."""

    path: Path
    size: int
    header: bytes
    processor: int = _INTEL
    groups: dict[int, str] = field(default_factory=dict)
    values: dict[tuple[int, str], list[float]] = field(default_factory=dict)

    @property
    def order(self) -> str:
        return ">" if self.processor == _MIPS else "<"

    def word(self, number: int) -> int:
        """A word of the header, from 1."""
        return int(struct.unpack_from(self.order + "H", self.header, 2 * (number - 1))[0])

    def value(self, group: str, name: str) -> float | None:
        """The first value of a numeric parameter."""
        for number, title in self.groups.items():
            if title == group and self.values.get((number, name)):
                return self.values[number, name][0]
        return None

    def count(self, group: str, name: str) -> int | None:
        """A count, which a file may hold as a signed number although it is none."""
        value = self.value(group, name)
        if value is None or not np.isfinite(value):
            return None
        return int(value) + 65536 if -32768 <= value < 0 else int(value)

    def trial_frames(self) -> int | None:
        """Frames by the first and the last of the trial, which are two words each."""
        ends = []
        for name in ("ACTUAL_START_FIELD", "ACTUAL_END_FIELD"):
            found = [
                values
                for (number, title), values in self.values.items()
                if title == name and self.groups.get(number) == "TRIAL"
            ]
            if not found or len(found[0]) < 2:
                return None
            low, high = (int(word) & 0xFFFF for word in found[0][:2])
            ends.append(low + 65536 * high)
        return ends[1] - ends[0] + 1


@dataclass(frozen=True)
class Extent:
    """Where the data of a C3D file are.

    Parameters
    ----------
    start
        Bytes before them: the header and the parameters.
    frames, points
        How many, of all kinds of points.
    frame_size
        Bytes of a frame: four numbers a point, and the analog samples.
    plain_floats
        Whether the numbers are floats of the usual byte order.
    order
        Of the bytes in the header, as `struct` has it.
    """

    start: int
    frames: int
    points: int
    frame_size: int
    plain_floats: bool
    order: str


def check_structure(path: Path) -> Extent:
    """Refuse a C3D file that does not hold together; where its data are.

    Raises
    ------
    FileFormatError
        If it is another kind of file, cut off, or its parts contradict each other.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(BLOCK)
        if not looks_like_c3d(header):
            raise FileFormatError(
                "this is not a C3D file",
                path=path,
                found=header[:2].hex(" "),
                expected="02 50 as its first bytes",
                advice="Check that it is the file you mean.",
            )
        start = (header[0] - 1) * BLOCK
        if len(header) < BLOCK or size < start + 4:
            _refuse(path, "the file is cut off in its header", f"{size} bytes")
        file.seek(start)
        prefix = file.read(4)
        if prefix[3] not in (_INTEL, _DEC, _MIPS):
            _refuse(path, "the parameters do not name a known processor", prefix[3])
        plan = _Plan(path, size, header, processor=prefix[3])
        data_start = (plan.word(9) - 1) * BLOCK
        if data_start < start + BLOCK or data_start > size:
            _refuse(path, "the data are not where the header says", f"block {plan.word(9)}")
        # The parameters end where the data start, whatever number of blocks is noted.
        section = file.read(data_start - start - 4)
    _read_parameters(plan, section)
    return _check_counts(plan, data_start)


def _read_parameters(plan: _Plan, section: bytes) -> None:
    """Follow the chain of groups and parameters to its end."""
    place = 0
    while place + 2 <= len(section):
        length, group = struct.unpack_from("bb", section, place)
        if length == 0:
            break
        name = section[place + 2 : place + 2 + abs(length)].decode("latin-1").upper().strip()
        offset_at = place + 2 + abs(length)
        if group == 0 or offset_at + 2 > len(section):
            _refuse(plan.path, "a parameter leads out of its section", f"byte {place}")
        offset = int(struct.unpack_from(plan.order + "h", section, offset_at)[0])
        if group < 0:
            plan.groups[-group] = name
            end = offset_at + 2
        else:
            end = _read_parameter(plan, section, offset_at + 2, (group, name))
        if end >= len(section):
            _refuse(plan.path, "a parameter leads out of its section", name)
        end += 1 + section[end]
        if offset == 0:
            break
        if offset_at + offset != end or end > len(section):
            _refuse(plan.path, "the chain of parameters is broken", f"at {name}")
        place = end
    else:
        _refuse(plan.path, "the chain of parameters has no end", f"{len(section)} bytes")
    if not all((group in plan.groups) for group, _ in plan.values):
        _refuse(plan.path, "a parameter belongs to no group", "an unknown group")


def _read_parameter(plan: _Plan, section: bytes, place: int, key: tuple[int, str]) -> int:
    """Note a parameter's values; the place after them."""
    if place + 2 > len(section):
        _refuse(plan.path, "a parameter leads out of its section", key[1])
    kind, dimensions = struct.unpack_from("bB", section, place)
    data = place + 2 + dimensions
    # ezc3d does not survive a text without dimensions.
    if kind not in (-1, 1, 2, 4) or dimensions > 7 or (kind == -1 and dimensions == 0):
        _refuse(plan.path, "a parameter has an impossible type", key[1])
    count = 1
    for size in section[place + 2 : data]:
        count *= size
    end = data + abs(kind) * count
    if end > len(section):
        _refuse(plan.path, "a parameter is larger than its section", key[1])
    values: list[float] = []
    if kind > 0:
        order = "" if kind == 1 else plan.order
        array = np.frombuffer(section[data:end], dtype=np.dtype(order + _NUMERIC[kind]))
        if plan.processor == _DEC and kind == 4:
            words = np.frombuffer(section[data:end], dtype="<u2").reshape(-1, 2)
            array = words[:, ::-1].copy().reshape(-1).view("<f4") / 4
        values = array[:16].astype(np.float64).tolist()
    plan.values[key] = values
    return int(end)


def _check_counts(plan: _Plan, data_start: int) -> Extent:
    points, analog = plan.word(2), plan.word(3)
    first, last, per_frame = plan.word(4), plan.word(5), plan.word(10)
    if points == 0:
        _refuse(plan.path, "the file holds no points", "0 in its header")
    used = plan.count("POINT", "USED")
    if used is not None and used != points:
        _refuse(plan.path, "header and parameters contradict each other", used, f"{points} points")
    rate = plan.value("POINT", "RATE")
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        _refuse(plan.path, "the frame rate is not possible", f"{rate:g} Hz", "a number above 0")
    channels = plan.count("ANALOG", "USED") or 0
    if analog != channels * per_frame:
        _refuse(
            plan.path,
            "header and parameters contradict each other",
            f"{analog} analog numbers a frame",
            f"{per_frame} of {channels} channels",
        )
    ratio = plan.count("ROTATION", "RATIO") or 0
    if max(per_frame, ratio) > _MOST_SAMPLES:
        found = f"{max(per_frame, ratio)} samples a frame"
        _refuse(plan.path, "the header is not possible", found, f"at most {_MOST_SAMPLES}")
    frames = last - first + 1
    if last == LONG:
        said = (
            plan.count("POINT", "LONG_FRAMES"),
            plan.count("POINT", "FRAMES"),
            plan.trial_frames(),
        )
        frames = max((count for count in said if count is not None), default=frames)
    if frames < 1:
        _refuse(plan.path, "the recording has no frames", f"first {first}, last {last}")
    # The byte with the sign of the scale: negative for data stored as floats.
    sign = plan.header[{_INTEL: 15, _DEC: 13, _MIPS: 12}[plan.processor]]
    floats = bool(sign & 0x80)
    frame_size = (4 * points + analog) * (4 if floats else 2)
    needed = data_start + frames * frame_size
    if plan.size < needed:
        _refuse(plan.path, "the file is cut off in its data", f"{plan.size} bytes", f"{needed}")
    plain = floats and plan.processor == _INTEL
    return Extent(data_start, frames, points, frame_size, plain, plan.order)


def _refuse(path: Path, problem: str, found: object, expected: object = None) -> NoReturn:
    raise FileFormatError(
        problem,
        path=path,
        found=found,
        expected=expected,
        advice="The file is damaged; export or copy it again.",
    )
