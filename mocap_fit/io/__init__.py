"""Readers of recordings, one module a format, found through the registry; a TSV writer."""

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

__all__ = [
    "READERS",
    "Reader",
    "Tracks",
    "describe",
    "find_reader",
    "read",
    "read_poses",
    "read_tracks",
    "write_qualisys_tsv",
]
