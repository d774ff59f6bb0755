"""Figures of an evaluation: scores, and figures 2, 4 and 5 of Beskow.

Figure 2 is the dominance functions of a Cohen-Massaro model, figure 4 what looking ahead is worth,
figure 5 the trajectories of several models.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mocap_fit.drawing import CYCLE, GREY, INK, PALE, create_figure, set_log_scale, write_title
from mocap_fit.evaluation.measures import GROUP_LABELS
from mocap_fit.phones import PhoneSequence
from mocap_fit.tracks import FloatArray, ParameterTracks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mocap_fit.control.cohen_massaro import CohenMassaro
    from mocap_fit.evaluation.evaluation import Evaluation

_TITLES = {"rmse": "RMSE (% of the range; less is better)", "correlation": "correlation"}


def to_words(name: str) -> str:
    """Convert the name of a parameter or model to words.

    Parameters
    ----------
    name
        With underscores.

    Returns
    -------
    str
        With spaces.
    """
    return name.replace("_", " ")


def draw_scores(ax: Axes, evaluation: Evaluation, measure: str) -> None:
    """Draw the average of a measure for every model, with 95 % intervals, by group of phones.

    Parameters
    ----------
    ax
        The axes to draw into.
    evaluation
        The scores.
    measure
        ``rmse`` or ``correlation``.
    """
    order = [evaluation.models.index(name) for name in reversed(evaluation.rank_models())]
    values, low, high = evaluation.compute_averages(measure)
    for g, label in enumerate(GROUP_LABELS.values()):
        value = values[order, g]
        ax.errorbar(
            value,
            np.arange(len(order)) + 0.22 * (1 - g),
            xerr=np.abs(np.stack([value - low[order, g], high[order, g] - value])),
            fmt="o",
            ms=4.5 if g == 0 else 3,
            lw=1.4 if g == 0 else 0.9,
            color=(INK, CYCLE[0], CYCLE[1])[g],
            label=label,
        )
    ax.set_title(_TITLES[measure])
    ax.grid(axis="x")
    ax.set_yticks(np.arange(len(order)), [evaluation.models[i] for i in order])
    ax.set_ylim(-0.6, len(order) - 0.4)


def plot_scores(evaluation: Evaluation) -> Figure:
    """Plot average error and correlation of every model, with 95 % intervals, by group of phones.

    Parameters
    ----------
    evaluation
        The scores.

    Returns
    -------
    matplotlib.figure.Figure
        Two panels, the best model on top.
    """
    size = (9.0, 1.5 + 0.42 * len(evaluation.models))
    figure, axes = create_figure(size, 1, 2, sharey=True)
    for axis, measure in zip(axes[0], _TITLES, strict=True):
        draw_scores(axis, evaluation, measure)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    write_title(figure, f"{evaluation.utterances} held-out utterances, 95 % intervals")
    return figure


def plot_parameters(evaluation: Evaluation) -> Figure:
    """Plot the error of every parameter by every model, over all but silence, as a coloured table.

    Parameters
    ----------
    evaluation
        The scores.

    Returns
    -------
    matplotlib.figure.Figure
        A row a model, the best on top, and a column a parameter.
    """
    order = [evaluation.models.index(name) for name in evaluation.rank_models()]
    values = evaluation.rmse[order, 0]
    rows, columns = values.shape
    figure, axes = create_figure((1.6 + 0.85 * columns, 1.9 + 0.34 * rows))
    axis = axes[0, 0]
    known = values[np.isfinite(values)]
    top = float(known.max()) if known.size else 1.0
    # Of the colours the light half alone, which dark numbers are read on.
    axis.imshow(values, cmap="YlOrBr", vmin=0.0, vmax=2.0 * top, aspect="auto")
    for i in range(rows):
        for j in range(columns):
            if np.isfinite(values[i, j]):
                axis.text(
                    j, i, f"{values[i, j]:.1f}", ha="center", va="center", color=INK, fontsize=8
                )
    words = [to_words(name).replace(" ", "\n", 1) for name in evaluation.parameters]
    axis.set_xticks(range(columns), words, rotation=35, ha="right", rotation_mode="anchor")
    axis.set_yticks(range(rows), [evaluation.models[i] for i in order])
    axis.tick_params(length=0)
    axis.spines[:].set_visible(False)
    write_title(figure, "RMSE of each parameter (% of its range, all but silence)")
    return figure


def plot_trajectories(
    target: ParameterTracks,
    predictions: Mapping[str, FloatArray],
    phones: PhoneSequence,
    parameter: str,
    text: str = "",
) -> Figure:
    """Plot target and predicted trajectories of one parameter over the phones (Figure 5).

    Parameters
    ----------
    target
        Target tracks of the utterance.
    predictions
        By model, ``(frames, parameters)`` each, at the times of the target, no unit.
    phones
        Phones of the utterance, on the same clock.
    parameter
        Name of the parameter.
    text
        What is said, for the title.

    Returns
    -------
    matplotlib.figure.Figure
        A panel a model, and the phones.
    """
    column = target.index(parameter)
    times = target.times
    every = np.stack([target.values, *predictions.values()])[:, :, column]
    low, high = float(np.nanmin(every)), float(np.nanmax(every))
    margin = 0.06 * max(high - low, 1e-3)
    rows = len(predictions)
    figure, axes = create_figure(
        (10.0, 1.25 * rows + 1.3), rows + 1, 1, sharex=True, height_ratios=[1.0] * rows + [0.28]
    )
    for i, (name, values) in enumerate(predictions.items()):
        axis: Axes = axes[i, 0]
        axis.plot(times, target.values[:, column], color=GREY, lw=2.6, alpha=0.6, label="target")
        axis.plot(times, values[:, column], color=CYCLE[i % len(CYCLE)], lw=1.3)
        axis.set_title(name, pad=3)
        axis.set_ylim(low - margin, high + margin)
        for segment in phones:
            axis.axvline(segment.start, color=PALE, lw=0.6, zorder=0)
    draw_phones(axes[rows, 0], phones)
    axes[rows, 0].set_xlim(times[0], times[-1])
    axes[rows, 0].set_xlabel("time (s)")
    figure.supylabel(f"{to_words(parameter)} (grey: target)", fontsize=9)
    write_title(figure, f"{target.name}: {text}" if text else target.name)
    return figure


def draw_phones(axis: Axes, phones: PhoneSequence) -> None:
    """Write the phones over time into a low panel.

    Parameters
    ----------
    axis
        The axes to draw into.
    phones
        The phones.
    """
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


def plot_dominances(
    model: CohenMassaro, target: ParameterTracks, phones: PhoneSequence, parameter: str
) -> Figure:
    """Plot the dominance functions of a Cohen-Massaro model, and their trajectory (Figure 2).

    Parameters
    ----------
    model
        A trained model.
    target
        Target tracks of the utterance.
    phones
        Phones of the utterance, 100 segments at most.
    parameter
        Name of the parameter.

    Returns
    -------
    matplotlib.figure.Figure
        Dominances, the trajectory beside the target, and the phones.
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
    set_log_scale(above)
    above.set_ylim(max(1e-4 * float(dominances.max()), 1e-300), 1.5 * float(dominances.max()))
    above.set_title("dominance of each phone (part of the largest)", pad=3)
    below.plot(times, target.values[:, column], color=GREY, lw=2.6, alpha=0.6, label="target")
    below.plot(fine, model.predict_at(phones, fine)[:, column], color=INK, lw=1.3, label="model")
    below.set_title(to_words(parameter), pad=3)
    below.legend(loc="upper right", ncols=2)
    for segment in phones:
        for axis in (above, below):
            axis.axvline(segment.start, color=PALE, lw=0.6, zorder=0)
    draw_phones(strip, phones)
    strip.set_xlim(times[0], times[-1])
    strip.set_xlabel("time (s)")
    write_title(figure, f"{model.title}: dominance functions, {target.name}")
    return figure


