"""Sound files: read by libsndfile, written as wav."""

from __future__ import annotations

import io
import os
import struct
import warnings
from dataclasses import dataclass
from typing import Any, BinaryIO, Literal, get_args

import numpy as np

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import (
    DataError,
    FileFormatError,
    MocapFitWarning,
    add_path,
    from_os_error,
)
from mocap_fit.io.text import check_file
from mocap_fit.size_limit import check_size
from mocap_fit.sound.sound import Sound
from mocap_fit.sound.sound_header import (
    count_announced,
    describe_header,
    has_known_head,
    has_wav_header,
    is_bw64,
    is_open_ended,
    mend_wav,
)
from mocap_fit.tracks import FloatArray

SOUND_ENDINGS = (
    *(".wav", ".wave", ".flac", ".aif", ".aiff", ".aifc", ".ogg", ".oga", ".opus", ".mp3"),
    *(".sph", ".nist", ".au", ".rf64", ".w64", ".caf"),
)
"""Endings of the names of sound files, in lower case."""

Encoding = Literal["PCM_U8", "PCM_16", "PCM_24", "PCM_32", "ULAW", "ALAW", "FLOAT", "DOUBLE"]
_ENCODINGS: tuple[Encoding, ...] = get_args(Encoding)
# Bits of a sample; those of floating-point numbers are not listed.
_BITS = {"PCM_U8": 8, "PCM_16": 16, "PCM_24": 24, "PCM_32": 32, "ULAW": 16, "ALAW": 16}
_BLOCK = 65536
# The length that libsndfile gives a file that does not say its own.
_UNKNOWN = 2**63 - 1
# Hertz. Above it, a header is damaged.
_HIGHEST_RATE = 10_000_000
# Files of floats may hold integers of up to 32 bits.
_LOUDEST = 2.0**31


