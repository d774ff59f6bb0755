"""PLY, text and binary: vertices and polygons.

VTK's own reader ends the whole program on a file that is cut off, so it is not used.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import FileFormatError
from mocap_fit.face.mesh import IndexArray
from mocap_fit.tracks import FloatArray

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 100_000


@dataclass
class _Element:
    """One kind of record: its name, how many, and its properties (name, count type, type)."""

    name: str
    count: int
    properties: list[tuple[str, str | None, str]]


def read_ply(path: Path) -> tuple[FloatArray, IndexArray]:
    """Read a PLY file.

    Returns
    -------
    tuple
        `(vertices, 3)` and `(triangles, 3)`; polygons are cut into triangles.

    Raises
    ------
    FileFormatError
        If the header is not PLY's, or the file holds fewer records than it says.
    """
    data = path.read_bytes()
    order, elements, body = _header(data, path)
    try:
        read = _Text(data[body:]) if order == "" else _Binary(data[body:], order)
        found = {element.name: read.element(element) for element in elements}
        vertices = found["vertex"]
        points = np.stack([np.asarray(vertices[axis], np.float64) for axis in "xyz"], axis=1)
        polygons = found.get("face", {})
        lists = polygons.get("vertex_indices", polygons.get("vertex_index", []))
        fans = [
            (polygon[0], polygon[i], polygon[i + 1])
            for polygon in lists
            for i in range(1, len(polygon) - 1)
        ]
    except (ValueError, IndexError, KeyError) as error:
        raise FileFormatError(
            "the PLY file does not hold what its header says",
            path=path,
            found=f"{type(error).__name__}: {error}",
            expected=", ".join(f"{e.count} {e.name}" for e in elements),
            advice="It may be cut off: export or copy it again.",
        ) from None
    return points, np.array(fans, dtype=np.int64).reshape(-1, 3)


def _header(data: bytes, path: Path) -> tuple[str, list[_Element], int]:
    """Byte order ("" for text), the elements, and where the records begin."""
    head, end, _ = data[:_LONGEST_HEADER].partition(b"end_header")
    lines = head.decode("latin-1").splitlines()
    if not lines or lines[0].strip() != "ply" or not end:
        raise FileFormatError(
            "the file does not begin as PLY does",
            path=path,
            found=repr(data[:20]),
            expected="'ply' … 'end_header'",
        )
    body = len(head) + len(end)
    body += 2 if data[body : body + 2] == b"\r\n" else 1
    order: str | None = None
    elements: list[_Element] = []
    for number, line in enumerate(lines[1:], start=2):
        words = line.split()
        try:
            match words:
                case ["format", kind, *_]:
                    order = _ORDERS[kind]
                case ["element", name, count]:
                    elements.append(_Element(name, int(count), []))
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
    return order, elements, body


class _Text:
    """Records of a text file, one after the other."""

    def __init__(self, data: bytes) -> None:
        self.words = data.split()
        self.position = 0

    def element(self, element: _Element) -> dict[str, list[NDArray[np.float64]]]:
        columns: dict[str, list[NDArray[np.float64]]] = {p[0]: [] for p in element.properties}
        for _ in range(element.count):
            for name, counts, _kind in element.properties:
                values = self._take(1 if counts is None else int(self._take(1)[0]))
                columns[name].append(values[0] if counts is None else values)
        return columns

    def _take(self, count: int) -> NDArray[np.float64]:
        taken = self.words[self.position : self.position + count]
        if len(taken) < count:
            raise ValueError("the file ends too soon")
        self.position += count
        return np.array([float(word) for word in taken])


class _Binary:
    """Records of a binary file, one kind after the other."""

    def __init__(self, data: bytes, order: str) -> None:
        self.data = data
        self.order = order
        self.position = 0

    def element(self, element: _Element) -> dict[str, NDArray[np.generic]]:
        # Nearly always all polygons are triangles, or all are quads.
        sizes = [
            0 if counts is None else self._count(element, name)
            for name, counts, _ in element.properties
        ]
        fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
        for (name, counts, kind), size in zip(element.properties, sizes, strict=True):
            if counts is None:
                fields.append((name, self.order + kind))
            else:
                fields.append((f"count {name}", self.order + counts))
                fields.append((name, self.order + kind, (size,)))
        record = np.dtype(fields)
        lists = [p[0] for p in element.properties if p[1] is not None]
        end = self.position + record.itemsize * element.count
        if end <= len(self.data):
            rows = np.frombuffer(self.data, record, element.count, self.position)
            if all((rows[f"count {n}"] == rows[n].shape[1]).all() for n in lists):
                self.position = end
                return {name: rows[name] for name, _, _ in element.properties}
        if not lists:
            raise ValueError("the file ends too soon")
        return self._walk(element)

    def _count(self, element: _Element, wanted: str) -> int:
        """Length of a list in the first record."""
        if element.count == 0:
            return 0
        position = self.position
        for name, counts, kind in element.properties:
            if counts is None:
                position += np.dtype(kind).itemsize
                continue
            size = int(np.frombuffer(self.data, self.order + counts, 1, position)[0])
            if name == wanted:
                return size
            position += np.dtype(counts).itemsize + size * np.dtype(kind).itemsize
        raise KeyError(wanted)

    def _walk(self, element: _Element) -> dict[str, NDArray[np.generic]]:
        """Record by record, for lists of different lengths."""
        columns: dict[str, list[NDArray[np.generic]]] = {p[0]: [] for p in element.properties}
        for _ in range(element.count):
            for name, counts, kind in element.properties:
                size = 1 if counts is None else int(self._take(counts, 1)[0])
                columns[name].append(self._take(kind, size))
        return {name: np.array(column, dtype=object) for name, column in columns.items()}

    def _take(self, kind: str, count: int) -> NDArray[np.generic]:
        values = np.frombuffer(self.data, self.order + kind, count, self.position)
        self.position += values.nbytes
        return values