def plot_look_ahead(
    look_ahead: Sequence[float], errors: Sequence[float], baseline: float | None = None
) -> Figure:
    """Plot the error of networks by their look-ahead (Figure 4).

    Parameters
    ----------
    look_ahead
        Look-ahead of each network, seconds.
    errors
        Root mean square errors on held-out sentences, in the unit of the parameters.
    baseline
        The error of phone means, in the same unit; None where it was not measured.

    Returns
    -------
    matplotlib.figure.Figure
        One panel.
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
    write_title(figure, "Error by look-ahead (total context 31 frames)")
    return figure


def plot_training(log: Sequence[Any], title: str) -> Figure:
    """Plot the error by iteration, of the training part and of the validation part.

    Parameters
    ----------
    log
        `mocap_fit.control.LogEntry` each.
    title
        Title of the figure.

    Returns
    -------
    matplotlib.figure.Figure
        One panel.
    """
    parts = list(dict.fromkeys(entry.part for entry in log))
    figure, axes = create_figure((7.0, 4.0))
    axis = axes[0, 0]
    for i, part in enumerate(parts):
        entries = [entry for entry in log if entry.part == part]
        colour = CYCLE[i % len(CYCLE)]
        steps = [entry.iteration for entry in entries]
        axis.plot(steps, [e.training_error for e in entries], color=colour, lw=1.0, alpha=0.55)
        held = [
            (e.iteration, e.validation_error) for e in entries if e.validation_error is not None
        ]
        if held:
            axis.plot(*zip(*held, strict=True), color=colour, lw=1.6, label=to_words(part))
        else:
            axis.plot([], [], color=colour, lw=1.0, label=to_words(part))
    axis.set_xlabel("iteration")
    axis.set_ylabel("root mean square error")
    set_log_scale(axis)
    axis.grid(axis="y")
    if any(parts):
        axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    write_title(figure, f"{title} (pale: training part)")
    return figure
