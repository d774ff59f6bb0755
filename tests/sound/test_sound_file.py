"""Sound files: every encoding, headers that are wrong, files that are cut off, false claims."""

import contextlib
import io
import os
import struct
import time
import warnings

import numpy as np
import pytest
import soundfile
from hypothesis import given
from hypothesis import strategies as st

from mocap_fit.errors import DataError, FileFormatError, MocapFitError, MocapFitWarning
from mocap_fit.sound import SOUND_ENDINGS, Sound, is_plain_wav, read_sound, write_sound
from mocap_fit.sound.sound_file import _remove_clock_time

COUNT = 3000
PCM = (8000 * np.sin(np.arange(COUNT) * 0.05) + np.arange(COUNT) % 7).astype("<i2")
DATA = PCM.tobytes()


def chunk(name, content, size=None, pad=True):
    size = len(content) if size is None else size
    return name + struct.pack("<I", size) + content + (b"\0" if pad and len(content) % 2 else b"")


def form(tag=1, channels=1, rate=16000, bits=16, more=b""):
    block = channels * bits // 8
    speed = rate * block % 2**32
    return chunk(b"fmt ", struct.pack("<HHIIHH", tag, channels, rate, speed, block, bits) + more)


def riff(*chunks, size=None, kind=b"RIFF"):
    body = b"WAVE" + b"".join(chunks)
    return kind + struct.pack("<I", len(body) if size is None else size) + body


def guid(tag, mask=4):
    tail = bytes.fromhex("000000001000800000aa00389b71")
    return struct.pack("<HHI", 22, 16, mask) + struct.pack("<H", tag) + tail


def wide_sizes(size):
    return chunk(b"ds64", struct.pack("<QQQI", size + 72, size, COUNT, 0))


def written(samples=None, **options):
    stream = io.BytesIO()
    soundfile.write(stream, PCM / 32768 if samples is None else samples, 16000, **options)
    return stream.getvalue()


@pytest.fixture
def read(tmp_path):
    """Write bytes, and read them with the warnings as text."""

    def read_bytes(content, name="take.wav"):
        path = tmp_path / name
        path.write_bytes(content)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            sound = read_sound(path)
        assert all(issubclass(warning.category, MocapFitWarning) for warning in caught)
        assert all(str(path) in str(warning.message) for warning in caught)
        return sound, [str(warning.message).removeprefix(f"{path}: ") for warning in caught]

    return read_bytes


RIGHT = riff(form(), chunk(b"data", DATA))
WELL_READ = {
    "size of the file 0": riff(form(), chunk(b"data", DATA), size=0),
    "size of the file too small": riff(form(), chunk(b"data", DATA), size=100),
    "size of the file too large": riff(form(), chunk(b"data", DATA), size=2**32 - 1),
    "a list after the samples": riff(form(), chunk(b"data", DATA), chunk(b"LIST", b"INFOISFT")),
    "garbage after the samples": RIGHT + b"garbage" * 9,
    "an odd chunk with its pad": riff(form(), chunk(b"junk", b"odd"), chunk(b"data", DATA)),
    "extensible": riff(form(0xFFFE, more=guid(1)), chunk(b"data", DATA)),
    "a block size of 0": RIGHT[:32] + b"\0\0" + RIGHT[34:],
    "RF64": riff(wide_sizes(len(DATA)), form(), chunk(b"data", DATA, 2**32 - 1), kind=b"RF64"),
    "BW64": riff(wide_sizes(len(DATA)), form(), chunk(b"data", DATA, 2**32 - 1), kind=b"BW64"),
    "RIFX": b"RIFX" + struct.pack(">I", 36 + len(DATA)) + b"WAVEfmt "
    + struct.pack(">IHHIIHH", 16, 1, 1, 16000, 32000, 2, 16)
    + b"data" + struct.pack(">I", len(DATA)) + PCM.astype(">i2").tobytes(),
} | {
    f"a stream of size {size:#x}": riff(form(), chunk(b"data", DATA, size), size=2**32 - 1)
    for size in (0x7FFFF000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0xFFFFFFDB)
}  # fmt: skip
MENDED = {
    "a size of 0 of a stream": riff(form(), chunk(b"data", DATA, 0), size=0),
    "a size of 0 in a right file": riff(form(), chunk(b"data", DATA, 0)),
    "an odd chunk without its pad": riff(
        form(), chunk(b"junk", b"odd", pad=False), chunk(b"data", DATA)
    ),
    "a chunk without a name": riff(form(), chunk(b"\0\1\2\3", b"junk"), chunk(b"data", DATA)),
    "samples twice": riff(form(), chunk(b"data", DATA), chunk(b"data", b"")),
}


