"""Control models scored on held-out utterances: Table 2 of Beskow, with confidence intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mocap_fit.control import ControlModel
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import DataError
from mocap_fit.evaluation.closure import Gaps, segment_gaps, together
from mocap_fit.evaluation.measures import (
    DEFINITIONS,
    GROUPS,
    SUMS,
    average,
    frame_groups,
    interval,
    resample_counts,
    scores,
    two_sided_p,
    utterance_sums,
)
from mocap_fit.face import Rig, load_face
from mocap_fit.tracks import FloatArray

if TYPE_CHECKING:
    import pandas as pd

RESAMPLES = 2000


@dataclass(frozen=True)
class Difference:
    """The first model's average error less the second's, per cent of the range, paired.

    Parameters
    ----------
    first, second
        Names of the models.
    group
        Of the frames.
    value, low, high
        The difference and its 95 % interval.
    p
        `two_sided_p` of it.
    """

    first: str
    second: str
    group: str
    value: float
    low: float
    high: float
    p: float


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What came of scoring models on a corpus; `mocap_fit.evaluation.measures` defines it.

    Parameters
    ----------
    models, parameters
        Names, in order.
    utterances, frames
        How many were scored; frames of each of `GROUPS`.
    ranges
        `(parameters,)`, of the targets.
    rmse, correlation
        `(models, groups, parameters)`; RMSE in per cent of the range.
    rmse_samples, correlation_samples
        `(resamples, models, groups, parameters)`: the same for bootstrap samples of the utterances.
    parameter_counts
        Free parameters of each model.
    closed
        Part of the bilabials whose lips close, by model, and ``target``; empty where the face is
        not known.
    bilabials
        How many bilabials there were.
    seed
        Of the bootstrap.
    """

    models: tuple[str, ...]
    parameters: tuple[str, ...]
    utterances: int
    frames: tuple[int, ...]
    ranges: FloatArray
    rmse: FloatArray
    correlation: FloatArray
    rmse_samples: FloatArray
    correlation_samples: FloatArray
    parameter_counts: tuple[int, ...]
    closed: dict[str, float]
    bilabials: int
    seed: int

    def averages(self, measure: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Averages over the parameters and their 95 % intervals, `(models, groups)` each.

        Parameters
        ----------
        measure
            ``rmse`` or ``correlation``.
        """
        low, high = interval(average(getattr(self, f"{measure}_samples")))
        return average(getattr(self, measure)), low, high

    def difference(self, first: str, second: str, group: str = "all") -> Difference:
        """The paired difference of two models' average RMSE."""
        i, j, g = self._model(first), self._model(second), GROUPS.index(group)
        values = average(self.rmse)[:, g]
        samples = average(self.rmse_samples)[:, :, g]
        apart = samples[:, i] - samples[:, j]
        low, high = interval(apart)
        return Difference(
            first,
            second,
            group,
            float(values[i] - values[j]),
            float(low),
            float(high),
            two_sided_p(apart),
        )

    def _model(self, name: str) -> int:
        if name not in self.models:
            raise DataError(
                f"the model '{name}' was not scored", expected=f"one of {', '.join(self.models)}"
            )
        return self.models.index(name)

    def ranking(self) -> tuple[str, ...]:
        """The models, the least average error over all phones first."""
        order = np.argsort(average(self.rmse)[:, 0], kind="stable")
        return tuple(self.models[i] for i in order)

    def to_frame(self) -> pd.DataFrame:
        """One row a model, group, parameter and measure, with the 95 % interval.

        The parameter ``average`` is the mean over all.
        """
        import pandas as pd

        rows: list[dict[str, Any]] = []
        for measure in ("rmse", "correlation"):
            values, samples = getattr(self, measure), getattr(self, f"{measure}_samples")
            values = np.concatenate([values, average(values)[..., None]], axis=-1)
            low, high = interval(np.concatenate([samples, average(samples)[..., None]], axis=-1))
            for i, model in enumerate(self.models):
                for g, group in enumerate(GROUPS):
                    for p, parameter in enumerate((*self.parameters, "average")):
                        rows.append(
                            {
                                "model": model,
                                "group": group,
                                "parameter": parameter,
                                "measure": "rmse_percent" if measure == "rmse" else measure,
                                "value": values[i, g, p],
                                "low": low[i, g, p],
                                "high": high[i, g, p],
                            }
                        )
        return pd.DataFrame(rows)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the bootstrap samples, as values that JSON can hold."""
        names = list(self.models)
        pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
        return {
            "definitions": DEFINITIONS,
            "utterances": self.utterances,
            "frames": dict(zip(GROUPS, self.frames, strict=True)),
            "ranges": dict(zip(self.parameters, self.ranges.tolist(), strict=True)),
            "resamples": len(self.rmse_samples),
            "seed": self.seed,
            "models": {
                name: {
                    "free_parameters": self.parameter_counts[i],
                    "bilabials_closed": self.closed.get(name),
                }
                for i, name in enumerate(names)
            },
            "bilabials": self.bilabials,
            "bilabials_closed_in_target": self.closed.get("target"),
            "scores": self.to_frame().to_dict("records"),
            "differences": [
                self.difference(a, b, group).__dict__ for group in GROUPS for a, b in pairs
            ],
        }


def evaluate(
    corpus: Corpus,
    models: Mapping[str, ControlModel],
    *,
    face: str | Rig | None = "built-in",
    resamples: int = RESAMPLES,
    seed: int = 0,
    progress: Callable[[], object] | None = None,
) -> Evaluation:
    """Score control models on a corpus, such as the test split of one.

    Parameters
    ----------
    corpus
        What is predicted; none of the models has seen it.
    models
        Trained models by the names that tables and figures give them.
    face
        For the closure of the lips: a face, its name, or None to leave that out. It is left out
        too where the corpus has other parameters than the face.
    resamples, seed
        Of the bootstrap over utterances.
    progress
        Called after each utterance.

    Raises
    ------
    DataError
        If there is nothing to score, or a model has other parameters than the corpus.
    """
    if not models or not len(corpus):
        raise DataError(
            "there is nothing to score", found=f"{len(models)} models, {len(corpus)} utterances"
        )
    for name, model in models.items():
        if getattr(model, "parameter_names_", None) != corpus.parameter_names:
            raise DataError(
                f"the model '{name}' does not predict the parameters of the corpus",
                found=", ".join(getattr(model, "parameter_names_", ())) or "a model not trained",
                expected=", ".join(corpus.parameter_names),
            )
    rig = load_face(face) if isinstance(face, str) else face
    if rig is not None and rig.parameter_names != corpus.parameter_names:
        rig = None
    low, high, centre, frames = _extent(corpus)
    ranges = np.where(high > low, high - low, 0.0)
    count = len(corpus.parameter_names)
    sums = np.zeros((len(corpus), len(models), len(GROUPS), count, SUMS))
    gaps: dict[str, list[Gaps]] = {name: [] for name in ("target", *models)}
    for u, utterance in enumerate(corpus):
        tracks, phones = utterance.read_tracks(), utterance.read_phones()
        groups = frame_groups(phones, corpus.phone_set, tracks.times)
        predicted = {name: m.predict_at(phones, tracks.times) for name, m in models.items()}
        for i, values in enumerate(predicted.values()):
            sums[u, i] = utterance_sums(tracks.values, values, groups, centre)
        if rig is not None:
            for name, values in {"target": tracks.values, **predicted}.items():
                gaps[name].append(segment_gaps(rig, values, tracks.times, phones, corpus.phone_set))
        if progress is not None:
            progress()
    rmse, correlation = scores(sums.sum(axis=0), ranges)
    drawn = resample_counts(len(corpus), resamples, seed)
    samples = (drawn @ sums.reshape(len(corpus), -1)).reshape(resamples, *sums.shape[1:])
    rmse_samples, correlation_samples = scores(samples, ranges)
    whole = {name: together(parts) for name, parts in gaps.items()}
    open_gap = whole["target"].open_gap()
    return Evaluation(
        tuple(models),
        corpus.parameter_names,
        len(corpus),
        frames,
        ranges,
        rmse,
        correlation,
        rmse_samples,
        correlation_samples,
        tuple(model.parameter_count for model in models.values()),
        {} if rig is None else {name: part.closed(open_gap) for name, part in whole.items()},
        int(whole["target"].bilabials.size),
        seed,
    )


def _extent(corpus: Corpus) -> tuple[FloatArray, FloatArray, FloatArray, tuple[int, ...]]:
    """Least, largest and middle target value of each parameter; frames of each group."""
    count = len(corpus.parameter_names)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    frames = np.zeros(len(GROUPS), dtype=np.int64)
    for utterance in corpus:
        values, groups = _scored(corpus, utterance)
        frames += groups.sum(axis=1)
        speech = values[groups[0]]
        low = np.minimum(
            low, np.min(np.where(np.isfinite(speech), speech, np.inf), 0, initial=np.inf)
        )
        high = np.maximum(
            high, np.max(np.where(np.isfinite(speech), speech, -np.inf), 0, initial=-np.inf)
        )
    if not frames[0]:
        raise DataError("no frame of the corpus lies in a phone that is speech")
    centre = np.where(np.isfinite(low) & np.isfinite(high), 0.5 * (low + high), 0.0)
    return low, high, centre, tuple(int(n) for n in frames)


def _scored(corpus: Corpus, utterance: Utterance) -> tuple[FloatArray, Any]:
    tracks = utterance.read_tracks()
    return tracks.values, frame_groups(utterance.read_phones(), corpus.phone_set, tracks.times)
