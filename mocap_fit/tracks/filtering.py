"""Resampling to other rates, and zero-phase smoothing.

Gaps stay gaps: every stretch between two gaps is filtered by itself, continued beyond its ends by
point reflection, which keeps level and slope.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np

from mocap_fit.errors import DataError
from mocap_fit.tracks.arrays import FloatArray
from mocap_fit.tracks.base import Tracks
from mocap_fit.tracks.interpolation import find_runs, flatten_tracks, interpolate
from mocap_fit.tracks.rigid import project_to_rotations

SomeTracks = TypeVar("SomeTracks", bound=Tracks)

# The low-pass before a lower rate: 3 dB at this part of the new rate (half of it is Nyquist's).
_ALIAS_CUTOFF = 0.4
_ALIAS_ORDER = 8
_HIGHEST_ORDER = 12


def smooth(tracks: SomeTracks, cutoff_hz: float, order: int = 4) -> SomeTracks:
    """Smooth with a Butterworth low-pass that runs forwards and backwards, without delay.

    Parameters
    ----------
    tracks
        Markers, poses (whose rotation matrices are smoothed and made orthonormal again) or
        parameters (whose standard deviations and residuals stay as they are).
    cutoff_hz
        Frequency at which the two passes together attenuate by 3 dB, hertz, below half of the
        rate.
    order
        Order of one pass, 1 to 12.

    Returns
    -------
    MarkerTracks, PoseTracks or ParameterTracks
        Tracks of the same kind; missing samples stay missing.

    Raises
    ------
    DataError
        If the cutoff is not between 0 and half of the rate, or the order is not possible.
    """
    if not (np.isfinite(cutoff_hz) and 0 < cutoff_hz < tracks.rate / 2):
        raise DataError(
            "the cutoff frequency is not possible",
            found=f"{cutoff_hz:g} Hz",
            expected=f"above 0 and below {tracks.rate / 2:g} Hz, half of the rate",
        )
    if not 1 <= order <= _HIGHEST_ORDER:
        raise DataError(
            "the order of the filter is not possible",
            found=order,
            expected=f"1 to {_HIGHEST_ORDER}",
        )
    return _smooth_signals(tracks, cutoff_hz, order).add_step(
        "smooth", {"cutoff_hz": float(cutoff_hz), "order": int(order)}
    )


def _smooth_signals(tracks: SomeTracks, cutoff: float, order: int) -> SomeTracks:
    changes = {}
    for declared in tracks.arrays:
        if declared.is_signal:
            array = getattr(tracks, declared.attribute)
            result = _filter_low_pass(array, tracks.rate, cutoff, order)
            if declared.interpolation == "slerp":
                result = project_to_rotations(result)
            changes[declared.attribute] = result
    return tracks.replace(**changes)


def _filter_low_pass(values: FloatArray, rate: float, cutoff: float, order: int) -> FloatArray:
    """Filter every track between its gaps, ``(frames, tracks, ...)``."""
    from scipy.signal import butter, sos2zpk, sosfiltfilt

    # Two passes take 3 dB at the cutoff where each takes 1.5: the single filter's own corner lies
    # higher, in the frequencies that the bilinear transform warps.
    corner = np.tan(np.pi * cutoff / rate) / (np.sqrt(2.0) - 1.0) ** (0.5 / order)
    sections = butter(
        order, min(np.arctan(corner) * rate / np.pi, 0.4999 * rate), fs=rate, output="sos"
    )
    # Continued until the response has died down to a millionth.
    slowest = float(np.abs(sos2zpk(sections)[1]).max())
    padding = int(np.clip(np.ceil(np.log(1e-6) / np.log(slowest)), 10, 20_000))

    def filter_stretch(stretch: FloatArray) -> FloatArray:
        if len(stretch) < 2:
            return stretch
        shape = ((padding, padding), *((0, 0) for _ in stretch.shape[1:]))
        longer = np.pad(stretch, shape, mode="reflect", reflect_type="odd")
        return np.asarray(sosfiltfilt(sections, longer, axis=0, padtype=None)[padding:-padding])

    result = flatten_tracks(values).copy()
    seen = np.asarray(~np.isnan(result).any(axis=2))
    complete = seen.all(axis=0)
    if complete.any():
        result[:, complete] = filter_stretch(result[:, complete])
    for track in np.flatnonzero(~complete):
        for run in find_runs(seen[:, track]):
            result[run, track] = filter_stretch(result[run, track])
    return result.reshape(values.shape)


def resample(tracks: SomeTracks, rate: float) -> SomeTracks:
    """Resample tracks to another rate.

    To a lower rate, what the new rate cannot carry is filtered out first, without delay. Between
    frames, positions and values follow a cubic spline through each stretch without gaps, rotations
    turn evenly from frame to frame (slerp), standard deviations and residuals go in a straight
    line.

    Parameters
    ----------
    tracks
        Markers, poses or parameters.
    rate
        The new rate, hertz.

    Returns
    -------
    MarkerTracks, PoseTracks or ParameterTracks
        Tracks of the same kind, from the same start time until the last frame. A new frame that
        falls into a gap is missing. Of two neighbours with different origins, the less direct one
        counts (virtual before filled before measured).

    Raises
    ------
    DataError
        If the rate is not a number above 0.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise DataError("the new rate is not possible", found=f"{rate} Hz", expected="above 0")
    source = tracks
    if rate < tracks.rate * (1 - 1e-9):
        source = _smooth_signals(tracks, _ALIAS_CUTOFF * rate, _ALIAS_ORDER)
    changes: dict[str, Any] = {"rate": rate}
    if tracks.frames:
        count = int(np.floor((tracks.frames - 1) * rate / tracks.rate + 1e-6)) + 1
        frames: FloatArray = np.arange(count, dtype=np.float64) * (tracks.rate / rate)
        for declared in tracks.arrays:
            method = declared.interpolation
            if declared.is_signal and method != "slerp":
                method = "spline"
            array = getattr(source, declared.attribute)
            changes[declared.attribute] = interpolate(array, frames, method)
    return source.replace(**changes).add_step("resample", {"rate": float(rate)})
