"""OFF, as text: vertices and polygons.

Read here because trimesh (5.2) takes a file that is cut off for a smaller mesh.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mocap_fit.errors import FileFormatError
from mocap_fit.face.mesh_pieces import Piece


def read_off(path: Path) -> Piece:
    """Read an OFF file.

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
        If it is not OFF, or holds fewer vertices or polygons than it says.
    """
    text = path.read_bytes().decode("latin-1")
    lines = (line.partition("#")[0].split() for line in text.splitlines())
    rows = iter([row for row in lines if row])
    first = next(rows, [""])
    if not first[0].endswith("OFF"):
        raise FileFormatError(
            "the file does not begin as OFF does", path=path, found=first[0], expected="OFF"
        )
    counts = first[1:] or next(rows, [])
    try:
        vertex_count, polygon_count = (int(count) for count in counts[:2])
        vertices = [_parse_vertex(row) for row in _take(rows, vertex_count)]
        polygons = [_parse_polygon(row, vertex_count) for row in _take(rows, polygon_count)]
    except ValueError as error:
        raise FileFormatError(
            "the OFF file does not hold what it says",
            path=path,
            found=error,
            expected=f"{' '.join(counts[:2])} vertices and polygons",
            advice="It may be cut off: export or copy it again.",
        ) from None
    fans = [(p[0], p[i], p[i + 1]) for p in polygons for i in range(1, len(p) - 1)]
    triangles = np.array(fans, dtype=np.int64).reshape(-1, 3)
    return Piece(path.stem, np.array(vertices, dtype=np.float64).reshape(-1, 3), triangles)


def _take(rows: Iterator[list[str]], count: int) -> Iterator[list[str]]:
    for _ in range(count):
        row = next(rows, None)
        if row is None:
            raise ValueError("it ends too soon")
        yield row
    if count < 0:
        raise ValueError(f"a count of {count}")


def _parse_vertex(row: list[str]) -> list[float]:
    """Return the position; a colour may follow."""
    position = [float(word) for word in row[:3]]
    if len(position) < 3:
        raise ValueError(f"a vertex '{' '.join(row)}'")
    return position


def _parse_polygon(row: list[str], vertex_count: int) -> list[int]:
    """Return the corners; a colour may follow."""
    size = int(row[0])
    corners = [int(word) for word in row[1 : 1 + max(size, 0)]]
    if size != len(corners) or any(not 0 <= corner < vertex_count for corner in corners):
        raise ValueError(f"a polygon '{' '.join(row[:9])}'")
    return corners
