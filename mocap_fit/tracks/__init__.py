"""Marker, pose and parameter tracks, and what is done to them before a fit."""

from mocap_fit.tracks.filtering import resample, smooth
from mocap_fit.tracks.gaps import GapReport, MarkerGaps, fill_gaps, gap_report
from mocap_fit.tracks.rigid import rigid_transform, rigid_transforms, similarity_transform, spread
from mocap_fit.tracks.storage import from_frame, read_parquet, read_provenance, to_frame
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
from mocap_fit.tracks.writing import TracksWriter, write_parquet

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
    "TracksWriter",
    "fill_gaps",
    "from_frame",
    "gap_report",
    "read_parquet",
    "read_provenance",
    "resample",
    "rigid_transform",
    "rigid_transforms",
    "similarity_transform",
    "smooth",
    "spread",
    "to_frame",
    "write_parquet",
]
