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
from mocap_fit.errors import DataError, FileFormatError, from_os_error
from mocap_fit.tracks import FloatArray

Encoding = Literal["PCM_16", "PCM_24", "PCM_32", "FLOAT", "DOUBLE"]
_ENCODINGS: tuple[Encoding, ...] = get_args(Encoding)


@dataclass(frozen=True, eq=False)
class Sound:
    """Sound of one or more channels.

    Parameters
    ----------
    samples
        `(samples, channels)`; one dimension is one channel. Full scale is 1.
    rate
        Samples a second, hertz.
    name
        What it is called; the file name without its ending when it was read.
    encoding
        How its samples were stored, and are when it is written.

    Raises
    ------
    DataError
        If the shape or the rate is impossible, or a sample is not a finite number.
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
                "the sampling rate is not possible",
                found=f"{self.rate} Hz",
                expected="a number above 0",
            )
        bad = ~np.isfinite(samples)
        if bad.any():
            raise DataError(
                "the sound has samples that are no numbers",
                found=f"{int(bad.sum())}, the first is sample {int(np.argwhere(bad)[0][0])}",
            )
        samples.setflags(write=False)
        object.__setattr__(self, "samples", samples)
        object.__setattr__(self, "rate", float(self.rate))

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def channels(self) -> int:
        """Number of channels."""
        return int(self.samples.shape[1])

    @property
    def duration(self) -> float:
        """Number of samples over the rate, in seconds."""
        return len(self.samples) / self.rate

    def channel(self, number: int) -> FloatArray:
        """The samples of one channel, `(samples,)`; the first channel is 1.

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

    def without_channel(self, number: int) -> Self:
        """The sound without one of its channels, such as that of the pulses.

        Raises
        ------
        DataError
            If there is no such channel, or no other.
        """
        self.channel(number)
        if self.channels == 1:
            raise DataError(f"the sound has no channel but channel {number}")
        return self.replace(samples=np.delete(self.samples, number - 1, axis=1))

    def mono(self) -> Self:
        """The mean of the channels, as one."""
        return self.replace(samples=self.samples.mean(axis=1))

    def replace(self, **changes: object) -> Self:
        """A copy with some fields changed, checked again."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]


def read_sound(path: str | os.PathLike[str]) -> Sound:
    """Read a wav file, or another format that libsndfile knows (FLAC, AIFF, Ogg).

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FileFormatError
        If there is no such file, it is not sound, or it holds no sample.
    DataError
        If a sample is not a finite number.
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
    encoding: Encoding = "PCM_16"
    for known in _ENCODINGS:
        encoding = known if stored == known else encoding
    try:
        return Sound(samples, rate, name=file.stem, encoding=encoding)
    except DataError as error:
        raise DataError(
            error.problem, path=path, found=error.found, expected=error.expected
        ) from None


def write_sound(
    sound: Sound, path: str | os.PathLike[str], *, encoding: Encoding | None = None
) -> None:
    """Write a wav file, whole or not at all; the same sound gives the same bytes.

    Parameters
    ----------
    sound
        What to write; the rate must be a whole number of hertz.
    path
        The file; one that exists is replaced.
    encoding
        How a sample is stored; as the sound says where not given. As whole numbers
        (``PCM_16``), samples beyond full scale are clipped.

    Raises
    ------
    DataError
        If the rate is not a whole number.
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
            expected="a whole number",
        )
    samples: FloatArray = sound.samples
    encoding = encoding or sound.encoding
    if encoding.startswith("PCM"):
        samples = np.clip(samples, -1.0, 1.0)
    stream = io.BytesIO()
    soundfile.write(stream, samples, rate, subtype=encoding, format="WAV")
    with write_atomically(path) as partial:
        partial.write_bytes(_without_clock_time(stream.getvalue()))


def _without_clock_time(content: bytes) -> bytes:
    """The file without the time of writing, which libsndfile puts beside the peaks of floats."""
    place = 12
    while place + 16 <= len(content):
        (size,) = struct.unpack_from("<I", content, place + 4)
        if content[place : place + 4] == b"PEAK":
            return content[: place + 12] + bytes(4) + content[place + 16 :]
        place += 8 + size + size % 2
    return content
