"""Other rates, and zero-phase smoothing.

Gaps stay gaps: every stretch between two gaps is filtered by itself, continued beyond its ends by
point reflection, which keeps level and slope.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.tracks.gaps import runs
from mocap_fit.tracks.types import FloatArray, MarkerTracks, Origin, ParameterTracks, PoseTracks

SomeTracks = TypeVar("SomeTracks", MarkerTracks, PoseTracks, ParameterTracks)

# The low-pass before a lower rate: 3 dB at this part of the new rate (half of it is Nyquist's).
_ALIAS_CUTOFF = 0.4
_ALIAS_ORDER = 8


def smooth(tracks: SomeTracks, cutoff_hz: float, order: int = 4) -> SomeTracks:
    """Smooth with a Butterworth low-pass that runs forwards and backwards, without delay.

    Parameters
    ----------
    tracks
        Markers, poses (whose rotation matrices are smoothed and made orthonormal again) or
        parameters (whose standard deviations and residuals stay as they are).
    cutoff_hz
        Where the two passes together have taken 3 dB, below half of the rate.
    order
        Order of one pass.

    Returns
    -------
    MarkerTracks, PoseTracks or ParameterTracks
        Of the same kind; what is missing stays missing.

    Raises
    ------
    DataError
        If the cutoff is not between 0 and half of the rate, or the order is below 1.
    """
    if not (np.isfinite(cutoff_hz) and 0 < cutoff_hz < tracks.rate / 2):
        raise DataError(
            "the cutoff frequency is not possible",
            found=f"{cutoff_hz:g} Hz",
            expected=f"above 0 and below {tracks.rate / 2:g} Hz, half of the rate",
        )
    if order < 1:
        raise DataError("the order of the filter is not possible", found=order, expected="1 to 12")
    return _smoothed(tracks, cutoff_hz, order).with_step(
        "smooth", {"cutoff_hz": float(cutoff_hz), "order": int(order)}
    )


def _smoothed(tracks: SomeTracks, cutoff: float, order: int) -> SomeTracks:
    if isinstance(tracks, MarkerTracks):
        return tracks.replace(positions=_low_passed(tracks.positions, tracks.rate, cutoff, order))
    if isinstance(tracks, ParameterTracks):
        return tracks.replace(values=_low_passed(tracks.values, tracks.rate, cutoff, order))
    flat = tracks.rotations.reshape(*tracks.rotations.shape[:2], 9)
    rotations = _low_passed(flat, tracks.rate, cutoff, order).reshape(tracks.rotations.shape)
    return tracks.replace(
        rotations=_nearest_rotations(rotations),
        translations=_low_passed(tracks.translations, tracks.rate, cutoff, order),
    )


def _nearest_rotations(matrices: FloatArray) -> FloatArray:
    there = ~np.isnan(matrices[..., 0, 0])
    left, _, right = np.linalg.svd(matrices[there])
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    result = np.full_like(matrices, np.nan)
    result[there] = left @ right
    return result


def _by_track(values: FloatArray) -> FloatArray:
    """`(frames, tracks, coordinates)`, whatever it was."""
    return values.reshape(*values.shape[:2], int(np.prod(values.shape[2:])))


def _low_passed(values: FloatArray, rate: float, cutoff: float, order: int) -> FloatArray:
    """Filter every track between its gaps, `(frames, tracks, ...)`."""
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

    def filtered(stretch: FloatArray) -> FloatArray:
        if len(stretch) < 2:
            return stretch
        shape = ((padding, padding), *((0, 0) for _ in stretch.shape[1:]))
        longer = np.pad(stretch, shape, mode="reflect", reflect_type="odd")
        return np.asarray(sosfiltfilt(sections, longer, axis=0, padtype=None)[padding:-padding])

    result = _by_track(values).copy()
    there = np.asarray(~np.isnan(result).any(axis=2))
    whole = there.all(axis=0)
    if whole.any():
        result[:, whole] = filtered(result[:, whole])
    for track in np.flatnonzero(~whole):
        for run in runs(there[:, track]):
            result[run, track] = filtered(result[run, track])
    return result.reshape(values.shape)


def resample(tracks: SomeTracks, rate: float) -> SomeTracks:
    """Give tracks at another rate.

    To a lower rate, what the new rate cannot carry is filtered out first, without delay. Between
    frames, positions and values follow a cubic spline through each stretch without gaps, rotations
    turn evenly from frame to frame (slerp), standard deviations and residuals go in a straight
    line.

    Parameters
    ----------
    tracks
        Markers, poses or parameters.
    rate
        Hertz.

    Returns
    -------
    MarkerTracks, PoseTracks or ParameterTracks
        From the same start time until the last frame. A new frame that falls into a gap is
        missing. Of two neighbours with different origins, the less direct one counts (virtual
        before filled before measured).

    Raises
    ------
    DataError
        If the rate is not a number above 0.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise DataError("the new rate is not possible", found=f"{rate} Hz", expected="above 0")
    source = tracks
    if rate < tracks.rate * (1 - 1e-9):
        source = _smoothed(tracks, _ALIAS_CUTOFF * rate, _ALIAS_ORDER)
    # Positions of the new frames in old frames; whole ones exactly, against rounding.
    count = (
        int(np.floor((tracks.frames - 1) * rate / tracks.rate + 1e-6)) + 1 if tracks.frames else 0
    )
    places: FloatArray = np.arange(count, dtype=np.float64) * (tracks.rate / rate)
    close = np.abs(places - np.round(places)) < 1e-6
    places[close] = np.round(places[close])
    return _resampled(source, places, rate).with_step("resample", {"rate": float(rate)})


