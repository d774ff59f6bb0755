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
