"""Files of cameras: anipose's ``cameras.toml``, which is ours, and those of two other programs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict

from mocap_fit.atomic_file import write_text
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.settings_file import StrictModel, read_toml, validate_settings
from mocap_fit.stereo.cameras import Camera, Cameras

Layout = Literal["anipose", "caliscope", "pose2sim"]
Unit = Literal["mm", "m"]

_NOUN = "file of cameras"
_MILLIMETRES = {"mm": 1.0, "m": 1000.0}
# Millimetres between the two most distant cameras: fewer are metres that nobody has named so.
_SMALLEST = 20.0

Row = tuple[float, float, float]


class _CameraTable(StrictModel):
    # Programs add what they like; what they leave out is missed by name.
    model_config = ConfigDict(extra="ignore")

    name: str | None = None
    size: tuple[float, float]
    matrix: tuple[Row, Row, Row]
    distortions: tuple[float, ...]
    rotation: Row | tuple[Row, Row, Row]
    translation: Row
    fisheye: bool = False


def read_cameras(path: str | os.PathLike[str], unit: Unit | None = None) -> Cameras:
    """Read cameras from the TOML file of anipose, Pose2Sim or caliscope.

    Parameters
    ----------
    path
        The file.
    unit
        The unit of its translations. Where it is left out, the file's metadata say it; caliscope's
        layout (``[cameras.0]``) is in metres, and others are in millimetres.

    Returns
    -------
    Cameras
        In the order of the file.

    Raises
    ------
    FileFormatError
        If the file does not exist or cannot be read.
    ConfigurationError
        If it is not TOML, has no camera, a camera lacks something or has an impossible number, a
        lens is a fisheye, or the cameras are so close together that the unit must be metres.
    """
    content = read_toml(path, noun=_NOUN)
    metadata = content.pop("metadata", {})
    is_caliscope = "cameras" in content
    tables = content["cameras"] if is_caliscope else content
    if not isinstance(tables, dict) or not any(isinstance(one, dict) for one in tables.values()):
        raise ConfigurationError(
            f"the {_NOUN} has no camera",
            path=path,
            expected="a table a camera, such as [cam_0] with name, size, matrix, distortions, "
            "rotation and translation",
        )
    is_known = unit is not None or is_caliscope or "unit" in metadata
    unit = unit or metadata.get("unit", "m" if is_caliscope else "mm")
    if unit not in _MILLIMETRES:
        raise ConfigurationError(
            "the unit of the translations is unknown", path=path, found=unit, expected="mm or m"
        )
    try:
        cameras = Cameras(
            tuple(
                _make_camera(key, table, path, _MILLIMETRES[unit], f"cam_{key}" * is_caliscope)
                for key, table in tables.items()
                if isinstance(table, dict)
            )
        )
    except DataError as error:
        raise ConfigurationError(
            error.problem, path=path, found=error.found, expected=error.expected
        ) from None
    centres = np.array([camera.centre for camera in cameras])
    extent = float(np.linalg.norm(np.ptp(centres, axis=0)))
    if not is_known and 0 < extent < _SMALLEST:
        raise ConfigurationError(
            f"the cameras are {extent:.3g} mm apart, and the {_NOUN} names no unit",
            path=path,
            advice="If its translations are metres, as Pose2Sim writes them, read it with "
            'unit="m", or add unit = "m" under [metadata].',
        )
    return cameras


def _make_camera(
    key: str, content: Mapping[str, Any], path: str | os.PathLike[str], scale: float, name: str
) -> Camera:
    import cv2

    table = validate_settings(_CameraTable, content, path, f"camera {key}")
    if table.fisheye:
        raise ConfigurationError(
            f"camera {key} has a fisheye lens, whose distortion is another one",
            path=path,
            advice="Calibrate it here with more terms, or undistort its pictures first.",
        )
    rotation = np.array(table.rotation)
    if rotation.ndim == 2:
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) or (
            np.linalg.det(rotation) < 0
        ):
            raise ConfigurationError(
                f"the rotation of camera {key} is none",
                path=path,
                found=rotation.tolist(),
                expected="an orthonormal matrix with determinant 1, or a rotation vector",
            )
        rotation = cv2.Rodrigues(rotation)[0][:, 0]
    return Camera(
        table.name or name or key,
        (table.size[0], table.size[1]),  # type: ignore[arg-type]  # it checks them itself
        np.array(table.matrix),
        np.array(table.distortions),
        rotation,
        np.array(table.translation) * scale,
    )


def write_cameras(
    path: str | os.PathLike[str], cameras: Cameras, layout: Layout = "anipose"
) -> None:
    """Write cameras to a TOML file.

    Parameters
    ----------
    path
        The file; an existing one is replaced.
    cameras
        What is written.
    layout
        Of which program: ``anipose`` (ours: rotation vectors, millimetres), ``pose2sim`` (the
        same in metres) or ``caliscope`` (rotation matrices, metres).

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    import tomli_w

    scale = 1.0 if layout == "anipose" else 1e-3
    tables: dict[str, Any] = {}
    for number, camera in enumerate(cameras):
        is_caliscope = layout == "caliscope"
        table = {
            "name": camera.name,
            "size": list(camera.size),
            "matrix": camera.matrix.tolist(),
            "distortions": camera.distortion.tolist(),
            "rotation": (camera.rotation_matrix if is_caliscope else camera.rotation).tolist(),
            "translation": (camera.translation * scale).tolist(),
        }
        if is_caliscope:
            tables[str(number)] = {"cam_id": number, "rotation_count": 0, "ignore": False} | table
        else:
            tables[f"cam_{number}"] = table | {"fisheye": False}
    content = {"cameras": tables} if layout == "caliscope" else tables
    if layout == "anipose":
        content["metadata"] = {"unit": "mm"}
    write_text(path, tomli_w.dumps(content), _NOUN)
