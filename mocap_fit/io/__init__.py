"""Readers of recordings, one module a format, found through a registry; writers."""

from mocap_fit.io.qualisys_tsv_writer import write_qualisys_tsv
from mocap_fit.io.readers import (
    READERS,
    Reader,
    describe,
    find_reader,
    read,
    read_poses,
    read_tracks,
)
from mocap_fit.io.samples import load_sample
from mocap_fit.io.stretches import read_stretches, reads_in_stretches

__all__ = [
    "READERS",
    "Reader",
    "describe",
    "find_reader",
    "load_sample",
    "read",
    "read_poses",
    "read_stretches",
    "read_tracks",
    "reads_in_stretches",
    "write_qualisys_tsv",
]
