"""What is written over the stage: names with lines to their points, title, legend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from corpus_tools.inspection.bodies import (
    DROPPED,
    FILLED,
    HEAD_MARKER,
    MEASURED,
    MOST_DIFFERENT,
)
from corpus_tools.inspection.paint import (
    FAINT,
    INK,
    PAPER,
    Canvas,
    Colour,
    draw_text,
    fit_text,
)
from corpus_tools.inspection.screen import Area, Screen
from corpus_tools.inspection.stage import Stage
from corpus_tools.inspection.strip import HEAD_COLOURS
from mocap_fit.tracks import FloatArray

_LEADER: Colour = (96, 104, 116)
_FEATURE: Colour = (120, 40, 90)
_LINE = 13
_MARGIN = 10
_TOP = 46


class Overlay(Canvas):
    """A picture that is see-through where nothing is painted.

    Parameters
    ----------
    width, height
        Its size, pixels.
    """

    def __init__(self, width: int, height: int) -> None:
        super().__init__(width, height)
        self.alpha: NDArray[np.float32] = np.zeros((height, width), dtype=np.float32)

    def put(self, x: float, y: float, text: str, colour: Colour, size: int, bold: bool) -> None:
        """Write a text with a light border, which can be read on anything.

        Parameters
        ----------
        x
            Its left end, pixels from the left.
        y
            The middle of its height, pixels from the top.
        text
            The text.
        colour
            Red, green and blue.
        size
            Height of the letters, pixels.
        bold
            Whether it is bold.
        """
        cover = np.pad(draw_text(text, size, bold), 2)
        border = cover.copy()
        for axis in (0, 1):
            for by in (-1, 1, -2, 2):
                border = np.maximum(
                    border, np.roll(cover, by, axis) * (0.9 if abs(by) < 2 else 0.5)
                )
        left, top = round(x) - 2, round(y - cover.shape[0] / 2)
        for shade, share in ((PAPER, 0.85 * border), (colour, cover)):
            self._blend(left, top, shade, share)

    def _blend(self, left: int, top: int, colour: Colour, share: NDArray[np.float32]) -> None:
        x0, y0 = max(left, 0), max(top, 0)
        height, width = share.shape
        alpha = self.alpha[y0 : max(top + height, 0), x0 : max(left + width, 0)]
        share = share[y0 - top :, x0 - left :][: alpha.shape[0], : alpha.shape[1]]
        pixels = self.pixels[y0 : max(top + height, 0), x0 : max(left + width, 0)]
        below = alpha * (1.0 - share)
        total = np.maximum(share + below, 1e-6)[:, :, None]
        mixed = share[:, :, None] * np.array(colour, np.float32) + below[:, :, None] * pixels
        pixels[:] = np.rint(mixed / total)
        alpha[:] = share + below

    def to_picture(self) -> NDArray[np.uint8]:
        """Return the picture with its transparency.

        Returns
        -------
        ndarray
            Red, green, blue and alpha, ``(height, width, 4)``.
        """
        return np.dstack([self.pixels, np.rint(255 * self.alpha).astype(np.uint8)])


def _paint_names(stage: Stage, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Paint the names of all markers, and of the feature points of a layout."""
    canvas = Overlay(*size)
    features = stage.list_feature_points()
    layout = stage.material.layout
    tied = {m.name: m.feature_point or "" for m in layout.markers} if features and layout else {}
    names = [f"{name} {tied.get(name, '')}".strip() for name in stage.names]
    colours: list[Colour] = [INK] * len(names)
    points = [*stage.positions]
    for name, point in features.items():
        if name in tied.values():
            continue
        names.append(name)
        colours.append(_FEATURE)
        points.append(point)
        x, y = stage.project(point[None], size)[0]
        if 2 <= x < size[0] - 2 and 2 <= y < size[1] - 2:
            where = slice(round(y) - 1, round(y) + 2), slice(round(x) - 1, round(x) + 2)
            canvas.pixels[where], canvas.alpha[where] = _FEATURE, 1.0
    if names:
        places = stage.project(np.array(points), size)
        _write_names(canvas, names, places, colours, picked=stage.picked)
    return canvas.to_picture()


@dataclass(frozen=True)
class Words:
    """What is written over the stage.

    Parameters
    ----------
    title
        The title.
    notes
        Lines below it, of which two are shown.
    heads
        Names of the heads, in the order of their colours; of one nothing is said.
    with_names
        Whether every marker has its name.
    """

    title: str
    notes: tuple[str, ...]
    heads: tuple[str, ...]
    with_names: bool

    @property
    def height(self) -> int:
        """Height of title, notes and names of heads, pixels."""
        return 28 + 15 * min(len(self.notes), 2) + (16 if len(self.heads) > 1 else 0)


def put_words(screen: Screen, stage: Stage, area: Area, words: Words) -> None:
    """Write title, legend and names over the stage.

    Parameters
    ----------
    screen
        The window of VTK.
    stage
        The stage, at some time.
    area
        Where it is.
    words
        What is written.
    """
    left, bottom, width, height = area
    top = (left, bottom + height - words.height, width, words.height)
    screen.put("title", top, words, lambda *_: _paint_title(words, width))
    low = (left, bottom, width, 22)
    screen.put("legend", low, stage.stretch, lambda *_: _paint_legend(stage, width))
    if words.with_names:
        screen.put("names", area, None, lambda *size: _paint_names(stage, size))
    else:
        screen.hide("names")


