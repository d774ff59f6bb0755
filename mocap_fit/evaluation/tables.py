"""Tables of scores as text and as HTML."""

from __future__ import annotations

import html
from collections.abc import Sequence

from mocap_fit.evaluation.closure import LipScores, Share

# Stands behind the name of a model whose training stopped by the test set.
MARK = " *"
MARK_EXPLAINED = (
    "* Trained with the protocol paper: training stops where the error on the corpus's test set is "
    "least, and scores on that set are better than on sentences that training has not seen."
)
LIP_COLUMNS = ("lips closed", "lip at teeth", "vowels open", "fastest, mm/s")


def format_value(values: Sequence[float], digits: int) -> str:
    """Format a value with its confidence interval.

    Parameters
    ----------
    values
        The value, and the low and the high end of its interval, in any unit.
    digits
        Digits after the point.

    Returns
    -------
    str
        Such as ``6.68 [6.55, 6.80]``.
    """
    value, low, high = (f"{each:.{digits}f}" for each in values)
    return f"{value} [{low}, {high}]"


def format_share(share: Share) -> str:
    """Format a share with its confidence interval.

    Parameters
    ----------
    share
        How many of several.

    Returns
    -------
    str
        Such as ``97.5 % [94.0, 99.0]``, or a dash for a share of none.
    """
    if not share.count:
        return "–"
    low, high = share.interval
    return f"{100 * share.value:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def format_lips(scores: LipScores) -> list[str]:
    """Format what the lips do.

    Parameters
    ----------
    scores
        Of a model, or of the targets.

    Returns
    -------
    list of str
        A cell for each of `LIP_COLUMNS`.
    """
    shares = [format_share(share) for share in (scores.closed, scores.contact, scores.opened)]
    return [*shares, "–" if scores.speed != scores.speed else f"{scores.speed:.0f}"]


def format_text(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table as text: the first column at the left, the others at the right.

    Parameters
    ----------
    header
        Names of the columns.
    rows
        Cells.

    Returns
    -------
    str
        A line for the header and one a row.
    """
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = []
    for row in (header, *rows):
        cells = map(str.rjust, row[1:], widths[1:])
        lines.append("  ".join([row[0].ljust(widths[0]), *cells]).rstrip())
    return "\n".join(lines)


def format_markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table as Markdown, whose columns of shares have their unit in the header.

    Parameters
    ----------
    header
        Names of the columns.
    rows
        Cells.

    Returns
    -------
    str
        A line for the header, one that rules it off, and one a row.
    """
    columns = []
    for name, *cells in zip(header, *rows, strict=True):
        is_share = any(" % [" in cell for cell in cells)
        columns.append(
            [f"{name}, %", *(cell.replace(" % [", " [") for cell in cells)]
            if is_share
            else [name, *cells]
        )
    first, *others = zip(*columns, strict=True)
    lines = (first, ["---"] * len(header), *others)
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def format_html(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table as HTML.

    Parameters
    ----------
    header
        Names of the columns.
    rows
        Cells.

    Returns
    -------
    str
        One ``table`` element.
    """
    head = "".join(f"<th>{html.escape(name)}</th>" for name in header)
    body = "".join(
        f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
