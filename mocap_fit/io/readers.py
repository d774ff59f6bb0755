"""Read recordings of any format; the readers are found through a registry.

A reader is a module (or any object) with the attributes of `Reader`. A laboratory adds its own by
an entry point in the group ``mocap_fit.readers``; its name is the name of the format.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from mocap_fit.errors import DataError, MocapFitError, RegistryError, from_os_error
from mocap_fit.io.names import rename_tracks
from mocap_fit.io.text import check_file
from mocap_fit.registry import Registry
from mocap_fit.tracks import MarkerTracks, PoseTracks, Tracks

READERS = Registry("mocap_fit.readers", "reader")

_Kind = TypeVar("_Kind", bound=Tracks)

_ADVICE = {
    "markers": "Read it with read_tracks.",
    "poses": "Read it with read_poses, or export the 3D markers.",
    "parameters": "Read it with mocap_fit.tracks.read_parquet.",
}


class Reader(Protocol):
    """Reader of one format; a module with these attributes is one."""

    @property
    def description(self) -> str:
        """The format in a few words."""

    @property
    def extensions(self) -> tuple[str, ...]:
        """Usual extensions of the files, in lower case, with their points."""

    def sniff(self, path: str | os.PathLike[str]) -> bool:
        """Return whether a file looks like this format, quickly and without an error.

        Parameters
        ----------
        path
            The file, of any format.

        Returns
        -------
        bool
            Whether its first bytes are those of the format.
        """

    def read(
        self,
        path: str | os.PathLike[str],
        *,
        names: Sequence[str] | None = None,
        rate: float | None = None,
        unit: str | None = None,
        subject: str | None = None,
    ) -> Tracks:
        """Read a file.

        Only what a caller sets is passed on: a reader may lack any of these options.

        Parameters
        ----------
        path
            File to read.
        names
            Names of the tracks, in the order of the file; they replace those of the file.
        rate
            Frame rate, hertz; it replaces that of the file.
        unit
            Unit of length, such as ``m``; it replaces that of the file.
        subject
            Subject whose tracks alone are read, where the names have subjects.

        Returns
        -------
        Tracks
            Markers, poses or parameters: millimetres, seconds; NaN where missing.

        Raises
        ------
        MocapFitError
            With the file, if its content cannot be used.
        """


def find_reader(path: str | os.PathLike[str]) -> str:
    """Return the name of the reader for a file.

    The content of the file decides; where no reader recognises it, its extension does.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    str
        Name of the reader, such as ``qualisys-tsv``.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file is empty or cannot be read, or no reader takes it.
    RegistryError
        If a reader of another distribution fails.

    Warns
    -----
    MocapFitWarning
        If a reader cannot be loaded; it is passed over.
    """
    return READERS.find(check_file(path))


def read(
    path: str | os.PathLike[str],
    *,
    reader: str | None = None,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
    rename: Mapping[str, str] | None = None,
) -> Tracks:
    """Read a recording of any known format.

    Parameters
    ----------
    path
        File to read.
    reader
        Name of the format, such as ``qualisys-tsv``; determined from the file where not given.
    names
        Names of the tracks, in the order of the file; they replace those of the file.
    rate
        Frame rate, hertz; it replaces that of the file.
    unit
        Unit of length, such as ``mm``, ``cm`` or ``m``; it replaces that of the file.
    subject
        Subject whose tracks alone are read, where a file names several (``Ann:chin``).
    rename
        New names of tracks by those that the file gives them.

    Returns
    -------
    Tracks
        Markers, poses or parameters: millimetres, seconds; NaN where missing.

    Raises
    ------
    MissingFileError
        If there is no such file.
    MocapFitError
        If the file cannot be read.

    Warns
    -----
    MocapFitWarning
        If something in the file was corrected or left out.
    """
    file = check_file(path)
    name = find_reader(file) if reader is None else reader
    source: Reader = READERS.get(name)
    options: dict[str, Any] = {"names": names, "rate": rate, "unit": unit, "subject": subject}
    options = {option: value for option, value in options.items() if value is not None}
    _check_options(name, source, options, file)
    try:
        with READERS.guard(name, file):
            tracks = source.read(file, **options)
    except MocapFitError:
        raise
    except OSError as error:
        raise from_os_error(error, path) from None
    return tracks if rename is None else rename_tracks(tracks, rename, path=file)


def read_tracks(
    path: str | os.PathLike[str],
    *,
    reader: str | None = None,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
    rename: Mapping[str, str] | None = None,
) -> MarkerTracks:
    """Read the markers of a recording.

    Qualisys TSV, C3D, TRC, Parquet and CSV files are read, exports of Motive and Nexus, and the
    formats of installed plug-ins.
    The content of the file decides which reader is used. Units are converted to millimetres; the
    axes stay those of the file.

    Parameters
    ----------
    path
        File to read.
    reader
        Name of the format: ``qualisys-tsv``, ``c3d``, ``trc``, ``csv``, ``motive-csv``,
        ``nexus-csv``, ``parquet``, or that of a plug-in. Determined from the file where not given.
    names
        Names of the markers, in the order of the file; they replace those of the file. Required
        where the file has none.
    rate
        Frame rate, hertz; it replaces that of the file. Required where the file has none.
    unit
        Unit of length, such as ``mm``, ``cm`` or ``m``; it replaces that of the file.
    subject
        Subject whose tracks alone are read, where a file names several (``Ann:chin``).
    rename
        New names of tracks by those that the file gives them.

    Returns
    -------
    MarkerTracks
        Markers over time: `positions`, ``(frames, markers, 3)``, millimetres, NaN where a marker
        is missing; `names`; `rate`, hertz; `start_time`, seconds; `origin`, which tells measured
        samples from filled ones; `events`; and the `provenance`.

    Raises
    ------
    MissingFileError
        If there is no such file (also a `FileNotFoundError`).
    MissingRateError
        If neither the caller nor the file says the frame rate.
    FileFormatError
        If the file does not follow its format; the message says the line, what is there, and what
        was expected.
    DataError
        If the file holds poses or face parameters instead of markers.
    RegistryError
        If there is no reader of that name, or one of another distribution fails.

    Warns
    -----
    MocapFitWarning
        If the file is cut off, its unit is probably not the millimetre, or something in it is not
        known.

    See Also
    --------
    load_sample : Return the path of a sample recording.
    write_tracks : Write tracks to a file.
    remove_head_motion : Remove the motion of the head from the markers.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> tracks = mf.read_tracks(mf.load_sample("take_01"))
    >>> tracks.positions.shape, tracks.rate
    ((184, 35, 3), 60.0)
    >>> tracks.names[:3]
    ('lip_upper_mid', 'lip_lower_mid', 'lip_corner_left')
    >>> float(tracks.visible.mean().round(2))
    0.97
    """
    options: dict[str, Any] = {
        "names": names,
        "rate": rate,
        "unit": unit,
        "subject": subject,
        "rename": rename,
    }
    return check_kind(read(path, reader=reader, **options), MarkerTracks, path)


def read_poses(
    path: str | os.PathLike[str],
    *,
    reader: str | None = None,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
    rename: Mapping[str, str] | None = None,
) -> PoseTracks:
    """Read the poses of rigid bodies.

    Parameters
    ----------
    path
        File to read: a Qualisys 6DOF export or Parquet.
    reader
        Name of the format; determined from the file where not given.
    names
        Names of the bodies, in the order of the file; they replace those of the file.
    rate
        Frame rate, hertz; it replaces that of the file.
    unit
        Unit of length, such as ``mm``, ``cm`` or ``m``; it replaces that of the file.
    subject
        Subject whose tracks alone are read, where a file names several (``Ann:chin``).
    rename
        New names of tracks by those that the file gives them.

    Returns
    -------
    PoseTracks
        Rotations and translations in millimetres; NaN where a body is missing.

    Raises
    ------
    MissingFileError
        If there is no such file.
    MocapFitError
        If the file cannot be read.
    DataError
        If it does not hold poses.
    """
    options: dict[str, Any] = {
        "names": names,
        "rate": rate,
        "unit": unit,
        "subject": subject,
        "rename": rename,
    }
    return check_kind(read(path, reader=reader, **options), PoseTracks, path)


def describe(
    path: str | os.PathLike[str],
    *,
    read: Callable[[str | os.PathLike[str]], Tracks] = read,
) -> dict[str, Any]:
    """Describe the content of a recording by values that JSON can hold.

    Parameters
    ----------
    path
        File to read.
    read
        How it is read, such as `ReadOptions.read`.

    Returns
    -------
    dict
        ``file``, ``format``, ``description``, ``content`` (``markers``, ``poses`` or
        ``parameters``), ``name``, ``frames``, ``rate``, ``duration``, ``start_time``, ``units``,
        a list of ``markers``, ``bodies`` or ``parameters`` (each with its ``name`` and its
        ``gap_rate``, the share of frames in which it is missing), ``events`` (``name``,
        ``time``), and ``provenance``.

    Raises
    ------
    MissingFileError
        If there is no such file.
    MocapFitError
        If the file cannot be read.
    """
    name = find_reader(path)
    tracks = read(path)
    about = {"file": os.fspath(path), "format": name, "description": READERS.get(name).description}
    return about | tracks.describe()


def _check_options(name: str, source: Reader, options: Mapping[str, Any], path: Path) -> None:
    """Refuse an option that a reader of another distribution does not have."""
    parameters = inspect.signature(source.read).parameters
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values()):
        return
    for option in options:
        if option not in parameters:
            raise RegistryError(
                f"the reader '{name}' of {READERS.get_distribution(name)} cannot take {option}",
                path=path,
                found=f"{option}={options[option]!r}",
                expected=f"none but {', '.join(list(parameters)[1:])}",
                advice="Leave the option out, or convert the recording to another format.",
            )


def check_kind(tracks: Tracks, kind: type[_Kind], path: str | os.PathLike[str]) -> _Kind:
    """Return tracks that are of a kind.

    Parameters
    ----------
    tracks
        Tracks of any kind.
    kind
        The kind that is needed.
    path
        File for the message.

    Returns
    -------
    Tracks
        The same tracks.

    Raises
    ------
    DataError
        If they are of another kind.
    """
    if isinstance(tracks, kind):
        return tracks
    raise DataError(
        f"the file does not hold {kind.kind}",
        path=path,
        found=tracks.kind,
        expected=kind.kind,
        advice=_ADVICE[tracks.kind],
    )
