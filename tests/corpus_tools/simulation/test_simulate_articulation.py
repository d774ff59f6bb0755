"""The simulated face: what phonetics asks of it, and that it is never beyond its bounds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from corpus_tools.simulation.articulation import Articulator
from corpus_tools.simulation.articulation_table import (
    Articulation,
    SpeakerTargets,
    evaluate_target,
    load_articulation,
)
from corpus_tools.simulation.durations import time_words
from corpus_tools.simulation.dynamics import (
    LipDistance,
    MotionTargets,
    simulate_motion,
)
from corpus_tools.simulation.sentences import list_languages, load_language
from corpus_tools.simulation.speech_sound import (
    RATE,
    create_sync_pulses,
    locate_pulses,
    synthesise_sound,
)
from corpus_tools.simulation.traits import TRAITS, get_traits, load_table
from mocap_fit.errors import MissingFileError
from mocap_fit.face import compute_lip_gap, load_face
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set
from mocap_fit.sound import Sound, decode_pulses, energy_db

COUNT = 20
FRAMES = 120.0


@pytest.fixture(scope="module")
def face():
    return load_face()


@pytest.fixture(scope="module")
def said(face):
    """Twenty sentences of each language: phones, times, values."""
    found = {}
    for language in list_languages():
        known = load_language(language)
        speaker = Articulator(face, known.phone_set, np.random.default_rng(1))
        takes = []
        for i, sentence in enumerate(known.draw_sentences(COUNT, np.random.default_rng(2))):
            rng = np.random.default_rng([3, i])
            phones = time_words(sentence.words, known.phone_set, rng)
            times = np.arange(int(phones.duration * FRAMES)) / FRAMES
            takes.append((phones, times, speaker.say(phones, times, rng)))
        found[language] = known.phone_set, takes
    return found


every_language = pytest.mark.parametrize("language", list_languages())


def at_centres(said, language, wanted, track):
    """A track at the centres of the phones that are wanted."""
    phone_set, takes = said[language]
    found = []
    for phones, times, values in takes:
        centres = [s.centre for s in phones if wanted(phone_set.get_phone(s), s)]
        found.append(np.stack([np.interp(centres, times, row) for row in values.T], axis=1))
    return track(np.concatenate(found))


@every_language
def test_lips_close_on_every_bilabial(said, face, language):
    gaps = at_centres(
        said,
        language,
        lambda phone, _: "bilabial_stop" in phone.get_classes(),
        lambda values: compute_lip_gap(face, values),
    )
    assert len(gaps) > 25
    # On the face at rest they are 0.08 mm apart.
    assert gaps.max() < 0.4
    assert np.median(gaps) < -0.2


@every_language
def test_lips_are_closed_before_and_after_speech(said, face, language):
    for phones, times, values in said[language][1]:
        gaps = compute_lip_gap(face, values[[0, -1]])
        assert np.abs(gaps).max() < 1.5
        assert times[-1] < phones.duration


@every_language
def test_labiodentals_bring_the_lower_lip_up_and_in(said, face, language):
    names = face.parameter_names
    gaps = at_centres(
        said,
        language,
        lambda phone, _: phone.values["labiodental"] == 1,
        lambda values: compute_lip_gap(face, values),
    )
    pulled = at_centres(
        said,
        language,
        lambda phone, _: phone.values["labiodental"] == 1,
        lambda values: values[:, names.index("lower_lip_retraction")],
    )
    assert 0.5 < np.median(gaps) < 3.0
    assert gaps.max() < 4.5
    assert np.median(pulled) > 0.35


@every_language
def test_open_vowels_open_the_jaw_and_rounded_ones_round_the_lips(said, face, language):
    names = face.parameter_names

    def of(parameter, wanted):
        column = names.index(parameter)
        return at_centres(
            said, language, lambda p, s: p.kind == "vowel" and wanted(p, s), lambda v: v[:, column]
        )

    jaw_open = of("jaw_rotation", lambda p, _: p.values["open"] >= 0.8)
    jaw_close = of("jaw_rotation", lambda p, _: p.values["open"] <= -0.7)
    assert np.median(jaw_open) > 2 * np.median(jaw_close)
    rounded = of("lip_rounding", lambda p, _: p.values["rounded"] >= 0.8)
    spread = of("lip_rounding", lambda p, _: p.values["rounded"] <= -0.4)
    assert np.median(rounded) > 0.35 > np.median(spread) + 0.2
    corners = of("left_corner_stretch", lambda p, _: p.values["rounded"] <= -0.6)
    assert np.median(corners) > 0.1
    # Undershoot: the same vowel is less open without stress.
    if language != "cs":
        stressed = of("jaw_rotation", lambda p, s: p.values["open"] >= 0.8 and s.stress == 1)
        weak = of("jaw_rotation", lambda p, s: p.values["open"] >= 0.8 and s.stress == 0)
        assert np.median(weak) < np.median(stressed)


@every_language
def test_hissing_keeps_the_teeth_together(said, face, language):
    jaw = face.parameter_names.index("jaw_rotation")
    found = at_centres(
        said,
        language,
        lambda phone, _: get_traits(phone)["sibilant"],
        lambda values: values[:, jaw],
    )
    assert np.quantile(found, 0.9) < 0.14


@every_language
def test_no_value_reaches_a_bound(said, face, language):
    lower, upper = face.bounds.T
    for _, _, values in said[language][1]:
        assert (values > lower).all()
        assert (values < upper).all()
        # Nor does anything jump: lips that close do 200 mm a second, 8 mm to the full gesture.
        assert np.abs(np.diff(values, axis=0)).max() * FRAMES < 32


def syllables(phones, each=0.09, silence=0.4):
    """A sequence of phones of equal length between silences; stress after a digit."""
    chosen = load_phone_set("sv-sta")
    clock, segments = silence, [PhoneSegment(0.0, silence, "sil")]
    for phone in phones.split():
        stress = 1 if chosen.is_vowel(phone) else None
        segments.append(PhoneSegment(clock, clock + each, phone, stress, "x"))
        clock += each
    segments.append(PhoneSegment(clock, clock + silence, "sil"))
    return PhoneSequence(tuple(segments), phone_set="sv-sta")


def quiet_table():
    """The shipped table without any noise."""
    table = load_articulation()
    still = {
        name: getattr(table, name).model_copy(
            update=dict.fromkeys(type(getattr(table, name)).model_fields, 0.0)
        )
        for name in ("speaker", "utterance", "word", "gesture")
    }
    return table.model_copy(update=still)


def say(face, phones, table=None, seed=0):
    speaker = Articulator(
        face, load_phone_set("sv-sta"), np.random.default_rng(0), table or quiet_table()
    )
    times = np.arange(int(phones.duration * FRAMES)) / FRAMES
    return times, speaker.say(phones, times, np.random.default_rng(seed))


def test_rounding_is_anticipated_through_consonants_that_do_not_mind(face):
    column = face.parameter_names.index("lip_rounding")
    for between, earlier in (("S T", True), ("SJ T", True)):
        phones = syllables(f"A {between} O:")
        times, values = say(face, phones)
        plain = say(face, syllables(f"A {between} A"))[1][:, column]
        onset = phones[4].start
        rising = np.interp(onset - 0.08, times, values[:, column] - plain)
        assert (rising > 0.02) == earlier
    # Not through a vowel, and only a little before the speaker begins.
    phones = syllables("A S I S O:")
    times, values = say(face, phones)
    assert np.interp(phones[3].centre, times, values[:, column]) < 0.12
    times, values = say(face, syllables("O:", silence=0.6))
    assert np.interp(0.35, times, values[:, column]) < 0.02


def test_short_vowels_undershoot(face):
    jaw = face.parameter_names.index("jaw_rotation")
    reached = []
    for each in (0.05, 0.08, 0.15, 0.3):
        reached.append(say(face, syllables("S A S", each))[1][:, jaw].max())
    assert (np.diff(reached) > 0.01).all()
    assert reached[0] < 0.75 * reached[-1]


def test_the_lips_meet_however_open_the_jaw_is(face):
    jaw = face.parameter_names.index("jaw_rotation")
    found = []
    for vowel in ("A:", "I:"):
        phones = syllables(f"{vowel} M {vowel}", 0.09)
        values = say(face, phones)[1]
        frame = round(phones[2].centre * FRAMES)
        found.append(values[frame])
        assert -1.5 < compute_lip_gap(face, values[frame : frame + 1])[0] < 0.1
    opened, closed = found
    lower = face.parameter_names.index("lower_lip_depression")
    assert opened[jaw] > closed[jaw] + 0.05
    assert opened[lower] < closed[lower] - 0.05


def test_a_diphthong_moves(face):
    known = load_language("en")
    phones = PhoneSequence(
        (
            PhoneSegment(0.0, 0.4, "sil"),
            PhoneSegment(0.4, 0.7, "AW", 1, "how"),
            PhoneSegment(0.7, 1.1, "sil"),
        ),
        phone_set="en-arpabet",
    )
    speaker = Articulator(face, known.phone_set, np.random.default_rng(0), quiet_table())
    values = speaker.say(phones, np.array([0.5, 0.68]), np.random.default_rng(0))
    jaw, rounding = (face.parameter_names.index(n) for n in ("jaw_rotation", "lip_rounding"))
    assert values[0, jaw] > values[1, jaw] + 0.03
    assert values[1, rounding] > values[0, rounding] + 0.2


def collect_targets(phone_set, kind, targets=None, contact=False):
    """Targets of a parameter, ``(sounds,)`` each: of the table, or of a speaker."""
    columns = {}
    for phone in load_phone_set(phone_set).phones:
        traits = get_traits(phone)
        for gesture in load_articulation().gestures if traits[kind] else ():
            if not gesture.is_met_by(traits) or gesture.contact != contact:
                continue
            for name, sums in gesture.targets.items():
                value = (
                    evaluate_target(sums, traits)
                    if targets is None
                    else targets.get_target(phone.symbol, 0, gesture, name, traits)
                )
                columns.setdefault(name, []).append(value)
    return {name: np.array(values) for name, values in columns.items()}


@pytest.mark.parametrize("phone_set", ["sv-sta", "en-arpabet", "cs-sampa"])
def test_speakers_are_as_far_from_the_table_as_from_each_other(face, phone_set):
    table, names = load_articulation(), face.parameter_names
    rules = collect_targets(phone_set, "vowel")
    speakers = [
        SpeakerTargets(table, load_phone_set(phone_set), names, np.random.default_rng(seed))
        for seed in range(20)
    ]
    distances, likenesses = [], []
    for speaker in speakers:
        for name, values in collect_targets(phone_set, "vowel", speaker).items():
            expected = rules[name]
            distances.append(np.sqrt(np.mean((values - expected) ** 2)) / expected.std())
            likenesses.append(np.corrcoef(values, expected)[0, 1])
    # sqrt(2) times what speakers differ by around their mean; see articulation.toml.
    assert np.sqrt(np.mean(np.square(distances))) == pytest.approx(0.47, abs=0.03)
    assert 0.86 < np.mean(likenesses) < 0.94


def test_speakers_make_contacts_alike_and_sounds_their_way(face):
    table, names, phone_set = load_articulation(), face.parameter_names, load_phone_set("sv-sta")
    first, again, other = (
        SpeakerTargets(table, phone_set, names, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )

    def gather(kind, targets, contact=False):
        return np.concatenate([*collect_targets("sv-sta", kind, targets, contact).values()])

    assert len(gather("consonant", None, True)) > 10
    np.testing.assert_array_equal(gather("consonant", first, True), gather("consonant", None, True))
    for kind in ("vowel", "consonant"):
        np.testing.assert_array_equal(gather(kind, first), gather(kind, again))
        assert np.mean(gather(kind, first) != gather(kind, other)) > 0.8
    np.testing.assert_array_equal(gather("silence", first), gather("silence", None))
    vowels = collect_targets("sv-sta", "vowel", first)
    np.testing.assert_array_equal(vowels["left_corner_stretch"], vowels["right_corner_stretch"])


def test_speakers_and_takes_vary_a_little(face):
    phones = syllables("B A M I S O: F A")
    table = load_articulation()
    first, again = (say(face, phones, table)[1] for _ in range(2))
    other = say(face, phones, table, seed=1)[1]
    np.testing.assert_array_equal(first, again)
    apart = np.sqrt(np.mean((first - other) ** 2, axis=0))
    spread = first.std(axis=0)
    assert (apart > 1e-4).all()
    moving = spread > 0.05
    assert (apart[moving] < 0.6 * spread[moving]).all()
    # The corners go their own ways, but not far.
    left, right = (
        first[:, face.parameter_names.index(f"{side}_corner_stretch")] for side in ("left", "right")
    )
    assert 0 < np.abs(left - right).max() < 0.1


# ---- dynamics -----------------------------------------------------------------------------------


def test_the_lips_distance_is_that_of_the_face(face):
    lips = LipDistance.from_face(face)
    rng = np.random.default_rng(0)
    values = rng.uniform(-0.2, 0.3, (20, len(face.parameter_names)))
    np.testing.assert_allclose(
        lips.rest + values @ lips.slopes, compute_lip_gap(face, values), atol=0.4
    )


@given(
    stiffness=st.floats(5, 80),
    target=st.floats(-1, 1),
    step=st.sampled_from([0.001, 0.0025, 0.01]),
)
@settings(max_examples=25, deadline=None)
def test_a_lone_gesture_is_critically_damped(face, stiffness, target, step):
    names = face.parameter_names
    steps = 60
    shape = (steps, len(names))
    pull = MotionTargets(
        step,
        np.full(shape, target),
        np.full(shape, stiffness),
        np.zeros((steps, 2)),
        np.zeros(steps),
        np.zeros(steps),
    )
    found = simulate_motion(pull, names, LipDistance.from_face(face))
    times = step * np.arange(1, steps + 1)
    expected = target * (1 - (1 + stiffness * times) * np.exp(-stiffness * times))
    np.testing.assert_allclose(found, np.tile(expected[:, None], (1, len(names))), atol=1e-9)


# ---- tables -------------------------------------------------------------------------------------


def test_traits_of_phones():
    swedish, english, czech = map(load_phone_set, ("sv-sta", "en-arpabet", "cs-sampa"))
    for chosen in (swedish, english, czech):
        for phone in chosen.phones:
            found = get_traits(phone)
            assert tuple(found) == TRAITS
            assert found["vowel"] + found["consonant"] + found["silence"] == 1
    hissing = {p.symbol for p in swedish.phones if get_traits(p)["sibilant"]}
    assert hissing == {"S", "2S", "TJ"}
    assert {p.symbol for p in english.phones if get_traits(p)["long"]} == {
        "IY",
        "UW",
        "AA",
        "AO",
        "ER",
    }
    assert {p.symbol for p in czech.phones if get_traits(p)["long"]} == {
        "i:",
        "e:",
        "a:",
        "o:",
        "u:",
    }
    assert {p.symbol for p in czech.phones if get_traits(p)["affricate"]} == {
        "t_s", "d_z", "t_S", "d_Z",
    }  # fmt: skip


def test_every_phone_has_gestures_durations_and_sound():
    from corpus_tools.simulation.durations import load_durations
    from corpus_tools.simulation.speech_sound import load_speech_sound

    durations, sounds = load_durations().phones, load_speech_sound().sounds
    for name in ("sv-sta", "en-arpabet", "cs-sampa", "cs-ipa"):
        for phone in load_phone_set(name).phones:
            found = get_traits(phone)
            assert any(sound.is_met_by(found) for sound in sounds)
            assert phone.kind == "silence" or any(rule.is_met_by(found) for rule in durations)


def test_a_rule_that_asks_for_a_trait_that_is_not_there():
    with pytest.raises(ValueError, match="there is no trait 'wet'"):
        load_articulation().gestures[0].model_validate(
            {**load_articulation().gestures[0].model_dump(), "where": {"wet": 1}}
        )


def test_a_table_that_is_not_there():
    with pytest.raises(MissingFileError, match=r"none.*no such table"):
        load_table("none", Articulation)


# ---- sound --------------------------------------------------------------------------------------


def test_energy_follows_the_phones():
    phones = syllables("A: T A: M A: S A: D", 0.15)
    sound = synthesise_sound(phones, load_phone_set("sv-sta"), np.random.default_rng(0))
    assert len(sound) == round(phones.duration * RATE)
    assert np.abs(sound).max() <= 1
    levels = dict(
        zip(
            ["0", "A", "T", "A1", "M", "A2", "S", "A3", "D", "9"],
            energy_db(Sound(sound, RATE), 0.5 * (phones.starts + phones.ends)),
            strict=True,
        )
    )
    vowel = levels["A"]
    for other, least in {"M": 5, "S": 6, "D": 12, "T": 35, "0": 35, "9": 35}.items():
        assert levels[other] < vowel - least
    assert levels["A2"] == pytest.approx(vowel, abs=3)


def test_pulses_are_where_frames_are():
    times = 0.1234 + np.arange(150) / 60.002
    channel = create_sync_pulses(times, 3 * RATE)
    found = decode_pulses(channel, RATE, 60.0, 150)
    assert list(found.samples) == locate_pulses(times)
    assert found.drift_ppm == pytest.approx(1e6 * 0.002 / 60, abs=5)
    fast = create_sync_pulses(np.arange(900) / 1000.0, RATE)
    assert 0 < np.count_nonzero(np.diff(fast) > 0) == 899