def read_sound(path: str | os.PathLike[str]) -> Sound:
    """Read a sound file: wav, FLAC, NIST SPHERE, AIFF, AU, CAF, Ogg or MP3.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Sound
        All its channels. Integers are divided by their full scale, those of 16 bits by 32768.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is not a sound file, it holds no sample, or it claims more than may be unpacked.
    DataError
        If a sample is not a finite number, or the sampling rate is out of range.

    Warns
    -----
    MocapFitWarning
        If the file is cut off, or does not say how long it is.

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
    file = check_file(path)
    try:
        with open(file, "rb", buffering=0) as stream:
            decoded, fault = _decode(stream, path)
            mended = mend_wav(stream) if decoded is None else None
            if mended is not None:
                decoded, fault = _decode(mended, path)
            if decoded is None:
                raise _describe_failure(stream, path, fault)
            loss = _describe_loss(stream, decoded, was_mended=mended is not None)
    except OSError as error:
        raise from_os_error(error, path) from None
    if loss:
        warnings.warn(f"{os.fspath(path)}: {loss}", MocapFitWarning, stacklevel=2)
    try:
        sound = Sound(decoded.samples, decoded.rate, name=file.stem, encoding=decoded.encoding)
    except DataError as error:
        raise add_path(error, path) from None
    loudest = float(np.abs(sound.samples).max()) if decoded.encoding not in _BITS else 1.0
    if loudest > _LOUDEST:
        raise DataError(
            "the samples are far beyond full scale",
            path=path,
            found=f"{loudest:.3g}",
            expected="-1 to 1",
            advice="The file is damaged; export or copy it again.",
        )
    return sound


@dataclass(frozen=True)
class _Decoded:
    """What libsndfile has read: the format and encoding have its names."""

    samples: FloatArray
    rate: int
    format: str
    encoding: str
    expected: int
    """Number of samples that libsndfile expected; `_UNKNOWN` where the file does not say."""


def _decode(source: BinaryIO, path: str | os.PathLike[str]) -> tuple[_Decoded | None, str | None]:
    """Return the samples before the end or the first fault, or the reason why there are none."""
    import soundfile

    if not has_known_head(source):
        return None, "no format that is known"
    # A descriptor, so that libsndfile cannot guess a format by the name. On Windows each runtime
    # library has descriptors of its own.
    is_file = os.name != "nt" and not isinstance(source, io.BytesIO)
    size = source.seek(0, io.SEEK_END)
    source.seek(0)
    try:
        with soundfile.SoundFile(source.fileno() if is_file else source, closefd=False) as opened:
            # It would seek after every block, which some encodings cannot.
            opened.seekable = lambda: False
            if opened.samplerate > _HIGHEST_RATE:
                raise FileFormatError(
                    "the sampling rate is out of range",
                    path=path,
                    found=f"{opened.samplerate} Hz",
                    expected=f"at most {_HIGHEST_RATE} Hz",
                )
            if opened.frames != _UNKNOWN and size < opened.frames * opened.channels:
                # It is compressed, or says so.
                check_size(8 * opened.frames * opened.channels, path=path, noun="sound file")
            samples = _read_blocks(opened, path)
            about = (opened.samplerate, opened.format, opened.subtype, opened.frames)
    except soundfile.LibsndfileError as error:
        return None, error.error_string
    return (_Decoded(samples, *about), None) if len(samples) else (None, None)


def _read_blocks(opened: Any, path: str | os.PathLike[str]) -> FloatArray:
    """Return the samples before the end or the first fault, ``(samples, channels)``."""
    import soundfile

    frames, channels = opened.frames, opened.channels
    # Memory is taken only where something is written.
    samples: FloatArray = np.empty((frames if frames != _UNKNOWN else 16 * _BLOCK, channels))
    count = 0
    while count < frames:
        if count == len(samples):
            check_size(16 * count * channels, path=path, noun="sound file")
            samples.resize((2 * count, channels), refcheck=False)
        block = samples[count : count + _BLOCK]
        block.fill(np.nan)
        try:
            read = len(opened.read(out=block))
        except soundfile.LibsndfileError:
            # What was decoded before the fault is there.
            missing = np.isnan(block).any(axis=1)
            return samples[: count + (int(missing.argmax()) if missing.any() else len(block))]
        count += read
        if read < len(block):
            break
    return samples[:count]


def _describe_loss(stream: BinaryIO, decoded: _Decoded, *, was_mended: bool) -> str | None:
    """Return what is to be said of a file that ends early or whose header is wrong."""
    count, expected = len(decoded.samples), decoded.expected
    announced = count_announced(stream, decoded.format, count)
    if announced is None and expected != _UNKNOWN:
        # The length of an MP3 file that does not say it is estimated.
        announced = expected if decoded.format != "MP3" or count < 0.95 * expected else count
    if announced == 0:
        return f"the header announces no sample; all {count} that follow were read"
    if announced is not None and count < announced:
        return f"the sound file is cut off or damaged: {count} of {announced} samples were read"
    if decoded.format == "OGG" and is_open_ended(stream):
        return f"the sound file is cut off: {count} samples were read, and its end is missing"
    if was_mended and not is_bw64(stream):
        return f"the sound file has a damaged header; {count} samples were read"
    return None


def _describe_failure(
    stream: BinaryIO, path: str | os.PathLike[str], fault: str | None
) -> FileFormatError:
    """Return the error for a file without sound that can be read."""
    header, announced, advice = describe_header(stream)
    if fault is None:
        return FileFormatError(
            "the sound file holds no sample",
            path=path,
            expected=announced or None,
            advice="The file is cut off; export or copy it again." if announced else None,
        )
    return FileFormatError(
        "this is not a sound file that can be read",
        path=path,
        found=header or fault.rstrip("."),
        expected="wav, FLAC, NIST SPHERE, AIFF, Ogg or MP3",
        advice=advice,
    )


def is_plain_wav(path: str | os.PathLike[str]) -> bool:
    """Whether a file is a wav file that any program reads: its header says how long it is.

    Parameters
    ----------
    path
        A sound file that `read_sound` can read.

    Returns
    -------
    bool
        False for other formats, and for wav files that are cut off or have a damaged header.
    """
    with open(path, "rb") as stream:
        return has_wav_header(stream)


def write_sound(
    sound: Sound, path: str | os.PathLike[str], *, encoding: Encoding | None = None
) -> None:
    """Write a wav file atomically; the same sound gives the same bytes.

    A sound that was read from integers is written with the same integers.

    Parameters
    ----------
    sound
        The sound; its rate must be an integer number of hertz.
    path
        The file; an existing one is replaced.
    encoding
        How samples are stored. If None, as the sound's own encoding says; ``PCM_16`` where that
        is none of these, or compresses with losses. As integers, samples beyond full scale are
        clipped.

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
    subtype: str = encoding or (sound.encoding if sound.encoding in _ENCODINGS else "PCM_16")
    samples = sound.samples
    if subtype in _BITS:
        # Not by libsndfile, which multiplies by another number than it divides by.
        half = 2.0 ** (_BITS[subtype] - 1)
        integers = samples * half
        np.rint(integers, out=integers)
        np.clip(integers, -half, half - 1, out=integers)
        kind, top = (np.int16, 2.0**15) if half <= 2**15 else (np.int32, 2.0**31)
        samples = (integers * (top / half)).astype(kind)
    stream = io.BytesIO()
    soundfile.write(stream, samples, rate, subtype=subtype, format="WAV")
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
