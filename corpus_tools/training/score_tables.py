"""Tables of scores, for pages and terminals: a header and rows of texts."""

from __future__ import annotations

import numpy as np

from mocap_fit.evaluation import GROUPS, Evaluation, LandmarkScores
from mocap_fit.evaluation.landmarks import MEASURES

Table = tuple[list[str], list[list[str]]]

LANDMARKS_EXPLAINED = (
    "Correlation of the predicted face with the markers themselves, over the frames that are not "
    "silent, each utterance's mean taken from both; the fitted tracks show what the fit leaves."
)


def format_percent(share: float | None) -> str:
    """Return a share in per cent, or a dash.

    Parameters
    ----------
    share
        The share, 0 to 1; None or NaN where it is not known.

    Returns
    -------
    str
        The text.
    """
    return "–" if share is None or share != share else f"{100 * share:.1f} %"


def to_score_table(result: Evaluation) -> Table:
    """Return Beskow's Table 2: one row per model, the best first.

    Parameters
    ----------
    result
        The scores.

    Returns
    -------
    tuple
        Header and rows.
    """
    header = ["model", "free parameters"]
    for group in GROUPS:
        label = "all but silence" if group == "all" else group
        header += [f"RMSE %, {label}", f"r, {label}"]
    if result.closed:
        header.append("lips closed")
    rmse, correlation = result.averages("rmse"), result.averages("correlation")
    rows = []
    for name in result.ranking():
        i = result.models.index(name)
        row = [name, str(result.parameter_counts[i])]
        for g in range(len(GROUPS)):
            value, low, high = (part[i, g] for part in rmse)
            row.append(f"{value:.2f} [{low:.2f}, {high:.2f}]")
            value, low, high = (part[i, g] for part in correlation)
            row.append(f"{value:.3f} [{low:.3f}, {high:.3f}]")
        if result.closed:
            row.append(format_percent(result.closed[name]))
        rows.append(row)
    return header, rows


def to_short_table(result: Evaluation) -> Table:
    """Return the part of the table of scores that fits into a terminal: all but silence.

    Parameters
    ----------
    result
        The scores.

    Returns
    -------
    tuple
        Header and rows.
    """
    header, rows = to_score_table(result)
    columns = [0, 2, 3, *([len(header) - 1] if result.closed else [])]
    short = [header[i].replace(", all but silence", "") for i in columns]
    return short, [[row[i] for i in columns] for row in rows]


def to_difference_table(result: Evaluation) -> Table:
    """Return the difference of every pair of models, in the order of their errors.

    Parameters
    ----------
    result
        The scores.

    Returns
    -------
    tuple
        Header and rows.
    """
    order = result.ranking()
    rows = []
    for i, first in enumerate(order):
        for second in order[i + 1 :]:
            difference = result.difference(first, second)
            rows.append(
                [
                    first,
                    second,
                    f"{difference.value:+.3f}",
                    f"[{difference.low:+.3f}, {difference.high:+.3f}]",
                    f"{difference.p:.3f}",
                ]
            )
    return ["first", "second", "difference (%)", "95 % interval", "p"], rows


def to_landmark_table(scores: LandmarkScores) -> Table:
    """Return the correlations with the markers, one row per model, the best first.

    Parameters
    ----------
    scores
        The correlations.

    Returns
    -------
    tuple
        Header and rows.
    """
    header = ["model", *MEASURES, "mean", "from", "to"]
    order = sorted(range(len(scores.models)), key=lambda i: -scores.mean[i])
    numbers = np.column_stack([scores.correlation, scores.mean, scores.low, scores.high])
    return header, [[scores.models[i], *(f"{v:.3f}" for v in numbers[i])] for i in order]
