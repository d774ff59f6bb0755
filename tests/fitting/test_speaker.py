"""A speaker: prepared from files or objects, fitted, compared, copied, shown."""

import copy
import pickle

import numpy as np
import pytest

from corpus_tools.simulation import Conditions, Session
from mocap_fit import load_sample, read_tracks
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.fitting import (
    Speaker,
    align_reference,
    bind_markers,
    fit_orientation,
    fit_shape,
    fit_speaker,
)
from mocap_fit.fitting import load_layout as load
from mocap_fit.fitting.precision import compute_covariance
from mocap_fit.fitting.speaker import _flatten

pytestmark = pytest.mark.filterwarnings("ignore:the head.s pose is not known")

LAYOUT = "face30-head5"


@pytest.fixture(scope="module")
def noisy(layout, face):
    """A noisy recording of the head's wearer, with drop-outs, and the truth."""
    session = Session(layout, face, Conditions(noise=0.1, duration=20.0))
    first, second = np.random.default_rng(3).spawn(2)
    return session.record_reference(first), session.record(second, "noisy")


@pytest.fixture(scope="module")
def speaker(noisy, face) -> Speaker:
    return fit_speaker(face, LAYOUT, noisy[0])


@pytest.fixture(scope="module")
def fitted(speaker, noisy):
    return speaker.fit(noisy[1].recording)


def test_it_does_the_steps_that_a_user_can_do(noisy, face, layout, speaker, fitted):
    reference = align_reference(layout, noisy[0])
    orientation = fit_orientation(face, layout, reference)
    binding = bind_markers(face, layout, reference, orientation)
    still, motion = speaker.remove_head_motion(noisy[1].recording)
    alone = fit_shape(binding, still)
    np.testing.assert_array_equal(fitted.parameters.values, alone.parameters.values)
    np.testing.assert_array_equal(fitted.residuals, alone.parameters.residuals)
    np.testing.assert_array_equal(fitted.head_motion.rotations, motion.rotations)
    steps = [step.name for step in fitted.parameters.provenance]
    assert steps[-3:] == ["remove_head_motion", "bind_markers", "fit_shape"]


@pytest.mark.parametrize("objective", ["distances", "squares"])
def test_intervals_of_95_per_cent_hold_the_truth(speaker, noisy, face, objective):
    """Frame by frame, away from the bounds, which cut the errors off."""
    fit = speaker.fit(noisy[1].recording, objective=objective)
    values, deviations = fit.parameters.values, fit.parameters.standard_deviations
    lower, upper = face.bounds.T
    inside = (values > lower + 2 * deviations) & (values < upper - 2 * deviations)
    inside &= np.isfinite(deviations)
    assert inside.sum() > 8000
    errors = np.abs(values - noisy[1].parameters.values)[inside]
    assert 0.94 <= np.mean(errors < 1.959964 * deviations[inside]) <= 0.97


def test_settings_reach_the_fit(speaker, noisy, fitted):
    part = noisy[1].recording.between(0.0, 0.5)
    squares = speaker.fit(part, objective="squares", solver="newton")
    step = squares.parameters.provenance[-1]
    assert step.arguments["objective"] == "squares"
    assert step.arguments["solver"] == "newton"
    done = []
    smooth = speaker.fit(part, smooth=True, objective="squares", progress=done.append)
    assert smooth.parameters.provenance[-1].name == "fit_over_time"
    assert smooth.parameters.provenance[-1].arguments["objective"] == "squares"
    assert done == [part.frames]
    assert speaker.fit(part, refine_pose=True).shape.pose_corrections.any()


def test_files_and_names_do_as_well_as_objects(face):
    rest = load_sample("rest")
    by_name = fit_speaker("built-in", LAYOUT, rest)
    by_object = fit_speaker(face, load(LAYOUT), read_tracks(rest))
    np.testing.assert_array_equal(by_name.binding.coordinates, by_object.binding.coordinates)
    assert by_name.face_name == "built-in"
    assert by_object.face_name == type(face).__name__
    assert by_name.compute_fingerprint() != by_object.compute_fingerprint()


