"""How several files are read: what they do not say themselves, or say wrongly."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from mocap_fit.io.names import rename_tracks
from mocap_fit.io.readers import check_kind, read
from mocap_fit.tracks import MarkerTracks, Tracks


@dataclass(frozen=True)
class ReadOptions:
    """Options of `read` for the files of a command or a manifest.

    Parameters
    ----------
    rate
        Frame rate, hertz; it replaces those of the files.
    unit
        Unit of length; it replaces those of the files.
    subject
        Subject whose tracks alone are read.
    rename
        New names by old ones; what a file already calls by the new name stays.
    """

    rate: float | None = None
    unit: str | None = None
    subject: str | None = None
    rename: Mapping[str, str] = field(default_factory=dict)

    def read(self, path: str | os.PathLike[str]) -> Tracks:
        """Read a recording of any known format.

        Parameters
        ----------
        path
            File to read.

        Returns
        -------
        Tracks
            Markers, poses or parameters.

        Raises
        ------
        MocapFitError
            If it cannot be read, or has no track of a name that is to be changed.
        """
        tracks = read(path, rate=self.rate, unit=self.unit, subject=self.subject)
        return rename_tracks(tracks, self.rename, path=Path(path), missing_ok=True)

    def read_tracks(self, path: str | os.PathLike[str]) -> MarkerTracks:
        """Read the markers of a recording.

        Parameters
        ----------
        path
            File to read.

        Returns
        -------
        MarkerTracks
            The markers.

        Raises
        ------
        MocapFitError
            If it cannot be read, holds no markers, or has none of a name that is to be changed.
        """
        return check_kind(self.read(path), MarkerTracks, path)

    def to_dict(self) -> dict[str, Any]:
        """Return what is set, as JSON can hold it.

        Returns
        -------
        dict
            Values by option.
        """
        return {name: value for name, value in asdict(self).items() if value not in (None, {})}
