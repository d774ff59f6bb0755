"""QTM exports as other versions, editors and spreadsheets leave them."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io import qualisys_tsv, read_tracks
from mocap_fit.tracks import Event, MarkerTracks


def save(path: Path, lines: Sequence[str], ending: str = "\r\n") -> Path:
    path.write_bytes("".join(line + ending for line in lines).encode())
    return path


def check(path: Path, made: ModuleType, names: Sequence[str] | None = None) -> MarkerTracks:
    assert qualisys_tsv.sniff(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tracks = read_tracks(path)
    assert tracks.names == tuple(names or made.MARKERS)
    assert tracks.rate == made.RATE
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=0, atol=1e-9)
    return tracks


@pytest.mark.parametrize("blanks", [" ", "   "])
@pytest.mark.parametrize("line", [*range(10), "all"])
def test_blanks_for_the_first_tab_of_a_header_line(
    line: int | str, blanks: str, made: ModuleType, tmp_path: Path
) -> None:
    head = made.header()
    for number in range(10) if line == "all" else [line]:
        head[number] = head[number].replace("\t", blanks, 1)
    titles = made.titles().replace("\t", blanks if line == "all" else "\t", 1)
    check(save(tmp_path / "a.tsv", [*head, titles, *made.rows()]), made)


def test_blanks_for_all_tabs_of_the_header(made: ModuleType, tmp_path: Path) -> None:
    names = ("a", "b-1", "c", "d", "e")
    extra = ["TRAJECTORY_TYPES\t" + "\t".join(["Measured"] * 5), "EVENT\tclap two\t3\t0.02"]
    head = [line.replace("\t", " ") for line in made.header(names=names, after=extra)]
    path = save(tmp_path / "a.tsv", [*head, made.titles(names), *made.rows()])
    assert check(path, made, names).events == (Event("clap two", 0.02),)
    head[9] += " f"
    with pytest.raises(FileFormatError, match=r"NO_OF_MARKERS .*5 and 1 names"):
        read_tracks(save(path, [*head, *made.rows()]))


def test_an_empty_value_before_a_blank(made: ModuleType, tmp_path: Path) -> None:
    head = made.header()
    head[6:8] = ["DESCRIPTION -- ", "TIME_STAMP "]
    check(save(tmp_path / "a.tsv", [*head, *made.rows()]), made)


@pytest.mark.parametrize(
    "again",
    [
        "TIME_STAMP\t2022-11-22, 22:00:35",
        "DESCRIPTION\tcut",
        "NO_OF_CAMERAS\t9",
        "ANALOG_FREQUENCY\t1000",
        "FREQUENCY\t100",
        "DATA_INCLUDED\t3D",
    ],
)
@pytest.mark.parametrize("line", [8, 9, 10])
def test_a_line_that_comes_twice(again: str, line: int, made: ModuleType, tmp_path: Path) -> None:
    head = made.header()
    head.insert(line, again)
    check(save(tmp_path / "a.tsv", [*head, made.titles(), *made.rows()]), made)


@pytest.mark.parametrize("again", ["FREQUENCY\t200", "MARKER_NAMES\ta\tb\tc\td\te"])
def test_a_line_that_comes_twice_and_differs(again: str, made: ModuleType, tmp_path: Path) -> None:
    path = save(tmp_path / "a.tsv", [*made.header(after=[again]), *made.rows()])
    with pytest.raises(FileFormatError, match=f"line 11: {again.split()[0]} comes twice"):
        read_tracks(path)


@pytest.mark.parametrize("all_cells", [False, True])
def test_quoted_by_a_spreadsheet(all_cells: bool, made: ModuleType, tmp_path: Path) -> None:
    def quote(line: str) -> str:
        cells = line.split("\t")
        return "\t".join(f'"{c}"' if c and (all_cells or c[0].isalpha()) else c for c in cells)

    width = 2 + 3 * len(made.MARKERS)
    lines = [*made.header(), made.titles(), *made.rows(gap=""), ""]
    lines.insert(6, "")
    lines = [quote(line) + "\t" * (width - 1 - line.count("\t")) for line in lines]
    check(save(tmp_path / "a.tsv", lines), made)


def test_a_quoted_name_with_a_tab(made: ModuleType, tmp_path: Path) -> None:
    head = made.header()
    head[9] = head[9].replace("chin", '"chin\tlow ""2"""')
    names = (*made.MARKERS[:4], 'chin\tlow "2"')
    check(save(tmp_path / "a.tsv", [*head, *made.rows()]), made, names)


def test_a_last_marker_without_a_name(made: ModuleType, tmp_path: Path) -> None:
    names = (*made.MARKERS[:4], "")
    path = save(tmp_path / "a.tsv", [*made.header(names=names), *made.rows()])
    check(path, made, (*made.MARKERS[:4], "unlabelled 5"))


@pytest.mark.parametrize("types", ["Angle", "Position\tVelocity", "Force"])
def test_other_data_than_positions(types: str, made: ModuleType, tmp_path: Path) -> None:
    extra = [f"NO_OF_DATA_TYPES\t{len(types.split())}", f"DATA_TYPES\t{types}"]
    path = save(tmp_path / "a.tsv", [*made.header(after=extra), made.titles(), *made.rows()])
    with pytest.raises(FileFormatError, match=r"line 12: .*other data than positions"):
        read_tracks(path)


def test_a_blank_row_behind_the_last(made: ModuleType, tmp_path: Path) -> None:
    lines = [*made.header(), made.titles(), *made.rows(), "\t" * 16]
    check(save(tmp_path / "a.tsv", lines), made)


def test_the_clock_of_the_times_wins(made: ModuleType, tmp_path: Path) -> None:
    path = save(tmp_path / "a.tsv", [*made.header(rate=90), made.titles(), *made.rows()])
    with pytest.warns(MocapFitWarning, match="header says 90 Hz.* 100 Hz"):
        assert read_tracks(path).rate == pytest.approx(100)
    assert read_tracks(path, rate=90).rate == 90
