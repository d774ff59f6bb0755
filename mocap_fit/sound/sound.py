"""Sound in memory."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from mocap_fit.errors import DataError
from mocap_fit.tracks import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Sound:
    """Sound of one or more channels.

    Parameters
    ----------
    samples
        Samples, ``(samples, channels)``, or ``(samples,)`` for one channel. Full scale is 1.
    rate
        Sampling rate, hertz.
    name
        Its name; when it was read, the file name without its ending.
    encoding
        How its samples are stored in a file, as libsndfile names it: ``PCM_16``, ``FLOAT``,
        ``ULAW``, ``VORBIS`` and so on.

    Raises
    ------
    DataError
        If the shape or the rate is out of range, or a sample is not a finite number.
    """

    samples: FloatArray
    rate: float
    name: str = field(default="", kw_only=True)
    encoding: str = field(default="PCM_16", kw_only=True)

    def __post_init__(self) -> None:
        try:
            samples = np.array(self.samples, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise DataError("the samples are not numbers", found=error) from None
        if samples.ndim == 1:
            samples = samples[:, None]
        if samples.ndim != 2 or samples.shape[1] == 0:
            raise DataError(
                "the samples have the wrong shape",
                found=samples.shape,
                expected="(samples,) or (samples, channels)",
            )
        if not np.isfinite(self.rate) or self.rate <= 0:
            raise DataError(
                "the sampling rate is out of range",
                found=f"{self.rate} Hz",
                expected="a number above 0",
            )
        bad = ~np.isfinite(samples)
        if bad.any():
            raise DataError(
                "the sound has samples that are not numbers",
                found=f"{int(bad.sum())}, the first is sample {int(np.argwhere(bad)[0][0])}",
            )
        samples.setflags(write=False)
        object.__setattr__(self, "samples", samples)
        object.__setattr__(self, "rate", float(self.rate))

    def __len__(self) -> int:
        return len(self.samples)

    def __repr__(self) -> str:
        channels = "1 channel" if self.channels == 1 else f"{self.channels} channels"
        return f"Sound({self.name!r}, {channels}, {self.duration:.2f} s at {self.rate:g} Hz)"

    @property
    def channels(self) -> int:
        """Number of channels."""
        return int(self.samples.shape[1])

    @property
    def duration(self) -> float:
        """Number of samples over the rate, seconds."""
        return len(self.samples) / self.rate

    def get_channel(self, number: int) -> FloatArray:
        """Return the samples of one channel.

        Parameters
        ----------
        number
            The channel; the first is 1.

        Returns
        -------
        ndarray
            Samples, ``(samples,)``; full scale is 1.

        Raises
        ------
        DataError
            If there is no such channel.
        """
        if not 1 <= number <= self.channels:
            raise DataError(
                f"there is no channel {number} of the sound",
                found=f"{self.channels} channels",
                expected=f"a number from 1 to {self.channels}",
            )
        samples: FloatArray = self.samples[:, number - 1]
        return samples

    def drop_channel(self, number: int) -> Self:
        """Return the sound without one of its channels, such as that of the pulses.

        Parameters
        ----------
        number
            The channel; the first is 1.

        Returns
        -------
        Sound
            The other channels.

        Raises
        ------
        DataError
            If there is no such channel, or no other.
        """
        self.get_channel(number)
        if self.channels == 1:
            raise DataError(f"the sound has no channel but channel {number}")
        return self.replace(samples=np.delete(self.samples, number - 1, axis=1))

    def to_mono(self) -> Self:
        """Return the mean of the channels.

        Returns
        -------
        Sound
            One channel.
        """
        return self.replace(samples=self.samples.mean(axis=1))

    def replace(self, **changes: object) -> Self:
        """Return a copy with some fields changed, checked again.

        Parameters
        ----------
        **changes
            Fields and their new values.

        Returns
        -------
        Sound
            The copy.
        """
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]
