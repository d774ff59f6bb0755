"""The tongue by rule: it is where a sound needs it, when it is heard."""

import numpy as np
import pytest

from mocap_fit.control.tongue import TONGUE_PARAMETERS, compute_tongue
from mocap_fit.errors import MissingFileError
from mocap_fit.face import load_face
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set

TIP, TIP_ADVANCE, BODY, BODY_ADVANCE, WIDTH = range(5)
SETS = ("sv-sta", "cs-ipa", "en-arpabet")


def said(labels: list[str], phone_set: str, length: float = 0.07) -> PhoneSequence:
    segments = [PhoneSegment(i * length, (i + 1) * length, label) for i, label in enumerate(labels)]
    return PhoneSequence(tuple(segments), phone_set=phone_set)


def at_middle(labels: list[str], phone_set: str = "en-arpabet") -> np.ndarray:
    phones = said(labels, phone_set, 0.12)
    return compute_tongue(phones, [phones[len(phones) // 2].centre])[0]


def test_they_are_the_parameters_of_the_face() -> None:
    assert load_face(tongue=True).parameter_names[10:] == TONGUE_PARAMETERS


@pytest.mark.parametrize(("first", "last"), [("AA", "IY"), ("UW", "UW"), ("IY", "AA")])
def test_consonants_reach_their_place_between_any_vowels(first: str, last: str) -> None:
    """In a picture at 25 a second, wherever that is in the sound."""
    reached = {
        "T": (TIP, 1.0),
        "N": (TIP, 1.0),
        "L": (TIP, 1.0),
        "TH": (TIP_ADVANCE, 1.05),
        "K": (BODY, 1.0),
        "NG": (BODY, 1.0),
        "Y": (BODY, 0.82),
        "S": (TIP, 0.72),
    }
    for phone, (parameter, target) in reached.items():
        phones = said([first, phone, last], "en-arpabet", 0.06)
        times = np.arange(phones[1].start, phones[1].end, 0.002)
        values = compute_tongue(phones, times)[:, parameter]
        for offset in range(20):
            assert np.abs(values[offset::20] - target).min() < 0.05, (phone, offset)


def test_vowels_are_front_and_back_high_and_low() -> None:
    front, back, low = (at_middle(["sil", v, "sil"]) for v in ("IY", "UW", "AA"))
    assert min(front[BODY], back[BODY]) > low[BODY] + 0.5
    assert front[BODY_ADVANCE] > low[BODY_ADVANCE] > back[BODY_ADVANCE] - 0.05
    assert front[BODY_ADVANCE] > back[BODY_ADVANCE] + 1.0


def test_consonants_differ_as_they_should() -> None:
    lateral, nasal, dental, s, sh, r = (
        at_middle(["AA", c, "AA"]) for c in ("L", "N", "TH", "S", "SH", "R")
    )
    assert lateral[WIDTH] < -0.5 < nasal[WIDTH]
    assert dental[TIP_ADVANCE] > s[TIP_ADVANCE] > sh[TIP_ADVANCE] > r[TIP_ADVANCE]
    assert nasal[TIP] > s[TIP] > dental[TIP]
    palatal, velar = (at_middle(["a", c, "a"], "cs-ipa") for c in ("ɟ", "ɡ"))
    assert palatal[BODY] == pytest.approx(velar[BODY], abs=0.05)
    assert palatal[BODY_ADVANCE] > velar[BODY_ADVANCE] + 0.5


def test_labials_leave_it_to_their_neighbours() -> None:
    np.testing.assert_allclose(at_middle(["IY", "P", "IY"]), at_middle(["IY"] * 3), atol=0.02)


@pytest.mark.parametrize("name", SETS)
def test_every_phone_has_a_tongue_within_bounds_that_moves_smoothly(name: str) -> None:
    phone_set = load_phone_set(name)
    labels = [phone.symbol for phone in phone_set.phones]
    phones = said(labels, name)
    times = np.arange(0, phones[-1].end, 0.005)
    values = compute_tongue(phones, times, jaw=np.full(len(times), 0.2))
    low, high = load_face(tongue=True).bounds[10:].T
    assert (values >= low).all()
    assert (values <= high).all()
    # No faster than a tongue: 14 mm full gesture, 300 mm/s and a margin.
    assert np.abs(np.diff(values[:, TIP])).max() / 0.005 * 14 < 450


def test_silence_is_rest_and_so_is_what_none_specifies() -> None:
    phones = said(["sil", "P", "sil"], "en-arpabet")
    assert not compute_tongue(phones, np.linspace(0, 0.2, 9)).any()


@pytest.mark.parametrize("phone", ["T", "L", "K", "TH"])
def test_what_reaches_the_palate_does_so_with_any_jaw(phone: str) -> None:
    rig = load_face(tongue=True)
    phones = said(["AA", phone, "AA"], "en-arpabet", 0.12)
    point = rig.mesh.get_feature_point("6.2" if phone == "K" else "6.1")
    heights = []
    for jaw in (0.0, 0.1, 0.2):
        values = np.zeros(15)
        values[0] = jaw
        values[10:] = compute_tongue(phones, [phones[1].centre], jaw=[jaw])[0]
        heights.append(rig.deform(values)[point, 1])
    assert np.ptp(heights) < 1.0


def test_phones_of_no_set_are_refused() -> None:
    with pytest.raises(MissingFileError, match="phone set"):
        compute_tongue(PhoneSequence((PhoneSegment(0, 1, "T"),)), [0.5])
