"""PLY, text and binary: vertices and polygons.

Read here because other readers cannot be trusted with files as people have them: trimesh (5.2)
refuses binary files that mix triangles and quads and takes a text file that is cut off for a
smaller mesh; VTK's ends the program on a file that is cut off.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.face.mesh_pieces import Piece

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_Column = NDArray[np.generic] | list[NDArray[np.generic]]


@dataclass
class _Element:
    """One kind of record: its name, how many, and its properties (name, count type, type)."""

    name: str
    count: int
    properties: list[tuple[str, str | None, str]] = field(default_factory=list)


def read_ply(path: Path) -> Piece:
    """Read a PLY file.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Piece
        Its vertices and triangles; polygons are cut into triangles round their first corner.

    Raises
    ------
    FileFormatError
        If the header is not PLY's, or the file holds fewer records than it says.
    DataError
        If a polygon names a vertex that is not there.
    """
    data = path.read_bytes()
    order, elements, start = _parse_header(data, path)
    try:
        body = _Body(data[start:], order)
        columns = {element.name: body.read(element) for element in elements}
        vertices, polygons = columns["vertex"], columns.get("face", {})
        points = np.stack([np.asarray(vertices[axis], np.float64) for axis in "xyz"], axis=1)
        fans = [
            (polygon[0], polygon[i], polygon[i + 1])
            for polygon in polygons.get("vertex_indices", polygons.get("vertex_index", []))
            for i in range(1, len(polygon) - 1)
        ]
        points = points.reshape(len(points), 3)
        corners = np.array(fans, dtype=np.float64).reshape(-1, 3)
    except (ValueError, IndexError, KeyError, OverflowError) as error:
        raise FileFormatError(
            "the PLY file does not hold what its header says",
            path=path,
            found=f"{type(error).__name__}: {error}",
            expected=", ".join(f"{e.count} {e.name}" for e in elements),
            advice="It may be cut off: export or copy it again.",
        ) from None
    # The file may have them in any type of numbers, with what is no index of a vertex.
    wrong = corners != np.clip(np.trunc(corners), 0, len(points) - 1)
    if wrong.any():
        raise DataError(
            "a polygon of the PLY file names a vertex that is not there",
            path=path,
            found=f"{corners[wrong][0]:.15g}",
            expected=f"0 to {len(points) - 1}",
        )
    return Piece(path.stem, points, corners.astype(np.int64))


def _parse_header(data: bytes, path: Path) -> tuple[str, list[_Element], int]:
    """Byte order ("" for text), the elements, and where the records begin."""
    head, end, _ = data.partition(b"end_header")
    lines = head.decode("latin-1").splitlines()
    if not lines or lines[0].strip() != "ply" or not end:
        raise FileFormatError(
            "the file does not begin as PLY does",
            path=path,
            found=repr(data[:20]),
            expected="'ply' … 'end_header'",
        )
    start = len(head) + len(end)
    start += 2 if data[start : start + 2] == b"\r\n" else 1
    order: str | None = None
    elements: list[_Element] = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            match line.split():
                case ["format", kind, *_]:
                    order = _ORDERS[kind]
                case ["element", name, count]:
                    elements.append(_Element(name, int(count)))
                case ["property", "list", counts, kind, name]:
                    elements[-1].properties.append((name, _TYPES[counts], _TYPES[kind]))
                case ["property", kind, name]:
                    elements[-1].properties.append((name, None, _TYPES[kind]))
        except (KeyError, ValueError, IndexError):
            raise FileFormatError(
                "this line of the PLY header is not known", path=path, line=number, found=line
            ) from None
    if order is None or not any(element.name == "vertex" for element in elements):
        raise FileFormatError(
            "the PLY header names no format or no vertices", path=path, found=" ".join(lines)
        )
    return order, elements, start


class _Body:
    """The records after the header, read one after the other."""

    def __init__(self, data: bytes, order: str) -> None:
        self.order = order
        self.data = data if order else data.split()
        self.position = 0

    def read(self, element: _Element) -> dict[str, _Column]:
        """Read all records of one kind, a column for each property."""
        if all(counts is None for _, counts, _ in element.properties):
            return self._read_table(element)
        columns: dict[str, list[NDArray[np.generic]]] = {p[0]: [] for p in element.properties}
        for _ in range(element.count):
            for name, counts, kind in element.properties:
                size = 1 if counts is None else int(self._take(counts, 1)[0])
                columns[name].append(self._take(kind, size))
        return dict(columns)

    def _read_table(self, element: _Element) -> dict[str, _Column]:
        """Read records that hold no list, all at once."""
        names = [name for name, _, _ in element.properties]
        if self.order:
            record = [(name, self.order + kind) for name, _, kind in element.properties]
            rows: Any = self._take(np.dtype(record), element.count)
            return {name: rows[name] for name in names}
        table = self._take("f8", element.count * len(names)).reshape(element.count, len(names))
        return dict(zip(names, table.T, strict=True))

    def _take(self, kind: str | np.dtype[np.void], count: int) -> NDArray[np.generic]:
        """Read the next values."""
        if count < 0:
            raise ValueError(f"a count of {count}")
        if isinstance(self.data, bytes):
            kind = self.order + kind if isinstance(kind, str) else kind
            values: NDArray[np.generic] = np.frombuffer(self.data, kind, count, self.position)
            self.position += values.nbytes
            return values
        words = self.data[self.position : self.position + count]
        if len(words) < count:
            raise ValueError("the file ends too soon")
        self.position += count
        return np.array([float(word) for word in words])