def test_a_bad_frame_does_not_move_the_reference_pose(noisy, face, speaker):
    """The reference pose is the median of its frames."""
    positions = noisy[0].positions.copy()
    positions[: len(positions) // 3] += 80.0
    spoilt = fit_speaker(face, LAYOUT, noisy[0].replace(positions=positions))
    difference = spoilt.binding.orientation.translation - speaker.binding.orientation.translation
    assert np.linalg.norm(difference) < 0.5
    assert spoilt.binding.orientation.scale == pytest.approx(
        speaker.binding.orientation.scale, abs=1e-3
    )


def test_a_marker_that_is_hidden_in_some_frames_is_where_it_is_seen(noisy, face, speaker):
    positions = noisy[0].positions.copy()
    positions[1:, noisy[0].index(speaker.binding.names[0])] = np.nan
    other = fit_speaker(face, LAYOUT, noisy[0].replace(positions=positions, origin=None))
    assert np.abs(other.binding.coordinates - speaker.binding.coordinates).max() < 0.5


def test_faults_name_the_file_to_mend(tmp_path, face):
    rest = load_sample("rest")
    with pytest.raises(DataError, match=r"lacks \d+ of the \d+ markers") as caught:
        fit_speaker(face, "grid_s1", rest)
    assert caught.value.path == str(rest)
    text = '[[markers]]\nname = "a"\nfeature_point = "2.1"\norientation = true\n'
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        fit_speaker(face, path, rest)
    assert caught.value.path == str(path)
    tracks = read_tracks(rest)
    head = [name for name in tracks.names if name.startswith("head")]
    positions = tracks.positions.copy()
    positions[:, tracks.indices(head[2:])] = np.nan
    with pytest.raises(DataError, match="do not determine the head's pose") as caught:
        fit_speaker(face, LAYOUT, tracks.replace(positions=positions, origin=None, name="rest 2"))
    assert caught.value.path == "rest 2"


class TestFingerprint:
    def test_every_setting_and_the_reference_count(self, speaker, noisy, face):
        fingerprints = {
            speaker.compute_fingerprint(**settings)
            for settings in (
                {},
                {"objective": "squares"},
                {"solver": "newton"},
                {"refine_pose": True},
                {"smooth": True},
            )
        }
        moved = noisy[0].replace(positions=noisy[0].positions + 1e-9)
        fingerprints.add(fit_speaker(face, LAYOUT, moved).compute_fingerprint())
        assert len(fingerprints) == 6
        again = fit_speaker(face, LAYOUT, noisy[0])
        assert again.compute_fingerprint() == speaker.compute_fingerprint()


class TestObjects:
    def test_they_are_pickled_and_copied(self, speaker, fitted):
        for twin in (pickle.loads(pickle.dumps(speaker)), copy.deepcopy(speaker)):
            assert twin.compute_fingerprint() == speaker.compute_fingerprint()
        for twin in (pickle.loads(pickle.dumps(fitted)), copy.deepcopy(fitted)):
            np.testing.assert_array_equal(twin.residuals, fitted.residuals)
            np.testing.assert_array_equal(twin.head_motion.weights, fitted.head_motion.weights)

    def test_reprs_are_a_few_lines(self, speaker, fitted):
        for shown in (
            speaker,
            speaker.layout,
            speaker.binding,
            speaker.binding.orientation,
            fitted,
            fitted.shape,
            fitted.head_motion,
        ):
            lines = repr(shown).splitlines()
            assert len(lines) <= 8
            assert max(map(len, lines)) <= 100
            assert str(shown) == repr(shown)
        assert "30 face markers, 5 head markers" in repr(speaker)
        assert "1199 of 1200 frames" in repr(fitted)

    def test_layouts_compare_by_their_contents(self, layout):
        assert load(LAYOUT) == layout
        assert layout != layout.model_copy(update={"marker_offset": 9.0})

    def test_a_notebook_shows_a_table(self, fitted):
        page = fitted._repr_html_()
        assert page.count("<tr>") == 11
        assert "jaw_rotation" in page
        jaw = fitted.parameters.values[:, 0]
        for number in (np.nanmin(jaw), np.nanmedian(jaw), np.nanmax(jaw)):
            assert f"<td>{number:.3f}</td>" in page

    def test_a_plot_has_every_parameter_and_the_residuals(self, fitted):
        upper, lower = fitted.plot().axes
        assert len(upper.lines) == 10
        np.testing.assert_array_equal(upper.lines[3].get_ydata(), fitted.parameters.values[:, 3])
        np.testing.assert_array_equal(lower.lines[0].get_ydata(), fitted.residuals)
        times, band = fitted.parameters.times, upper.collections[0].get_paths()[0].vertices
        middle, deviation = (
            fitted.parameters.values[50, 0],
            fitted.parameters.standard_deviations[50, 0],
        )
        at_50 = band[np.isclose(band[:, 0], times[50])][:, 1]
        assert at_50.max() == pytest.approx(middle + 1.96 * deviation)


def test_deviations_are_those_of_the_formula(speaker, noisy, fitted):
    """A frame that shows all markers, with the noise that the residuals show."""
    still, _ = speaker.remove_head_motion(noisy[1].recording)
    binding = speaker.binding
    everything = still.visible.all(axis=1)
    frame = int(np.flatnonzero(everything)[0])
    positions, jacobian = binding.evaluate(fitted.parameters.values[frame])
    covariance = compute_covariance(
        jacobian,
        binding.weights,
        positions=positions,
        head_positions=binding.head_positions,
        head_weights=binding.head_weights,
    )
    noise = fitted.shape.noise * binding.orientation.scale
    np.testing.assert_allclose(
        fitted.parameters.standard_deviations[frame],
        noise * np.sqrt(np.diag(covariance)),
        rtol=1e-6,
    )


def test_ten_times_less_certain_is_uncertain(speaker, noisy, fitted):
    """Where hidden markers make a parameter more than ten times less certain than all do."""
    still, _ = speaker.remove_head_motion(noisy[1].recording)
    binding, rng = speaker.binding, np.random.default_rng(5)
    positions = still.positions[:200].copy()
    hidden = rng.random(positions.shape[:2]) < 0.62
    hidden[:, still.indices(binding.head_names)] = False
    positions[hidden] = np.nan
    fit = fit_shape(binding, still.replace(positions=positions, origin=None))
    _, everything = binding.evaluate(binding.reference_parameters)
    least = np.sqrt(np.diag(compute_covariance(everything, binding.weights)))
    seen = np.isfinite(positions[:, still.indices(binding.names), 0])
    ratios = np.full(fit.parameters.values.shape, np.nan)
    for frame in np.flatnonzero(fit.fitted):
        _, jacobian = binding.evaluate(fit.parameters.values[frame])
        shown = seen[frame]
        covariance = compute_covariance(jacobian[shown], binding.weights[shown])
        ratios[frame] = np.sqrt(np.diag(covariance)) / least
    known = fit.fitted[:, None] & ~(np.abs(ratios - 10.0) < 0.01)
    uncertain = fit.parameters.uncertain
    np.testing.assert_array_equal(uncertain[known], (ratios > 10.0)[known])
    between = (ratios > 5.0) & (ratios < 20.0)
    assert uncertain[between].any()
    assert not uncertain[between].all()


def test_head_markers_count_by_the_weights_of_the_layout(noisy, face, layout):
    markers = [
        marker.model_copy(update={"weight": 4.0}) if marker.name == "head_bridge" else marker
        for marker in layout.markers
    ]
    weighted = fit_speaker(face, layout.model_copy(update={"markers": tuple(markers)}), noisy[0])
    _, motion = weighted.remove_head_motion(noisy[1].recording)
    bridge = motion.reference_names.index("head_bridge")
    assert motion.weights.max(axis=0).tolist() == [4.0 if i == bridge else 1.0 for i in range(5)]
    np.testing.assert_array_equal(weighted.binding.head_weights, motion.weights.max(axis=0))


def test_recordings_are_brought_to_size_where_the_layout_says_so(noisy, face, layout, fitted):
    larger = noisy[1].recording.replace(positions=1.3 * noisy[1].recording.positions)
    varied = fit_speaker(face, layout.model_copy(update={"size_varies": True}), noisy[0])
    fit = varied.fit(larger)
    known = np.isfinite(fit.residuals) & np.isfinite(fitted.residuals)
    difference = fit.parameters.values[known] - fitted.parameters.values[known]
    assert np.abs(difference).max() < 0.02
    assert "match_size" in [step.name for step in fit.parameters.provenance]


def test_results_of_other_faces_are_told_apart(noisy, layout, speaker):
    """A rig that does not compile is known by what it answers."""

    class Other:
        """The built-in head, whose answers are changed a little."""

        def __init__(self, rig, change):
            self._rig, self._change = rig, change

        def __getattr__(self, name):
            return getattr(self._rig, name)

        def deform(self, parameters):
            return self._rig.deform(parameters) + self._change * np.sum(parameters)

        def compile(self, vertex_ids):
            return None

    rig = speaker.binding.rig
    fingerprints = {
        fit_speaker(Other(rig, change), layout, noisy[0]).compute_fingerprint()
        for change in (0.0, 0.0, 1e-6)
    }
    assert len(fingerprints) == 2
    assert speaker.compute_fingerprint() not in fingerprints


def test_contents_that_differ_have_other_bytes():
    """Lists begin with their lengths, so that what is in which of them counts."""
    values = [
        [["a"], ["b"]],
        [["a", "b"], []],
        ["a", "b"],
        {"a": "b"},
        {"a": ["b"]},
        np.zeros(2),
        np.zeros((2, 1)),
        np.zeros(2, np.float32),
        1,
        1.0,
        "1",
        None,
        np.float64(2.0),
    ]
    found = [b"".join(_flatten(value)) for value in values]
    assert len(set(found)) == len(values) - 1  # a mapping is the list of its keys and values
    assert found[2] == found[3]
    with pytest.raises(TypeError, match="a object has no fingerprint"):
        list(_flatten(object()))
