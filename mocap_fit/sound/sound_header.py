"""What headers of sound files say, where libsndfile says less or does not read them.

It cuts the length of most files to what is there without a word, and refuses wav files whose
chunks are not quite in order. Samples are read by it alone.
"""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

_ORDERS = {b"RIFF": "<", b"RF64": "<", b"BW64": "<", b"RIFX": ">", b"FORM": ">"}
# A file with more chunks than this before its samples is no sound.
_MOST_CHUNKS = 1000
# Sizes that programs write which do not know how long the sound will be: sox and arecord, then
# those that write the largest number or one a little below.
_STREAMED = (range(0x7FFFF000, 0x80000001), range(0xFFFFF000, 0x100000000))
# How files begin that are read: wav and its relatives, FLAC, NIST, AIFF, AU, CAF, Ogg, MP3 with
# and without a tag. libsndfile also takes formats that begin with anything, and a decoder of one
# of them prints.
_HEADS = re.compile(
    rb"RIFF|RIFX|RF64|BW64|riff|fLaC|NIST|FORM|\.snd|dns\.|caff|OggS|ID3|\xff[\xe0-\xff]"
)
_TAIL = 65536 + 282


@dataclass(frozen=True)
class Chunk:
    """A chunk of a RIFF or an AIFF file.

    Parameters
    ----------
    name
        Four characters.
    start
        Where its content begins, bytes from the start of the file.
    size
        What it says is its size, bytes.
    """

    name: bytes
    start: int
    size: int


def list_chunks(stream: BinaryIO) -> Iterator[Chunk]:
    """Yield the chunks up to the first that is larger than the file, which is yielded too.

    The size of the file in its header is not used, and a missing pad byte is no harm.

    Parameters
    ----------
    stream
        A file; nothing is yielded where it is not of RIFF, AIFF or their relatives.

    Yields
    ------
    Chunk
        The next chunk.
    """
    end = stream.seek(0, io.SEEK_END)
    order = _ORDERS.get(_read(stream, 0, 4))
    position = 12
    for _ in range(_MOST_CHUNKS if order else 0):
        head = _read(stream, position, 8)
        if len(head) < 8:
            return
        name, size = struct.unpack(f"{order}4sI", head)
        yield Chunk(name, position + 8, size)
        position += 8 + size
        if position > end:
            return
        if size % 2:
            pad = _read(stream, position, 4)
            position += not (pad[:1] != b"\0" and _is_name(pad))


def _read(stream: BinaryIO, position: int, size: int) -> bytes:
    stream.seek(position)
    return stream.read(size)


def _is_name(name: bytes) -> bool:
    return len(name) == 4 and all(32 <= letter < 127 for letter in name)


@dataclass(frozen=True)
class _Wav:
    """Where a wav file has what is needed to read it; `announced` is None in a stream."""

    order: str
    format: bytes
    fact: bytes
    start: int
    announced: int | None
    available: int


def _find_wav(stream: BinaryIO) -> _Wav | None:
    """Find format and samples of a wav file; None where there are none."""
    head = _read(stream, 0, 12)
    if head[8:] != b"WAVE":
        return None
    contents: dict[bytes, bytes] = {}
    for chunk in list_chunks(stream):
        if chunk.name != b"data":
            contents.setdefault(chunk.name, _read(stream, chunk.start, min(chunk.size, 4096)))
            continue
        size: int | None = chunk.size
        wide = contents.get(b"ds64", b"")
        if chunk.size == 0xFFFFFFFF and len(wide) >= 16:
            (size,) = struct.unpack_from("<Q", wide, 8)
        elif any(chunk.size in sizes for sizes in _STREAMED):
            size = None
        form = contents.get(b"fmt ", b"")
        if len(form) < 16:
            return None
        available = stream.seek(0, io.SEEK_END) - chunk.start
        fact = contents.get(b"fact", b"")
        return _Wav(_ORDERS[head[:4]], form, fact, chunk.start, size, available)
    return None


def has_known_head(stream: BinaryIO) -> bool:
    """Whether a file begins as one of the formats that are read.

    Parameters
    ----------
    stream
        The file.

    Returns
    -------
    bool
        False for raw samples, and for formats of samplers and old computers.
    """
    return _HEADS.match(_read(stream, 0, 4)) is not None


def mend_wav(stream: BinaryIO) -> io.BytesIO | None:
    """Write a wav file anew: format and samples in order, with their right sizes.

    Parameters
    ----------
    stream
        A file that libsndfile does not read, or finds empty.

    Returns
    -------
    io.BytesIO
        The wav file; None where the stream has no format, or no samples.
    """
    wav = _find_wav(stream)
    if wav is None or (wav.announced == 0 and _is_chain(stream, wav.start)):
        return None
    size = min(wav.announced or wav.available, wav.available)
    chunks = [(b"fmt ", wav.format), (b"fact", wav.fact), (b"data", _read(stream, wav.start, size))]
    content = b"WAVE"
    for name, part in chunks:
        if part:
            content += name + struct.pack(f"{wav.order}I", len(part)) + part + bytes(len(part) % 2)
    if not size or len(content) >= 2**32:
        return None
    kind = b"RIFF" if wav.order == "<" else b"RIFX"
    return io.BytesIO(kind + struct.pack(f"{wav.order}I", len(content)) + content)


