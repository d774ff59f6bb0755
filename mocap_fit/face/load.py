"""Loading a face: the built-in head, or a mesh of one's own with its rig file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mocap_fit.errors import ConfigurationError, DataError, FileFormatError
from mocap_fit.face.mesh import Mesh
from mocap_fit.face.rig import RIGS, Rig
from mocap_fit.face.rig_file import RigFile, add_location, read_rig_file

BUILT_IN = "built-in"


def load_face(face: str | Path = BUILT_IN, *, mesh: Mesh | None = None) -> Rig:
    """Load a face: a mesh and the rig that moves it.

    Parameters
    ----------
    face
        ``"built-in"``, or a rig file (TOML); see `mocap_fit.face.rig_file`.
    mesh
        Put the rig on this mesh instead of the one that the file names.

    Raises
    ------
    ConfigurationError
        If the rig file or the mesh is wrong, or they do not fit each other.
    """
    name = "parke" if str(face) == BUILT_IN else str(face)
    rig_file = read_rig_file(name)
    try:
        mesh = rig_file.named(_mesh(rig_file, Path(name).parent) if mesh is None else mesh)
        rig: Rig = _rig_class(rig_file).from_file(rig_file, mesh)
    except ConfigurationError as error:
        # The rig file is where the user can mend it.
        if error.path is None and str(face) != BUILT_IN:
            raise ConfigurationError(
                error.problem,
                path=name,
                found=error.found,
                expected=error.expected,
                advice=error.advice,
            ) from None
        raise
    return rig


def _rig_class(rig_file: RigFile) -> Any:
    with add_location("kind"):
        if rig_file.kind not in RIGS.names():
            raise ConfigurationError(
                f"there is no rig '{rig_file.kind}'",
                expected=f"one of {', '.join(RIGS.names())}",
                advice="Check the spelling, or install the package that provides it.",
            )
    return RIGS.get(rig_file.kind)


def _mesh(rig_file: RigFile, folder: Path) -> Mesh:
    if rig_file.mesh is None:
        from mocap_fit.face.builtin import load_built_in_head

        return load_built_in_head()
    from mocap_fit.face.import_mesh import read_mesh

    try:
        return read_mesh(folder / rig_file.mesh, scale=rig_file.scale, axes=rig_file.axes)
    except (ConfigurationError, DataError, FileFormatError) as error:
        raise ConfigurationError(
            f"the rig file is wrong at mesh, '{rig_file.mesh}': {error.problem}",
            found=error.found,
            expected=error.expected,
            advice=error.advice,
        ) from None
