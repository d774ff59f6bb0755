"""Edit lists: what a person mended in a recording or its labels, without changing either file.

An edit takes what the edits before it have left. Stretches of time are ``[start, end)`` in
seconds: those of markers on the recording's clock, as its file is read, those of phones on that
of the labels.
"""

from mocap_fit.edits.edit_file import (
    EDITS_ENDING,
    load_edits,
    locate_edits,
    read_edits,
    start_edits,
    write_edits,
)
from mocap_fit.edits.edit_list import Edit, EditHistory, EditList
from mocap_fit.edits.label_edits import LabelEdit, Merge, MoveBoundary, Relabel, Split
from mocap_fit.edits.marker_edits import (
    DropMarker,
    DropSpan,
    MarkerEdit,
    Mirror,
    Rename,
    SetReference,
    Swap,
)

__all__ = [
    "EDITS_ENDING",
    "DropMarker",
    "DropSpan",
    "Edit",
    "EditHistory",
    "EditList",
    "LabelEdit",
    "MarkerEdit",
    "Merge",
    "Mirror",
    "MoveBoundary",
    "Relabel",
    "Rename",
    "SetReference",
    "Split",
    "Swap",
    "load_edits",
    "locate_edits",
    "read_edits",
    "start_edits",
    "write_edits",
]
