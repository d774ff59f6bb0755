"""Declarations of the arrays that tracks consist of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.tracks.interpolation import FloatArray as FloatArray
from mocap_fit.tracks.interpolation import Interpolation


@dataclass(frozen=True)
class TrackArray:
    """The declaration of one array of a kind of tracks.

    Parameters
    ----------
    attribute
        The name of the array.
    columns
        Its columns in a table, in the order of its flattened trailing axes: the endings of their
        names, which follow the track's, such as ``x`` of ``chin_x``; empty for the track's name
        alone. The column of an array without tracks has this name alone.
    shape
        Trailing axes, after frames and tracks.
    interpolation
        How values between frames are found.
    is_signal
        Whether it is filtered by `smooth`, and resampled as a smooth signal.
    has_names
        Whether the second axis is that of the tracks; otherwise there is one value a frame.
    is_optional
        Whether it may be left out: NaN takes its place, or what the kind of tracks says.
    allows_infinity
        Whether infinite values are valid.
    dtype
        The type of its numbers.
    """

    attribute: str
    columns: tuple[str, ...] = ("",)
    shape: tuple[int, ...] = ()
    interpolation: Interpolation = "linear"
    is_signal: bool = False
    has_names: bool = True
    is_optional: bool = False
    allows_infinity: bool = False
    dtype: type[np.generic] = np.float64

    @property
    def noun(self) -> str:
        """What the array is called in messages."""
        return self.attribute.replace("_", " ")

    def name_columns(self, name: str) -> list[str]:
        """Return the columns of one track, in the order of the flattened trailing axes.

        Parameters
        ----------
        name
            The track.

        Returns
        -------
        list of str
            Names of columns.
        """
        if not self.has_names:
            return list(self.columns)
        return [f"{name}_{column}" if column else name for column in self.columns]

    def get_shape(self, frames: int, tracks: int) -> tuple[int, ...]:
        """Return the shape of the array.

        Parameters
        ----------
        frames
            Number of frames.
        tracks
            Number of tracks.

        Returns
        -------
        tuple of int
            Lengths of the axes.
        """
        return (frames, tracks, *self.shape) if self.has_names else (frames, *self.shape)

    def check(self, value: object, frames: int | None, tracks: int) -> NDArray[Any]:
        """Return a checked copy of an array.

        Parameters
        ----------
        value
            Numbers of the array's unit and shape.
        frames
            Number of frames; None where this array determines it.
        tracks
            Number of tracks.

        Returns
        -------
        ndarray
            With the shape of `get_shape`, ``(frames, ...)``, in the array's unit.

        Raises
        ------
        DataError
            If the values are not numbers, have the wrong shape, or are infinite.
        """
        try:
            array = np.array(value, dtype=np.float64 if self.dtype is np.float64 else None)
        except (TypeError, ValueError) as error:
            raise DataError(f"the {self.noun} are not numbers", found=error) from None
        if array.dtype.kind not in "fiu":
            raise DataError(f"the {self.noun} are not numbers", found=array.dtype)
        count = frames if frames is not None else len(array) if array.ndim else 0
        expected = self.get_shape(count, tracks)
        if array.shape != expected:
            first = "frames" if frames is None else frames
            raise DataError(
                f"the {self.noun} have the wrong shape",
                found=array.shape,
                expected=f"({', '.join(map(str, (first, *expected[1:])))})",
            )
        if not self.allows_infinity and np.isinf(array).any():
            raise DataError(
                f"the {self.noun} hold an infinite number",
                frame=int(np.argwhere(np.isinf(array))[0][0]),
                expected="finite or NaN",
            )
        return array