def _paint_title(words: Words, width: int) -> NDArray[np.uint8]:
    canvas = Overlay(width, words.height)
    rest = width - 2 * _MARGIN
    canvas.put(_MARGIN, 14, fit_text(words.title, rest, 14, True), INK, 14, True)
    for number, note in enumerate(words.notes[:2]):
        canvas.put(_MARGIN, 32 + 15 * number, fit_text(note, rest, 11), FAINT, 11, False)
    x = float(_MARGIN)
    for number, (colour, name) in enumerate(zip(HEAD_COLOURS, words.heads, strict=False)):
        if len(words.heads) > 1:
            text = name + (" (left)", " (right)", "")[min(number, 2)]
            canvas.put(x, canvas.height - 9, text, colour, 11, True)
            x += draw_text(text, 11, True).shape[1] + 16
    return canvas.to_picture()


def _paint_legend(stage: Stage, width: int) -> NDArray[np.uint8]:
    """Paint what the markers' colours and shapes are."""
    canvas = Overlay(width, 22)
    entries: list[tuple[str, Colour, bool]] = []
    if stage.has_frames:
        entries += [("● measured", MEASURED, False), ("■ filled", FILLED, False)]
        entries += [("◆ missing", DROPPED, False), ("● head", HEAD_MARKER, False)]
    elif stage.names:
        entries += [("● face", MEASURED, False), ("● head", HEAD_MARKER, False)]
        entries.append(("▪ feature point", _FEATURE, False))
    if stage.has_residuals:
        drawn = "residual" if stage.stretch == 1 else f"residual, drawn × {stage.stretch:g}:"
        entries += [(drawn, INK, False), ("0", (30, 140, 66), True)]
        entries += [("1", (176, 132, 10), True), ("2 mm", (205, 30, 30), True)]
    if stage.compares:
        entries += [("    right head differs by", INK, False), ("0.3", (176, 132, 10), True)]
        entries.append((f"{MOST_DIFFERENT:g} mm", (205, 30, 30), True))
    x = float(_MARGIN)
    for text, colour, bold in entries:
        canvas.put(x, 11, text, colour, 11, bold)
        x += draw_text(text, 11, bold).shape[1] + (6 if bold else 10)
    return canvas.to_picture()


def _write_names(
    canvas: Overlay,
    names: list[str],
    places: FloatArray,
    colours: list[Colour],
    *,
    picked: str | None,
) -> None:
    """Write names in columns at both sides, each with a line to its point."""
    inside = np.isfinite(places).all(axis=1)
    inside &= (places >= 0).all(axis=1) & (places < (canvas.width, canvas.height)).all(axis=1)
    chosen = np.flatnonzero(inside)
    # Half of the names at each side.
    order = chosen[np.argsort(places[chosen, 0], kind="stable")]
    for right, side in ((False, order[: len(order) // 2]), (True, order[len(order) // 2 :])):
        side = side[np.argsort(places[side, 1], kind="stable")]
        rows = _spread(places[side, 1].tolist(), _TOP + 8, canvas.height - 34)
        for index, y in zip(side, rows, strict=True):
            bold = names[index] == picked
            wide = draw_text(names[index], 10, bold).shape[1]
            start = canvas.width - _MARGIN - wide if right else _MARGIN
            edge = start - 4 if right else start + wide + 3
            draw_line(canvas, edge, y, float(places[index, 0]), float(places[index, 1]))
        for index, y in zip(side, rows, strict=True):
            bold = names[index] == picked
            wide = draw_text(names[index], 10, bold).shape[1]
            start = canvas.width - _MARGIN - wide if right else _MARGIN
            canvas.put(start, y, names[index], colours[index], 10, bold)


def _spread(heights: list[float], top: float, bottom: float) -> list[float]:
    """Move heights apart until their texts do not overlap, as little as that takes."""
    count = len(heights)
    if not count:
        return []
    step = min(_LINE, (bottom - top) / max(count - 1, 1))
    rows = np.array(heights) - step * np.arange(count)
    # The nearest ascending sequence: pools of neighbours share their mean.
    pools: list[list[float]] = []
    for row in rows:
        pools.append([float(row), 1.0])
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            mean, weight = pools.pop()
            former = pools[-1]
            total = former[1] + weight
            pools[-1] = [(former[0] * former[1] + mean * weight) / total, total]
    level = np.repeat([mean for mean, _ in pools], [int(weight) for _, weight in pools])
    level = np.clip(level, top, max(bottom - step * (count - 1), top))
    return list(level + step * np.arange(count))


def draw_line(canvas: Overlay, x0: float, y0: float, x1: float, y1: float) -> None:
    """Draw a thin line.

    Parameters
    ----------
    canvas
        The picture.
    x0, y0, x1, y1
        Its ends, pixels from the left and from the top.
    """
    steps = int(max(abs(x1 - x0), abs(y1 - y0))) + 1
    part = np.linspace(0.0, 1.0, steps)
    columns = np.rint(x0 + part * (x1 - x0)).astype(int)
    rows = np.rint(y0 + part * (y1 - y0)).astype(int)
    inside = (columns >= 0) & (columns < canvas.width) & (rows >= 0) & (rows < canvas.height)
    canvas.pixels[rows[inside], columns[inside]] = _LEADER
    canvas.alpha[rows[inside], columns[inside]] = 0.55
