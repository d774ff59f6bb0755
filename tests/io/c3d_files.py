"""A literal writer of C3D files, of every processor and with every oddity that a test wants."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

BLOCK = 512
PROCESSORS = {"intel": 84, "dec": 85, "mips": 86}


def pack(code: str, values: Any, order: str) -> bytes:
    """Numbers as a processor stores them: b, h, H or f."""
    numbers = np.atleast_1d(np.asarray(values)).ravel().tolist()
    mark = ">" if order == "mips" else "<"
    if code == "f" and order == "dec":
        swapped = []
        for number in numbers:
            raw = struct.pack("<f", 4 * number)
            swapped.append(raw[2:] + raw[:2])
        return b"".join(swapped)
    return struct.pack(f"{mark}{len(numbers)}{code}", *numbers)


def parameter(value: Any, order: str) -> bytes:
    """Type, dimensions and data: texts, floats, words, or what a caller has packed himself."""
    if isinstance(value, bytes):
        return value
    if isinstance(value, str):
        return bytes([255, 1, len(value)]) + value.encode()
    if isinstance(value, list) and value and isinstance(value[0], str):
        texts = [text.encode("utf-8") for text in value]
        length = max(map(len, texts))
        data = b"".join(text.ljust(length) for text in texts)
        return bytes([255, 2, length, len(texts)]) + data
    array = np.asarray(value)
    code = "f" if array.dtype.kind == "f" else "h"
    if array.dtype.kind in "iu":
        array = ((array + 2**15) % 2**16) - 2**15
    # The first dimension runs fastest.
    dimensions = bytes([4 if code == "f" else 2, array.ndim, *array.shape])
    return dimensions + pack(code, array.T.ravel() if array.ndim else array, order)


Entry = tuple[int, str, Any, bytes | None]


def entries(groups: Mapping[str, Mapping[str, Any]], description: bytes | None) -> list[Entry]:
    """Number, name, value and description of all groups and parameters; a group has no value."""
    rows: list[Entry] = []
    for number, (group, values) in enumerate(groups.items(), start=1):
        rows.append((-number, group, None, description))
        rows += [(number, name, value, description) for name, value in values.items()]
    return rows


def chain(rows: Sequence[Entry], order: str, last_pointer: int, locked: bool) -> bytes:
    """The chain of parameters; a description of None leaves out even its length."""
    section = b""
    for index, (number, name, value, description) in enumerate(rows):
        body = b"" if value is None else parameter(value, order)
        if description is not None:
            body += bytes([len(description)]) + description
        length = len(name)
        head = struct.pack("bb", -length if locked else length, number) + name.encode()
        offset = len(body) + 2 if index < len(rows) - 1 else last_pointer and len(body) + 2
        section += head + pack("H", offset, order) + body
    return section


def pad(data: bytes, fill: bytes = b"\0") -> bytes:
    return data + fill * (-len(data) % BLOCK)


def c3d(
    positions: Any,
    *,
    order: str = "intel",
    floats: bool = True,
    scale: float = 0.1,
    fourth: Any = None,
    labels: Sequence[str] = ("chin", "lip", "nose"),
    unit: str = "mm",
    rate: float = 100.0,
    first: int = 1,
    channels: int = 0,
    per_frame: int = 1,
    header: Mapping[int, int] | None = None,
    header_floats: Mapping[int, float] | None = None,
    changes: Mapping[tuple[str, str], Any] | None = None,
    rows: Any = None,
    parameter_block: int = 2,
    data_block: int | None = None,
    blocks: int | None = None,
    processor: int | None = None,
    lead: bytes = b"\1\x50",
    description: bytes | None = b"",
    last_pointer: int = 0,
    locked: bool = False,
    header_events: Sequence[tuple[str, float]] = (),
    padded: bool = True,
) -> bytes:
    """A file: positions, ``(frames, points, 3)``, in its unit; the rest as it should be.

    `header` sets words, `header_floats` floats, `changes` parameters (None leaves them out), `rows`
    is called with all entries of the chain and returns others.
    """
    values = np.asarray(positions, dtype=np.float64)
    frames, points = values.shape[:2]
    sign = -1 if floats else 1
    fourth = np.ones((frames, points)) if fourth is None else np.asarray(fourth)
    four = np.concatenate(
        [values if floats else np.rint(values / scale), fourth[..., None]], axis=2
    )
    samples = channels * per_frame
    analog = np.arange(frames * samples).reshape(frames, samples) % 1000
    numbers = np.hstack([four.reshape(frames, -1), analog])
    data = pack("f", numbers, order) if floats else pack("h", numbers.astype(int), order)
    groups: dict[str, dict[str, Any]] = {
        "POINT": {
            "USED": points,
            "SCALE": float(sign * scale),
            "RATE": float(rate),
            "FRAMES": min(frames, 65535),
            "LABELS": list(labels[:points]),
            "UNITS": [unit],
        },
        "ANALOG": {"USED": channels},
    }
    if channels:
        groups["ANALOG"] |= {
            "RATE": float(rate * per_frame),
            "GEN_SCALE": 1.0,
            "SCALE": np.ones(channels),
            "OFFSET": np.zeros(channels, dtype=int),
        }
    for (group, name), value in (changes or {}).items():
        groups.setdefault(group, {})[name] = value
    for values_of_group in groups.values():
        for name in [name for name, value in values_of_group.items() if value is None]:
            del values_of_group[name]

    def section(start: int) -> bytes:
        if ("POINT", "DATA_START") not in (changes or {}):
            groups["POINT"]["DATA_START"] = start
        listed = entries(groups, description)
        listed = rows(listed) if rows else listed
        content = chain(listed, order, last_pointer, locked)
        code = PROCESSORS[order] if processor is None else processor
        size = -(-(len(content) + 4) // BLOCK)
        return pad(lead + bytes([size if blocks is None else blocks, code]) + content)

    block = data_block or parameter_block + len(section(1)) // BLOCK
    parameters = section(block)
    words = {
        2: points,
        3: samples,
        4: first % 65536,
        5: min(first + frames - 1, 65535),
        6: 10,
        9: block,
        10: per_frame if channels else 0,
    } | dict(header or {})
    head = bytearray(BLOCK)
    head[:2] = bytes([parameter_block, 0x50])
    for word, number in words.items():
        head[2 * word - 2 : 2 * word] = pack("H", number % 65536, order)
    for word, number in ({7: sign * scale, 11: rate} | dict(header_floats or {})).items():
        head[2 * word - 2 : 2 * word + 2] = pack("f", number, order)
    if header_events:
        head[298:302] = pack("H", [12345, len(header_events)], order)
        for index, (label, time) in enumerate(header_events):
            head[304 + 4 * index : 308 + 4 * index] = pack("f", time, order)
            head[396 + 4 * index : 400 + 4 * index] = label.encode().ljust(4)
    pieces = {0: bytes(head), parameter_block - 1: parameters, block - 1: data}
    file = b""
    for at in sorted(pieces):
        # What nobody points to holds anything.
        file = file.ljust(BLOCK * at, b"\xff") + pieces[at]
    return pad(file) if padded else file
