"""Face parameters of a rig at the times of pictures and exported frames."""

from __future__ import annotations

import numpy as np

from mocap_fit.control.tongue import TONGUE_PARAMETERS, compute_tongue
from mocap_fit.errors import DataError
from mocap_fit.face.rig import Rig
from mocap_fit.phones import PhoneSequence, find_unknown_phones, list_phone_sets
from mocap_fit.tracks import FloatArray, ParameterTracks


def sample_parameters(
    tracks: ParameterTracks, times: FloatArray, rig: Rig, phones: PhoneSequence | None = None
) -> FloatArray:
    """Return the parameters of a rig at any times, from tracks of some of them.

    Values between frames lie on monotone cubics; before and after the tracks the face stays as it
    is at their ends. Parameters that are not in the tracks are at rest, but for a tongue whose
    phones are known: it moves by rule. Values beyond the bounds of the rig are moved to the bound.

    Parameters
    ----------
    tracks
        Face parameters over time.
    times
        Times, ``(times,)``, seconds.
    rig
        The face.
    phones
        The phones of the utterance, of a phone set that comes with the package.

    Returns
    -------
    ndarray
        Values in the order of the rig, ``(times, parameters)``, 1 is the full gesture.

    Raises
    ------
    DataError
        If the tracks have a parameter that the face lacks, or no frame.
    """
    names = rig.parameter_names
    unknown = [name for name in tracks.names if name not in names]
    if unknown:
        raise DataError(
            f"the face has no parameter {', '.join(unknown)}",
            expected=f"some of {', '.join(names)}",
            advice="Give the face that the tracks were made with.",
        )
    values = np.zeros((len(times), len(names)))
    values[:, [names.index(name) for name in tracks.names]] = np.nan_to_num(tracks.at(times))
    missing = set(TONGUE_PARAMETERS) & set(names) - set(tracks.names)
    if len(missing) == len(TONGUE_PARAMETERS) and phones is not None and _has_known_phones(phones):
        jaw = values[:, names.index("jaw_rotation")] if "jaw_rotation" in names else None
        columns = [names.index(name) for name in TONGUE_PARAMETERS]
        values[:, columns] = compute_tongue(phones, times, jaw=jaw)
    low, high = rig.bounds.T
    return np.asarray(np.clip(values, low, high))


def _has_known_phones(phones: PhoneSequence) -> bool:
    """Return whether there are phones, all of a set that comes with the package."""
    known = bool(phones) and phones.phone_set in list_phone_sets()
    return known and not find_unknown_phones(phones, phones.phone_set)


def sample_frames(
    tracks: ParameterTracks,
    rig: Rig,
    rate: float | None = None,
    phones: PhoneSequence | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the frames of tracks at another rate, with the parameters of a rig.

    Parameters
    ----------
    tracks
        Face parameters over time.
    rig
        The face.
    rate
        Frame rate, hertz; that of the tracks if None.
    phones
        The phones of the utterance, by which a tongue moves that is not in the tracks.

    Returns
    -------
    ndarray
        Times of the frames, ``(frames,)``, seconds.
    ndarray
        Values in the order of the rig, ``(frames, parameters)``, 1 is the full gesture.

    Raises
    ------
    DataError
        If the tracks have a parameter that the face lacks, or no frame.
    """
    rate = tracks.rate if rate is None else rate
    frames = max(1, int(np.floor((tracks.frames - 1) * rate / tracks.rate + 1e-6)) + 1)
    times: FloatArray = tracks.start_time + np.arange(frames, dtype=np.float64) / rate
    return times, sample_parameters(tracks, times, rig, phones)
