"""Marker, pose and parameter tracks, and what is done to them before a fit."""

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
]
