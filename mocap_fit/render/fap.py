"""MPEG-4 facial animation parameters (FAP), for MPEG-4 players and older talking heads.

ISO/IEC 14496-2, Annex C: how far feature points are from rest along an axis, in 1024ths of
distances of the same face at rest (FAPU), whole numbers. The file is the text that MPEG-4's
reference player reads: a line ``2.1 NAME RATE FRAMES``, then for each frame a line of 68 zeros and
ones that say which parameters follow, and a line with the frame's number and their values.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocap_fit.atomic_file import whole_file
from mocap_fit.errors import ConfigurationError
from mocap_fit.face.mesh import Mesh
from mocap_fit.face.rig import Rig, evaluate
from mocap_fit.render.talking import parameters_at
from mocap_fit.tracks import FloatArray, ParameterTracks

COUNT = 68
_UNIT = 1024.0
_RIGHT, _LEFT, _DOWN, _UP, _FORWARD = (-1, 0), (1, 0), (-1, 1), (1, 1), (1, 2)


@dataclass(frozen=True)
class Fap:
    """One facial animation parameter.

    Parameters
    ----------
    number
        From 1 to 68.
    name
        The standard's.
    point
        The feature point that it moves.
    direction
        Sign and axis in which it is positive.
    unit
        ``MNS``, mouth to nose, or ``MW``, width of the mouth.
    """

    number: int
    name: str
    point: str
    direction: tuple[int, int]
    unit: str = "MNS"


# Those of the jaw and the lips: the rig moves nothing else.
FAPS: tuple[Fap, ...] = (
    Fap(3, "open_jaw", "2.1", _DOWN),
    Fap(4, "lower_t_midlip", "2.2", _DOWN),
    Fap(5, "raise_b_midlip", "2.3", _UP),
    Fap(6, "stretch_l_cornerlip", "2.4", _LEFT, "MW"),
    Fap(7, "stretch_r_cornerlip", "2.5", _RIGHT, "MW"),
    Fap(8, "lower_t_lip_lm", "2.6", _DOWN),
    Fap(9, "lower_t_lip_rm", "2.7", _DOWN),
    Fap(10, "raise_b_lip_lm", "2.8", _UP),
    Fap(11, "raise_b_lip_rm", "2.9", _UP),
    Fap(12, "raise_l_cornerlip", "2.4", _UP),
    Fap(13, "raise_r_cornerlip", "2.5", _UP),
    Fap(14, "thrust_jaw", "2.1", _FORWARD),
    Fap(15, "shift_jaw", "2.1", _RIGHT, "MW"),
    Fap(16, "push_b_lip", "2.3", _FORWARD),
    Fap(17, "push_t_lip", "2.2", _FORWARD),
    Fap(18, "depress_chin", "2.10", _UP),
    Fap(51, "lower_t_midlip_o", "8.1", _DOWN),
    Fap(52, "raise_b_midlip_o", "8.2", _UP),
    Fap(53, "stretch_l_cornerlip_o", "8.3", _LEFT, "MW"),
    Fap(54, "stretch_r_cornerlip_o", "8.4", _RIGHT, "MW"),
    Fap(55, "lower_t_lip_lm_o", "8.5", _DOWN),
    Fap(56, "lower_t_lip_rm_o", "8.6", _DOWN),
    Fap(57, "raise_b_lip_lm_o", "8.7", _UP),
    Fap(58, "raise_b_lip_rm_o", "8.8", _UP),
    Fap(59, "raise_l_cornerlip_o", "8.3", _UP),
    Fap(60, "raise_r_cornerlip_o", "8.4", _UP),
)


def facial_animation_parameters(
    tracks: ParameterTracks, rig: Rig, rate: float | None = None
) -> tuple[tuple[Fap, ...], NDArray[np.int64]]:
    """Measure the feature points of a moving face.

    Parameters
    ----------
    tracks
        Face parameters over time.
    rig
        The face.
    rate
        Frames per second; the tracks' own where not given.

    Returns
    -------
    faps
        Those whose feature points the mesh has.
    values
        `(frames, faps)`, in 1024ths of their units.

    Raises
    ------
    ConfigurationError
        If the mesh lacks the points that the units are measured between.
    DataError
        If the tracks do not belong to the face, or have no frames.
    """
    mesh = rig.mesh
    units = _units(mesh)
    rate = tracks.rate if rate is None else rate
    frames = max(1, int(np.floor((tracks.frames - 1) * rate / tracks.rate + 1e-6)) + 1)
    times: FloatArray = tracks.start_time + np.arange(frames, dtype=np.float64) / rate
    values = parameters_at(tracks, times, rig)
    faps = tuple(fap for fap in FAPS if fap.point in mesh.feature_points)
    vertices = np.array([mesh.feature_points[fap.point] for fap in faps])
    compiled = rig.compile(vertices)

    def places(parameters: FloatArray) -> FloatArray:
        return (
            rig.deform(parameters)[vertices] if compiled is None else evaluate(compiled, parameters)
        )

    rest = places(np.zeros(len(rig.parameter_names)))
    signs = np.array([fap.direction[0] for fap in faps])
    axes = np.array([fap.direction[1] for fap in faps])
    scale = np.array([_UNIT / units[fap.unit] for fap in faps])
    moved = np.stack([places(frame) for frame in values]) - rest
    along = moved[:, np.arange(len(faps)), axes]
    return faps, np.rint(signs * scale * along).astype(np.int64)


def write_fap(
    tracks: ParameterTracks,
    path: str | os.PathLike[str],
    rig: Rig,
    *,
    rate: float | None = None,
) -> int:
    """Write a movement as a FAP file, whole or not at all.

    Parameters
    ----------
    tracks, rig, rate
        As for `facial_animation_parameters`.
    path
        The file.

    Returns
    -------
    int
        How many frames.

    Raises
    ------
    MocapFitError
        As for `facial_animation_parameters`, or if the file cannot be written.
    """
    faps, values = facial_animation_parameters(tracks, rig, rate)
    rate = tracks.rate if rate is None else rate
    present = {fap.number for fap in faps}
    mask = " ".join("1" if number in present else "0" for number in range(1, COUNT + 1))
    name = "_".join((tracks.name or "talk").split())
    lines = [f"2.1 {name} {rate:g} {len(values)}"]
    for number, row in enumerate(values.tolist()):
        lines += [mask, " ".join(map(str, [number, *row]))]
    with whole_file(path) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    return len(values)


def _units(mesh: Mesh) -> dict[str, float]:
    needed = ("9.15", "2.2", "8.3", "8.4")
    missing = [name for name in needed if name not in mesh.feature_points]
    if missing:
        raise ConfigurationError(
            "facial animation parameters are measured in distances of the face, and it lacks "
            "feature points for them",
            found=f"no {', '.join(missing)}",
            expected=", ".join(needed),
            advice="Name them in the rig file.",
        )
    nose, lip, left, right = (mesh.vertices[mesh.feature_point(name)] for name in needed)
    return {"MNS": float(nose[1] - lip[1]), "MW": float(left[0] - right[0])}
