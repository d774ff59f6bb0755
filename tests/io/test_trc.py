"""TRC files of Motion Analysis and OpenSim."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from mocap_fit.errors import MocapFitWarning
from mocap_fit.io import read_tracks


@pytest.mark.parametrize("name", ["motion_analysis.trc", "opensim_metres.trc"])
def test_every_variant_gives_the_truth(name: str, recordings: Path, made: ModuleType) -> None:
    tracks = read_tracks(recordings / name)
    assert tracks.names == made.MARKERS
    assert tracks.rate == made.RATE
    assert tracks.start_time == 0.01
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=0, atol=1e-9)


def test_zeros_are_gaps(made: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "a.trc"
    lines = made.trc()
    frame = made.GAP[0].start
    cells = lines[6 + frame].split("\t")
    marker = made.GAP[1]
    cells[2 + 3 * marker : 5 + 3 * marker] = ["0.000000"] * 3
    lines[6 + frame] = "\t".join(cells)
    path.write_bytes(made.text(lines))
    np.testing.assert_allclose(read_tracks(path).positions, made.positions(), atol=1e-9)


def test_a_file_cut_off_in_a_row(made: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "a.trc"
    path.write_bytes(made.text(made.trc())[:-50])
    with pytest.warns(MocapFitWarning, match=r"line 18.* 11 complete rows"):
        assert read_tracks(path).frames == 11


def test_a_header_with_blanks_for_tabs(made: ModuleType, tmp_path: Path) -> None:
    lines = made.trc()
    lines[1:3] = [line.replace("\t", "  ") for line in lines[1:3]]
    path = tmp_path / "a.trc"
    path.write_bytes(made.text(lines))
    np.testing.assert_allclose(read_tracks(path).positions, made.positions(), atol=1e-9)


def test_no_line_of_axes(made: ModuleType, tmp_path: Path) -> None:
    lines = made.trc(blank_line=False)
    path = tmp_path / "a.trc"
    path.write_bytes(made.text([*lines[:4], *lines[5:]]))
    assert read_tracks(path).frames == made.FRAMES
