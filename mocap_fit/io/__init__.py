"""Readers of recordings and of labels, one module a format, found through registries; writers."""

from mocap_fit.io.label_phones import labels_of, phones_of, read_phones
from mocap_fit.io.label_tiers import (
    LabelFault,
    fill_gaps,
    find_phone_tier,
    find_word_tier,
    label_faults,
)
from mocap_fit.io.labels import (
    LABEL_READERS,
    Label,
    LabelReader,
    Labels,
    Tier,
    find_label_reader,
    read_all_labels,
    read_labels,
    write_labels,
)
from mocap_fit.io.qualisys_tsv_writer import write_qualisys_tsv
from mocap_fit.io.reading import (
    READERS,
    Reader,
    Tracks,
    describe,
    find_reader,
    read,
    read_poses,
    read_tracks,
)
from mocap_fit.io.retiming import retime
from mocap_fit.io.stretches import read_stretches, reads_in_stretches

__all__ = [
    "LABEL_READERS",
    "READERS",
    "Label",
    "LabelFault",
    "LabelReader",
    "Labels",
    "Reader",
    "Tier",
    "Tracks",
    "describe",
    "fill_gaps",
    "find_label_reader",
    "find_phone_tier",
    "find_reader",
    "find_word_tier",
    "label_faults",
    "labels_of",
    "phones_of",
    "read",
    "read_all_labels",
    "read_labels",
    "read_phones",
    "read_poses",
    "read_stretches",
    "read_tracks",
    "reads_in_stretches",
    "retime",
    "write_labels",
    "write_qualisys_tsv",
]
