"""Fitting: from marker tracks to face parameters."""

from mocap_fit.fitting.binding import Binding, bind_markers
from mocap_fit.fitting.layout import Layout, LayoutMarker, list_layouts, load_layout
from mocap_fit.fitting.layout_search import LayoutMatch, find_layout, rank_layouts
from mocap_fit.fitting.memory import check_memory, estimate_memory
from mocap_fit.fitting.orientation import Orientation, fit_orientation
from mocap_fit.fitting.over_time import fit_over_time
from mocap_fit.fitting.reference_pose import (
    ReferenceSpan,
    align_reference,
    parse_reference,
    read_reference,
    suggest_reference,
)
from mocap_fit.fitting.shape import ShapeFit, fit_shape
from mocap_fit.fitting.speaker import Speaker, SpeakerFit, fit_speaker

__all__ = [
    "Binding",
    "Layout",
    "LayoutMarker",
    "LayoutMatch",
    "Orientation",
    "ReferenceSpan",
    "ShapeFit",
    "Speaker",
    "SpeakerFit",
    "align_reference",
    "bind_markers",
    "check_memory",
    "estimate_memory",
    "find_layout",
    "fit_orientation",
    "fit_over_time",
    "fit_shape",
    "fit_speaker",
    "list_layouts",
    "load_layout",
    "parse_reference",
    "rank_layouts",
    "read_reference",
    "suggest_reference",
]
