"""Predicted faces compared with the markers: correlation of what a lip-reader sees.

The other scores compare with fitted parameters; these compare with the measured markers, and
include what the fit has lost. Four measures of the mouth are taken from the predicted face and from
the recorded markers: how far the inner lips are apart, how far the corners, how high the chin is,
and how far the lips protrude. In each utterance the mean over all its frames is subtracted from
both (a video's scale drifts, and a face that rests differently is no error), and Pearson's
correlation is over the frames of all utterances that are not silent.

Markers are brought to the axes of the face by their head markers and by the mean positions of
their feature points alone, without the fit.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mocap_fit.control import ControlModel
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.evaluation.measures import (
    SUMS,
    average,
    compute_interval,
    compute_scores,
    draw_resamples,
    mark_groups,
    sum_utterance,
)
from mocap_fit.evaluation.tables import format_html, format_text
from mocap_fit.face import Rig, load_face
from mocap_fit.face.rig import deform_points
from mocap_fit.fitting import Layout, load_layout
from mocap_fit.head import match_size, remove_head_motion
from mocap_fit.processes import limit_to_one_thread
from mocap_fit.tracks import FloatArray, MarkerTracks, estimate_similarity_transform

MEASURES = ("lip opening", "mouth width", "chin height", "lip protrusion")
#: The row of the fitted tracks: the best that a model could reach through the fit.
FITTED = "fitted tracks"
# Feature points of each measure; the second choice where a layout lacks the first.
_LIPS = (("2.2", "2.3"), ("8.1", "8.2"))
_CORNERS = (("8.3", "8.4"), ("2.4", "2.5"))
_CHIN = (("2.1",), ("2.10",))
_OUTER_LIPS = (("8.1", "8.2"), ("2.2", "2.3"))


@dataclass(frozen=True, eq=False, repr=False)
class LandmarkScores:
    """Correlations with the markers.

    Parameters
    ----------
    models
        Names; `FITTED` is the first.
    correlation
        ``(models, measures)``, in the order of `MEASURES`, -1 to 1.
    low, high
        95 % interval of the mean over the measures, ``(models,)``, -1 to 1, by bootstrap over
        utterances.
    utterances, frames
        Numbers of those that were compared.
    """

    models: tuple[str, ...]
    correlation: FloatArray
    low: FloatArray
    high: FloatArray
    utterances: int
    frames: int

    @property
    def mean(self) -> FloatArray:
        """Mean over the measures, ``(models,)``, -1 to 1."""
        return average(self.correlation)

    def __repr__(self) -> str:
        return (
            f"LandmarkScores of {len(self.models)} models on {self.utterances} utterances, "
            f"{self.frames} frames of speech"
        )

    def __str__(self) -> str:
        return format_text(*self.to_rows())

    def _repr_html_(self) -> str:
        return format_html(*self.to_rows())

    def to_rows(self) -> tuple[list[str], list[list[str]]]:
        """Convert the correlations to the cells of a table.

        Returns
        -------
        header
            Names of the columns.
        rows
            A row a model, the best first.
        """
        order = np.argsort(-self.mean, kind="stable")
        numbers = np.column_stack([self.correlation, self.mean, self.low, self.high])
        rows = [[self.models[i], *(f"{value:.3f}" for value in numbers[i])] for i in order]
        return ["model", *MEASURES, "mean", "from", "to"], rows


@limit_to_one_thread()
def evaluate_landmarks(
    corpus: Corpus,
    models: Mapping[str, ControlModel],
    *,
    face: str | Rig = "built-in",
    layout: str | Layout | None = None,
    resamples: int = 2000,
    seed: int = 0,
    progress: Callable[[], object] | None = None,
) -> LandmarkScores:
    """Compare predicted faces with the markers of a corpus.

    Parameters
    ----------
    corpus
        On disk, with its markers; no model has seen it.
    models
        Trained models by name.
    face
        The face that the parameters move, or its name.
    layout
        The layout of the markers, or its name; by default the corpus's.
    resamples
        Number of bootstrap samples of the utterances.
    seed
        Seed of the bootstrap.
    progress
        Called after each utterance.

    Returns
    -------
    LandmarkScores
        Correlations and their confidence intervals.

    Raises
    ------
    DataError
        If the parameters are not those of the face, or the markers lack feature points of the
        lips, the corners of the mouth or the chin.
    """
    rig = load_face(face) if isinstance(face, str) else face
    if rig.parameter_names != corpus.parameter_names:
        raise DataError(
            "the parameters of the corpus are not those of the face",
            found=", ".join(corpus.parameter_names),
            expected=", ".join(rig.parameter_names),
        )
    marker_layout = layout if isinstance(layout, Layout) else load_layout(layout or corpus.layout)
    mouth = _Mouth(rig, marker_layout)
    still = {u.id: _remove_motion(u, marker_layout, _find_first(corpus, u)) for u in corpus}
    rotations = mouth.find_rotations(corpus, still)
    names = (FITTED, *models)
    sums = np.zeros((len(corpus), len(names), 1, len(MEASURES), SUMS))
    frames, zeros = 0, np.zeros(len(MEASURES))
    for i, utterance in enumerate(corpus):
        tracks, phones = utterance.read_tracks(), utterance.read_phones()
        target = mouth.measure_markers(still[utterance.id], rotations[_get_session(utterance)])
        speech = mark_groups(phones, corpus.phone_set, tracks.times)[:1]
        fitted = np.asarray(np.isfinite(tracks.values).all(axis=1))
        target = np.where(fitted[:, None], target, np.nan)
        frames += int((speech[0] & np.isfinite(target).all(axis=1)).sum())
        predicted = [
            tracks.values,
            *(model.predict_at(phones, tracks.times) for model in models.values()),
        ]
        for m, values in enumerate(predicted):
            shown = np.where(np.isfinite(target), mouth.measure_face(values), np.nan)
            sums[i, m] = sum_utterance(
                target - average(target.T), shown - average(shown.T), speech, zeros
            )
        if progress is not None:
            progress()
    ones = np.ones(len(MEASURES))
    counts = draw_resamples(len(corpus), resamples, seed)
    samples = (counts @ sums.reshape(len(corpus), -1)).reshape(resamples, *sums.shape[1:])
    low, high = compute_interval(average(compute_scores(samples, ones)[1])[:, :, 0])
    correlation = compute_scores(sums.sum(axis=0), ones)[1][:, 0]
    return LandmarkScores(names, correlation, low, high, len(corpus), frames)


def _get_session(utterance: Utterance) -> tuple[str, str]:
    """Return the speaker and session, whose recordings share their axes."""
    return utterance.speaker, utterance.session


def _find_first(corpus: Corpus, utterance: Utterance) -> Utterance:
    return next(u for u in corpus if _get_session(u) == _get_session(utterance))


def _remove_motion(utterance: Utterance, layout: Layout, first: Utterance) -> MarkerTracks:
    """Remove head motion: the head stays where it is in the session's first recording."""
    names = [marker.name for marker in layout.head_markers]
    shown = first.read_markers()
    complete = shown.visible[:, shown.indices(names)].all(axis=1)
    if not complete.any():
        raise DataError(
            f"no frame of '{first.id}' shows all head markers", expected=", ".join(names)
        )
    frame = int(np.argmax(complete))
    reference = shown.replace(
        positions=shown.positions[frame : frame + 1], origin=shown.origin[frame : frame + 1]
    )
    recording = utterance.read_markers()
    with warnings.catch_warnings():
        # The conversion of the corpus has warned of frames without a head pose.
        warnings.simplefilter("ignore", MocapFitWarning)
        if layout.size_varies:
            recording, _ = match_size(recording, reference, names)
        return remove_head_motion(recording, reference, names)[0]


