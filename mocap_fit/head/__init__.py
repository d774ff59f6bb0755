"""Rigid head motion: estimate it, remove it, put it back."""

from mocap_fit.head.motion import (
    HeadMotion,
    estimate_head_motion,
    match_size,
    remove_head_motion,
    restore_head_motion,
)
from mocap_fit.tracks.rigid_sets import find_reference_markers

__all__ = [
    "HeadMotion",
    "estimate_head_motion",
    "find_reference_markers",
    "match_size",
    "remove_head_motion",
    "restore_head_motion",
]
