"""The progress of a batch, and how the command line shows it."""

from corpus_tools.batch import ItemResult, progress
from corpus_tools.cli import display


def result(frames=0, *, name="a", cached=False):
    return ItemResult(name, {"frames": frames}, cached=cached)


def test_time_left_is_judged_by_the_sizes(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    states = []
    tracker = progress.Tracker([1000, 3000, 4000], states.append)

    def last():
        return states[-1].share, states[-1].finished, display.format_batch_progress(states[-1])

    now[0] = 110.0
    tracker.finish(0, result(500))
    assert last() == (0.125, 1, "1 of 3, 500 frames, 50 frames/s, 1:10 left")
    tracker.update(1, 750, 1500)
    assert last() == (0.3125, 1, "1 of 3, 1250 frames, 125 frames/s, 0:22 left")
    # What is cached is done, but says nothing about how fast the rest will be.
    tracker.finish(2, result(900, cached=True))
    assert last() == (0.8125, 2, "2 of 3, 1250 frames, 125 frames/s, 0:06 left")
    now[0] = 120.0
    tracker.finish(1, result(1500))
    assert last() == (1.0, 3, "3 of 3, 2000 frames, 100 frames/s")


def test_results_come_in_the_order_of_the_items():
    states = []
    tracker = progress.Tracker([1, 1, 1], states.append)
    for index in (2, 0, 1):
        tracker.finish(index, result(name=str(index)))
    assert [[each.name for each in state.results] for state in states] == [[], ["0"], ["1", "2"]]
    assert [each.name for each in tracker.results] == ["0", "1", "2"]


def test_lines_where_there_is_no_terminal(capsys):
    with display.show_batch_progress("fitting") as show:
        tracker = progress.Tracker([1] * 40, show)
        for index in range(40):
            tracker.update(index, 1, 3)
            tracker.finish(index, result(3))
    lines = capsys.readouterr().err.splitlines()
    assert 10 <= len(lines) <= 11
    assert lines[-1].startswith("mocap-fit: fitting: 40 of 40, 120 frames, ")
