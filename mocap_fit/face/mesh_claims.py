"""What STL and glTF files claim to hold, checked before trimesh reads them."""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import Any

from mocap_fit.errors import FileFormatError
from mocap_fit.parsing import parse_json
from mocap_fit.size_limit import check_size

# Bytes of the largest element of glTF, a matrix of 4 by 4 numbers.
_ELEMENT = 64
_MAGIC = b"glTF"
# Bytes of a binary STL file before its triangles, and of each.
_STL_HEADER, _STL_TRIANGLE = 84, 50


def check_stl(path: Path) -> None:
    """Refuse an STL file that is cut off: trimesh would take a text for a smaller mesh.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FileFormatError
        If a binary file is not as long as it says, or a text has no end.
    """
    data = path.read_bytes()
    if data.lstrip().startswith(b"solid") and b"facet" in data:
        if not data.rstrip().splitlines()[-1].strip().startswith(b"endsolid"):
            raise FileFormatError(
                "the STL file is cut off", path=path, expected="endsolid in its last line"
            )
        return
    count = struct.unpack_from("<I", data.ljust(_STL_HEADER, b"\0"), _STL_HEADER - 4)[0]
    if len(data) != _STL_HEADER + count * _STL_TRIANGLE:
        raise FileFormatError(
            "the STL file is not as long as it says",
            path=path,
            found=f"{len(data):,} bytes",
            expected=f"{_STL_HEADER + count * _STL_TRIANGLE:,} for {count:,} triangles",
            advice="It may be cut off: export or copy it again.",
        )


def check_gltf(path: Path) -> None:
    """Refuse a glTF or GLB file that claims too much, or whose buffers are not ordinary files.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FileFormatError
        If its arrays are larger than what may be read, or a buffer is not a file beside it.
    ValueError
        If it is not glTF.
    """
    content = _read_json(path)
    accessors = content.get("accessors", [])
    size = sum(_ELEMENT * accessor.get("count", 0) for accessor in accessors)
    check_size(size, path=path, noun="scene")
    for item in (*content.get("buffers", []), *content.get("images", [])):
        name = item.get("uri", "")
        if not name or name.startswith("data:"):
            continue
        file = Path(os.path.normpath(path.parent / name))
        if path.parent.absolute() not in file.absolute().parents or not file.is_file():
            raise FileFormatError(
                "a buffer of the scene is not a file beside it", path=path, found=name
            )


def _read_json(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    if data.startswith(_MAGIC):
        (length,) = struct.unpack_from("<I", data, 12)
        data = data[20 : 20 + length]
    content = parse_json(data)
    if not isinstance(content, dict):
        raise ValueError("not a table")  # noqa: TRY004
    return content