class _Mouth:
    """The four measures, of markers and of a face.

    Parameters
    ----------
    rig
        The face.
    layout
        What the markers are.
    """

    def __init__(self, rig: Rig, layout: Layout) -> None:
        self._rig = rig
        self._markers = {
            marker.feature_point: marker.name
            for marker in layout.markers
            if marker.feature_point is not None
            and marker.role == "face"
            and marker.feature_point in rig.mesh.feature_points
        }
        chosen = [self._choose_points(pairs) for pairs in (_LIPS, _CORNERS, _CHIN, _OUTER_LIPS)]
        self._points = tuple(dict.fromkeys(point for pair in chosen for point in pair))
        self._columns = [[self._points.index(point) for point in pair] for pair in chosen]
        self._vertices = np.array([rig.mesh.get_feature_point(point) for point in self._points])

    def _choose_points(self, choices: tuple[tuple[str, ...], ...]) -> tuple[str, ...]:
        for points in choices:
            if all(point in self._markers for point in points):
                return points
        raise DataError(
            "the markers lack a feature point that shows the mouth",
            expected=" or ".join(", ".join(points) for points in choices),
        )

    def find_rotations(
        self, corpus: Corpus, still: Mapping[str, MarkerTracks]
    ) -> dict[tuple[str, str], FloatArray]:
        """Find the rotation from each session's axes to those of the face, ``(3, 3)``."""
        names = list(self._markers.values())
        vertices = [self._rig.mesh.get_feature_point(point) for point in self._markers]
        goals = self._rig.mesh.vertices[vertices]
        rotations: dict[tuple[str, str], FloatArray] = {}
        for utterance in corpus:
            if _get_session(utterance) in rotations:
                continue
            tracks = still[utterance.id]
            positions = tracks.positions[:, tracks.indices(names)]
            mean = average(positions.transpose(1, 2, 0))
            rotations[_get_session(utterance)] = estimate_similarity_transform(mean, goals)[1]
        return rotations

    def measure_markers(self, tracks: MarkerTracks, rotation: FloatArray) -> FloatArray:
        """Measure the mouth, ``(frames, measures)``, in the unit of the markers."""
        names = [self._markers[point] for point in self._points]
        return self._measure(tracks.positions[:, tracks.indices(names)] @ rotation.T)

    def measure_face(self, values: FloatArray) -> FloatArray:
        """Measure the mouth of the face, ``(frames, measures)``, millimetres; NaN where missing."""
        return self._measure(deform_points(self._rig, self._vertices, values))

    def _measure(self, points: FloatArray) -> FloatArray:
        lips, corners, chin, outer = self._columns
        return np.stack(
            [
                points[:, lips[0], 1] - points[:, lips[1], 1],
                points[:, corners[0], 0] - points[:, corners[1], 0],
                points[:, chin[0], 1],
                points[:, outer, 2].mean(axis=1),
            ],
            axis=1,
        )
