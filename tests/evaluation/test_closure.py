"""Lip closure at known openings on both sides of the thresholds."""

import numpy as np
import pytest

from mocap_fit.evaluation.closure import LipGaps, concatenate_gaps, measure_gaps
from mocap_fit.face import compute_lip_gap, load_face
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set

PHONES = load_phone_set("en-arpabet")


def test_a_bilabial_is_closed_below_a_tenth_of_the_open_gap():
    gaps = LipGaps(np.array([0.99, 1.01, -0.5, 1.99, 0.0]), np.array([9.0, 10.0, 30.0]))
    assert gaps.compute_open_gap() == 10.0
    assert gaps.compute_closed_share(gaps.compute_open_gap()) == 3 / 5
    assert gaps.compute_closed_share(20.0) == 1.0
    # At a tenth it is not.
    assert LipGaps(np.array([1.0]), np.zeros(0)).compute_closed_share(10.0) == 0.0


def test_without_bilabials_or_open_vowels_nothing_is_known():
    nothing = LipGaps(np.zeros(0), np.zeros(0))
    assert np.isnan(nothing.compute_open_gap())
    assert np.isnan(nothing.compute_closed_share(10.0))
    assert np.isnan(LipGaps(np.ones(3), np.zeros(0)).compute_closed_share(float("nan")))
    joined = concatenate_gaps([nothing, LipGaps(np.ones(2), np.ones(1)), nothing])
    assert (len(joined.bilabials), len(joined.open_vowels)) == (2, 1)
    assert concatenate_gaps([]).bilabials.shape == (0,)


@pytest.fixture(scope="module")
def face():
    return load_face()


def measure(face, symbols, jaw):
    """Gaps of phones of 0.1 s, with a jaw rotation a frame of 10 ms."""
    segments = []
    for i, symbol in enumerate(symbols):
        phone, stress = PHONES.parse(symbol)
        if stress is None and PHONES.get_phone(phone).takes_stress:
            stress = 1
        segments.append(PhoneSegment(0.1 * i, 0.1 * (i + 1), phone, stress))
    phones = PhoneSequence(tuple(segments), phone_set="en-arpabet")
    values = np.zeros((len(jaw), len(face.parameter_names)))
    values[:, face.parameter_names.index("jaw_rotation")] = jaw
    times = 0.005 + 0.01 * np.arange(len(jaw))
    return measure_gaps(face, values, times, phones, PHONES), compute_lip_gap(face, values)


def test_the_least_gap_of_a_bilabial_and_the_largest_of_an_open_vowel_count(face):
    jaw = np.random.default_rng(0).uniform(0.1, 0.6, 40)
    gaps, frames = measure(face, ["B", "AA", "S", "M"], jaw)
    assert gaps.bilabials.tolist() == [frames[:10].min(), frames[30:].min()]
    assert gaps.open_vowels.tolist() == [frames[10:20].max()]


def test_vowels_are_open_from_a_feature_of_07_on(face):
    symbols = [s for s in PHONES.list_symbols(stress=False) if PHONES.is_vowel(s)]
    opening = [PHONES.get_phone(s).values["open"] for s in symbols]
    # There are vowels on both sides, and at the threshold.
    assert min(opening) < 0.5
    assert max(opening) >= 0.7
    jaw = np.linspace(0.1, 0.6, 10 * len(symbols))
    gaps, frames = measure(face, symbols, jaw)
    expected = [
        frames[10 * i : 10 * (i + 1)].max() for i, each in enumerate(opening) if each >= 0.7
    ]
    assert gaps.open_vowels.tolist() == expected
    assert not gaps.bilabials.size


def test_consonants_are_neither_unless_the_lips_meet(face):
    symbols = [s for s in PHONES.list_symbols(stress=False) if PHONES.is_consonant(s)]
    gaps, _ = measure(face, symbols, np.full(10 * len(symbols), 0.3))
    assert not gaps.open_vowels.size
    assert len(gaps.bilabials) == len({"B", "P", "M"}.intersection(symbols)) == 3


def test_segments_without_a_value_do_not_count(face):
    jaw = np.full(20, 0.3)
    jaw[:10] = np.nan
    gaps, frames = measure(face, ["B", "M"], jaw)
    assert gaps.bilabials.tolist() == [frames[10:].min()]
    jaw[:9] = 0.3
    gaps, _ = measure(face, ["B", "M"], jaw)
    assert len(gaps.bilabials) == 2
