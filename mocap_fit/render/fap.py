"""MPEG-4 facial animation parameters (FAP), for MPEG-4 players and older talking heads.

ISO/IEC 14496-2, Annex C: how far feature points are from rest along an axis, in 1024ths of
distances of the same face at rest (FAPU), integers. The file is the text that MPEG-4's reference
player reads: a line ``2.1 NAME RATE FRAMES``, then for each frame a line of 68 zeros and ones that
say which parameters follow, and a line with the frame's number and their values.
"""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from mocap_fit.atomic_file import write_text
from mocap_fit.face.fap import FAP_COUNT, FAPS, Fap, measure_fap_units
from mocap_fit.face.rig import Rig, deform_points
from mocap_fit.render.sampling import sample_frames
from mocap_fit.tracks import ParameterTracks

_UNIT = 1024.0


def measure_faps(
    tracks: ParameterTracks, rig: Rig, rate: float | None = None
) -> tuple[tuple[Fap, ...], NDArray[np.int64]]:
    """Measure the facial animation parameters of a moving face.

    Parameters
    ----------
    tracks
        Face parameters over time.
    rig
        The face.
    rate
        Frame rate, hertz; that of the tracks if None.

    Returns
    -------
    tuple of Fap
        The parameters whose feature points the mesh has.
    ndarray
        Their values, ``(frames, faps)``, in 1024ths of their units.

    Raises
    ------
    ConfigurationError
        If the mesh lacks the points that the units are measured between.
    DataError
        If the tracks have a parameter that the face lacks, or no frame.
    """
    mesh = rig.mesh
    units = measure_fap_units(mesh, ("MNS", "MW"))
    _, values = sample_frames(tracks, rig, rate)
    faps = tuple(fap for fap in FAPS if fap.point in mesh.feature_points)
    vertices = np.array([mesh.feature_points[fap.point] for fap in faps])
    rest = deform_points(rig, vertices, np.zeros((1, len(rig.parameter_names))))
    signs = np.array([fap.direction[0] for fap in faps])
    axes = np.array([fap.direction[1] for fap in faps])
    scale = np.array([_UNIT / units[fap.unit] for fap in faps])
    displacements = deform_points(rig, vertices, values) - rest
    along = displacements[:, np.arange(len(faps)), axes]
    return faps, np.rint(signs * scale * along).astype(np.int64)


def write_fap(
    tracks: ParameterTracks, path: str | os.PathLike[str], rig: Rig, *, rate: float | None = None
) -> int:
    """Write a movement as a FAP file.

    Parameters
    ----------
    tracks
        Face parameters over time.
    path
        The file; an existing one is replaced.
    rig
        The face.
    rate
        Frame rate, hertz; that of the tracks if None.

    Returns
    -------
    int
        Number of frames.

    Raises
    ------
    ConfigurationError
        If the mesh lacks the points that the units are measured between.
    DataError
        If the tracks have a parameter that the face lacks, or no frame.
    FileFormatError
        If the file cannot be written.
    """
    faps, values = measure_faps(tracks, rig, rate)
    rate = tracks.rate if rate is None else rate
    present = {fap.number for fap in faps}
    mask = " ".join("1" if number in present else "0" for number in range(1, FAP_COUNT + 1))
    name = "_".join((tracks.name or "talk").split())
    lines = [f"2.1 {name} {rate:g} {len(values)}"]
    for number, row in enumerate(values.tolist()):
        lines += [mask, " ".join(map(str, [number, *row]))]
    write_text(path, "\n".join(lines) + "\n")
    return len(values)
