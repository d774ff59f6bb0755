"""Write tracks in the format that the extension of the file names."""

from __future__ import annotations

import os
from pathlib import Path

from mocap_fit.errors import DataError
from mocap_fit.io.qualisys_tsv_writer import write_qualisys_tsv
from mocap_fit.tracks import MarkerTracks, Tracks, write_parquet


def write_tracks(tracks: Tracks, path: str | os.PathLike[str]) -> None:
    """Write tracks to a file, atomically; the extension of its name says the format.

    Parquet holds everything: names, times, origins, events and provenance. A Qualisys TSV file
    holds markers with three decimals, and can be read by other programs.

    Parameters
    ----------
    tracks
        Markers, poses or face parameters.
    path
        File to write, ``.parquet`` for all kinds of tracks or ``.tsv`` for markers; an existing
        one is replaced.

    Raises
    ------
    DataError
        If the extension is not known, or the format cannot hold the tracks.
    FileFormatError
        If the file cannot be written.

    See Also
    --------
    read_tracks : Read the markers of a recording.
    mocap_fit.io.write_qualisys_tsv : Write a Qualisys TSV file with settings of its own.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import mocap_fit as mf
    >>> rest = mf.read_tracks(mf.load_sample("rest"))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     mf.write_tracks(rest, Path(folder, "rest.parquet"))
    ...     again = mf.read_tracks(Path(folder, "rest.parquet"))
    >>> bool((again.positions == rest.positions).all())
    True
    """
    extension = Path(path).suffix.lower()
    if extension == ".parquet":
        write_parquet(tracks, path)
    elif extension == ".tsv" and isinstance(tracks, MarkerTracks):
        write_qualisys_tsv(tracks, path)
    else:
        raise DataError(
            "there is no format of that extension for these tracks",
            path=path,
            found=f"{extension or 'no extension'} for {type(tracks).__name__}",
            expected=".parquet, or .tsv for markers",
            advice="Choose another extension; mocap-fit export writes more formats.",
        )
