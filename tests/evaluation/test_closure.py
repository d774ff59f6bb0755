"""Lip closure at known openings on both sides of the thresholds."""

import numpy as np
import pytest
from scipy.stats import norm

from mocap_fit.evaluation.closure import LipEvent, LipGaps, Share, concatenate_gaps, measure_gaps
from mocap_fit.face import load_face
from mocap_fit.face.lips import compute_lip_openings, compute_teeth_distance
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set

PHONES = load_phone_set("en-arpabet")


def events(*gaps):
    return tuple(LipEvent("m", 0.1 * i, 0.1 * (i + 1), gap) for i, gap in enumerate(gaps))


def test_lips_are_closed_up_to_the_limit_and_vowels_are_open_above_it():
    gaps = LipGaps(events(0.99, 1.01, -0.5, 1.99, 1.0), events(2.0, 2.1), events(9.0, 10.0, 30.0))
    assert gaps.compute_open_gap() == 10.0
    scores = gaps.score(1.0)
    assert scores.closed == Share(3, 5)
    assert scores.opened == Share(3, 3)
    assert gaps.score(9.0).opened == Share(2, 3)
    # The teeth are where they are, whatever is closed.
    assert scores.contact == gaps.score(float("nan")).contact == Share(1, 2)


def test_where_teeth_are_not_measured_the_speakers_median_is_at_the_teeth():
    near, far = LipGaps((), events(1.0, 1.5, 5.0)), LipGaps((), events(3.0, 4.0, 5.0, 5.5))
    assert (near.compute_contact(), far.compute_contact()) == (2.0, 4.5)
    assert LipGaps().compute_contact() == 2.0
    assert far.score(1.0, far.compute_contact()).contact == Share(2, 4)


def test_shares_have_wilsons_interval():
    share = Share(8, 10)
    assert share.value == 0.8
    # Brown, Cai and DasGupta (2001) give the formula.
    z = norm.ppf(0.975)
    centre = (8 + z**2 / 2) / (10 + z**2)
    half = z / (10 + z**2) * np.sqrt(8 * 2 / 10 + z**2 / 4)
    assert share.interval == pytest.approx((centre - half, centre + half))


def test_without_bilabials_or_open_vowels_nothing_is_known():
    nothing = LipGaps()
    assert np.isnan(nothing.compute_open_gap())
    scores = nothing.score(10.0)
    assert scores.closed.count == scores.contact.count == scores.opened.count == 0
    assert np.isnan([scores.closed.value, *scores.closed.interval, scores.speed]).all()
    assert LipGaps(events(1.0)).score(float("nan")).closed.count == 0
    joined = concatenate_gaps([nothing, LipGaps(events(1, 1), (), events(1), 3.0), nothing])
    assert (len(joined.bilabials), len(joined.open_vowels), joined.speed) == (2, 1, 3.0)
    assert np.isnan(concatenate_gaps([]).speed)


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
    gaps = measure_gaps(face, values, times, phones, PHONES)
    return gaps, compute_lip_openings(face, values).max(axis=1)


def values_of(events):
    return [event.gap for event in events]


def test_the_least_gap_of_a_bilabial_and_the_largest_of_an_open_vowel_count(face):
    jaw = np.random.default_rng(0).uniform(0.1, 0.6, 40)
    gaps, frames = measure(face, ["B", "AA", "S", "M"], jaw)
    assert values_of(gaps.bilabials) == [frames[:10].min(), frames[30:].min()]
    assert values_of(gaps.open_vowels) == [frames[10:20].max()]
    assert [(each.phone, each.start, each.end) for each in gaps.bilabials] == [
        ("B", 0.0, 0.1),
        ("M", pytest.approx(0.3), pytest.approx(0.4)),
    ]
    assert gaps.speed == pytest.approx(np.abs(np.diff(frames)).max() / 0.01)


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
    assert values_of(gaps.open_vowels) == expected
    assert not gaps.bilabials


def test_consonants_are_neither_unless_the_lips_meet(face):
    symbols = [s for s in PHONES.list_symbols(stress=False) if PHONES.is_consonant(s)]
    gaps, _ = measure(face, symbols, np.full(10 * len(symbols), 0.3))
    assert not gaps.open_vowels
    assert len(gaps.bilabials) == len({"B", "P", "M"}.intersection(symbols)) == 3


def test_segments_without_a_value_do_not_count(face):
    jaw = np.full(20, 0.3)
    jaw[:10] = np.nan
    gaps, frames = measure(face, ["B", "M"], jaw)
    assert values_of(gaps.bilabials) == [frames[10:].min()]
    jaw[:9] = 0.3
    gaps, _ = measure(face, ["B", "M"], jaw)
    assert len(gaps.bilabials) == 2


def test_a_labiodental_has_the_least_distance_from_the_teeth(face):
    jaw = np.linspace(0.5, 0.1, 20)
    gaps, _ = measure(face, ["F", "V"], jaw)
    values = np.zeros((20, len(face.parameter_names)))
    values[:, face.parameter_names.index("jaw_rotation")] = jaw
    distances = compute_teeth_distance(face, values)
    assert values_of(gaps.labiodentals) == [distances[:10].min(), distances[10:].min()]


def test_a_phone_between_two_frames_has_the_nearest_one(face):
    phones = PhoneSequence(
        (
            PhoneSegment(0.0, 0.045, "AA", 1),
            PhoneSegment(0.045, 0.055, "B"),
            PhoneSegment(0.055, 0.4, "AA", 1),
        ),
        phone_set="en-arpabet",
    )
    values = np.zeros((10, len(face.parameter_names)))
    values[:, face.parameter_names.index("jaw_rotation")] = [0.3, 0.4, *[0.5] * 8]
    times = 0.025 + 0.04 * np.arange(10)
    gaps = measure_gaps(face, values, times, phones, PHONES)
    expected = compute_lip_openings(face, values).max(axis=1)
    # 0.045 to 0.055 lies between 0.025 and 0.065; the second is 10 ms away, the first 20.
    assert values_of(gaps.bilabials) == [expected[1]]
    far = measure_gaps(face, values[3:], times[3:], phones, PHONES)
    assert not far.bilabials
    # Of two that are as near, either may be the closed one.
    for shift, nearest in ((0.005, expected[:2].min()), (0.006, expected[0])):
        between = measure_gaps(face, values, times + shift, phones, PHONES)
        assert values_of(between.bilabials) == [nearest]
