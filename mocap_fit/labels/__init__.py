"""Labels of recordings: tiers of labelled times, one module a format, found through a registry."""

from mocap_fit.labels.phone_labels import read_phones, to_labels, to_phones
from mocap_fit.labels.readers import (
    LABEL_READERS,
    LabelReader,
    find_label_reader,
    read_all_labels,
    read_labels,
    write_labels,
)
from mocap_fit.labels.retiming import retime
from mocap_fit.labels.tiers import (
    LabelFault,
    fill_label_gaps,
    find_label_faults,
    find_phone_tier,
    find_word_tier,
)
from mocap_fit.labels.types import Label, Labels, Tier

__all__ = [
    "LABEL_READERS",
    "Label",
    "LabelFault",
    "LabelReader",
    "Labels",
    "Tier",
    "fill_label_gaps",
    "find_label_faults",
    "find_label_reader",
    "find_phone_tier",
    "find_word_tier",
    "read_all_labels",
    "read_labels",
    "read_phones",
    "retime",
    "to_labels",
    "to_phones",
    "write_labels",
]
