"""One HTML page that holds all that it shows: text, tables, pictures, a movie."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path

_TYPES = {".png": "image/png", ".svg": "image/svg+xml", ".gif": "image/gif", ".mp4": "video/mp4"}
_STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, "Segoe UI", Roboto, sans-serif; color: #222; background: #fff;
  max-width: 70rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.7rem; } h2 { font-size: 1.25rem; margin-top: 2.2rem; }
table { border-collapse: collapse; margin: 0.8rem 0; font-size: 0.92rem; }
th, td { padding: 0.25rem 0.8rem; border-bottom: 1px solid #e3e3e3; text-align: right;
  vertical-align: top; font-variant-numeric: tabular-nums; }
th { border-bottom: 2px solid #999; }
th.text, td.text { text-align: left; font-variant-numeric: normal; }
figure { margin: 1rem 0; } figcaption { color: #555; font-size: 0.9rem; }
img, video { max-width: 100%; height: auto; }
code { background: #f3f3f3; padding: 0 0.25em; }
"""


def page(title: str, parts: Iterable[str]) -> str:
    """The whole page, as text.

    Parameters
    ----------
    title
        In the window's head and above all.
    parts
        From the functions below.
    """
    escaped = html.escape(title)
    body = "\n".join(parts)
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width">\n<title>{escaped}</title>\n'
        f"<style>{_STYLE}</style>\n</head>\n<body>\n<h1>{escaped}</h1>\n{body}\n</body>\n</html>\n"
    )


def heading(text: str) -> str:
    """The head of a section."""
    return f"<h2>{html.escape(text)}</h2>"


def paragraph(text: str) -> str:
    """A paragraph; what is between ` marks is set as code."""
    pieces = html.escape(text).split("`")
    marked = "".join(f"<code>{p}</code>" if i % 2 else p for i, p in enumerate(pieces))
    return f"<p>{marked}</p>"


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table; a column whose cells look like numbers is set to the right."""
    cells = [[str(cell) for cell in row] for row in rows]
    text = [any(not _is_number(row[i]) for row in cells) for i in range(len(header))]

    def line(tag: str, values: Sequence[str]) -> str:
        made = (
            f"<{tag}{' class=text' if text[i] else ''}>{html.escape(value)}</{tag}>"
            for i, value in enumerate(values)
        )
        return f"<tr>{''.join(made)}</tr>"

    body = "\n".join(line("td", row) for row in cells)
    return f"<table>\n<thead>{line('th', header)}</thead>\n<tbody>\n{body}\n</tbody>\n</table>"


def picture(path: Path, caption: str = "") -> str:
    """A picture or a movie, put into the page itself."""
    kind = _TYPES[path.suffix.lower()]
    source = f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"
    label = html.escape(caption or path.stem, quote=True)
    if kind.startswith("video"):
        shown = f'<video controls src="{source}" aria-label="{label}"></video>'
    else:
        shown = f'<img src="{source}" alt="{label}">'
    words = f"<figcaption>{html.escape(caption)}</figcaption>" if caption else ""
    return f"<figure>{shown}{words}</figure>"


def _is_number(cell: str) -> bool:
    return not cell or cell[0] in "0123456789-+−.≥<" or cell in ("nan", "–")
