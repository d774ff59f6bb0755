"""Loading a face: the built-in head, or a user's mesh with its rig file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, add_path
from mocap_fit.face.mesh import Mesh
from mocap_fit.face.rig import RIGS, Rig
from mocap_fit.face.rig_file import RigFile, read_rig_file
from mocap_fit.face.rig_tables import add_location

BUILT_IN = "built-in"


def load_face(
    face: str | Path = BUILT_IN, *, mesh: Mesh | None = None, tongue: bool | None = False
) -> Rig:
    """Load a face: a mesh and the rig that moves it.

    Parameters
    ----------
    face
        ``"built-in"``, or a rig file (TOML), whose format `mocap_fit.face.rig_file` describes.
    mesh
        Put the rig on this mesh instead of the one that the file names.
    tongue
        Whether the tongue has parameters of its own, five after the others, which the rig file
        states; None where both the file and the mesh have a tongue. Without them it goes with the
        jaw.

    Returns
    -------
    Rig
        Parameters → vertices; its `mesh` is the face at rest.

    Raises
    ------
    FileFormatError
        If the rig file cannot be read; a `MissingFileError` where there is none.
    ConfigurationError
        If the rig file or the mesh is wrong, or they do not fit each other.
    RegistryError
        If the rig is a plug-in that cannot be loaded or fails.

    See Also
    --------
    bind_markers : Tie markers to a face.
    render_movie : Draw a face that moves.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> face = mf.load_face()
    >>> face
    ParkeRig(10 parameters, 11 transforms, ... vertices)
    >>> face.parameter_names[:3]
    ('jaw_rotation', 'lip_rounding', 'upper_lip_retraction')

    How far the chin moves, in millimetres, when the jaw opens fully:

    >>> from mocap_fit.face import to_parameters
    >>> opened = face.deform(to_parameters({"jaw_rotation": 1.0}, face.parameter_names))
    >>> chin = face.mesh.get_feature_point("2.1")
    >>> (opened - face.mesh.vertices)[chin].round(1)
    array([  0. , -17.5, -30.4])
    """
    name = "parke" if str(face) == BUILT_IN else str(face)
    rig_file = read_rig_file(name)
    try:
        mesh = rig_file.label_mesh(
            _load_mesh(rig_file, Path(name).parent) if mesh is None else mesh
        )
        there = rig_file.tongue is not None and mesh.has_region("tongue")
        if tongue or (tongue is None and there):
            rig_file = rig_file.add_tongue()
        rig_class = _get_rig_class(rig_file)
        with RIGS.guard(rig_file.kind, name):
            rig: Rig = rig_class.from_file(rig_file, mesh)
    except ConfigurationError as error:
        # The rig file is where the user can correct it.
        raise error if str(face) == BUILT_IN else add_path(error, name) from None
    return rig


def _get_rig_class(rig_file: RigFile) -> Any:
    with add_location("kind"):
        if rig_file.kind not in RIGS.names():
            raise ConfigurationError(
                f"there is no rig '{rig_file.kind}'",
                expected=f"one of {', '.join(RIGS.names())}",
                advice="Check the spelling, or install the package that provides it.",
            )
    return RIGS.get(rig_file.kind)


def _load_mesh(rig_file: RigFile, folder: Path) -> Mesh:
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
