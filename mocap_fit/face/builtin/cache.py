"""A mesh saved between runs in the user's cache folder."""

from __future__ import annotations

import hashlib
import json
import os
import sys
import zipfile
import zlib
from dataclasses import astuple
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit._version import __version__
from mocap_fit.atomic_file import make_folder, write_atomically
from mocap_fit.errors import MocapFitError
from mocap_fit.face.mesh import Material, Mesh, Part

_UNREADABLE = (
    OSError,
    EOFError,
    ValueError,
    KeyError,
    TypeError,
    zipfile.BadZipFile,
    zlib.error,
    MocapFitError,
)


def get_cache_folder() -> Path:
    """Return the folder for files that mocap-fit can make again at any time.

    Returns
    -------
    Path
        ``MOCAP_FIT_CACHE`` if that environment variable is set, or the platform's folder for
        caches.
    """
    chosen = os.environ.get("MOCAP_FIT_CACHE")
    if chosen:
        return Path(chosen)
    home = Path.home()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or home / "AppData/Local") / "mocap-fit/Cache"
    if sys.platform == "darwin":
        return home / "Library/Caches/mocap-fit"
    return Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache") / "mocap-fit"


def hash_sources(*sources: Path) -> str:
    """Return a short name for the state of some modules and of the libraries they compute with.

    Parameters
    ----------
    *sources
        The modules' files.

    Returns
    -------
    str
        Sixteen hexadecimal digits, other ones when a source or the version of a library changes.
    """
    versions = (__version__, np.__version__, metadata.version("scipy"))
    digest = hashlib.sha256("\n".join(versions).encode())
    for source in sorted(sources):
        digest.update(source.name.encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def save_mesh(mesh: Mesh, path: Path) -> bool:
    """Save a mesh to a file, completely or not at all.

    Parameters
    ----------
    mesh
        The mesh.
    path
        The file; its folder is created.

    Returns
    -------
    bool
        Whether it could be written; a cache that cannot be written to is not an error.
    """
    about = {
        "parts": [
            {
                "name": part.name,
                "vertices": [part.vertices.start, part.vertices.stop],
                "triangles": [part.triangles.start, part.triangles.stop],
                "material": astuple(part.material),
            }
            for part in mesh.parts
        ],
        "regions": list(mesh.regions),
        "feature_points": dict(mesh.feature_points),
    }
    text = np.frombuffer(json.dumps(about).encode(), dtype=np.uint8)
    arrays: dict[str, NDArray[Any]] = {
        f"region_{i}": members for i, members in enumerate(mesh.regions.values())
    }
    arrays |= {"vertices": mesh.vertices, "triangles": mesh.triangles, "about": text}
    if mesh.colours is not None:
        arrays["colours"] = mesh.colours
    try:
        make_folder(path.parent)
        with write_atomically(path) as partial, partial.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
    except MocapFitError:
        return False
    return True


def load_mesh(path: Path) -> Mesh | None:
    """Load a mesh from a file of the cache.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Mesh or None
        None if there is no such file or it cannot be used.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            about = json.loads(arrays["about"].tobytes())
            return Mesh(
                arrays["vertices"],
                arrays["triangles"],
                tuple(
                    Part(
                        part["name"],
                        range(*part["vertices"]),
                        range(*part["triangles"]),
                        Material(tuple(part["material"][0]), *part["material"][1:]),
                    )
                    for part in about["parts"]
                ),
                {name: arrays[f"region_{i}"] for i, name in enumerate(about["regions"])},
                about["feature_points"],
                arrays.get("colours"),
            )
    except _UNREADABLE:
        return None
