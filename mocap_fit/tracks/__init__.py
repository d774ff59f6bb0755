"""Marker, pose and parameter tracks, and what is done to them before a fit."""

from mocap_fit.tracks.arrays import FloatArray
from mocap_fit.tracks.base import Tracks
from mocap_fit.tracks.filtering import resample, smooth
from mocap_fit.tracks.gaps import GapReport, MarkerGaps, count_gaps, fill_gaps
from mocap_fit.tracks.provenance import Event, Provenance, Step
from mocap_fit.tracks.rigid import (
    compute_spread,
    estimate_rigid_transform,
    estimate_rigid_transforms,
    estimate_similarity_transform,
)
from mocap_fit.tracks.storage import (
    from_frame,
    read_parquet,
    to_frame,
    write_parquet,
)
from mocap_fit.tracks.types import MarkerTracks, Origin, ParameterTracks, PoseTracks

__all__ = [
    "Event",
    "FloatArray",
    "GapReport",
    "MarkerGaps",
    "MarkerTracks",
    "Origin",
    "ParameterTracks",
    "PoseTracks",
    "Provenance",
    "Step",
    "Tracks",
    "compute_spread",
    "count_gaps",
    "estimate_rigid_transform",
    "estimate_rigid_transforms",
    "estimate_similarity_transform",
    "fill_gaps",
    "from_frame",
    "read_parquet",
    "resample",
    "smooth",
    "to_frame",
    "write_parquet",
]
