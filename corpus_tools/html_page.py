"""An HTML page in one file: text, tables, pictures, movies."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from mocap_fit.plain_text import escape_controls

_TYPES = {".png": "image/png", ".svg": "image/svg+xml", ".gif": "image/gif", ".mp4": "video/mp4"}
_INTERVAL = re.compile(r"\[[^\[\]]*\]")
_STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, "Segoe UI", Roboto, sans-serif; color: #222; background: #fff;
  max-width: 76rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.7rem; } h2 { font-size: 1.25rem; margin-top: 2.2rem; }
table { border-collapse: collapse; margin: 0.8rem 0; font-size: 0.92rem; }
th, td { padding: 0.25rem 0.5rem; border-bottom: 1px solid #e3e3e3; text-align: right;
  vertical-align: top; font-variant-numeric: tabular-nums; }
th { border-bottom: 2px solid #999; }
th.text, td.text { text-align: left; font-variant-numeric: normal; }
table { display: block; overflow-x: auto; }
figure { margin: 1rem 0; } figcaption { color: #555; font-size: 0.9rem; }
img, video { max-width: 100%; height: auto; }
code { background: #f3f3f3; padding: 0 0.25em; }
"""


def format_page(title: str, parts: Iterable[str]) -> str:
    """Return a page.

    Parameters
    ----------
    title
        Title of the window and of the page.
    parts
        Headings, paragraphs, tables and pictures from the functions of this module.

    Returns
    -------
    str
        HTML.
    """
    escaped = html.escape(title)
    body = "\n".join(parts)
    return escape_controls(
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width">\n<title>{escaped}</title>\n'
        f"<style>{_STYLE}</style>\n</head>\n<body>\n<h1>{escaped}</h1>\n{body}\n</body>\n</html>\n"
    )


def format_heading(text: str) -> str:
    """Return the heading of a section.

    Parameters
    ----------
    text
        The heading.

    Returns
    -------
    str
        HTML.
    """
    return f"<h2>{html.escape(text)}</h2>"


def format_paragraph(text: str) -> str:
    """Return a paragraph.

    Parameters
    ----------
    text
        The text; what is between ` marks is set as code.

    Returns
    -------
    str
        HTML.
    """
    pieces = html.escape(text).split("`")
    marked = "".join(f"<code>{p}</code>" if i % 2 else p for i, p in enumerate(pieces))
    return f"<p>{marked}</p>"


def format_table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table; columns of numbers are aligned to the right.

    Parameters
    ----------
    header
        Names of the columns.
    rows
        The cells of each row.

    Returns
    -------
    str
        HTML.
    """
    cells = [[str(cell) for cell in row] for row in rows]
    text = [any(not _is_number(row[i]) for row in cells) for i in range(len(header))]

    def format_row(tag: str, values: Sequence[str]) -> str:
        formatted = (
            f"<{tag}{' class=text' if text[i] else ''}>{_escape_cell(value)}</{tag}>"
            for i, value in enumerate(values)
        )
        return f"<tr>{''.join(formatted)}</tr>"

    body = "\n".join(format_row("td", row) for row in cells)
    head = format_row("th", header)
    return f"<table>\n<thead>{head}</thead>\n<tbody>\n{body}\n</tbody>\n</table>"


def format_picture(path: Path, caption: str = "") -> str:
    """Return a picture or a movie with its content.

    Parameters
    ----------
    path
        The file.
    caption
        Text below it.

    Returns
    -------
    str
        HTML.
    """
    kind = _TYPES[path.suffix.lower()]
    source = f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"
    label = html.escape(caption or path.stem, quote=True)
    if kind.startswith("video"):
        shown = f'<video controls src="{source}" aria-label="{label}"></video>'
    else:
        shown = f'<img src="{source}" alt="{label}">'
    words = f"<figcaption>{html.escape(caption)}</figcaption>" if caption else ""
    return f"<figure>{shown}{words}</figure>"


def _escape_cell(text: str) -> str:
    """Return HTML of a cell, in which an interval is on one line."""
    return _INTERVAL.sub(
        lambda match: match[0].replace(" ", "\N{NO-BREAK SPACE}"), html.escape(text)
    )


def _is_number(cell: str) -> bool:
    return not cell or cell[0] in "0123456789-+−.≥<" or cell in ("nan", "–")
