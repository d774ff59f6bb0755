"""What headers say, byte by byte: chunks in order, sizes at their limits, announced lengths."""

import io
import struct

import pytest

from mocap_fit.sound.sound_header import (
    _find_wav,
    count_announced,
    describe_header,
    has_wav_header,
    is_bw64,
    is_open_ended,
    list_chunks,
    mend_wav,
)


def chunk(name, content=b"", size=None, order="<"):
    size = len(content) if size is None else size
    return name + struct.pack(f"{order}I", size) + content


def wav(*chunks, kind=b"RIFF", size=None):
    content = b"WAVE" + b"".join(chunks)
    return kind + struct.pack("<I", len(content) if size is None else size) + content


def form(tag=1, channels=2, block=4, more=b""):
    return chunk(b"fmt ", struct.pack("<HHIIHH", tag, channels, 8000, 32000, block, 16) + more)


DATA = bytes(range(40))


def chunks_of(content):
    return [(c.name, c.start, c.size) for c in list_chunks(io.BytesIO(content))]


def test_chunks_begin_behind_their_heads():
    content = wav(form(), chunk(b"data", DATA), chunk(b"LIST", b"INFO"))
    assert chunks_of(content) == [(b"fmt ", 20, 16), (b"data", 44, 40), (b"LIST", 92, 4)]
    assert chunks_of(b"none" + content[4:]) == chunks_of(b"") == chunks_of(content[:12]) == []
    big = b"FORM" + bytes(4) + b"AIFF" + chunk(b"COMM", bytes(18), order=">")
    assert chunks_of(big) == [(b"COMM", 20, 18)]
    # Seven bytes are no head of a chunk, and eight are.
    assert chunks_of(content + b"junk\0\0\0")[3:] == []
    assert chunks_of(content + chunk(b"junk"))[3:] == [(b"junk", 104, 0)]


def test_an_odd_chunk_has_a_byte_more_unless_a_name_follows_at_once():
    after = chunk(b"data", DATA)
    assert chunks_of(wav(chunk(b"junk", b"odd"), b"\0", after))[1] == (b"data", 32, 40)
    assert chunks_of(wav(chunk(b"junk", b"odd"), after))[1] == (b"data", 31, 40)
    # A pad byte that is not 0 is one where no name begins with it.
    assert chunks_of(wav(chunk(b"junk", b"odd"), b"\x7f", after))[1] == (b"data", 32, 40)
    assert chunks_of(wav(chunk(b"junk", b"odd"), b" ", chunk(b"\x1fdat")))[1][0] == b"\x1fdat"


def test_the_first_chunk_that_is_larger_than_the_file_is_the_last():
    content = wav(form(), chunk(b"junk", b"12", 3), chunk(b"data", DATA))
    assert [name for name, *_ in chunks_of(wav(form(), chunk(b"junk", b"", 99)))] == [
        b"fmt ",
        b"junk",
    ]
    assert len(chunks_of(content)) >= 2


@pytest.mark.parametrize(("before", "found"), [(998, True), (999, True), (1000, False)])
def test_a_thousand_chunks_are_looked_through(before, found):
    content = wav(form(), *[chunk(b"junk")] * (before - 1), chunk(b"data", DATA))
    assert (_find_wav(io.BytesIO(content)) is not None) == found


@pytest.mark.parametrize(
    ("size", "announced"),
    [
        (0, 0),
        (40, 40),
        (0x7FFFEFFF, 0x7FFFEFFF),
        (0x7FFFF000, None),
        (0x80000000, None),
        (0x80000001, 0x80000001),
        (0xFFFFEFFF, 0xFFFFEFFF),
        (0xFFFFF000, None),
        (0xFFFFFFFE, None),
        (0xFFFFFFFF, None),
    ],
)
def test_sizes_of_streams_announce_nothing(size, announced):
    found = _find_wav(io.BytesIO(wav(form(), chunk(b"data", DATA, size))))
    assert (found.announced, found.available, found.start) == (announced, 40, 44)
    assert count_announced(io.BytesIO(wav(form(), chunk(b"data", DATA, size))), "WAV", 10) == (
        None if announced is None else 10 if announced == 40 else announced // 4
    )


