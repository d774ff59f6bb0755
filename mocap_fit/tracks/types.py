"""Tracks over time: markers, rigid bodies, and face parameters.

Frame ``i`` is at ``start_time + i / rate``. Positions are millimetres; NaN is missing, never 0.
Every type is a frozen dataclass that checks its arrays when it is made, and carries its
provenance: the steps that led to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.tracks.arrays import FloatArray, TrackArray
from mocap_fit.tracks.base import Tracks

_AXES = ("x", "y", "z")
_MATRIX = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))


class Origin(IntEnum):
    """Where a sample of a marker comes from; of two, the less direct one is higher."""

    MISSING = 0
    MEASURED = 1
    FILLED = 2
    VIRTUAL = 3


@dataclass(frozen=True, eq=False, repr=False)
class MarkerTracks(Tracks):
    """Markers of a recording over time.

    Parameters
    ----------
    names
        Marker names, unique.
    rate
        Frames per second, hertz.
    positions
        Positions, ``(frames, markers, 3)``, millimetres; NaN is missing. A marker with one
        coordinate missing is missing.
    origin
        A code of `Origin` for every sample, ``(frames, markers)``, no unit; measured or missing
        where left out.
    start_time
        Time of the first frame, seconds.
    name
        What the recording is called; the file name without its ending when it was read.
    events
        What was marked in time.
    provenance
        The steps that led here.

    Raises
    ------
    DataError
        If a shape, the rate, the names or the origin are impossible.
    """

    positions: FloatArray
    origin: NDArray[np.uint8] = None  # type: ignore[assignment]

    kind = "markers"
    noun = "marker"
    plural = "markers"
    unit = "mm"
    arrays = (
        TrackArray("positions", _AXES, (3,), is_signal=True),
        TrackArray("origin", ("origin",), (), "highest", is_optional=True, dtype=np.uint8),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        missing = np.asarray(np.isnan(self.positions).any(axis=2))
        if (np.isnan(self.positions).all(axis=2) != missing).any():
            self._set_array("positions", np.where(missing[:, :, None], np.nan, self.positions))
        codes = self.origin.copy()
        codes[missing] = Origin.MISSING
        # Of the memory of long recordings isin takes many times as much.
        unknown = ~np.logical_or.reduce([codes == origin for origin in Origin])
        if unknown.any():
            raise DataError(
                "an origin is none of the known codes",
                found=codes[unknown][0],
                expected=", ".join(f"{int(o)} {o.name.lower()}" for o in Origin),
            )
        contradictory = (codes == Origin.MISSING) & ~missing
        if contradictory.any():
            frame = int(np.argwhere(contradictory)[0][0])
            raise DataError("a sample is marked missing but has a position", frame=frame)
        self._set_array("origin", codes.astype(np.uint8))

    def _get_default(self, declared: TrackArray, shape: tuple[int, ...]) -> np.ndarray[Any, Any]:
        return np.full(shape, Origin.MEASURED, dtype=np.uint8)

    @property
    def visible(self) -> NDArray[np.bool_]:
        """Which samples are there, ``(frames, markers)``."""
        return np.asarray(self.origin != Origin.MISSING)


@dataclass(frozen=True, eq=False, repr=False)
class PoseTracks(Tracks):
    """Poses of rigid bodies over time.

    Parameters
    ----------
    names
        Names of the bodies, unique.
    rate
        Frames per second, hertz.
    rotations
        Right-handed rotation matrices that take a point of the body to the recording,
        ``(frames, bodies, 3, 3)``, no unit; NaN is missing.
    translations
        Where the body's origin is in the recording, ``(frames, bodies, 3)``, millimetres.
    residuals
        Root mean square distance of the body's markers from where the pose puts them,
        ``(frames, bodies)``, millimetres; all NaN where left out.
    start_time
        Time of the first frame, seconds.
    name
        What the recording is called.
    events
        What was marked in time.
    provenance
        The steps that led here.

    Raises
    ------
    DataError
        If a shape, the rate or the names are impossible.
    """

    rotations: FloatArray
    translations: FloatArray
    residuals: FloatArray = None  # type: ignore[assignment]

    kind = "poses"
    noun = "body"
    plural = "bodies"
    unit = "mm"
    arrays = (
        TrackArray("translations", _AXES, (3,), is_signal=True),
        TrackArray("rotations", _MATRIX, (3, 3), "slerp", is_signal=True),
        TrackArray("residuals", ("residual_mm",), is_optional=True),
    )


@dataclass(frozen=True, eq=False, repr=False)
class ParameterTracks(Tracks):
    """Parameters of a face over time.

    Parameters
    ----------
    names
        Parameter names, in the order of the rig.
    rate
        Frames per second, hertz.
    values
        The parameters, ``(frames, parameters)``: 0 is rest, 1 the full gesture; NaN is missing.
    standard_deviations
        Standard deviations in the unit of the values, ``(frames, parameters)``; infinite where
        the visible markers do not determine a parameter, NaN where unknown. All NaN where left
        out.
    residuals
        Root mean square distance of the visible markers from the fitted face, ``(frames,)``,
        millimetres of the speaker. All NaN where left out.
    start_time
        Time of the first frame, seconds.
    name
        What the recording is called.
    events
        What was marked in time.
    provenance
        The steps that led here.

    Raises
    ------
    DataError
        If a shape, the rate or the names are impossible.
    """

    values: FloatArray
    standard_deviations: FloatArray = None  # type: ignore[assignment]
    residuals: FloatArray = None  # type: ignore[assignment]

    kind = "parameters"
    noun = "parameter"
    plural = "parameters"
    unit = "rest to full gesture: 0 to 1"
    columns_by_track = False
    arrays = (
        TrackArray("values", ("",), (), "pchip", is_signal=True),
        TrackArray("standard_deviations", ("sd",), is_optional=True, allows_infinity=True),
        TrackArray(
            "residuals", ("residual_mm",), has_names=False, is_optional=True, allows_infinity=True
        ),
    )

    @property
    def uncertain(self) -> NDArray[np.bool_]:
        """Which values the visible markers do not determine, ``(frames, parameters)``."""
        return np.isinf(self.standard_deviations)


TRACK_KINDS: dict[str, type[Tracks]] = {
    kind.kind: kind for kind in (MarkerTracks, PoseTracks, ParameterTracks)
}
