"""Names and sentences in figures are text, whatever signs of mathematics they hold."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from remembered_model import Remembered, spoken

from mocap_fit.corpus import Corpus
from mocap_fit.drawing import create_figure, save_figure, set_log_scale, write_plainly, write_title
from mocap_fit.evaluation import evaluate, figures
from mocap_fit.tracks import MarkerTracks

NAMES = ["a$#$", "$x", r"$\frac$", "_^{", r"\frac", "$$", "$ and $", r"$\undefined{$"]


def draw(names):
    figure, panels = create_figure((3.0, 3.0), 1, 2)
    for name in names:
        panels[0, 0].plot([1, 2], [1, 3], label=name)
        panels[0, 0].annotate(name, (1, 1))
    panels[0, 0].legend(title=names[0])
    panels[0, 0].set(xlabel=names[0], ylabel=names[1], title=names[2])
    panels[0, 0].set_yticks(range(len(names)), names)
    panels[0, 1].plot([1, 2], [0.001, 100])
    set_log_scale(panels[0, 1])
    write_title(figure, names[3])
    return figure


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_a_figure_for_a_file(tmp_path, ending):
    save_figure(tmp_path / f"a.{ending}", draw, NAMES)
    assert (tmp_path / f"a.{ending}").stat().st_size > 1000


def test_a_logarithmic_axis_shows_numbers():
    with write_plainly():
        figure = draw(NAMES)
        figure.draw_without_rendering()
    labels = [label.get_text() for label in figure.axes[1].get_yticklabels()]
    assert "1e\N{MINUS SIGN}02" in labels
    assert "$" not in "".join(labels)


def test_plots_of_tracks_and_scores_also_in_axes_of_the_user():
    tracks = MarkerTracks(NAMES, 100.0, np.zeros((3, len(NAMES), 3)), name="take $#$")
    tracks.plot().figure.draw_without_rendering()
    own = Figure()
    tracks.plot(ax=own.subplots())
    own.draw_without_rendering()
    corpus = Corpus.from_utterances(
        [spoken(f"u$#{i}$", i, ("x$", "$y")) for i in range(4)], "en-arpabet"
    )
    models = {f"m$#{i}$": Remembered(scale=1 - 0.3 * i).fit(corpus) for i in range(2)}
    result = evaluate(corpus, models, face=None, resamples=40)
    result.plot().figure.draw_without_rendering()
    own = Figure()
    result.plot(ax=own.subplots())
    own.draw_without_rendering()


def test_every_figure_of_an_evaluation(tmp_path):
    corpus = Corpus.from_utterances(
        [spoken(f"u$#{i}$", i, ("x$", "$y")) for i in range(4)], "en-arpabet"
    )
    models = {"m$#$": Remembered().fit(corpus), r"\frac": Remembered(scale=0.7).fit(corpus)}
    save_figure(
        tmp_path / "a.png", figures.plot_scores, evaluate(corpus, models, face=None, resamples=40)
    )
