"""Rigid head motion: estimate it, remove it, put it back; in whole recordings or in stretches."""

from mocap_fit.head.motion import (
    HeadMotion,
    estimate_head_motion,
    match_size,
    remove_head_motion,
    restore_head_motion,
)
from mocap_fit.head.stretches import HeadInStretches
from mocap_fit.tracks.rigid_sets import find_reference_markers

__all__ = [
    "HeadInStretches",
    "HeadMotion",
    "estimate_head_motion",
    "find_reference_markers",
    "match_size",
    "remove_head_motion",
    "restore_head_motion",
]
