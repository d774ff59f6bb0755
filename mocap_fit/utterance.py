"""An utterance of a corpus: what is known of it, and its files.

`mocap_fit.corpus` has the corpus that it belongs to.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self, TypeVar

from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.phones import PhoneSequence, read_stored_phones
from mocap_fit.tracks import MarkerTracks, ParameterTracks, PoseTracks, read_parquet
from mocap_fit.tracks.parquet_file import (
    check_types,
    from_damaged_table,
    read_table,
    write_table,
)

UTTERANCES_FILE = "utterances.parquet"
_COLUMNS = ("id", "speaker", "session", "split", "duration", "text", "sources", "checks")
_Tracks = TypeVar("_Tracks", ParameterTracks, PoseTracks, MarkerTracks)


@dataclass(frozen=True, eq=False, repr=False)
class Utterance:
    """An utterance of a corpus, on disk or in memory.

    The ``read_`` methods of an utterance on disk read its files each time they are called; those
    of an utterance in memory (`from_tracks`) return what it holds. Two utterances are equal if
    their fields and their contents are, wherever they are stored.

    Parameters
    ----------
    id
        Unique in the corpus; its files are called so.
    speaker
        Name of the speaker; empty where it is not known.
    session
        Name of the session it was recorded in; empty where it is not known.
    split
        ``train``, ``validation``, ``test``, or another name.
    duration
        Duration of the parameters, seconds.
    text
        What is said; empty where it is not known.
    sources
        Files that it was converted from, relative to the root of the conversion.
    checks
        What the conversion reports to the user, a line each.
    folder
        The folder of the corpus; None for an utterance in memory.
    """

    id: str
    speaker: str = ""
    session: str = ""
    split: str = "train"
    duration: float = 0.0
    text: str = ""
    sources: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()
    folder: Path | None = None
    _contents: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def from_tracks(
        cls,
        tracks: ParameterTracks,
        phones: PhoneSequence,
        *,
        markers: MarkerTracks | None = None,
        head: PoseTracks | None = None,
        **fields: Any,
    ) -> Self:
        """Return an utterance in memory.

        Parameters
        ----------
        tracks
            Its face parameters.
        phones
            Its phones, on the clock of the tracks.
        markers
            Its markers as they were recorded, where they are needed.
        head
            Its head motion, where it is needed.
        **fields
            Other fields, such as ``split``; the id is the name of the tracks by default.

        Returns
        -------
        Utterance
            It holds the tracks and the phones.
        """
        fields = {"id": tracks.name, "duration": tracks.duration, **fields}
        contents = {"tracks": tracks, "phones": phones, "markers": markers, "head": head}
        contents = {name: each for name, each in contents.items() if each is not None}
        return cls(**fields, _contents=contents)

    def read_tracks(self) -> ParameterTracks:
        """Read the face parameters.

        Returns
        -------
        ParameterTracks
            Read from the file at each call.

        Raises
        ------
        FileFormatError
            If the file cannot be read, or holds something else.
        """
        return self._read("tracks", ParameterTracks)

    def read_phones(self) -> PhoneSequence:
        """Read the labelled phones.

        Returns
        -------
        PhoneSequence
            Read from the file at each call.

        Raises
        ------
        FileFormatError
            If the file cannot be read, or holds something else.
        """
        if "phones" in self._contents:
            phones: PhoneSequence = self._contents["phones"]
            return phones
        return read_stored_phones(self._get_path("phones"))

    def read_head(self) -> PoseTracks:
        """Read the motion of the head, which was removed from the markers before the fit.

        Returns
        -------
        PoseTracks
            Read from the file at each call.

        Raises
        ------
        FileFormatError
            If the file cannot be read, or holds something else.
        DataError
            If the utterance is in memory and has none.
        """
        return self._read("head", PoseTracks)

    def read_markers(self) -> MarkerTracks:
        """Read the markers as they were recorded.

        Returns
        -------
        MarkerTracks
            Read from the file at each call.

        Raises
        ------
        FileFormatError
            If the file cannot be read, or holds something else.
        DataError
            If the utterance is in memory and has none.
        """
        return self._read("markers", MarkerTracks)

    @property
    def sound_file(self) -> Path | None:
        """Path of its sound file; None where it has no sound."""
        if self.folder is None:
            return None
        path = self._get_path("audio", "wav")
        return path if path.is_file() else None

    def _get_path(self, part: str, ending: str = "parquet") -> Path:
        if self.folder is None:
            raise DataError(f"the utterance '{self.id}' is in memory and has no {part}")
        return self.folder / part / f"{self.id}.{ending}"

    def _read(self, part: str, kind: type[_Tracks]) -> _Tracks:
        if part in self._contents:
            contents: _Tracks = self._contents[part]
            return contents
        path = self._get_path(part)
        tracks = read_parquet(path)
        if not isinstance(tracks, kind):
            raise FileFormatError(
                "this file holds something else than its folder says",
                path=path,
                found=type(tracks).__name__,
                expected=kind.__name__,
            )
        return tracks

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Utterance):
            return NotImplemented
        if any(getattr(self, name) != getattr(other, name) for name in _COLUMNS):
            return False
        if self.folder is not None and self.folder == other.folder:
            return True
        return self.read_phones() == other.read_phones() and self.read_tracks().equals(
            other.read_tracks()
        )

    def __hash__(self) -> int:
        return hash((self.id, self.split, self.duration))

    def __repr__(self) -> str:
        text = self.text if len(self.text) <= 40 else self.text[:39] + "…"
        return f"Utterance({self.id!r}, split={self.split!r}, {self.duration:.2f} s, {text!r})"


def write_utterances(utterances: Iterable[Utterance], folder: Path) -> None:
    """Write the table of a corpus's utterances.

    Parameters
    ----------
    utterances
        A row each.
    folder
        The folder of the corpus.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    import pyarrow as pa

    rows = list(utterances)
    columns = {
        name: pa.array([getattr(row, name) for row in rows], type=kind)
        for name, kind in _get_types().items()
    }
    write_table(columns, {"kind": "utterances"}, folder / UTTERANCES_FILE)


def _get_types() -> dict[str, Any]:
    """Return the types of the columns, as pyarrow has them."""
    import pyarrow as pa

    strings = pa.list_(pa.string())
    types = (*[pa.string()] * 4, pa.float64(), pa.string(), strings, strings)
    return dict(zip(_COLUMNS, types, strict=True))


def read_utterances(folder: Path) -> tuple[Utterance, ...]:
    """Read the table of a corpus's utterances.

    Parameters
    ----------
    folder
        The folder of the corpus.

    Returns
    -------
    tuple of Utterance
        In the order of the table.

    Raises
    ------
    FileFormatError
        If the table cannot be read, or is not that of a corpus.
    """
    path = folder / UTTERANCES_FILE
    table, _ = read_table(path, ("utterances",), "utterances", "Convert the recordings again.")
    try:
        check_types(table, _get_types())
        rows = table.select(list(_COLUMNS)).to_pylist()
        lists = ("sources", "checks")
        return tuple(
            Utterance(**row | {name: tuple(row[name]) for name in lists}, folder=folder)
            for row in rows
        )
    except (KeyError, TypeError, ValueError) as error:
        raise from_damaged_table(error, path, "utterances") from None
