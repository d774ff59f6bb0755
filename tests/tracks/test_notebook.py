"""Summaries and plots of tracks at the limits of what they show."""

import numpy as np
import pytest

from mocap_fit.drawing import CYCLE
from mocap_fit.tracks import MarkerTracks, ParameterTracks, PoseTracks


def parameters(count, frames=3) -> ParameterTracks:
    names = tuple(f"p{k}" for k in range(count))
    return ParameterTracks(names, 50, np.arange(float(frames * count)).reshape(frames, count))


def test_eight_names_are_shown_and_no_more():
    assert repr(parameters(8)).endswith("parameters: p0, p1, p2, p3, p4, p5, p6, p7")
    assert repr(parameters(9)).endswith("p6, p7, … (9 in all)")


def test_a_summary_tells_times_and_what_is_missing():
    positions = np.zeros((8, 2, 3))
    positions[:3, 1] = np.nan
    tracks = MarkerTracks(("a", "b"), 40, positions, start_time=1.5, name="take")
    assert repr(tracks).splitlines() == [
        "MarkerTracks 'take'",
        "  frames: 8 at 40 Hz, 0.200 s",
        "  times: 1.500 s to 1.675 s",
        "  missing: 18.75% of the samples",
        "  markers: a, b",
    ]
    page = tracks._repr_html_()
    assert "<td style='text-align:left'>none</td>" in page
    assert "smooth, cut" in tracks.add_step("smooth").add_step("cut")._repr_html_()


@pytest.mark.parametrize("count", [1, 12, 13])
def test_a_dozen_lines_have_a_legend(count):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    axes = parameters(count).plot()
    assert (axes.get_legend() is not None) == (count <= 12)
    assert [line.get_color() for line in axes.lines] == [
        CYCLE[k % len(CYCLE)] for k in range(count)
    ]
    assert axes.get_ylabel() == "parameter (0 rest, 1 full gesture)"
    pyplot.close(axes.figure)


def test_distances_from_the_median_are_drawn_of_what_is_seen():
    pyplot = pytest.importorskip("matplotlib.pyplot")
    positions = np.zeros((5, 2, 3))
    positions[:, 0, 1], positions[:, 0, 2] = [0, 30, 3, -3, np.nan], [0, 40, 4, -4, 0]
    positions[:, 1] = np.nan
    axes = MarkerTracks(("a", "b"), 50, positions, name="take").plot()
    assert axes.get_ylabel() == "distance from the median position (mm)"
    assert axes.get_title() == "take"
    # The median of 0, 30, 3 and -3 is 1.5, that of 0, 40, 4 and -4 is 2.
    np.testing.assert_allclose(axes.lines[0].get_ydata(), [2.5, 47.5, 2.5, 7.5, np.nan])
    assert np.isnan(axes.lines[1].get_ydata()).all()
    still = PoseTracks(("head",), 50, np.tile(np.eye(3), (3, 1, 1, 1)), np.ones((3, 1, 3)))
    assert not np.any(still.plot(ax=axes).lines[2].get_ydata())
    pyplot.close(axes.figure)
