"""MPEG-4 facial animation parameters (FAP), for MPEG-4 players and older talking heads.

ISO/IEC 14496-2, Annex C: how far feature points are from rest along an axis, in 1024ths of
distances of the same face at rest (FAPU), whole numbers. The file is the text that MPEG-4's
reference player reads: a line ``2.1 NAME RATE FRAMES``, then for each frame a line of 68 zeros and
ones that say which parameters follow, and a line with the frame's number and their values.
"""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from mocap_fit.atomic_file import write_atomically
from mocap_fit.face.fap import FAP_COUNT, FAPS, Fap, measure_fap_units
from mocap_fit.face.rig import Rig, evaluate
from mocap_fit.render.talking import parameters_at
from mocap_fit.tracks import FloatArray, ParameterTracks

_UNIT = 1024.0


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
    units = measure_fap_units(mesh, ("MNS", "MW"))
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
    mask = " ".join("1" if number in present else "0" for number in range(1, FAP_COUNT + 1))
    name = "_".join((tracks.name or "talk").split())
    lines = [f"2.1 {name} {rate:g} {len(values)}"]
    for number, row in enumerate(values.tolist()):
        lines += [mask, " ".join(map(str, [number, *row]))]
    with write_atomically(path) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    return len(values)
