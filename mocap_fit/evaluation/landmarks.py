"""Predicted faces beside the markers themselves: correlation of what a lip-reader sees.

The other scores compare with fitted parameters; these compare with what was measured, and so
count what the fit has lost as well. Four measures of the mouth are taken from the predicted face
and from the recorded markers: how far the inner lips are apart, how far the corners, how high the
chin is, and how far the lips stand out. Of each utterance the mean over all its frames is taken
from both (a video's scale drifts, and a face that rests differently is no error), and Pearson's
correlation is over the frames of all utterances that are not silent.

Markers are brought to the axes of the face by their head markers and by the mean places of their
feature points alone, without the fit.
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
    frame_groups,
    interval,
    resample_counts,
    scores,
    utterance_sums,
)
from mocap_fit.face import Rig, load_face
from mocap_fit.face.rig import evaluate as evaluate_rig
from mocap_fit.fitting import Layout, load_layout
from mocap_fit.head import match_size, remove_head_motion
from mocap_fit.tracks import FloatArray, MarkerTracks, estimate_similarity_transform

MEASURES = ("lip opening", "mouth width", "chin height", "lip protrusion")
#: The row of the fitted tracks themselves: what a model could reach through the fit.
FITTED = "fitted tracks"
# Feature points of each measure; the second choice where a layout lacks the first.
_LIPS = (("2.2", "2.3"), ("8.1", "8.2"))
_CORNERS = (("8.3", "8.4"), ("2.4", "2.5"))
_CHIN = (("2.1",), ("2.10",))
_OUTER_LIPS = (("8.1", "8.2"), ("2.2", "2.3"))


@dataclass(frozen=True, eq=False)
class LandmarkScores:
    """Correlations with the markers.

    Parameters
    ----------
    models
        Names; `FITTED` is the first.
    correlation
        `(models, measures)`, in the order of `MEASURES`.
    low, high
        95 % interval of the mean over the measures, `(models,)`, by bootstrap over utterances.
    utterances, frames
        How many were compared.
    """

    models: tuple[str, ...]
    correlation: FloatArray
    low: FloatArray
    high: FloatArray
    utterances: int
    frames: int

    @property
    def mean(self) -> FloatArray:
        """Mean over the measures, `(models,)`."""
        return average(self.correlation)


def landmark_scores(
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
        By name.
    face
        What the parameters move.
    layout
        What the markers are; the corpus's own where not given.
    resamples, seed
        Of the bootstrap.
    progress
        Called after each utterance.

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
    known = layout if isinstance(layout, Layout) else load_layout(layout or corpus.layout)
    mouth = _Mouth(rig, known)
    still = {u.id: _still(u, known, _first_of(corpus, u)) for u in corpus}
    turned = mouth.orientations(corpus, still)
    names = (FITTED, *models)
    sums = np.zeros((len(corpus), len(names), 1, len(MEASURES), SUMS))
    frames = 0
    for i, utterance in enumerate(corpus):
        tracks, phones = utterance.read_tracks(), utterance.read_phones()
        target = mouth.of_markers(still[utterance.id], turned[_place(utterance)])
        speech = frame_groups(phones, corpus.phone_set, tracks.times)[:1]
        fitted = np.asarray(np.isfinite(tracks.values).all(axis=1))
        target = np.where(fitted[:, None], target, np.nan)
        frames += int((speech[0] & np.isfinite(target).all(axis=1)).sum())
        predicted = [
            tracks.values,
            *(model.predict_at(phones, tracks.times) for model in models.values()),
        ]
        for m, values in enumerate(predicted):
            shown = np.where(np.isfinite(target), mouth.of_face(values), np.nan)
            sums[i, m] = utterance_sums(
                target - _mean(target), shown - _mean(shown), speech, np.zeros(len(MEASURES))
            )
        if progress is not None:
            progress()
    ones = np.ones(len(MEASURES))
    drawn = resample_counts(len(corpus), resamples, seed)
    samples = (drawn @ sums.reshape(len(corpus), -1)).reshape(resamples, *sums.shape[1:])
    low, high = interval(average(scores(samples, ones)[1])[:, :, 0])
    correlation = scores(sums.sum(axis=0), ones)[1][:, 0]
    return LandmarkScores(names, correlation, low, high, len(corpus), frames)


def _place(utterance: Utterance) -> tuple[str, str]:
    """Recordings of one speaker and session share their axes."""
    return utterance.speaker, utterance.session


def _first_of(corpus: Corpus, utterance: Utterance) -> Utterance:
    return next(u for u in corpus if _place(u) == _place(utterance))


def _mean(values: FloatArray) -> FloatArray:
    """Mean over the frames that are there, `(measures,)`."""
    return average(values.T)


def _still(utterance: Utterance, layout: Layout, first: Utterance) -> MarkerTracks:
    """The markers without head motion, in the head's place in the session's first recording."""
    names = [marker.name for marker in layout.head_markers]
    shown = first.read_markers()
    whole = shown.visible[:, shown.indices(names)].all(axis=1)
    if not whole.any():
        raise DataError(
            f"no frame of '{first.id}' shows all head markers", expected=", ".join(names)
        )
    frame = int(np.argmax(whole))
    reference = shown.replace(
        positions=shown.positions[frame : frame + 1], origin=shown.origin[frame : frame + 1]
    )
    recording = utterance.read_markers()
    with warnings.catch_warnings():
        # Whoever converted the corpus has been told of frames without a head pose.
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
        chosen = [self._chosen(pairs) for pairs in (_LIPS, _CORNERS, _CHIN, _OUTER_LIPS)]
        self._points = tuple(dict.fromkeys(point for pair in chosen for point in pair))
        self._columns = [[self._points.index(point) for point in pair] for pair in chosen]
        self._vertices = np.array([rig.mesh.get_feature_point(point) for point in self._points])

    def _chosen(self, choices: tuple[tuple[str, ...], ...]) -> tuple[str, ...]:
        for points in choices:
            if all(point in self._markers for point in points):
                return points
        raise DataError(
            "the markers lack a feature point that shows the mouth",
            expected=" or ".join(", ".join(points) for points in choices),
        )

    def orientations(
        self, corpus: Corpus, still: Mapping[str, MarkerTracks]
    ) -> dict[tuple[str, str], FloatArray]:
        """Rotation from each session's axes to those of the face, `(3, 3)`."""
        names = list(self._markers.values())
        vertices = [self._rig.mesh.get_feature_point(point) for point in self._markers]
        goals = self._rig.mesh.vertices[vertices]
        found: dict[tuple[str, str], FloatArray] = {}
        for utterance in corpus:
            if _place(utterance) in found:
                continue
            tracks = still[utterance.id]
            positions = tracks.positions[:, tracks.indices(names)]
            places = average(positions.transpose(1, 2, 0))
            found[_place(utterance)] = estimate_similarity_transform(places, goals)[1]
        return found

    def of_markers(self, tracks: MarkerTracks, rotation: FloatArray) -> FloatArray:
        """`(frames, measures)`, in the unit of the markers."""
        names = [self._markers[point] for point in self._points]
        return self._measured(tracks.positions[:, tracks.indices(names)] @ rotation.T)

    def of_face(self, values: FloatArray) -> FloatArray:
        """`(frames, measures)`, millimetres of the face; NaN where a parameter is."""
        compiled = self._rig.compile(self._vertices)
        places = np.full((len(values), len(self._points), 3), np.nan)
        for i in np.flatnonzero(np.isfinite(values).all(axis=1)):
            if compiled is None:
                places[i] = self._rig.deform(values[i])[self._vertices]
            else:
                places[i] = evaluate_rig(compiled, values[i])
        return self._measured(places)

    def _measured(self, places: FloatArray) -> FloatArray:
        lips, corners, chin, outer = self._columns
        return np.stack(
            [
                places[:, lips[0], 1] - places[:, lips[1], 1],
                places[:, corners[0], 0] - places[:, corners[1], 0],
                places[:, chin[0], 1],
                places[:, outer, 2].mean(axis=1),
            ],
            axis=1,
        )
