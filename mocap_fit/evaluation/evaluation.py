"""Control models scored on held-out utterances: Table 2 of Beskow, with confidence intervals."""

from __future__ import annotations

import dataclasses
import html
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mocap_fit.control import ControlModel
from mocap_fit.corpus import Corpus
from mocap_fit.errors import DataError
from mocap_fit.evaluation.closure import (
    CLOSED_PART,
    LipGaps,
    LipScores,
    concatenate_gaps,
    measure_gaps,
)
from mocap_fit.evaluation.measures import (
    DEFINITIONS,
    GROUP_LABELS,
    GROUPS,
    SUMS,
    Difference,
    average,
    compute_interval,
    compute_p_value,
    compute_scores,
    draw_resamples,
    mark_groups,
    sum_utterance,
)
from mocap_fit.evaluation.tables import (
    LIP_COLUMNS,
    MARK,
    MARK_EXPLAINED,
    format_html,
    format_lips,
    format_text,
    format_value,
)
from mocap_fit.face import Rig, load_face
from mocap_fit.processes import limit_to_one_thread
from mocap_fit.tracks import FloatArray

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

RESAMPLES = 2000


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """Scores of models on a corpus; `mocap_fit.evaluation.measures` defines them.

    Parameters
    ----------
    models, parameters
        Names, in order.
    utterances
        Number of utterances that were scored.
    frames
        Number of frames of each of `GROUPS`.
    ranges
        Ranges of the targets, ``(parameters,)``, in the unit of each parameter.
    rmse
        ``(models, groups, parameters)``, per cent of the range.
    correlation
        ``(models, groups, parameters)``, -1 to 1.
    rmse_samples
        RMSE of bootstrap samples of the utterances, ``(resamples, models, groups, parameters)``,
        per cent of the range.
    correlation_samples
        Correlation of the same samples, ``(resamples, models, groups, parameters)``, -1 to 1.
    parameter_counts
        Number of free parameters of each model.
    lips
        Whether the lips meet where they should, by model, and of the ``target``; empty where the
        face is not known.
    seed
        Seed of the bootstrap.
    stopped_by_test
        Models whose training stopped by the test set (``protocol`` in `trained_on_` is
        ``paper``): scores on that set are too good.
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
    lips: dict[str, LipScores]
    seed: int
    stopped_by_test: tuple[str, ...] = ()

    def __repr__(self) -> str:
        best = self.rank_models()[0]
        return (
            f"Evaluation of {len(self.models)} models on {self.utterances} utterances, "
            f"{self.frames[0]} frames of speech; the least error has '{best}'"
        )

    def __str__(self) -> str:
        return "\n".join([format_text(*self.to_rows(GROUPS[:1])), *self.notes])

    def _repr_html_(self) -> str:
        notes = "".join(f"<p>{html.escape(note)}</p>" for note in self.notes)
        return f"<div>{format_html(*self.to_rows())}{notes}</div>"

    @property
    def notes(self) -> tuple[str, ...]:
        """What the marks in the tables mean; empty where there are none."""
        return (MARK_EXPLAINED,) if self.stopped_by_test else ()

    def mark(self, name: str) -> str:
        """Mark the name of a model whose training stopped by the test set.

        Parameters
        ----------
        name
            Of any model.

        Returns
        -------
        str
            The name, with an asterisk where its scores are too good.
        """
        return name + MARK * (name in self.stopped_by_test)

    def equals(self, other: object) -> bool:
        """Return whether another evaluation has the same scores and samples.

        Parameters
        ----------
        other
            Anything.

        Returns
        -------
        bool
            NaN counts as equal to NaN.
        """
        if not isinstance(other, Evaluation):
            return False
        pairs = [
            (getattr(self, field.name), getattr(other, field.name))
            for field in dataclasses.fields(self)
            if field.name != "lips"
        ]
        # As text, in which NaN is equal to NaN.
        return repr(self.lips) == repr(other.lips) and all(
            np.array_equal(a, b, equal_nan=isinstance(a, (np.ndarray, list))) for a, b in pairs
        )

    def compute_averages(self, measure: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Average a measure over the parameters.

        Parameters
        ----------
        measure
            ``rmse`` or ``correlation``.

        Returns
        -------
        values, low, high
            Averages and their 95 % intervals, ``(models, groups)``, per cent of the range, or -1
            to 1.
        """
        low, high = compute_interval(average(getattr(self, f"{measure}_samples")))
        return average(getattr(self, measure)), low, high

    def compare(self, first: str, second: str, group: str = "all") -> Difference:
        """Compare the average RMSE of two models, paired by utterance.

        Parameters
        ----------
        first, second
            Names of the models.
        group
            One of `GROUPS`.

        Returns
        -------
        Difference
            The first less the second.

        Raises
        ------
        DataError
            If a model was not scored.
        """
        i, j, g = self._find_model(first), self._find_model(second), GROUPS.index(group)
        values = average(self.rmse)[:, g]
        samples = average(self.rmse_samples)[:, :, g]
        apart = samples[:, i] - samples[:, j]
        low, high = map(float, compute_interval(apart))
        value, p = float(values[i] - values[j]), compute_p_value(apart)
        return Difference(first, second, group, value, low, high, p)

    def _find_model(self, name: str) -> int:
        if name not in self.models:
            raise DataError(
                f"the model '{name}' was not scored", expected=f"one of {', '.join(self.models)}"
            )
        return self.models.index(name)

    def rank_models(self) -> tuple[str, ...]:
        """Rank the models by their average error over all phones.

        Returns
        -------
        tuple[str, ...]
            Their names, the least error first.
        """
        order = np.argsort(average(self.rmse)[:, 0], kind="stable")
        return tuple(self.models[i] for i in order)

    def plot(self, measure: str = "rmse", ax: Axes | None = None) -> Axes:
        """Plot the average of a measure for every model, with 95 % intervals.

        Parameters
        ----------
        measure
            ``rmse`` or ``correlation``.
        ax
            The axes to draw into; by default those of a new figure.

        Returns
        -------
        matplotlib.axes.Axes
            A row a model, the best on top; a point for each group of phones.
        """
        from mocap_fit.drawing import create_axes, write_plainly
        from mocap_fit.evaluation.figures import draw_scores

        axes = create_axes((6.4, 1.5 + 0.42 * len(self.models))) if ax is None else ax
        with write_plainly():
            draw_scores(axes, self, measure)
            axes.legend()
        for tick in axes.get_yticklabels():
            tick.set_parse_math(False)
        return axes

    def to_rows(self, groups: Sequence[str] = GROUPS) -> tuple[list[str], list[list[str]]]:
        """Convert the scores to the cells of a table (Table 2 of Beskow).

        Parameters
        ----------
        groups
            The groups of frames that are shown, some of `GROUPS`.

        Returns
        -------
        header
            Names of the columns.
        rows
            A row a model, the best first.
        """
        header = ["model", "free parameters"]
        for group in groups:
            suffix = "" if len(groups) == 1 else f", {GROUP_LABELS[group]}"
            header += [f"RMSE %{suffix}", f"r{suffix}"]
        rmse, correlation = self.compute_averages("rmse"), self.compute_averages("correlation")
        rows = []
        for name in self.rank_models():
            i = self.models.index(name)
            row = [self.mark(name), str(self.parameter_counts[i])]
            for g in map(GROUPS.index, groups):
                row.append(format_value([float(part[i, g]) for part in rmse], 2))
                row.append(format_value([float(part[i, g]) for part in correlation], 3))
            rows.append([*row, *format_lips(self.lips[name])] if self.lips else row)
        return [*header, *LIP_COLUMNS] if self.lips else header, rows

    def to_difference_rows(self) -> tuple[list[str], list[list[str]]]:
        """Convert the differences of all pairs of models to the cells of a table.

        Returns
        -------
        header
            Names of the columns.
        rows
            A row a pair, in the order of their errors.
        """
        order = self.rank_models()
        rows = []
        for i, first in enumerate(order):
            for second in order[i + 1 :]:
                apart = self.compare(first, second)
                interval = f"[{apart.low:+.3f}, {apart.high:+.3f}]"
                names = [self.mark(first), self.mark(second)]
                rows.append([*names, f"{apart.value:+.3f}", interval, f"{apart.p:.3f}"])
        return ["first", "second", "difference (%)", "95 % interval", "p"], rows

    def to_frame(self) -> pd.DataFrame:
        """Convert the scores to a table with one row a model, group, parameter and measure.

        Returns
        -------
        DataFrame
            With the 95 % interval. The parameter ``average`` is the mean over all.
        """
        import pandas as pd

        parameters = (*self.parameters, "average")
        names = ["model", "group", "parameter"]
        index = pd.MultiIndex.from_product([self.models, GROUPS, parameters], names=names)
        tables = []
        for measure in ("rmse", "correlation"):
            values, samples = getattr(self, measure), getattr(self, f"{measure}_samples")
            values = np.concatenate([values, average(values)[..., None]], axis=-1)
            samples = np.concatenate([samples, average(samples)[..., None]], axis=-1)
            low, high = compute_interval(samples)
            numbers = {"value": values.ravel(), "low": low.ravel(), "high": high.ravel()}
            name = "rmse_percent" if measure == "rmse" else measure
            tables.append(pd.DataFrame({"measure": name, **numbers}, index).reset_index())
        return pd.concat(tables, ignore_index=True)

    def to_dict(self) -> dict[str, Any]:
        """Convert everything but the bootstrap samples to values that JSON can hold.

        Returns
        -------
        dict[str, Any]
            Definitions, counts, scores and differences.
        """
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
                    "stopped_by_test_set": name in self.stopped_by_test,
                }
                for i, name in enumerate(names)
            },
            "notes": list(self.notes),
            "lips": {name: scores.to_dict() for name, scores in self.lips.items()},
            "scores": self.to_frame().to_dict("records"),
            "differences": [
                dataclasses.asdict(self.compare(a, b, group)) for group in GROUPS for a, b in pairs
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
        Utterances that none of the models has seen.
    models
        Trained models by the names that tables and figures give them.
    face
        For the closure of the lips: a face, its name, or None to leave that out. It is left out
        too where the corpus has other parameters than the face.
    resamples
        Number of bootstrap samples of the utterances.
    seed
        Seed of the bootstrap.
    progress
        Called after each utterance.

    Returns
    -------
    Evaluation
        Errors, correlations, their confidence intervals, and lip closure.

    Raises
    ------
    DataError
        If there is nothing to score, or a model has other parameters than the corpus.

    See Also
    --------
    open_corpus : Open the corpus that ``mocap-fit convert`` wrote.
    control.create : Create a control model.
    mocap_fit.evaluation.evaluate_landmarks : Compare predicted faces with the markers.

    Examples
    --------
    Phone means of one half of a sentence, scored on the other half:

    >>> import mocap_fit as mf
    >>> from mocap_fit.control.rule_based import RuleBased
    >>> from mocap_fit.corpus import Corpus, Utterance
    >>> phones = mf.read_phones(mf.load_sample("take_01.TextGrid"), phone_set="sv-sta")
    >>> tracks = mf.synthesise(phones, RuleBased().prepare("sv-sta"))
    >>> halves = [tracks.between(0.0, 1.6), tracks.between(1.6, 3.1)]
    >>> train, test = (
    ...     Corpus.from_utterances([Utterance.from_tracks(half, phones, id="half")], "sv-sta")
    ...     for half in halves
    ... )
    >>> model = mf.control.create("phone-mean").fit(train)
    >>> scores = mf.evaluate(test, {"phone means": model})
    >>> scores
    Evaluation of 1 models on 1 utterances, ... frames of speech; the least error has 'phone means'
    >>> print(scores)
    model        free parameters  RMSE %  ...
    phone means  ...
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
    # The range of all utterances is needed before the first is scored.
    takes = [(utterance.read_tracks(), utterance.read_phones()) for utterance in corpus]
    marked = [mark_groups(phones, corpus.phone_set, tracks.times) for tracks, phones in takes]
    speech = np.concatenate(
        [tracks.values[groups[0]] for (tracks, _), groups in zip(takes, marked, strict=True)]
    )
    if not len(speech):
        raise DataError("no frame of the corpus lies in a phone that is speech")
    low = np.min(np.where(np.isfinite(speech), speech, np.inf), axis=0)
    high = np.max(np.where(np.isfinite(speech), speech, -np.inf), axis=0)
    centre = np.where(np.isfinite(low) & np.isfinite(high), 0.5 * (low + high), 0.0)
    ranges = np.where(high > low, high - low, 0.0)
    sums = np.zeros((len(corpus), len(models), len(GROUPS), len(corpus.parameter_names), SUMS))
    gaps: dict[str, list[LipGaps]] = {name: [] for name in ("target", *models)}
    with limit_to_one_thread():
        for u, ((tracks, phones), groups) in enumerate(zip(takes, marked, strict=True)):
            times, values = tracks.times, {"target": tracks.values}
            for m, (name, model) in enumerate(models.items()):
                values[name] = model.predict_at(phones, times)
                sums[u, m] = sum_utterance(tracks.values, values[name], groups, centre)
            if rig is not None:
                for name, each in values.items():
                    gaps[name].append(measure_gaps(rig, each, times, phones, corpus.phone_set))
            if progress is not None:
                progress()
        rmse, correlation = compute_scores(sums.sum(axis=0), ranges)
        counts = draw_resamples(len(corpus), resamples, seed)
        samples = (counts @ sums.reshape(len(corpus), -1)).reshape(resamples, *sums.shape[1:])
    rmse_samples, correlation_samples = compute_scores(samples, ranges)
    joined = {name: concatenate_gaps(parts) for name, parts in gaps.items()}
    target = joined["target"]
    limits = CLOSED_PART * target.compute_open_gap(), target.compute_contact()
    lips = {name: part.score(*limits) for name, part in joined.items()}
    return Evaluation(
        tuple(models),
        corpus.parameter_names,
        len(corpus),
        tuple(int(n) for n in sum(groups.sum(axis=1) for groups in marked)),
        ranges,
        rmse,
        correlation,
        rmse_samples,
        correlation_samples,
        tuple(model.parameter_count for model in models.values()),
        {} if rig is None else lips,
        seed,
        tuple(n for n, model in models.items() if model.trained_on_.get("protocol") == "paper"),
    )
