"""What was measured of a talking head: its parameters, its markers, the pose of its head."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mocap_fit.errors import FileFormatError
from mocap_fit.phones import PhoneSequence, read_stored_phones
from mocap_fit.tracks import MarkerTracks, ParameterTracks, PoseTracks, read_parquet

if TYPE_CHECKING:
    from corpus_tools.talking.speak import Look
    from mocap_fit.fitting import Speaker


def read_parameters(path: Path) -> ParameterTracks:
    """Read face parameters that `mocap-fit fit` or `convert` wrote.

    Parameters
    ----------
    path
        A Parquet file.

    Returns
    -------
    ParameterTracks
        The parameters.

    Raises
    ------
    FileFormatError
        If it holds something else.
    """
    tracks = read_parquet(path)
    if not isinstance(tracks, ParameterTracks):
        raise FileFormatError(
            "the file does not hold face parameters",
            path=path,
            found=type(tracks).__name__,
            expected="what mocap-fit fit or convert wrote",
        )
    return tracks


def read_phones_beside(tracks: Path) -> PhoneSequence | None:
    """Read the phones of an utterance of a corpus, whose tracks are given.

    Parameters
    ----------
    tracks
        A Parquet file; in a corpus, ``CORPUS/tracks/ID.parquet``.

    Returns
    -------
    PhoneSequence | None
        The phones of ``CORPUS/phones/ID.parquet``; None where there is no such file.

    Raises
    ------
    MocapFitError
        If it cannot be read.
    """
    path = tracks.absolute().parent.parent / "phones" / tracks.name
    return read_stored_phones(path) if path.is_file() else None


def _fit_speaker(look: Look) -> Speaker | None:
    """Return the speaker whose reference pose and layout are known."""
    if look.reference is None:
        return None
    from mocap_fit.fitting import fit_speaker

    return fit_speaker(look.face, look.layout, look.reference)


def read_markers(look: Look, tracks: ParameterTracks | None) -> MarkerTracks:
    """Read recorded markers, on the face and on the clock of the measured tracks.

    Parameters
    ----------
    look
        The recording, and the speaker's reference pose and layout.
    tracks
        What was measured with them.

    Returns
    -------
    MarkerTracks
        The markers.
    """
    from mocap_fit.io import read_tracks

    assert look.markers is not None
    markers = read_tracks(look.markers)
    speaker = _fit_speaker(look)
    if speaker is not None:
        still, _ = speaker.remove_head_motion(speaker.prepare(markers))
        still = still.select(speaker.binding.names)
        markers = still.replace(positions=speaker.binding.orientation.apply(still.positions))
    if tracks is not None and tracks.frames == markers.frames:
        # A corpus puts a recording on the clock of its sound; the recording itself is not.
        markers = markers.replace(start_time=tracks.start_time)
    return markers


def read_pose(look: Look) -> PoseTracks:
    """Read the measured pose of the head, in the axes of the face.

    Parameters
    ----------
    look
        The file of the pose, and the speaker's reference pose and layout.

    Returns
    -------
    PoseTracks
        The pose.

    Raises
    ------
    FileFormatError
        If the file holds something else.
    """
    assert look.head is not None
    pose = read_parquet(look.head)
    if not isinstance(pose, PoseTracks):
        raise FileFormatError(
            "the file does not hold the pose of a head",
            path=look.head,
            found=type(pose).__name__,
            expected="a file of the folder head of a corpus, such as head/ID.parquet",
        )
    speaker = _fit_speaker(look)
    if speaker is None:
        return pose
    orientation = speaker.binding.orientation
    turn, origin = orientation.rotation, orientation.translation
    rotations = turn @ pose.rotations @ turn.T
    translations = orientation.apply(pose.translations) - rotations @ origin
    return pose.replace(rotations=rotations, translations=translations)