@pytest.mark.parametrize(("length", "announced"), [(15, None), (16, 36), (24, 36)])
def test_wide_sizes_are_in_their_own_chunk(length, announced):
    wide = chunk(b"ds64", struct.pack("<QQQ", 99, 36, 9)[:length]) + bytes(length % 2)
    content = wav(wide, form(), chunk(b"data", DATA, 0xFFFFFFFF), kind=b"RF64")
    assert _find_wav(io.BytesIO(content)).announced == announced
    # They do not count where the plain size says something.
    plain = wav(wide, form(), chunk(b"data", DATA), kind=b"RF64")
    assert _find_wav(io.BytesIO(plain)).announced == 40


def test_a_format_has_sixteen_bytes_and_the_first_one_counts():
    short = chunk(b"fmt ", form()[8:22]) + chunk(b"data", DATA)
    assert _find_wav(io.BytesIO(wav(short))) is None
    twice = wav(form(), form(tag=3), chunk(b"data", DATA))
    assert _find_wav(io.BytesIO(twice)).format[:2] == b"\1\0"
    assert _find_wav(io.BytesIO(wav(form())[:8] + b"AVI " + form())) is None


def test_a_mended_file_has_its_chunks_in_order_and_their_sizes():
    content = wav(chunk(b"junk", b"12"), form(), chunk(b"data", DATA[:39], 0), size=0)
    expected = wav(form(), chunk(b"data", DATA[:39]), b"\0")
    assert mend_wav(io.BytesIO(content)).getvalue() == expected
    fact = chunk(b"fact", struct.pack("<I", 80))
    packed = wav(fact, form(tag=17), chunk(b"data", DATA, 100))
    assert mend_wav(io.BytesIO(packed)).getvalue() == wav(form(tag=17), fact, chunk(b"data", DATA))
    cut = wav(form(), chunk(b"data", DATA, 20))
    assert mend_wav(io.BytesIO(cut)).getvalue() == wav(form(), chunk(b"data", DATA[:20]))
    big = b"RIFX" + bytes(4) + b"WAVE" + chunk(b"fmt ", form()[8:], order=">")
    mended = mend_wav(io.BytesIO(big + chunk(b"data", DATA, order=">"))).getvalue()
    assert mended[:8] == b"RIFX" + struct.pack(">I", len(mended) - 8)
    for nothing in (wav(form()), wav(chunk(b"data", DATA)), wav(form(), chunk(b"data", b""))):
        assert mend_wav(io.BytesIO(nothing)) is None


def test_a_size_of_0_is_right_where_proper_chunks_fill_the_rest():
    odd = chunk(b"LIST", b"odd") + b"\0"
    for rest, empty in (
        (b"", True),
        (chunk(b"LIST", b"INFO"), True),
        (odd + chunk(b"note"), True),
        (chunk(b"LIST", b"INFO") + b"\0", False),
        (chunk(b"LIST", b"INFO", 5), False),
        (b"\1\2\3\4" + bytes(4), False),
        (b"LIST", False),
    ):
        stream = io.BytesIO(wav(form(), chunk(b"data"), rest))
        assert (mend_wav(stream) is None) == empty


def test_a_plain_header_has_the_right_sizes():
    for content, plain in (
        (wav(form(), chunk(b"data", DATA)), True),
        (wav(form(), chunk(b"data", DATA), size=75), True),
        (wav(form(), chunk(b"data", DATA), size=77), False),
        (wav(form(), chunk(b"data", DATA), size=74), False),
        (wav(form(), chunk(b"data", DATA, 41), size=76), False),
        (wav(form(), chunk(b"data", b"")), False),
        (wav(form(), chunk(b"data", DATA, 0xFFFFFFFF)), False),
    ):
        assert has_wav_header(io.BytesIO(content)) == plain


@pytest.mark.parametrize(
    ("tag", "block", "fact", "expected"),
    [
        (1, 4, b"", 25),
        (3, 8, struct.pack("<I", 7), 12),
        (0xFFFE, 2, struct.pack("<I", 7), 50),
        (17, 4, struct.pack("<I", 7), 7),
        (17, 4, b"\7\0\0", 25),
        (1, 0, b"", 100),
    ],
)
def test_samples_are_counted_by_their_size_or_as_packed_files_say(tag, block, fact, expected):
    content = wav(form(tag, block=block), chunk(b"fact", fact), chunk(b"data", DATA, 100))
    if len(fact) % 2:
        content = wav(
            form(tag, block=block), chunk(b"fact", fact), b"\0", chunk(b"data", DATA, 100)
        )
    for kind in ("WAV", "WAVEX", "RF64"):
        assert count_announced(io.BytesIO(content), kind, 9) == expected
    assert count_announced(io.BytesIO(content), "FLAC", 9) is None


