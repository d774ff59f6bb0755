import dataclasses
import inspect

import numpy as np
import pytest

from corpus_tools import simulation as simulate
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import DataError
from mocap_fit.evaluation import evaluate
from mocap_fit.evaluation.landmarks import FITTED, LandmarkScores, _Mouth, evaluate_landmarks
from mocap_fit.face import load_face
from mocap_fit.fitting import load_layout
from mocap_fit.phones import PhoneSegment, PhoneSequence

CONDITIONS = simulate.Conditions(noise=0.1, drop_outs=0.02, duration=2.0)


@pytest.fixture(scope="module")
def recorded():
    """True parameters with the markers that they make, the head moving in a laboratory's axes."""
    session = simulate.Session(load_layout("face30-head5"), load_face(), CONDITIONS)
    phones = PhoneSequence((PhoneSegment(0.0, 2.0, "AA"),), phone_set="en-arpabet")
    utterances = []
    for i in range(3):
        made = session.record(np.random.default_rng(i), f"u{i}")
        one = Utterance.from_tracks(made.parameters, phones, markers=made.recording, id=f"u{i}")
        utterances.append(one)
    return Corpus.from_utterances(utterances, "en-arpabet", layout="face30-head5", face="built-in")


def test_true_parameters_agree_with_the_markers(recorded):
    result = evaluate_landmarks(recorded, {}, resamples=200)
    assert result.models == (FITTED,)
    assert (result.correlation > 0.98).all()
    assert result.low[0] <= result.mean[0] <= result.high[0]
    assert 0 < result.frames <= 3 * 120


def test_another_utterance_disagrees(recorded):
    swapped = [
        Utterance.from_tracks(
            recorded.utterances[(i + 1) % 3].read_tracks(),
            u.read_phones(),
            markers=u.read_markers(),
            id=u.id,
        )
        for i, u in enumerate(recorded)
    ]
    corpus = dataclasses.replace(recorded, utterances=tuple(swapped))
    assert evaluate_landmarks(corpus, {}, resamples=200).mean[0] < 0.5


def test_what_cannot_be_compared_is_refused(recorded):
    with pytest.raises(DataError, match="not those of the face"):
        evaluate_landmarks(dataclasses.replace(recorded, parameter_names=("x",)), {})
    layout = load_layout("face30-head5")
    bare = [m for m in layout.markers if m.feature_point not in ("8.3", "8.4", "2.4", "2.5")]
    with pytest.raises(DataError, match=r"shows the mouth.*8\.3, 8\.4 or 2\.4, 2\.5"):
        evaluate_landmarks(recorded, {}, layout=layout.model_copy(update={"markers": tuple(bare)}))


def test_the_four_measures_are_distances_and_places_of_feature_points():
    face = load_face()
    mouth = _Mouth(face, load_layout("face30-head5"))
    values = np.random.default_rng(0).uniform(0, 0.5, (4, len(face.parameter_names)))
    values[2, 1] = np.nan
    found = mouth.measure_face(values)
    assert np.isnan(found).any(axis=1).tolist() == [False, False, True, False]
    for frame in (0, 1, 3):
        vertices = face.deform(values[frame])
        point = {name: vertices[face.mesh.get_feature_point(name)] for name in mouth._points}
        upper, lower, left, right, chin = "2.2", "2.3", "8.3", "8.4", "2.1"
        if upper not in point:
            upper, lower = "8.1", "8.2"
        if left not in point:
            left, right = "2.4", "2.5"
        if chin not in point:
            chin = "2.10"
        outer = ("8.1", "8.2") if "8.1" in point else ("2.2", "2.3")
        expected = [
            point[upper][1] - point[lower][1],
            point[left][0] - point[right][0],
            point[chin][1],
            0.5 * (point[outer[0]][2] + point[outer[1]][2]),
        ]
        np.testing.assert_allclose(found[frame], expected, atol=1e-9)
    # The left of a face has the greater x.
    assert (found[[0, 1, 3], 1] > 20).all()


def test_scores_beside_the_markers_print_the_best_first():
    correlation = np.array([[0.5, 0.6, 0.7, 0.8], [0.9, 0.9, 0.9, 0.9]])
    scores = LandmarkScores(
        ("a", "b"), correlation, np.array([0.6, 0.8]), np.array([0.7, 0.95]), 3, 90
    )
    lines = str(scores).splitlines()
    assert lines[0].split()[-3:] == ["mean", "from", "to"]
    assert [line.split()[0] for line in lines[1:]] == ["b", "a"]
    assert lines[2].split()[1:] == ["0.500", "0.600", "0.700", "0.800", "0.650", "0.600", "0.700"]
    assert "3 utterances, 90 frames" in repr(scores)
    assert scores._repr_html_().count("<tr>") == 3


