"""Figures of an evaluation: scores, and figures 2, 4 and 5 of Beskow.

Figure 2 is the dominance functions of a Cohen-Massaro model, figure 4 what looking ahead is worth,
figure 5 the trajectories of several models.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mocap_fit.drawing import CYCLE, GREY, INK, PALE, create_figure, write_title
from mocap_fit.evaluation.evaluation import Evaluation
from mocap_fit.evaluation.measures import GROUPS
from mocap_fit.phones import PhoneSequence
from mocap_fit.tracks import FloatArray, ParameterTracks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mocap_fit.control.cohen_massaro import CohenMassaro

_LABELS = {"all": "all but silence", "vowels": "vowels", "consonants": "consonants"}


def spoken(name: str) -> str:
    """The name of a parameter or model, as people say it."""
    return name.replace("_", " ")


def score_figure(evaluation: Evaluation) -> Figure:
    """Average error and correlation of every model, with 95 % intervals, by group of phones."""
    order = [evaluation.models.index(name) for name in reversed(evaluation.ranking())]
    names = [evaluation.models[i] for i in order]
    size = (9.0, 1.5 + 0.42 * len(names))
    figure, axes = create_figure(size, 1, 2, sharey=True)
    titles = {"rmse": "RMSE (% of the range; less is better)", "correlation": "correlation"}
    for axis, (measure, title) in zip(axes[0], titles.items(), strict=True):
        values, low, high = evaluation.averages(measure)
        for g, group in enumerate(GROUPS):
            places = np.arange(len(order)) + 0.22 * (1 - g)
            value = values[order, g]
            bars = np.abs(np.stack([value - low[order, g], high[order, g] - value]))
            axis.errorbar(
                value,
                places,
                xerr=bars,
                fmt="o",
                ms=4.5 if g == 0 else 3,
                lw=1.4 if g == 0 else 0.9,
                color=(INK, CYCLE[0], CYCLE[1])[g],
                label=_LABELS[group],
            )
        axis.set_title(title)
        axis.grid(axis="x")
    axes[0, 0].set_yticks(np.arange(len(order)), names)
    axes[0, 0].set_ylim(-0.6, len(order) - 0.4)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    write_title(figure, f"{evaluation.utterances} held-out utterances, 95 % intervals")
    return figure


def parameter_figure(evaluation: Evaluation) -> Figure:
    """Error of every parameter by every model, over all but silence: a table with colours."""
    order = [evaluation.models.index(name) for name in evaluation.ranking()]
    values = evaluation.rmse[order, 0]
    rows, columns = values.shape
    figure, axes = create_figure((1.6 + 0.85 * columns, 1.9 + 0.34 * rows))
    axis = axes[0, 0]
    known = values[np.isfinite(values)]
    top = float(known.max()) if known.size else 1.0
    axis.imshow(values, cmap="YlOrBr", vmin=0.0, vmax=1.15 * top, aspect="auto")
    for i in range(rows):
        for j in range(columns):
            if np.isfinite(values[i, j]):
                axis.text(
                    j, i, f"{values[i, j]:.1f}", ha="center", va="center", color=INK, fontsize=8
                )
    words = [spoken(name).replace(" ", "\n", 1) for name in evaluation.parameters]
    axis.set_xticks(range(columns), words, rotation=35, ha="right", rotation_mode="anchor")
    axis.set_yticks(range(rows), [evaluation.models[i] for i in order])
    axis.tick_params(length=0)
    axis.spines[:].set_visible(False)
    write_title(figure, "RMSE of each parameter (% of its range, all but silence)")
    return figure


def trajectory_figure(
    target: ParameterTracks,
    predictions: Mapping[str, FloatArray],
    phones: PhoneSequence,
    parameter: str,
    text: str = "",
) -> Figure:
    """Target and predicted trajectories of one parameter over the phones (Figure 5).

    Parameters
    ----------
    target
        Of the utterance.
    predictions
        By model, `(frames, parameters)` each, at the times of the target.
    phones
        Of the utterance, on the same clock.
    parameter
        Which one is drawn.
    text
        What is said, for the title.
    """
    column = target.index(parameter)
    times = target.times
    every = np.stack([target.values, *predictions.values()])[:, :, column]
    low, high = float(np.nanmin(every)), float(np.nanmax(every))
    margin = 0.06 * max(high - low, 1e-3)
    rows = len(predictions)
    figure, axes = create_figure(
        (10.0, 1.25 * rows + 1.3),
        rows + 1,
        1,
        sharex=True,
        height_ratios=[1.0] * rows + [0.28],
    )
    for i, (name, values) in enumerate(predictions.items()):
        axis: Axes = axes[i, 0]
        axis.plot(times, target.values[:, column], color=GREY, lw=2.6, alpha=0.6, label="target")
        axis.plot(times, values[:, column], color=CYCLE[i % len(CYCLE)], lw=1.3)
        axis.set_title(name, pad=3)
        axis.set_ylim(low - margin, high + margin)
        for segment in phones:
            axis.axvline(segment.start, color=PALE, lw=0.6, zorder=0)
    phone_strip(axes[rows, 0], phones)
    axes[rows, 0].set_xlim(times[0], times[-1])
    axes[rows, 0].set_xlabel("time (s)")
    figure.supylabel(f"{spoken(parameter)} (grey: target)", fontsize=9)
    write_title(figure, f"{target.name}: {text}" if text else target.name)
    return figure


def phone_strip(axis: Axes, phones: PhoneSequence) -> None:
    """Write the phones over time into a low panel."""
    for segment in phones:
        axis.axvspan(segment.start, segment.end, facecolor="white", edgecolor=PALE, lw=0.6)
        axis.text(
            segment.centre,
            0.5,
            segment.phone,
            ha="center",
            va="center",
            fontsize=7,
            clip_on=True,
            parse_math=False,
        )
    axis.set_ylim(0, 1)
    axis.set_yticks([])
    axis.spines["left"].set_visible(False)


def dominance_figure(
    model: CohenMassaro, target: ParameterTracks, phones: PhoneSequence, parameter: str
) -> Figure:
    """Dominance functions of a Cohen-Massaro model, and the trajectory they make (Figure 2).

    Parameters
    ----------
    model
        A trained one.
    target
        Of the utterance.
    phones
        Of the utterance, 100 segments at most.
    parameter
        Which one is drawn.
    """
    times = target.times
    fine = np.linspace(times[0], times[-1], 4 * len(times))
    dominances = model.compute_dominances(phones, fine, parameter)
    column = target.index(parameter)
    figure, axes = create_figure((10.0, 4.6), 3, 1, sharex=True, height_ratios=[1.0, 1.0, 0.2])
    above, below, strip = axes[:, 0]
    for i in range(len(phones)):
        colour = CYCLE[i % len(CYCLE)]
        above.plot(fine, dominances[:, i], color=colour, lw=1.2)
        above.fill_between(fine, dominances[:, i], color=colour, alpha=0.08, lw=0)
    above.set_yscale("log")
    above.set_ylim(max(1e-4 * float(dominances.max()), 1e-300), 1.5 * float(dominances.max()))
    above.set_title("dominance of each phone (part of the largest)", pad=3)
    below.plot(times, target.values[:, column], color=GREY, lw=2.6, alpha=0.6, label="target")
    below.plot(fine, model.predict_at(phones, fine)[:, column], color=INK, lw=1.3, label="model")
    below.set_title(spoken(parameter), pad=3)
    below.legend(loc="upper right", ncols=2)
    for segment in phones:
        for axis in (above, below):
            axis.axvline(segment.start, color=PALE, lw=0.6, zorder=0)
    phone_strip(strip, phones)
    strip.set_xlim(times[0], times[-1])
    strip.set_xlabel("time (s)")
    write_title(figure, f"{model.title}: dominance functions, {target.name}")
    return figure


def look_ahead_figure(
    look_ahead: Sequence[float], errors: Sequence[float], baseline: float | None = None
) -> Figure:
    """Error of networks with more and more look-ahead (Figure 4).

    Parameters
    ----------
    look_ahead
        Seconds.
    errors
        Root mean square errors on held-out sentences, in the unit of the parameters.
    baseline
        The same for what the networks must beat; None where it was not measured.
    """
    figure, axes = create_figure((6.4, 3.8))
    axis = axes[0, 0]
    milliseconds = 1000.0 * np.asarray(look_ahead)
    axis.plot(milliseconds, errors, "o-", color=CYCLE[0], ms=4, label="networks")
    if baseline is not None:
        axis.axhline(baseline, color=GREY, lw=1.0, ls="--", label="phone means")
        axis.legend()
    axis.set_xlabel("look-ahead (ms)")
    axis.set_ylabel("error on held-out sentences")
    axis.grid(axis="y")
    write_title(figure, "What looking ahead is worth (total context 31 frames)")
    return figure


def training_figure(log: Sequence[Any], title: str) -> Figure:
    """Error by iteration, of the training part and of what is held out.

    Parameters
    ----------
    log
        `mocap_fit.control.LogEntry` each.
    title
        Of the figure.
    """
    parts = list(dict.fromkeys(entry.part for entry in log))
    figure, axes = create_figure((7.0, 4.0))
    axis = axes[0, 0]
    for i, part in enumerate(parts):
        own = [entry for entry in log if entry.part == part]
        colour = CYCLE[i % len(CYCLE)]
        steps = [entry.iteration for entry in own]
        axis.plot(steps, [e.training_error for e in own], color=colour, lw=1.0, alpha=0.55)
        held = [(e.iteration, e.validation_error) for e in own if e.validation_error is not None]
        if held:
            axis.plot(*zip(*held, strict=True), color=colour, lw=1.6, label=spoken(part))
        else:
            axis.plot([], [], color=colour, lw=1.0, label=spoken(part))
    axis.set_xlabel("iteration")
    axis.set_ylabel("root mean square error")
    axis.set_yscale("log")
    axis.grid(axis="y")
    if any(parts):
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    write_title(figure, f"{title} (pale: training part)")
    return figure
