"""X-SAMPA, as WebMAUS writes it; and the phone set that labels fit best."""

import copy
import json
import pickle

import pytest

from mocap_fit.errors import DataError
from mocap_fit.phones import (
    PhoneSegment,
    PhoneSequence,
    find_phone_sets,
    load_phone_set,
    map_phones,
    normalise_phones,
)

pytest.importorskip("panphon")

GERMAN, BRITISH, CZECH = (
    line.split()
    for line in (
        "<p:> g u: t @ n m O 6 g aI n OY C pf tS S 2: 9 Y E: ? x z v l N h b a:",
        "<p:> D @ k w I b r aU n f Q s dZ V m p O: v { T S N 3: @U eI I@ e@ U@ A: z j",
        "<p:> v l= k s p i: p o d s t r o m e m tS r= n J\\ a t_s",
    )
)


def sequence(labels, phone_set=""):
    segments = tuple(PhoneSegment(i, i + 1, s) for i, s in enumerate(labels))
    return PhoneSequence(segments, phone_set=phone_set)


@pytest.fixture(scope="module")
def x_sampa():
    return load_phone_set("x-sampa")


@pytest.mark.parametrize(
    ("symbol", "ipa"),
    [
        ("a:", "aː"),
        ("OY", "ɔʏ"),
        ("i:6", "iːɐ"),
        ("3:", "ɜː"),
        ("3`", "ɝ"),
        ("@`", "ɚ"),
        ("V", "ʌ"),
        ("r\\", "ɹ"),
        ("x\\", "ɧ"),
        ("s\\", "ɕ"),
        ("n=", "n̩"),
        ("p_h", "pʰ"),
        ("t_d", "t̪"),
        ("t_s", "ts"),
        ("O~", "ɔ̃"),
        ("gb", "ɡ͡b"),
    ],
)
def test_a_symbol_is_that_of_the_ipa(x_sampa, symbol, ipa):
    (parsed, stress), phone = x_sampa.parse(symbol), load_phone_set("ipa").get_phone(ipa)
    assert (parsed, stress) == (symbol, None)
    assert x_sampa.get_phone(symbol).values == phone.values
    assert x_sampa.get_phone(symbol).ipa == phone.ipa


@pytest.mark.parametrize("label", ["abc", "=", "ʃ", "E0", "Ä", "t ", '"t', "tt", '""a', '"%a'])
def test_what_is_not_one_sound_is_refused(x_sampa, label):
    assert x_sampa.parse(label) in (None, ("t", None))
    assert x_sampa.parse(label) is None or label == "t "


def test_stress_and_silence(x_sampa):
    assert x_sampa.parse('"a:') == ("a:", 1)
    assert x_sampa.parse("%aI") == ("aI", 2)
    for label in ("", "<p:>", "<usb>", "<nib>"):
        assert x_sampa.parse(label) == ("sil", None)


@pytest.mark.parametrize("labels", [GERMAN, BRITISH, CZECH])
def test_labels_of_webmaus_are_read_and_mapped(labels):
    phones = normalise_phones(sequence(labels), "x-sampa")
    assert len(phones) == len(labels)
    assert map_phones(phones, "en-arpabet", nearest=True).phones[0] == "sil"


def test_the_set_is_copied_stored_and_selected(x_sampa):
    stored = type(x_sampa).from_dict(json.loads(json.dumps(x_sampa.to_dict())))
    for other in (copy.deepcopy(x_sampa), pickle.loads(pickle.dumps(x_sampa)), stored):
        assert other == x_sampa
        assert other.parse("OY") == ("OY", None)
    chosen = x_sampa.select(GERMAN)
    assert set(chosen.list_symbols(stress=False)) == {"sil", *GERMAN[1:]}
    assert map_phones(sequence(["ɔʏ", "ʃ"], "ipa"), chosen).phones == ("OY", "S")


@pytest.mark.parametrize(
    ("labels", "names"),
    [
        (GERMAN, ("x-sampa",)),
        (BRITISH, ("x-sampa",)),
        (["AA1", "DH", "ER0", "sil"], ("en-arpabet",)),
        (["'A:", "2T", "SJ", "p"], ("sv-sta",)),
        (["r̝", "o", "t͡ʃ", "ɦ"], ("cs-ipa",)),
        (["ʈʰ", "ɓ", "ɤ"], ("ipa",)),
        (["P\\", "h\\", "o_u", "i:"], ("cs-sampa",)),
    ],
)
def test_the_set_that_fits_best(labels, names):
    assert find_phone_sets(set(labels)) == (names, len(set(labels)))


def test_labels_that_fit_no_set():
    assert find_phone_sets(set()) == ((), 0)
    assert find_phone_sets({"hello", "world!"}) == ((), 0)
    assert find_phone_sets({f"w{i}" for i in range(1000)}) == ((), 0)
    assert find_phone_sets({*GERMAN, "noise!"}) == (("x-sampa",), len(set(GERMAN)))


def test_the_error_names_the_set_that_fits():
    with pytest.raises(DataError, match="'x-sampa' has all of the symbols"):
        normalise_phones(sequence(GERMAN), "sv-sta")
    with pytest.raises(DataError, match=r"'x-sampa' has 2 of 3 of the symbols"):
        normalise_phones(sequence(["OY", "@U", "noise!"]), "en-arpabet")