def test_the_bootstrap_is_that_of_the_other_scores():
    ours, theirs = (inspect.signature(each).parameters for each in (evaluate_landmarks, evaluate))
    for name, value in (("resamples", 2000), ("seed", 0)):
        assert ours[name].default == theirs[name].default == value


def with_markers(recorded, change, **fields):
    """The utterances with changed markers, and with other fields, one for each."""
    return dataclasses.replace(
        recorded,
        utterances=tuple(
            dataclasses.replace(
                Utterance.from_tracks(
                    u.read_tracks(), u.read_phones(), markers=change(i, u.read_markers()), id=u.id
                ),
                **{name: values[i] for name, values in fields.items()},
            )
            for i, u in enumerate(recorded)
        ),
    )


def test_sessions_have_axes_of_their_own(recorded):
    """The second recording is from another laboratory, whose axes are others."""

    def turn(i, markers):
        if i != 1:
            return markers
        return markers.replace(positions=markers.positions[:, :, [2, 0, 1]])

    expected = evaluate_landmarks(recorded, {}, resamples=50)
    apart = with_markers(recorded, turn, session=("a", "b", "a"))
    result = evaluate_landmarks(apart, {}, resamples=50)
    np.testing.assert_allclose(result.correlation, expected.correlation, atol=0.02)


def test_frames_are_counted_that_are_compared(recorded):
    """Those of speech that were fitted and show the mouth."""
    mouth = _Mouth(load_face(), load_layout("face30-head5"))
    names = [mouth._markers[point] for point in mouth._points]
    shown = [u.read_markers().visible for u in recorded]
    columns = recorded.utterances[0].read_markers().indices(names)
    result = evaluate_landmarks(recorded, {}, resamples=10)
    counts = [int(s[:, columns].all(axis=1).sum()) for s in shown]
    assert result.utterances == 3
    assert sum(counts) - 6 <= result.frames <= sum(counts)
    first = recorded.utterances[0]
    values = first.read_tracks().values.copy()
    values[:60, 0] = np.nan
    late = Utterance.from_tracks(
        first.read_tracks().replace(values=values),
        PhoneSequence((PhoneSegment(0.0, 1.5, "AA"),), phone_set="en-arpabet"),
        markers=first.read_markers(),
        id="u0",
    )
    alone = dataclasses.replace(recorded, utterances=(late,))
    count = int(shown[0][60:90][:, columns].all(axis=1).sum())
    assert count - 2 <= evaluate_landmarks(alone, {}, resamples=10).frames <= count


def test_without_a_frame_of_all_head_markers_there_are_no_axes(recorded):
    layout = load_layout("face30-head5")
    head = [marker.name for marker in layout.head_markers]

    def hide(i, markers):
        positions = markers.positions.copy()
        for k, name in enumerate(head):
            positions[k::5, markers.index(name)] = np.nan
        return markers.replace(positions=positions, origin=None)

    with pytest.raises(DataError, match="no frame of 'u0' shows all head markers") as caught:
        evaluate_landmarks(with_markers(recorded, hide), {})
    assert caught.value.expected == ", ".join(head)


def test_models_are_compared_as_the_fit_is_and_progress_is_told(recorded):
    class Copy:
        """The true parameters, with a share of another one's."""

        def __init__(self, share):
            self.share, self.at = share, 0

        def predict_at(self, phones, times):
            true, other = (recorded.utterances[(self.at + k) % 3].read_tracks() for k in (0, 1))
            self.at += 1
            return (1 - self.share) * true.values + self.share * other.values

    calls = []
    models = {"same": Copy(0.0), "near": Copy(0.5), "far": Copy(1.0)}
    result = evaluate_landmarks(recorded, models, resamples=50, progress=lambda: calls.append(1))
    assert result.models == (FITTED, "same", "near", "far")
    np.testing.assert_array_equal(result.correlation[1], result.correlation[0])
    assert result.mean[1] > result.mean[2] > result.mean[3]
    assert len(calls) == 3
    again = evaluate_landmarks(recorded, {}, resamples=50, seed=1)
    assert again.low[0] != result.low[0]
    np.testing.assert_array_equal(again.correlation[0], result.correlation[0])