@pytest.mark.parametrize("name", WELL_READ)
def test_headers_that_are_right_or_of_a_stream(read, name):
    sound, messages = read(WELL_READ[name])
    np.testing.assert_array_equal(sound.samples[:, 0], PCM / 32768)
    assert (sound.rate, sound.encoding, messages) == (16000, "PCM_16", [])


@pytest.mark.parametrize("name", MENDED)
def test_headers_that_are_wrong_are_said(read, name):
    sound, messages = read(MENDED[name])
    np.testing.assert_array_equal(sound.samples[:, 0], PCM / 32768)
    assert len(messages) == 1
    assert "header" in messages[0]
    assert f"{COUNT}" in messages[0]


REFUSED = {
    "no format": (riff(chunk(b"data", DATA)), "no format"),
    "a short format": (riff(chunk(b"fmt ", b"\1\0"), chunk(b"data", DATA)), "no format"),
    "no samples": (riff(form()), r"no samples \('data'\)"),
    "an endless chunk": (
        riff(form(), chunk(b"junk", b"", 2**31 - 1), chunk(b"data", DATA)),
        "the chunk at byte 36 announces 2147483647 bytes",
    ),
    "0 Hz": (riff(form(rate=0), chunk(b"data", DATA)), "1 channels, 0 Hz"),
    "4 GHz": (riff(form(rate=2**32 - 1), chunk(b"data", DATA)), "4294967295 Hz"),
    "1 GHz": (riff(form(rate=10**9), chunk(b"data", DATA)), "1000000000 Hz"),
    "no channels": (riff(form(channels=0), chunk(b"data", DATA)), "0 channels"),
    "2000 channels": (riff(form(channels=2000), chunk(b"data", DATA)), "2000 channels"),
    "0 bits": (riff(form(bits=0), chunk(b"data", DATA)), "0 bits"),
    "MP3 in a wav file": (riff(form(0x55), chunk(b"data", DATA)), "format 0x0055"),
    "an unknown subformat": (riff(form(0xFFFE, more=guid(99)), chunk(b"data", DATA)), "0xfffe"),
    "nothing in it": (riff(form(), chunk(b"data", b"")), "holds no sample"),
    "nothing but a list": (
        riff(form(), chunk(b"data", b""), chunk(b"LIST", b"INFO")),
        "holds no sample",
    ),
    "a header alone": (RIGHT[:44], r"holds no sample \(expected 3000\).* cut off"),
    "half a header": (RIGHT[:20], "no format"),
    "an empty file": (b"", "the file is empty"),
    "a text": (b"not sound at all " * 20, "not a sound file"),
    "raw samples": (DATA, "need their rate and encoding"),
    "the head of FLAC": (written(format="FLAC")[:40], "not a sound file"),
    "the head of Ogg": (written(format="OGG")[:60], "not a sound file"),
    "the head of AIFF": (written(format="AIFF")[:30], "not a sound file"),
    "shorten": (
        b"NIST_1A\n   1024\nchannel_count -i 1\nsample_rate -i 16000\nsample_n_bytes -i 2\n"
        b"sample_coding -s26 pcm,embedded-shorten-v2.00\nend_head\n".ljust(1024)
        + b"ajkg\2" * 99,
        "embedded-shorten.*sph2pipe",
    ),
    "not a number": (
        riff(form(3, bits=32), chunk(b"data", np.array([0, np.nan], "<f4").tobytes())),
        "sample 1",
    ),
    "infinite": (
        riff(form(3, bits=64), chunk(b"data", np.array([0, 0, -np.inf]).tobytes())),
        "sample 2",
    ),
    "far beyond full scale": (
        riff(form(3, bits=64), chunk(b"data", np.array([0, 1e300]).tobytes())),
        "beyond full scale.*1e.300",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_is_refused_in_words(read, name, tmp_path):
    content, expected = REFUSED[name]
    with pytest.raises((FileFormatError, DataError), match=expected) as caught:
        read(content)
    assert str(caught.value).startswith(str(tmp_path / "take.wav"))


# Format, encoding, ending, largest error.
STORED = [
    ("WAV", "PCM_U8", "wav", 2**-7),
    ("WAV", "PCM_24", "wav", 0),
    ("WAV", "PCM_32", "wav", 0),
    ("WAV", "FLOAT", "wav", 0),
    ("WAV", "DOUBLE", "wav", 0),
    ("WAV", "ULAW", "wav", 0.01),
    ("WAV", "ALAW", "wav", 0.01),
    ("WAV", "IMA_ADPCM", "wav", 0.05),
    ("WAV", "MS_ADPCM", "wav", 0.05),
    ("WAV", "GSM610", "wav", 0.3),
    ("WAV", "G721_32", "wav", 0.3),
    ("WAVEX", "PCM_24", "wav", 0),
    ("RF64", "PCM_16", "rf64", 0),
    ("W64", "PCM_16", "w64", 0),
    ("FLAC", "PCM_16", "flac", 0),
    ("FLAC", "PCM_24", "flac", 0),
    ("NIST", "PCM_16", "sph", 0),
    ("NIST", "ULAW", "sph", 0.01),
    ("AIFF", "PCM_16", "aiff", 0),
    ("AIFF", "FLOAT", "aif", 0),
    ("AU", "PCM_16", "au", 0),
    ("AU", "ULAW", "au", 0.01),
    ("CAF", "ALAC_16", "caf", 0),
    ("OGG", "VORBIS", "ogg", 0.05),
    ("OGG", "OPUS", "opus", 0.3),
    ("MP3", "MPEG_LAYER_III", "mp3", 0.1),
]


@pytest.mark.parametrize(("kind", "encoding", "ending", "error"), STORED)
def test_every_format_and_encoding(read, kind, encoding, ending, error):
    sound, messages = read(written(format=kind, subtype=encoding), f"take.{ending}")
    assert (sound.name, sound.rate, sound.encoding, messages) == ("take", 16000, encoding, [])
    # Those that work in blocks fill the last one.
    assert COUNT <= len(sound) < 1.2 * COUNT
    assert np.abs(sound.samples[:COUNT, 0] - PCM / 32768).max() <= error
    assert f".{ending}" in SOUND_ENDINGS


@pytest.mark.parametrize("name", ["take.au", "take.snd", "take.vox", "take.gsm", "take.raw", "-"])
def test_a_name_says_nothing_of_the_content(read, name):
    """By their endings libsndfile takes some files for raw samples."""
    assert read(RIGHT, name)[0].encoding == "PCM_16"
    with pytest.raises(FileFormatError, match="not a sound file"):
        read(b"not sound at all " * 20, name)


CUT = {
    "wav": (RIGHT, 44, 2),
    "wav of 24 bits": (written(format="WAV", subtype="PCM_24"), None, 3),
    "wav of ADPCM": (written(format="WAV", subtype="IMA_ADPCM"), None, None),
    "RF64": (WELL_READ["RF64"], 80, 2),
    "RIFX": (WELL_READ["RIFX"], 44, 2),
    "NIST": (written(format="NIST", subtype="PCM_16"), 1024, 2),
    "AIFF": (written(format="AIFF", subtype="PCM_16"), None, 2),
    "AU": (written(format="AU", subtype="PCM_16"), 24, 2),
    "FLAC": (written(np.tile(PCM / 32768, 9), format="FLAC"), None, None),
    "MP3": (written(np.tile(PCM / 32768, 9), format="MP3"), None, None),
}


@pytest.mark.parametrize("name", CUT)
def test_a_file_cut_off_says_how_much_of_it_is_there(read, name):
    content, head, width = CUT[name]
    sound, messages = read(content[: round(0.6 * len(content)) // 2 * 2 - 1])
    total = 9 * COUNT if name in ("FLAC", "MP3") else COUNT
    (message,) = messages
    assert "cut off" in message
    assert f"{len(sound)} of " in message
    announced = int(message.split(" of ")[1].split()[0])
    assert total <= announced <= 1.2 * total
    assert 0.3 * total < len(sound) < 0.75 * total
    if head is not None:
        assert len(sound) == (round(0.6 * len(content)) // 2 * 2 - 1 - head) // width
    if width is not None:
        assert announced == COUNT
        assert np.abs(sound.samples[:, 0] - PCM[: len(sound)] / 32768).max() == 0


def test_an_ogg_file_without_its_end(read):
    noise = np.random.default_rng(1).normal(size=40000) / 10
    content = written(noise, format="OGG")
    assert read(content)[1] == []
    sound, (message,) = read(content[: len(content) * 4 // 5])
    assert "its end is missing" in message
    assert f"{len(sound)} samples" in message
    assert len(sound) < 40000


def set_flac_length(content, length):
    found = bytearray(content)
    found[21] = (found[21] & 0xF0) | length >> 32
    found[22:26] = (length & 0xFFFFFFFF).to_bytes(4, "big")
    return bytes(found)


class TestClaims:
    """Bytes that say they are more than they are."""

    FLAC = written(np.tile(PCM, 30), format="FLAC")

    def test_a_claim_is_refused_before_anything_is_unpacked(self, read):
        for claim in (3 * 10**9, 2**36 - 1):
            begun = time.process_time()
            with pytest.raises(FileFormatError, match=r"claims to be larger.*--max-size"):
                read(set_flac_length(self.FLAC, claim))
            assert time.process_time() - begun < 2

    def test_the_users_limit_holds(self, read, monkeypatch):
        monkeypatch.setenv("MOCAP_FIT_MAX_SIZE", "500kB")
        with pytest.raises(FileFormatError, match="claims"):
            read(self.FLAC)
        # What is not compressed claims no more than it holds.
        assert len(read(riff(form(), chunk(b"data", DATA * 30)))[0]) == 30 * COUNT

    def test_a_claim_within_the_limit_is_read_as_far_as_it_goes(self, read):
        sound, (message,) = read(set_flac_length(self.FLAC, 2 * 10**8))
        assert f"{30 * COUNT} of 200000000" in message
        np.testing.assert_array_equal(sound.samples[:COUNT, 0], PCM / 32768)

    def test_a_stream_does_not_say_its_length(self, read, monkeypatch):
        content = set_flac_length(self.FLAC, 0)
        sound, messages = read(content)
        assert (len(sound), messages) == (30 * COUNT, [])
        long = written(np.tile(PCM, 400), format="FLAC")
        assert len(read(set_flac_length(long, 0))[0]) == 400 * COUNT
        monkeypatch.setenv("MOCAP_FIT_MAX_SIZE", "10MB")
        with pytest.raises(FileFormatError, match="claims"):
            read(set_flac_length(long, 0))

    def test_wav_files_claim_nothing_that_is_not_there(self, read):
        huge = riff(wide_sizes(2**61), form(), chunk(b"data", DATA, 2**32 - 1), kind=b"RF64")
        sound, (message,) = read(huge)
        assert len(sound) == COUNT
        assert f"{COUNT} of {2**60}" in message


@given(data=st.data())
def test_no_damaged_file_ends_in_another_error(tmp_path_factory, data):
    kinds = [RIGHT, written(format="FLAC"), written(format="NIST"), written(format="AIFF")]
    content = bytearray(data.draw(st.sampled_from([*kinds, *WELL_READ.values()])))
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, 119))] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / "damaged.wav"
    path.write_bytes(content[: data.draw(st.integers(1, len(content)))])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        with contextlib.suppress(MocapFitError):
            assert len(read_sound(path))


@pytest.mark.parametrize("rate", [8000, 11025, 44100, 192000])
@pytest.mark.parametrize("channels", [1, 2, 6, 200])
def test_rates_and_channels(read, rate, channels):
    samples = np.tile(PCM[:, None], channels)
    stream = io.BytesIO()
    soundfile.write(stream, samples, rate, format="WAV", subtype="PCM_16")
    sound, messages = read(stream.getvalue())
    assert (sound.rate, sound.channels, messages) == (rate, channels, [])
    np.testing.assert_array_equal(sound.samples, samples / 32768)


@pytest.mark.parametrize("kind", ["SDS", "HTK", "MAT4", "IRCAM", "WVE", "PVF", "XI"])
def test_formats_without_a_sure_beginning_are_not_read(read, kind, capfd):
    """The decoder of SDS prints what it finds wrong."""
    encoding = {"WVE": "ALAW", "XI": "DPCM_16"}.get(kind, "PCM_16")
    stream = io.BytesIO()
    soundfile.write(stream, PCM, 8000, encoding, format=kind)
    content = bytearray(stream.getvalue())
    content[100:120] = b"\xff" * 20
    with pytest.raises(FileFormatError, match="not a sound file"):
        read(bytes(content))
    assert capfd.readouterr() == ("", "")


def test_what_is_no_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_sound(tmp_path / "none.wav")
    with pytest.raises(FileFormatError, match="this is a folder"):
        read_sound(tmp_path)
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.wav")
        for path in (tmp_path / "pipe.wav", os.devnull):
            with pytest.raises(FileFormatError, match="not an ordinary file"):
                read_sound(path)


@pytest.mark.skipif(os.name == "nt", reason="names are Unicode there")
def test_a_name_that_is_not_unicode(tmp_path):
    path = os.fsdecode(os.fsencode(tmp_path) + b"/t\xe4ke.wav")
    write_sound(Sound(PCM / 32768, 16000), path)
    np.testing.assert_array_equal(read_sound(path).samples[:, 0], PCM / 32768)


class TestPlainWav:
    """Files that any program reads can be copied as they are."""

    @pytest.mark.parametrize(
        ("content", "expected"),
        [
            (RIGHT, True),
            (RIGHT + chunk(b"LIST", b"INFO"), False),
            (WELL_READ["a list after the samples"], True),
            (WELL_READ["extensible"], True),
            (written(format="WAV", subtype="IMA_ADPCM"), True),
            (RIGHT[:-1], False),
            (WELL_READ["size of the file 0"], False),
            (WELL_READ["a stream of size 0xffffffff"], False),
            (WELL_READ["RF64"], False),
            (WELL_READ["RIFX"], False),
            (written(format="FLAC"), False),
            (written(format="AIFF"), False),
        ],
    )
    def test_by_its_header(self, tmp_path, content, expected):
        (tmp_path / "a.wav").write_bytes(content)
        assert is_plain_wav(tmp_path / "a.wav") is expected


class TestWriting:
    """What is written is read again."""

    @pytest.fixture
    def stereo(self):
        times = np.arange(8000) / 16000
        samples = [np.sin(2 * np.pi * 440 * times), 0.1 * (times > 0.25)]
        return Sound(np.stack(samples, axis=1), 16000)

    @pytest.mark.parametrize(
        ("encoding", "error"),
        [("PCM_U8", 2**-7), ("PCM_16", 2**-15), ("PCM_24", 2**-23), ("FLOAT", 1e-7), ("DOUBLE", 0)],
    )
    def test_a_round_trip(self, encoding, error, stereo, tmp_path):
        write_sound(stereo, tmp_path / "a.wav", encoding=encoding)
        found = read_sound(tmp_path / "a.wav")
        assert (found.name, found.rate, found.samples.shape) == ("a", 16000, (8000, 2))
        assert np.abs(found.samples - stereo.samples).max() <= error
        assert found.encoding == encoding
        assert [path.name for path in tmp_path.iterdir()] == ["a.wav"]

    @pytest.mark.parametrize("encoding", ["PCM_U8", "PCM_16", "PCM_24", "PCM_32", "ULAW", "ALAW"])
    def test_what_was_read_is_written_bit_by_bit(self, encoding, tmp_path):
        values = np.random.default_rng(2).integers(-(2**31), 2**31, 4000, dtype=np.int32)
        values[:2] = -(2**31), 2**31 - 1
        soundfile.write(tmp_path / "a.wav", values, 8000, subtype=encoding)
        first = read_sound(tmp_path / "a.wav")
        write_sound(first, tmp_path / "b.wav")
        again = read_sound(tmp_path / "b.wav")
        assert again.encoding == encoding
        np.testing.assert_array_equal(again.samples, first.samples)

    @pytest.mark.parametrize(
        ("encoding", "expected"),
        [("VORBIS", "PCM_16"), ("IMA_ADPCM", "PCM_16"), ("PCM_S8", "PCM_16"), ("ULAW", "ULAW")],
    )
    def test_encodings_that_lose_something_are_not_used_again(self, encoding, expected, tmp_path):
        write_sound(Sound(PCM / 32768, 16000, encoding=encoding), tmp_path / "a.wav")
        found = read_sound(tmp_path / "a.wav")
        assert found.encoding == expected
        if expected == "PCM_16":
            np.testing.assert_array_equal(found.samples[:, 0], PCM / 32768)

    def test_what_is_too_loud_is_clipped_and_does_not_turn_over(self, tmp_path):
        for encoding in ("PCM_U8", "PCM_16", "PCM_24", "PCM_32", "ULAW"):
            write_sound(Sound([2.0, -2.0, 1.0], 8000), tmp_path / "a.wav", encoding=encoding)
            channel = read_sound(tmp_path / "a.wav").get_channel(1)
            np.testing.assert_allclose(channel, [1, -1, 1], atol=0.03)

    @pytest.mark.parametrize("encoding", ["PCM_16", "FLOAT", "DOUBLE"])
    def test_the_same_sound_gives_the_same_bytes(self, encoding, stereo, tmp_path):
        """libsndfile notes the time in files of floats."""
        write_sound(stereo, tmp_path / "a.wav", encoding=encoding)
        if encoding != "PCM_16":
            time.sleep(1.1)
        write_sound(stereo, tmp_path / "b.wav", encoding=encoding)
        assert (tmp_path / "a.wav").read_bytes() == (tmp_path / "b.wav").read_bytes()

    def test_what_cannot_be_written(self, stereo, tmp_path):
        for rate in (16000.5, 16000 * (1 + 1.5e-9), 16000 * (1 - 1.5e-9)):
            with pytest.raises(DataError, match="integer"):
                write_sound(stereo.replace(rate=rate), tmp_path / "a.wav")
        with pytest.raises(FileFormatError, match="cannot be written"):
            write_sound(stereo, tmp_path / "none" / "a.wav")
        assert not list(tmp_path.iterdir())

    def test_a_sound_without_samples(self, tmp_path):
        write_sound(Sound(np.zeros((0, 1)), 8000), tmp_path / "a.wav")
        with pytest.raises(FileFormatError, match="no sample"):
            read_sound(tmp_path / "a.wav")


@pytest.mark.parametrize("size", [16, 17, 18, 19, 40])
def test_the_time_of_peaks_is_removed_behind_chunks_of_any_size(size):
    before = form()[:8] + bytes(8) + chunk(b"junk", bytes(size))
    peak = chunk(b"PEAK", struct.pack("<II", 1, 1234567890) + bytes(8))
    content = riff(before[16:], peak, chunk(b"data", DATA))
    found = _remove_clock_time(content)
    assert found == content.replace(struct.pack("<I", 1234567890), bytes(4))
    assert _remove_clock_time(RIGHT) == RIGHT
    last = riff(form(), peak)
    assert _remove_clock_time(last) == last.replace(struct.pack("<I", 1234567890), bytes(4))
    # A chunk that begins at the very end has no time.
    assert _remove_clock_time(riff(form(), peak[:12])) == riff(form(), peak[:12])
