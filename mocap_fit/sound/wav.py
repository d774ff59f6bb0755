"""Sound in memory, and wav files in and out."""

from __future__ import annotations

import dataclasses
import io
import os
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Self, get_args

import numpy as np

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import DataError, FileFormatError, add_path, from_os_error
from mocap_fit.tracks import FloatArray

Encoding = Literal["PCM_16", "PCM_24", "PCM_32", "FLOAT", "DOUBLE"]
_ENCODINGS: tuple[Encoding, ...] = get_args(Encoding)


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
        How its samples are stored in a file.

    Raises
    ------
    DataError
        If the shape or the rate is out of range, or a sample is not a finite number.
    """

    samples: FloatArray
    rate: float
    name: str = field(default="", kw_only=True)
    encoding: Encoding = field(default="PCM_16", kw_only=True)

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


def read_sound(path: str | os.PathLike[str]) -> Sound:
    """Read a wav file, or another format that libsndfile knows (FLAC, AIFF, Ogg).

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Sound
        All its channels.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is not a sound file, or it holds no sample.
    DataError
        If a sample is not a finite number.

    See Also
    --------
    read_tracks : Read the markers of the recording that belongs to it.
    render_movie : Make a movie of a talking head, with sound.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> sound = mf.read_sound(mf.load_sample("take_01.wav"))
    >>> sound
    Sound('take_01', 1 channel, 3.08 s at 8000 Hz)
    >>> sound.samples.shape
    (24640, 1)
    """
    import soundfile

    file = Path(path)
    try:
        with open(file, "rb") as stream, soundfile.SoundFile(stream) as opened:
            samples, rate = opened.read(dtype="float64", always_2d=True), opened.samplerate
            stored = opened.subtype
    except OSError as error:
        raise from_os_error(error, path) from None
    except (RuntimeError, ValueError, TypeError) as error:
        raise FileFormatError(
            "this is not a sound file that can be read",
            path=path,
            found=error,
            expected="wav, FLAC, AIFF or Ogg",
            advice="Convert it to a plain wav file.",
        ) from None
    if not len(samples):
        raise FileFormatError("the sound file holds no sample", path=path)
    encoding = next((known for known in _ENCODINGS if stored == known), _ENCODINGS[0])
    try:
        return Sound(samples, rate, name=file.stem, encoding=encoding)
    except DataError as error:
        raise add_path(error, path) from None


def write_sound(
    sound: Sound, path: str | os.PathLike[str], *, encoding: Encoding | None = None
) -> None:
    """Write a wav file atomically; the same sound gives the same bytes.

    Parameters
    ----------
    sound
        The sound; its rate must be an integer number of hertz.
    path
        The file; an existing one is replaced.
    encoding
        How samples are stored; that of the sound if None. As integers (``PCM_16``), samples
        beyond full scale are clipped.

    Raises
    ------
    DataError
        If the rate is not an integer.
    FileFormatError
        If the file cannot be written.
    """
    import soundfile

    rate = round(sound.rate)
    if abs(rate - sound.rate) > 1e-9 * sound.rate:
        raise DataError(
            "a wav file cannot hold this sampling rate",
            path=path,
            found=f"{sound.rate} Hz",
            expected="an integer",
        )
    stream = io.BytesIO()
    subtype = encoding or sound.encoding
    soundfile.write(stream, sound.samples, rate, subtype=subtype, format="WAV")
    with write_atomically(path) as partial:
        partial.write_bytes(_remove_clock_time(stream.getvalue()))


def _remove_clock_time(content: bytes) -> bytes:
    """Return a file without the time of writing, which libsndfile notes beside peaks of floats."""
    start = 12
    while start + 16 <= len(content):
        (size,) = struct.unpack_from("<I", content, start + 4)
        if content[start : start + 4] == b"PEAK":
            return content[: start + 12] + bytes(4) + content[start + 16 :]
        start += 8 + size + size % 2
    return content
