"""Phones: labelled segments of speech, and phone sets."""

from mocap_fit.phones.mapping import UnknownPhone, find_unknown_phones, map_phones, normalise_phones
from mocap_fit.phones.phone import ARTICULATORY_PARAMETERS, FEATURE_NAMES, QUESTION_CLASSES, Phone
from mocap_fit.phones.phone_set import PhoneSet
from mocap_fit.phones.set_file import find_phone_sets, list_phone_sets, load_phone_set
from mocap_fit.phones.storage import read_stored_phones, write_phones
from mocap_fit.phones.stress import StressMarks
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
    "find_phone_sets",
    "find_unknown_phones",
    "list_phone_sets",
    "load_phone_set",
    "map_phones",
    "normalise_phones",
    "read_stored_phones",
    "write_phones",
]
