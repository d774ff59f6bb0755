"""Phones: labelled segments of speech, and the sets of symbols that they are written in."""

from mocap_fit.phones.types import PhoneSegment, PhoneSequence

__all__ = ["PhoneSegment", "PhoneSequence"]
