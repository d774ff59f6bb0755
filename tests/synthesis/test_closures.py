"""Lips that close on every bilabial, and move at a limited speed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit.control.rule_based import RuleBased
from mocap_fit.errors import DataError
from mocap_fit.face import load_face
from mocap_fit.face.lips import compute_lip_openings
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set
from mocap_fit.synthesis import stream_frames, synthesise
from mocap_fit.synthesis.closures import SPEED, Interval, close_lips, find_closures

PHONES = load_phone_set("sv-sta")
LIMIT = 0.5


@pytest.fixture(scope="module")
def face():
    return load_face()


def sequence(*phones):
    """Phones and durations, one behind the other."""
    segments, start = [], 0.0
    for symbol, duration in phones:
        segments.append(PhoneSegment(start, start + duration, symbol))
        start += duration
    return PhoneSequence(tuple(segments), phone_set="sv-sta")


def measure(face, values):
    return compute_lip_openings(face, values).max(axis=1)


class TestWhen:
    def test_bilabials_that_touch_are_one_closure(self):
        phones = sequence(("A", 0.1), ("M", 0.04), ("P", 0.04), ("A", 0.1), ("B", 0.1), ("S", 0.1))
        one, two = find_closures(phones, PHONES, 1000.0)
        # The lips still move, and move already, in a quarter of a phone, or 15 ms.
        assert one == pytest.approx((0.11, 0.17))
        assert two == pytest.approx((0.295, 0.365))

    def test_each_of_those_that_touch_is_closed(self):
        (closure,) = find_closures(sequence(("A", 0.1), ("B", 0.09), ("B", 0.026)), PHONES, 1e6)
        # Of the second, which is short, half is at rest.
        assert closure == pytest.approx((0.115, 0.216 - 0.0065))

    def test_a_short_one_keeps_half_of_its_duration(self):
        (closure,) = find_closures(sequence(("A", 0.1), ("B", 0.02)), PHONES, 1000.0)
        assert closure == pytest.approx((0.105, 0.115))

    def test_bilabials_that_touch_have_a_frame_each(self):
        # At 25 Hz the first of them has none inside: the nearest frame is before it.
        phones = sequence(("A", 0.085), ("M", 0.02), ("P", 0.04), ("A", 0.2))
        assert find_closures(phones, PHONES, 25.0) == (pytest.approx((0.08, 0.12)),)

    def test_a_frame_that_there_is_not_is_not_the_nearest(self):
        phones = sequence(("A", 0.1), ("M", 0.02))
        assert find_closures(phones, PHONES, 25.0) == (pytest.approx((0.12, 0.12)),)
        assert find_closures(phones, PHONES, 25.0, 0.0, 3) == (pytest.approx((0.08, 0.08)),)
        assert find_closures(phones, PHONES, 25.0, 0.0, 2) == ()
        assert find_closures(phones, PHONES, 1000.0, 0.0, 0) == ()
        assert find_closures(phones, PHONES, 25.0, 0.2, 100) == ()

    @given(st.floats(0.2, 0.4), st.floats(0.017, 0.09), st.sampled_from([25.0, 30.0, 60.0]))
    def test_there_is_a_frame_in_every_closure(self, start, duration, rate):
        phones = sequence(("A", start), ("B", duration), ("A", 0.3))
        (closure,) = find_closures(phones, PHONES, rate, 0.5 / rate)
        frames = (np.arange(100) + 0.5) / rate
        inside = (frames >= closure.start - 1e-9) & (frames <= closure.end + 1e-9)
        assert inside.any()
        # It is inside the phone, or half a frame away at most.
        half = 0.5 / rate + 1e-6
        assert phones[1].start - half <= closure.start <= closure.end <= phones[1].end + half


class TestTheMovement:
    @pytest.mark.parametrize("rate", [25.0, 60.0, 200.0])
    @pytest.mark.parametrize("jaw", [0.2, 0.6, 1.2])
    def test_lips_close_along_their_line_from_any_opening(self, rate, jaw, face):
        values = np.zeros((round(rate), len(face.parameter_names)))
        values[:, face.parameter_names.index("jaw_rotation")] = jaw
        times = (np.arange(len(values)) + 0.5) / rate
        phones = sequence(("A", 0.4), ("B", 0.05), ("A", 0.5))
        closures = find_closures(phones, PHONES, rate, times[0])
        closed = close_lips(values, times, closures, face)
        gaps = measure(face, closed)
        (closure,) = closures
        inside = (times >= closure.start - 1e-9) & (times <= closure.end + 1e-9)
        assert inside.any()
        assert gaps[inside].max() <= LIMIT
        assert np.abs(np.diff(gaps)).max() * rate <= SPEED + 5.0
        low, high = face.bounds.T
        assert ((closed >= low - 1e-12) & (closed <= high + 1e-12)).all()
        # Where there is time, the mouth is as open as it was.
        far = np.abs(times - 0.425) > 0.025 + 1.3 * measure(face, values[:1])[0] / SPEED + 2 / rate
        np.testing.assert_array_equal(closed[far], values[far])

    def test_the_face_is_as_quick_as_its_lips(self, face):
        # The lips touch in the middle over an open jaw, which keeps the corners apart.
        values = np.zeros((100, len(face.parameter_names)))
        pressed = {"jaw_rotation": 0.28, "upper_lip_raise": -0.33, "lower_lip_depression": -0.62}
        for name, value in pressed.items():
            values[:, face.parameter_names.index(name)] = value
        times = np.arange(100) / 200.0
        closed = close_lips(values, times, [Interval(0.2, 0.25)], face)
        assert measure(face, closed)[40:51].max() <= LIMIT < measure(face, values).max() < 2.5
        points = np.stack([face.deform(row) for row in closed])
        moved = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1)
        assert moved.max() > 0.5
        assert moved.max() * 200.0 <= 1.3 * SPEED

    def test_what_keeps_the_limits_stays_to_the_bit(self, face):
        values = np.zeros((50, len(face.parameter_names)))
        times = np.arange(50) / 100.0
        assert np.array_equal(close_lips(values, times, [Interval(0.2, 0.3)], face), values)
        opened = values + np.eye(1, len(face.parameter_names)) * 0.4
        assert np.array_equal(close_lips(opened, times, [], face), opened)

    def test_missing_frames_stay_missing(self, face):
        values = np.full((20, len(face.parameter_names)), 0.1)
        values[5:8] = np.nan
        closed = close_lips(values, np.arange(20) / 100, [Interval(0.02, 0.1)], face)
        assert np.isnan(closed[5:8]).all()
        known = np.r_[2:5, 8:11]
        assert measure(face, closed[known]).max() <= LIMIT
        nothing = np.full((3, len(face.parameter_names)), np.nan)
        times = np.arange(3) / 100
        assert np.isnan(close_lips(nothing, times, [Interval(0.0, 0.02)], face)).all()

    def test_parameters_that_a_movement_lacks_stay_at_rest(self, face):
        names = ["lower_lip_depression", "unknown", "jaw_rotation"]
        values = np.tile([0.0, 7.0, 0.5], (20, 1))
        closed = close_lips(values, np.arange(20) / 100, [Interval(0.05, 0.1)], face, names)
        assert (closed[:, 1] == 7.0).all()
        full = np.zeros((20, len(face.parameter_names)))
        full[:, [face.parameter_names.index(n) for n in names[::2]]] = closed[:, ::2]
        assert measure(face, full)[5:11].max() <= LIMIT
        with pytest.raises(DataError, match="none of the parameters"):
            close_lips(values, np.arange(20) / 100, [], face, ["a", "b", "c"])

    def test_a_rig_that_cannot_be_compiled_gives_the_same(self, face):
        class Opaque:
            mesh, bounds, parameter_names = face.mesh, face.bounds, face.parameter_names
            deform, jacobian = face.deform, face.jacobian

            def compile(self, vertex_ids):
                return None

        values = np.full((4, len(face.parameter_names)), 0.2)
        arguments = values, np.arange(4) / 100, [Interval(0.01, 0.02)]
        np.testing.assert_allclose(
            close_lips(*arguments, Opaque()), close_lips(*arguments, face), atol=1e-9
        )


class TestSynthesis:
    WORDS = sequence(
        ("sil", 0.1), ("M", 0.06), ("A", 0.08), ("M", 0.07), ("A", 0.1), ("B", 0.02), ("A:", 0.2),
        ("P", 0.035), ("A", 0.12), ("sil", 0.1),
    )  # fmt: skip

    @pytest.mark.parametrize("rate", [25.0, 30.0, 60.0, 200.0])
    def test_every_bilabial_of_a_model_is_closed(self, rate, face):
        from mocap_fit.evaluation import measure_gaps

        model = RuleBased().prepare(PHONES, face.parameter_names)
        tracks = synthesise(
            self.WORDS, model, rate, face=face, articulation=1.3, start_time=0.5 / rate
        )
        lips = measure_gaps(face, tracks.values, tracks.times, self.WORDS, PHONES)
        assert len(lips.bilabials) == 4
        assert max(event.gap for event in lips.bilabials) <= LIMIT
        assert lips.speed <= SPEED + 5
        free = synthesise(self.WORDS, model, rate, start_time=0.5 / rate)
        openings = measure_gaps(face, free.values, free.times, self.WORDS, PHONES).open_vowels
        for event, other in zip(lips.open_vowels, openings, strict=True):
            assert event.gap >= 0.9 * other.gap or event.end - event.start < 0.08

    def test_articulation_scales_about_rest(self, face):
        model = RuleBased().prepare(PHONES, face.parameter_names)
        usual = synthesise(self.WORDS, model, 50.0)
        clear = synthesise(self.WORDS, model, 50.0, articulation=1.3)
        np.testing.assert_allclose(clear.values, 1.3 * usual.values)
        assert len(clear.provenance) == len(usual.provenance) + 1

    @settings(max_examples=10, deadline=None)
    @given(st.integers(0, 1000))
    def test_a_stream_closes_the_same_bilabials(self, seed):
        face = load_face()
        model = RuleBased().prepare(PHONES, face.parameter_names)
        rng = np.random.default_rng(seed)
        symbols = rng.choice(["A", "B", "M", "S", "I", "P", "O"], 12)
        phones = sequence(
            *((s, d) for s, d in zip(symbols, rng.uniform(0.06, 0.15, 12), strict=True))
        )
        frames = list(stream_frames(phones, model, 100.0, face=face))
        values = np.stack([frame.values for frame in frames])
        times = np.array([frame.time for frame in frames])
        np.testing.assert_allclose(times, synthesise(phones, model, 100.0).times)
        gaps = measure(face, values)
        assert np.abs(np.diff(gaps)).max() * 100 <= SPEED + 5
        for closure in find_closures(phones, PHONES, 100.0):
            inside = (times >= closure.start - 1e-9) & (times <= closure.end + 1e-9)
            # The model looks a phone ahead, which is longer than lips take to close.
            assert gaps[inside].min() <= LIMIT
