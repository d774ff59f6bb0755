"""Labels of recordings: tiers of labelled times, one module a format, found through a registry."""

from mocap_fit.labels.phone_labels import read_phones, to_labels, to_phones
from mocap_fit.labels.readers import (
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
from mocap_fit.labels.retiming import retime
from mocap_fit.labels.tiers import (
    LabelFault,
    fill_gaps,
    find_phone_tier,
    find_word_tier,
    label_faults,
)

__all__ = [
    "LABEL_READERS",
    "Label",
    "LabelFault",
    "LabelReader",
    "Labels",
    "Tier",
    "fill_gaps",
    "find_label_reader",
    "find_phone_tier",
    "find_word_tier",
    "label_faults",
    "read_all_labels",
    "read_labels",
    "read_phones",
    "retime",
    "to_labels",
    "to_phones",
    "write_labels",
]
