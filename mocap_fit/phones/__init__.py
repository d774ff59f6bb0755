"""Phones: labelled segments of speech, and the sets of symbols that they are written in."""

from mocap_fit.phones.mapping import UnknownPhone, check_phones, map_phones, normalise_phones
from mocap_fit.phones.phone_set import (
    ARTICULATORY_PARAMETERS,
    FEATURE_NAMES,
    QUESTION_CLASSES,
    Phone,
    PhoneSet,
    StressMarks,
)
from mocap_fit.phones.set_file import load_phone_set, phone_set_names
from mocap_fit.phones.set_table import phone_set_from_table, phone_set_table
from mocap_fit.phones.storage import read_stored_phones, write_phones
from mocap_fit.phones.types import PhoneSegment, PhoneSequence

__all__ = [
    "ARTICULATORY_PARAMETERS",
    "FEATURE_NAMES",
    "QUESTION_CLASSES",
    "Phone",
    "PhoneSegment",
    "PhoneSequence",
    "PhoneSet",
    "StressMarks",
    "UnknownPhone",
    "check_phones",
    "load_phone_set",
    "map_phones",
    "normalise_phones",
    "phone_set_from_table",
    "phone_set_names",
    "phone_set_table",
    "read_stored_phones",
    "write_phones",
]
