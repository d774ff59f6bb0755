import numpy as np
import pytest
from remembered_model import Remembered

from mocap_fit.control import LogEntry
from mocap_fit.drawing import save_figure
from mocap_fit.errors import FileFormatError
from mocap_fit.evaluation import evaluate, figures


@pytest.fixture(scope="module")
def result(small_corpus):
    models = {f"m{i}": Remembered(scale=1 - 0.1 * i).fit(small_corpus) for i in range(3)}
    return evaluate(small_corpus, models, face=None, resamples=100)


def test_scores_are_drawn_best_first(result):
    axis = figures.plot_scores(result).axes[0]
    assert [t.get_text() for t in axis.get_yticklabels()] == ["m2", "m1", "m0"]
    drawn = {round(float(c[0].get_xdata()[2]), 6) for c in axis.containers}
    assert round(float(result.compute_averages("rmse")[0][0, 0]), 6) in drawn


def test_every_parameter_is_in_the_table(result):
    axis = figures.plot_parameters(result).axes[0]
    numbers = [float(t.get_text()) for t in axis.texts]
    assert numbers == pytest.approx(np.round(result.rmse[:, 0], 1).ravel().tolist())


def test_a_trajectory_lies_on_its_target(small_corpus):
    shown = small_corpus.utterances[0]
    predictions = {"m": shown.read_tracks().values}
    figure = figures.plot_trajectories(
        shown.read_tracks(), predictions, shown.read_phones(), "y", "ba"
    )
    target, predicted = figure.axes[0].get_lines()[:2]
    assert np.array_equal(target.get_ydata(), predicted.get_ydata())
    assert [t.get_text() for t in figure.axes[1].texts] == list(shown.read_phones().phones)


def test_look_ahead_and_training_are_drawn():
    axis = figures.plot_look_ahead([0.0, 1 / 60], [0.2, 0.1], 0.3).axes[0]
    assert axis.get_lines()[0].get_xdata() == pytest.approx([0, 1000 / 60])
    log = [LogEntry(i, 1 / (i + 1), 2 / (i + 1), "jaw") for i in range(5)]
    axis = figures.plot_training(log, "m").axes[0]
    assert [len(line.get_xdata()) for line in axis.get_lines()] == [5, 5]


def test_the_same_figure_gives_the_same_bytes(result, tmp_path):
    for ending in ("png", "svg"):
        for name in ("one", "two"):
            save_figure(tmp_path / f"{name}.{ending}", figures.plot_scores, result)
        one, two = (tmp_path / f"{name}.{ending}" for name in ("one", "two"))
        assert one.read_bytes() == two.read_bytes()
    with pytest.raises(FileFormatError, match=r"\.png or \.svg"):
        save_figure(tmp_path / "x.bmp", figures.plot_scores, result)
    assert len(list(tmp_path.iterdir())) == 4


def test_a_trajectory_that_hardly_moves_has_room_above_and_below(small_corpus):
    shown = small_corpus.utterances[0]
    still = shown.read_tracks().replace(values=np.full((60, 2), 0.25))
    figure = figures.plot_trajectories(still, {"m": still.values}, shown.read_phones(), "y")
    assert figure.axes[0].get_ylim() == pytest.approx((0.25 - 6e-5, 0.25 + 6e-5))
    moving = still.replace(values=np.tile(np.linspace(0, 2, 60)[:, None], 2))
    figure = figures.plot_trajectories(moving, {"m": moving.values}, shown.read_phones(), "y")
    assert figure.axes[0].get_ylim() == pytest.approx((-0.12, 2.12))