def test_other_headers_announce_their_samples():
    aiff = b"FORM" + bytes(4) + b"AIFF" + chunk(b"COMM", struct.pack(">HIH", 2, 70000, 16), 18, ">")
    assert count_announced(io.BytesIO(aiff), "AIFF", 5) == 70000
    assert count_announced(io.BytesIO(aiff[:25]), "AIFF", 5) is None
    assert count_announced(io.BytesIO(aiff[:12]), "AIFF", 5) is None
    nist = b"NIST_1A\n   1024\nsample_count -i 4711\nend_head\n"
    assert count_announced(io.BytesIO(nist.ljust(1024)), "NIST", 5) == 4711
    late = b"NIST_1A\n".ljust(1010, b" ") + b"\nsample_count -i 4711\n"
    assert count_announced(io.BytesIO(late), "NIST", 5) is None
    for length, expected in ((1024, 47), (1025, None)):
        field = b"\nsample_count -i 47\n"
        ends = b"NIST_1A\n".ljust(length - len(field), b" ") + field
        assert count_announced(io.BytesIO(ends), "NIST", 5) == expected
    assert count_announced(io.BytesIO(nist.replace(b"4711", b"9" * 19)), "NIST", 5) is None


@pytest.mark.parametrize("order", [">", "<"])
def test_an_au_file_announces_bytes(order):
    magic = b".snd" if order == ">" else b"dns."

    def count(size, there, found):
        head = magic + struct.pack(f"{order}IIIII", 24, size, 3, 8000, 1)
        return count_announced(io.BytesIO(head + bytes(there)), "AU", found)

    assert count(200, 100, 50) == 100
    assert count(100, 100, 50) == 50
    assert count(100, 300, 50) == 50
    assert count(0xFFFFFFFF, 100, 50) is None
    assert count(100, 100, 101) is None
    assert count(100, 100, 100) == 100


def page(flag, sizes, content):
    return b"OggS\0" + bytes([flag]) + bytes(20) + bytes([len(sizes), *sizes]) + content


def test_the_last_page_of_ogg_is_marked_and_complete():
    first, last = page(0, [5], b"12345"), page(4, [200, 3], bytes(203))
    assert not is_open_ended(io.BytesIO(first + last))
    assert not is_open_ended(io.BytesIO(page(5, [], b"")))
    assert is_open_ended(io.BytesIO(first + last[:-1]))
    assert is_open_ended(io.BytesIO(first))
    assert is_open_ended(io.BytesIO(page(4, [], b"")[:26]))
    assert is_open_ended(io.BytesIO(b""))
    longest = page(4, [255] * 255, bytes(255 * 255))
    assert not is_open_ended(io.BytesIO(bytes(99999) + longest))
    assert is_open_ended(io.BytesIO(bytes(99999) + longest[:-1]))


def test_headers_that_cannot_be_read_are_described():
    def describe(content):
        return describe_header(io.BytesIO(content))

    words, announced, advice = describe(wav(form(0x55), chunk(b"data", DATA, 100)))
    assert words == "format 0x0055, 2 channels, 8000 Hz, 16 bits"
    assert announced == 25
    assert "plain wav" in advice
    assert describe(wav(form()))[0].endswith(", no samples ('data')")
    far = wav(form(), chunk(b"junk", b"", 99))
    assert describe(far)[0].endswith("no samples ('data'); the chunk at byte 36 announces 99 bytes")
    whole = wav(form(), chunk(b"junk", b"12"))
    assert describe(whole)[0].endswith("no samples ('data')")
    assert describe(wav(chunk(b"data", DATA)))[:2] == ("no format ('fmt ')", None)
    assert describe(wav(chunk(b"fmt ", bytes(15))))[0] == "no format ('fmt ')"
    big = b"RIFX" + bytes(4) + b"WAVE"
    big += chunk(b"fmt ", struct.pack(">HHIIHH", 1, 2, 8000, 32000, 4, 16), order=">")
    assert describe(big)[0].startswith("format 0x0001, 2 channels, 8000 Hz, 16 bits")
    assert describe(b"text")[0] is None
    coded = b"NIST_1A\n   1024\nsample_coding -s26 pcm,embedded-shorten-v2.00\n"
    assert describe(coded)[0] == "samples as pcm,embedded-shorten-v2.00"
    assert is_bw64(io.BytesIO(b"BW64"))
    assert not is_bw64(io.BytesIO(b"RF64"))