def _resampled(tracks: SomeTracks, places: FloatArray, rate: float) -> SomeTracks:
    before = np.floor(places).astype(np.intp)
    after = np.ceil(places).astype(np.intp)
    if isinstance(tracks, MarkerTracks):
        positions = _splined(tracks.positions, places)
        origin = np.maximum(tracks.origin[before], tracks.origin[after])
        origin[np.isnan(positions[:, :, 0])] = Origin.MISSING
        return tracks.replace(positions=positions, origin=origin, rate=rate)
    if isinstance(tracks, ParameterTracks):
        return tracks.replace(
            values=_splined(tracks.values, places),
            standard_deviations=_straight(tracks.standard_deviations, places),
            residuals=_straight(tracks.residuals, places),
            rate=rate,
        )
    return tracks.replace(
        rotations=_turned(tracks.rotations, places),
        translations=_splined(tracks.translations, places),
        residuals=_straight(tracks.residuals, places),
        rate=rate,
    )


def _inside(run: slice, places: FloatArray) -> NDArray[np.intp]:
    """New frames between the first and last old frame of a stretch."""
    return np.flatnonzero((places >= run.start) & (places <= run.stop - 1))


def _splined(values: FloatArray, places: FloatArray) -> FloatArray:
    from scipy.interpolate import make_interp_spline

    old = _by_track(values)
    result = np.full((len(places), *old.shape[1:]), np.nan)
    there = np.asarray(~np.isnan(old).any(axis=2))
    whole = there.all(axis=0)
    # Tracks without gaps go together, the others one by one.
    groups = [(np.flatnonzero(whole), slice(0, len(old)))] if whole.any() and len(old) else []
    for track in np.flatnonzero(~whole):
        groups += [(np.array([track]), run) for run in runs(there[:, track])]
    for members, run in groups:
        chosen = _inside(run, places)
        degree = min(3, run.stop - run.start - 1)
        if degree == 0:
            result[np.ix_(chosen, members)] = old[run.start, members]
        elif len(chosen):
            frames = np.arange(run.start, run.stop)
            spline = make_interp_spline(frames, old[run, members], k=degree)
            result[np.ix_(chosen, members)] = spline(places[chosen])
    return result.reshape(len(places), *values.shape[1:])


def _straight(values: FloatArray, places: FloatArray) -> FloatArray:
    """Along a straight line; infinite or NaN where one of the two neighbours is."""
    before = np.floor(places).astype(np.intp)
    after = np.ceil(places).astype(np.intp)
    share = (places - before).reshape(-1, *(1 for _ in values.shape[1:]))
    with np.errstate(invalid="ignore"):
        mixed = (1 - share) * values[before] + share * values[after]
    return np.where(share == 0, values[before], mixed)


def _turned(rotations: FloatArray, places: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation, Slerp

    result = np.full((len(places), *rotations.shape[1:]), np.nan)
    for body in range(rotations.shape[1]):
        for run in runs(~np.isnan(rotations[:, body, 0, 0])):
            chosen = _inside(run, places)
            matrices = rotations[run, body]
            if len(matrices) == 1:
                result[chosen, body] = matrices
            elif len(chosen):
                turn = Slerp(np.arange(run.start, run.stop), Rotation.from_matrix(matrices))
                result[chosen, body] = turn(places[chosen]).as_matrix()
    return result
