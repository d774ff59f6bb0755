"""Marker, pose and parameter tracks, and what is done to them before a fit."""

from mocap_fit.tracks.rigid import rigid_transform, rigid_transforms, similarity_transform, spread
from mocap_fit.tracks.storage import from_frame, read_parquet, to_frame, write_parquet
from mocap_fit.tracks.types import (
    Event,
    FloatArray,
    MarkerTracks,
    Origin,
    ParameterTracks,
    PoseTracks,
    Provenance,
    Step,
)

__all__ = [
    "Event",
    "FloatArray",
    "MarkerTracks",
    "Origin",
    "ParameterTracks",
    "PoseTracks",
    "Provenance",
    "Step",
    "from_frame",
    "read_parquet",
    "rigid_transform",
    "rigid_transforms",
    "similarity_transform",
    "spread",
    "to_frame",
    "write_parquet",
]