def _is_chain(stream: BinaryIO, position: int) -> bool:
    """Whether chunks with proper names fill the rest of a file."""
    end = stream.seek(0, io.SEEK_END)
    while position < end:
        head = _read(stream, position, 8)
        if len(head) < 8 or not _is_name(head[:4]):
            return False
        (size,) = struct.unpack_from("<I", head, 4)
        position += 8 + size + size % 2
    return position == end


def has_wav_header(stream: BinaryIO) -> bool:
    """Whether a file is a wav file whose sizes are right.

    Parameters
    ----------
    stream
        A file.

    Returns
    -------
    bool
        False for other formats too.
    """
    wav = _find_wav(stream)
    size = int.from_bytes(_read(stream, 4, 4), "little") + 8
    end = stream.seek(0, io.SEEK_END)
    has_all = wav is not None and wav.announced is not None and 0 < wav.announced <= wav.available
    return has_all and _read(stream, 0, 4) == b"RIFF" and size in (end, end - 1)


def count_announced(stream: BinaryIO, kind: str, count: int) -> int | None:
    """Return how many samples a sound file says that each channel has.

    Parameters
    ----------
    stream
        The file.
    kind
        Its format, as libsndfile names it.
    count
        How many there are.

    Returns
    -------
    int
        None where it does not say, or libsndfile does.
    """
    if kind in ("WAV", "WAVEX", "RF64"):
        wav = _find_wav(stream)
        if wav is None or wav.announced is None:
            return None
        if 0 < wav.announced <= wav.available:
            return count
        tag, _, _, _, size = struct.unpack_from(f"{wav.order}HHIIH", wav.format)
        if tag not in (1, 3, 0xFFFE) and len(wav.fact) >= 4:
            # Blocks of several samples.
            return int(struct.unpack_from(f"{wav.order}I", wav.fact)[0])
        return int(wav.announced // max(size, 1))
    if kind == "AIFF":
        common = next((chunk for chunk in list_chunks(stream) if chunk.name == b"COMM"), None)
        content = b"" if common is None else _read(stream, common.start + 2, 4)
        return int.from_bytes(content, "big") if len(content) == 4 else None
    if kind == "NIST":
        match = re.search(rb"^sample_count -i (\d{1,18})\s", _read(stream, 0, 1024), re.MULTILINE)
        return int(match[1]) if match else None
    if kind == "AU":
        order = ">" if _read(stream, 0, 4) == b".snd" else "<"
        start, size = struct.unpack(f"{order}II", _read(stream, 4, 8))
        there = min(size, stream.seek(0, io.SEEK_END) - start)
        return None if size == 0xFFFFFFFF or there < count else size // (there // count)
    return None


def is_bw64(stream: BinaryIO) -> bool:
    """Whether a file is a wav file of the kind that libsndfile does not know.

    Parameters
    ----------
    stream
        The file.

    Returns
    -------
    bool
        True for BW64 of ITU-R BS.2088.
    """
    return _read(stream, 0, 4) == b"BW64"


def is_open_ended(stream: BinaryIO) -> bool:
    """Whether the last page of an Ogg file is incomplete, or not marked as the last.

    Parameters
    ----------
    stream
        The file.

    Returns
    -------
    bool
        True where the file is cut off.
    """
    end = stream.seek(0, io.SEEK_END)
    tail = _read(stream, max(end - _TAIL, 0), _TAIL)
    page = tail[max(tail.rfind(b"OggS"), 0) :]
    if len(page) < 27 or not page[5] & 4:
        return True
    sizes = page[27 : 27 + page[26]]
    return len(page) < 27 + page[26] + sum(sizes)


def describe_header(stream: BinaryIO) -> tuple[str | None, int | None, str]:
    """Describe the header of a sound file that cannot be read.

    Parameters
    ----------
    stream
        The file.

    Returns
    -------
    description
        What the header says; None where it is of no known kind.
    announced
        How many samples the header of a wav file announces; None where it does not.
    advice
        What to do.
    """
    damaged = "The file is damaged; export or copy it again."
    head = _read(stream, 0, 1024)
    coding = re.search(rb"^sample_coding -s\d+ (\w+,[\w.,-]+)", head, re.MULTILINE)
    if head.startswith(b"NIST") and coding:
        return f"samples as {coding[1].decode('ascii')}", None, "Unpack it with sph2pipe."
    if head[8:12] != b"WAVE":
        advice = "Convert it to a wav file. Samples without a header need their rate and encoding."
        return None, None, advice
    chunks = list(list_chunks(stream))
    form = next((chunk for chunk in chunks if chunk.name == b"fmt "), None)
    content = b"" if form is None else _read(stream, form.start, min(form.size, 16))
    if len(content) < 16:
        return "no format ('fmt ')", None, damaged
    tag, channels, rate, _, _, bits = struct.unpack(f"{_ORDERS.get(head[:4], '<')}HHIIHH", content)
    description = f"format 0x{tag:04x}, {channels} channels, {rate} Hz, {bits} bits"
    if not any(chunk.name == b"data" for chunk in chunks):
        last = chunks[-1]
        description += ", no samples ('data')"
        if last.start + last.size > stream.seek(0, io.SEEK_END):
            description += f"; the chunk at byte {last.start - 8} announces {last.size} bytes"
        return description, None, damaged
    announced = count_announced(stream, "WAV", 0)
    return description, announced, "Convert it to a plain wav file, or export it again."
