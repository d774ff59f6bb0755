"""Readers of recordings, one module a format, found through a registry; writers; samples."""

from mocap_fit.io.options import ReadOptions
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
from mocap_fit.io.writers import write_tracks

__all__ = [
    "READERS",
    "ReadOptions",
    "Reader",
    "describe",
    "find_reader",
    "load_sample",
    "read",
    "read_poses",
    "read_tracks",
    "write_qualisys_tsv",
    "write_tracks",
]
