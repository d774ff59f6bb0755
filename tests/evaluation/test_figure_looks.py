"""Every figure looks as it did when it was last approved.

``python tests/evaluation/test_figure_looks.py`` writes the looks anew; look at the figures first.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex

sys.path.insert(0, str(Path(__file__).parent))
from remembered_model import Remembered, spoken

from mocap_fit.control import LogEntry
from mocap_fit.corpus import Corpus
from mocap_fit.evaluation import evaluate, figures

LOOKS = Path(__file__).with_name("figure_looks.json")


class Dominances:
    """The two answers of a Cohen-Massaro model that its figure shows, by formula."""

    title = "Cohen-Massaro"

    def compute_dominances(self, phones, times, parameter):
        return np.exp(-10 * np.abs(times[:, None] - [s.centre for s in phones]))

    def predict_at(self, phones, times):
        return np.stack([np.cos(times), np.sin(times)], axis=1)


def draw():
    """Every figure, by name."""
    corpus = Corpus.from_utterances(
        [spoken(f"u{i}", i, ("x", "y")) for i in range(4)], "en-arpabet"
    )
    models = {f"m{i}": Remembered(scale=1 - 0.3 * i).fit(corpus) for i in range(3)}
    result = evaluate(corpus, models, face=None, resamples=40)
    utterance = corpus.utterances[0]
    tracks, phones = utterance.read_tracks(), utterance.read_phones()
    predictions = {name: m.predict_at(phones, tracks.times) for name, m in models.items()}
    log = [LogEntry(i, 1 / (i + 1), None if i % 2 else 2 / (i + 1), "jaw_x") for i in range(5)]
    log += [LogEntry(i, 3 / (i + 1), None, "lip") for i in range(3)]
    return {
        "scores": figures.plot_scores(result),
        "plot": result.plot().figure,
        "parameters": figures.plot_parameters(result),
        "trajectories": figures.plot_trajectories(tracks, predictions, phones, "y", "bas"),
        "untitled": figures.plot_trajectories(tracks, predictions, phones, "x"),
        "dominances": figures.plot_dominances(Dominances(), tracks, phones, "x"),
        "look-ahead": figures.plot_look_ahead([0.0, 0.05, 0.1], [0.3, 0.2, 0.1], 0.35),
        "no baseline": figures.plot_look_ahead([0.0, 0.05], [0.3, 0.2]),
        "training": figures.plot_training(log, "m"),
        "one part": figures.plot_training([LogEntry(0, 1.0), LogEntry(1, 0.5)], "m"),
    }


def describe_text(text):
    return [text.get_text(), text.get_fontsize(), text.get_rotation(), text.get_ha()]


def describe_axes(axes):
    def numbers(values):
        return [float(f"{float(value):.3g}") for value in np.ravel(values)]

    lines = [
        [
            *numbers(np.nan_to_num(line.get_xydata().sum(axis=0))),
            len(line.get_xydata()),
            line.get_linewidth(),
            line.get_linestyle(),
            line.get_marker(),
            line.get_markersize(),
            line.get_alpha(),
            to_hex(line.get_color()),
        ]
        for line in axes.lines
    ]
    patches = [
        [
            *numbers(p.get_extents().bounds),
            p.get_linewidth(),
            to_hex(p.get_fc()),
            to_hex(p.get_ec()),
        ]
        for p in axes.patches[:3]
    ]
    fills = [[c.get_alpha(), *numbers(c.get_linewidth())] for c in axes.collections]
    images = [[*numbers(i.get_clim()), i.get_cmap().name, i.get_array().size] for i in axes.images]
    grids = [any(g.get_visible() for g in a.get_gridlines()) for a in (axes.xaxis, axes.yaxis)]
    legend = axes.get_legend()
    return {
        "title": axes.get_title(loc="left") or axes.get_title(),
        "labels": [axes.get_xlabel(), axes.get_ylabel(), axes.get_xscale(), axes.get_yscale()],
        "limits": numbers([*axes.get_xlim(), *axes.get_ylim()]),
        "ticks": [describe_text(t) for t in (*axes.get_xticklabels(), *axes.get_yticklabels())],
        "texts": [
            [*describe_text(text), text.get_va(), *numbers(text.get_position())]
            for text in axes.texts
        ],
        "spines": {side: spine.get_visible() for side, spine in axes.spines.items()},
        "legend": None
        if legend is None
        else [
            [t.get_text() for t in legend.get_texts()],
            legend._loc,
            legend._ncols,
            legend._fontsize,
            numbers(legend.get_window_extent().bounds),
        ],
        "lines": lines,
        "patches": patches,
        "fills": fills,
        "images": images,
        "grids": grids,
    }


def describe(figure):
    figure.canvas.draw()
    return json.loads(
        json.dumps(
            {
                "size": figure.get_size_inches().tolist(),
                "title": figure.get_suptitle(),
                "label": figure.get_supylabel(),
                "sizes": [
                    text and text.get_fontsize() for text in (figure._suptitle, figure._supylabel)
                ],
                "legends": [
                    [[t.get_text() for t in legend.get_texts()], legend._ncols]
                    for legend in figure.legends
                ],
                "axes": [describe_axes(axes) for axes in figure.axes],
            }
        )
    )


@pytest.fixture(scope="module")
def drawn():
    return {name: describe(figure) for name, figure in draw().items()}


@pytest.mark.parametrize(
    "name", list(json.loads(LOOKS.read_text("utf-8"))) if LOOKS.exists() else []
)
def test_a_figure_looks_as_it_did(drawn, name):
    assert drawn[name] == json.loads(LOOKS.read_text("utf-8"))[name]


def test_every_figure_has_a_look(drawn):
    assert list(drawn) == list(json.loads(LOOKS.read_text("utf-8")))


if __name__ == "__main__":
    looks = {name: describe(figure) for name, figure in draw().items()}
    LOOKS.write_text(json.dumps(looks, indent=0) + "\n", encoding="utf-8")
