"""TIMIT's symbols, its samples, and the sound and words beside a file."""

import numpy as np
import pytest

from mocap_fit.errors import DataError
from mocap_fit.labels import read_labels, read_phones, write_labels
from mocap_fit.phones import load_phone_set

# The 61 symbols, and what they are in the 39 of ARPAbet.
SYMBOLS = {
    "AA": "aa", "AE": "ae", "AH": "ah ax ax-h", "AO": "ao", "AW": "aw", "AY": "ay", "EH": "eh",
    "ER": "er axr", "EY": "ey", "IH": "ih ix", "IY": "iy", "OW": "ow", "OY": "oy", "UH": "uh",
    "UW": "uw ux", "P": "p pcl", "B": "b bcl", "T": "t tcl", "D": "d dcl dx", "K": "k kcl",
    "G": "g gcl", "CH": "ch", "JH": "jh", "M": "m em", "N": "n en nx", "NG": "ng eng", "F": "f",
    "V": "v", "TH": "th", "DH": "dh", "S": "s", "Z": "z", "SH": "sh", "ZH": "zh", "HH": "hh hv",
    "L": "l el", "R": "r", "W": "w", "Y": "y", "sil": "h# pau epi q",
}  # fmt: skip


def write(path, symbols, step=1600):
    rows = [f"{i * step} {(i + 1) * step} {symbol}\n" for i, symbol in enumerate(symbols)]
    path.write_text("".join(rows))
    return path


@pytest.mark.parametrize("name", ["a.phn", "A.PHN"])
def test_all_symbols_are_phones_of_arpabet(tmp_path, name):
    symbols = [symbol for group in SYMBOLS.values() for symbol in group.split()]
    assert len(symbols) == 61
    english = load_phone_set("en-arpabet")
    for symbol in symbols:
        path = write(tmp_path / name, ["b", symbol, "b"])
        phones = read_phones(path, phone_set=english)
        expected = next(phone for phone, group in SYMBOLS.items() if symbol in group.split())
        assert expected in phones.phones
        assert phones.ends[-1] == pytest.approx(0.3)


def test_the_glottal_stop_is_silence_and_is_written_as_it_was(tmp_path):
    path = write(tmp_path / "a.phn", ["h#", "aa", "q", "iy", "Q", "h#"])
    assert read_phones(path, phone_set="en-arpabet").phones == (
        "sil", "AA", "sil", "IY", "sil",
    )  # fmt: skip
    write_labels(read_labels(path), tmp_path / "b.phn")
    assert (tmp_path / "b.phn").read_bytes() == path.read_bytes()
    # It is TIMIT's alone, and a word may be called so.
    (tmp_path / "c.lab").write_text("0 500000 aa\n500000 1000000 q\n")
    with pytest.raises(DataError, match="'q' 1×"):
        read_phones(tmp_path / "c.lab", phone_set="en-arpabet")
    assert [e.text for e in read_labels(write(tmp_path / "d.wrd", ["q"])).tiers[0].entries] == ["q"]


@pytest.mark.parametrize(("given", "sound", "rate"), [
    (None, None, 16000), (None, 20000, 20000), (8000, 20000, 8000),
])  # fmt: skip
def test_the_rate_is_that_of_the_caller_or_the_sound(tmp_path, given, sound, rate):
    soundfile = pytest.importorskip("soundfile")
    path = write(tmp_path / "A.PHN", ["h#", "aa"], step=4000)
    (tmp_path / "A.WRD").write_text("4000 8000 ah\n")
    if sound is not None:
        soundfile.write(tmp_path / "A.WAV", np.zeros(9000), sound, format="WAV")
    labels = read_labels(path, rate=given)
    assert [tier.name for tier in labels.tiers] == ["phone", "word"]
    assert labels.end == 8000 / rate
    assert read_phones(path, rate=given)[1].word == "ah"


def test_a_sound_that_cannot_be_read_says_nothing(tmp_path):
    path = write(tmp_path / "a.phn", ["h#"], step=16000)
    (tmp_path / "a.wav").write_bytes(b"NIST_1A\n   1024\n shortened")
    assert read_labels(path).end == 1.0
