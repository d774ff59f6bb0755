"""Phones in, parameters out: whole, live, and from phones of other sets."""

import numpy as np
import pytest

from mocap_fit.control import create
from mocap_fit.control.rule_based import RuleBased
from mocap_fit.errors import DataError
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.synthesis import stream_frames, synthesise, to_model_phones


def said(symbols: str, phone_set: str = "en-arpabet", start: float = 0.3) -> PhoneSequence:
    segments = []
    for i, symbol in enumerate(symbols.split()):
        begin = round(start + 0.1 * i, 3)
        segments.append(PhoneSegment(begin, round(begin + 0.1, 3), symbol))
    return PhoneSequence(tuple(segments), phone_set=phone_set, name="said")


@pytest.fixture(scope="module")
def english() -> RuleBased:
    return RuleBased().prepare("en-arpabet")


def test_frames_are_on_the_clock_of_the_phones(english):
    tracks = synthesise(said("sil B AA1 B sil"), english, 50)
    assert tracks.rate == 50
    assert tracks.start_time == 0.3
    assert tracks.frames == 25
    jaw = tracks["jaw_rotation"]
    assert 0.5 <= tracks.times[jaw.argmax()] <= 0.6
    assert tracks.provenance[-1].name == "predict"


def test_a_model_file_will_do(english, tmp_path):
    english.save(tmp_path / "m.model")
    phones = said("sil M IY1 sil")
    np.testing.assert_array_equal(
        synthesise(phones, tmp_path / "m.model").values, synthesise(phones, english).values
    )


def test_other_spellings_and_sets_of_the_same_language_are_taken(english):
    spelled = to_model_phones(said("b aa1 b"), english)
    assert spelled.phones == ("B", "AA", "B")
    assert spelled[1].stress == 1
    from_ipa = to_model_phones(said("b ɑ b", "ipa"), english)
    assert from_ipa.phone_set == "en-arpabet"
    assert from_ipa.phones == ("B", "AA", "B")
    assert to_model_phones(said("B AA B", ""), english).phone_set == "en-arpabet"


def test_a_model_of_another_language_is_refused_unless_the_nearest_will_do(english):
    swedish = said("sil B A: M Y: sil", "sv-sta")
    with pytest.raises(DataError, match=r"another phone set.*sv-sta.*en-arpabet.*nearest"):
        synthesise(swedish, english)
    tracks = synthesise(swedish, english, nearest=True)
    assert tracks.frames == 36
    assert np.isfinite(tracks.values).all()


def test_unknown_phones_and_untrained_models_are_refused(english):
    with pytest.raises(DataError, match="XYZ"):
        synthesise(said("B XYZ"), english)
    with pytest.raises(DataError, match="no phones"):
        synthesise(PhoneSequence((), phone_set="en-arpabet"), english)
    with pytest.raises(DataError, match="not trained"):
        synthesise(said("B"), create("phone-mean"))


def test_live_frames_are_those_of_the_whole_utterance(english):
    phones = said("sil HH AH0 L OW1 sil")
    whole = synthesise(phones, english, 30)
    live = list(stream_frames(iter(phones), english, 30))
    np.testing.assert_allclose([frame.time for frame in live], whole.times)
    np.testing.assert_allclose([frame.values for frame in live], whole.values)
    assert list(stream_frames(iter(()), english)) == []


def test_a_live_utterance_refuses_what_does_not_follow(english):
    backwards = [PhoneSegment(0.5, 0.6, "B"), PhoneSegment(0.1, 0.2, "AA1")]
    with pytest.raises(DataError, match="order of time"):
        list(stream_frames(backwards, english))
    with pytest.raises(DataError, match="XYZ"):
        list(stream_frames([PhoneSegment(0.5, 0.6, "XYZ")], english))


def test_live_frames_have_a_tongue_where_it_is_wanted(english) -> None:
    labels = ["sil", "AA", "L", "IY", "K", "AA", "sil"]
    phones = [PhoneSegment(0.1 * i, 0.1 * (i + 1), label) for i, label in enumerate(labels)]
    plain = list(stream_frames(iter(phones), english, 50))
    frames = list(stream_frames(iter(phones), english, 50, tongue=True))
    values = np.array([frame.values for frame in frames])
    np.testing.assert_array_equal(values[:, :-5], [frame.values for frame in plain])
    times = np.array([frame.time for frame in frames])
    lateral, velar = (np.abs(times - centre).argmin() for centre in (0.25, 0.45))
    # Raised: the tip for l, the body for k.
    assert values[lateral, -5] > 0.9
    assert values[velar, -3] > 0.9
