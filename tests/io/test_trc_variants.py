"""TRC files as converters and spreadsheets leave them; the truth is that of a literal writer."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io import read_tracks
from mocap_fit.tracks import FloatArray, MarkerTracks


def draw(names: list[str], frames: int = 4) -> FloatArray:
    """Positions with three decimals and a gap; no two numbers are the same."""
    values = np.arange(frames * len(names) * 3, dtype=float).reshape(frames, -1, 3) + 100.125
    values[1, 0] = np.nan
    return values


def compose(
    names: list[str],
    values: FloatArray,
    *,
    rate: str = "100.00",
    announced: int | None = None,
    axes: bool = True,
    blank: str | None = "",
    period: float = 0.01,
) -> list[list[str]]:
    """The cells of a TRC file, line by line."""
    count = len(names) if announced is None else announced
    keys = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame "
    frames = len(values)
    head = [
        ["PathFileType", "4", "(X/Y/Z)", "a.trc"],
        [*keys.split(), "OrigNumFrames"],
        [rate, rate, str(frames), str(count), "mm", rate, "1", str(frames)],
        ["Frame#", "Time", *(cell for name in names for cell in (name, "", ""))],
    ]
    if axes:
        head.append(["", "", *(f"{a}{i + 1}" for i in range(len(names)) for a in "XYZ")])
    if blank is not None:
        head.append([blank])
    for frame, row in enumerate(values):
        cells = ["" if np.isnan(value) else f"{value:.3f}" for value in row.ravel()]
        head.append([str(frame + 1), f"{frame * period:.5f}", *cells])
    return head


def save(path: Path, lines: list[list[str]], separator: str = "\t", ending: str = "\r\n") -> Path:
    path.write_bytes("".join(separator.join(line) + ending for line in lines).encode())
    return path


def check(path: Path, names: list[str], values: FloatArray, **options: object) -> MarkerTracks:
    tracks = read_tracks(path, **options)  # type: ignore[arg-type]
    assert tracks.names == tuple(names)
    assert tracks.rate == 100
    np.testing.assert_array_equal(tracks.positions, values)
    return tracks


NAMES = ["chin", "lip", "nose tip"]


@pytest.mark.parametrize(
    ("separator", "ending", "trailing"),
    [("\t", "\n", 0), ("\t", "\r\n", 1), ("\t", "\r", 4), (",", "\r\n", 3), (";", "\n", 2)],
)
@pytest.mark.parametrize("quotes", [False, True])
@pytest.mark.parametrize("blank", [None, "", "\t", "full"])
def test_saved_by_a_spreadsheet(
    separator: str, ending: str, trailing: int, quotes: bool, blank: str | None, tmp_path: Path
) -> None:
    values = draw(NAMES)
    lines = compose(NAMES, values, blank=blank and "")
    width = 11 + trailing
    if blank == "full":
        lines[5] = [""] * 11
        lines.append([""] * 11)
    elif blank:
        lines[5] = ["", ""]
    lines = [line + [""] * (width - len(line)) * bool(trailing) for line in lines]
    if quotes:
        lines = [
            [f'"{cell}"' if cell and cell[0].isalpha() else cell for cell in line] for line in lines
        ]
    if separator == ";":
        lines = [[cell.replace(".", ",") for cell in line] for line in lines]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check(save(tmp_path / "a.trc", lines, separator, ending), NAMES, values)


@pytest.mark.parametrize("which", [range(3, 99), range(1, 3), [1], [2], [3], [4], range(99)])
def test_doubled_tabs(which: list[int], tmp_path: Path) -> None:
    values = draw(NAMES)
    lines = compose(NAMES, values)
    text = [
        "\t".join(line).replace("\t", "\t\t" if number in which else "\t")
        for number, line in enumerate(lines)
    ]
    (tmp_path / "a.trc").write_text("\n".join(text) + "\n")
    check(tmp_path / "a.trc", NAMES, values)


def test_doubled_tabs_in_the_rows_alone(tmp_path: Path) -> None:
    values = draw(NAMES)
    lines = ["\t".join(line) for line in compose(NAMES, values)]
    lines[6:] = [line.replace("\t", "\t\t") for line in lines[6:]]
    (tmp_path / "a.trc").write_text("\n".join(lines) + "\n")
    check(tmp_path / "a.trc", NAMES, values)


def test_names_with_a_single_tab_between_them(tmp_path: Path) -> None:
    values = draw(NAMES)
    lines = compose(NAMES, values)
    lines[3] = ["Frame#", "Time", *NAMES]
    check(save(tmp_path / "a.trc", lines), NAMES, values)


def test_names_above_every_axis(tmp_path: Path) -> None:
    values = draw(NAMES)
    lines = compose(NAMES, values)
    lines[3] = ["Frame#", "Time", *(name for name in NAMES for _ in range(3))]
    check(save(tmp_path / "a.trc", lines), NAMES, values)


def test_utf_16(tmp_path: Path) -> None:
    values = draw(NAMES)
    path = save(tmp_path / "a.trc", compose(NAMES, values))
    path.write_bytes(path.read_text().encode("utf-16"))
    check(path, NAMES, values)


def test_a_blank_column_before_the_first_marker(tmp_path: Path) -> None:
    values = draw(NAMES)
    lines = [*compose(NAMES, values)]
    for number in range(3, len(lines)):
        if len(lines[number]) > 2:
            lines[number].insert(2, "")
    check(save(tmp_path / "a.trc", lines), NAMES, values)
    lines[-1].insert(2, "7")
    with pytest.raises(FileFormatError, match=r"a\.trc"):
        read_tracks(save(tmp_path / "a.trc", lines))


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_trajectories_without_a_name_are_left_out(data: st.DataObject, tmp_path: Path) -> None:
    """Between the named ones and behind them, with or without axes above them."""
    names = data.draw(
        st.lists(st.sampled_from(["", "a", "b b", "c", "d:e"]), min_size=1, max_size=6)
    )
    used = [index for index, name in enumerate(names) if name and name not in names[:index]]
    names = [name if index in used else "" for index, name in enumerate(names)]
    if not used:
        return
    values = draw(names)
    values[1, 0] = 5.0
    values[2, -1] = np.nan
    announced = data.draw(st.sampled_from([len(names), len(used)]))
    lines = compose(names, values, announced=announced)
    if data.draw(st.booleans()):
        behind = len(names) - max(used) - 1
        lines[4] = lines[4][: len(lines[4]) - 3 * behind]
    if data.draw(st.booleans()):
        lines = [[*line, ""] for line in lines]
    path = save(tmp_path / "a.trc", lines)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        tracks = read_tracks(path)
    assert tracks.names == tuple(
        names[index].removeprefix("d:") if len(used) == 1 else names[index] for index in used
    )
    np.testing.assert_array_equal(tracks.positions, values[:, used])
    unnamed = len(names) - len(used)
    assert [f"{unnamed} traject" in str(warning.message) for warning in caught] == [True] * (
        unnamed > 0
    )


@pytest.mark.parametrize("announced", [1, 2, 4, 30])
def test_a_wrong_number_of_markers_is_said(announced: int, tmp_path: Path) -> None:
    values = draw(NAMES)
    path = save(tmp_path / "a.trc", compose(NAMES, values, announced=announced))
    with pytest.warns(MocapFitWarning, match=f"NumMarkers is {announced}, but 3 markers"):
        check(path, NAMES, values)


def test_a_row_with_one_cell_too_many_is_refused(tmp_path: Path) -> None:
    lines = compose(NAMES, draw(NAMES))
    lines[7].insert(5, "1.0")
    with pytest.raises(FileFormatError, match=r"line 8: .*found 12, expected 11"):
        read_tracks(save(tmp_path / "a.trc", lines))


def test_the_times_win_over_data_rate_and_orig_data_rate(tmp_path: Path) -> None:
    values = draw(NAMES, 600)
    path = save(tmp_path / "a.trc", compose(NAMES, values, rate="60.00", period=1001 / 60000))
    with pytest.warns(MocapFitWarning, match=r"header says 60 Hz.* 59\.94"):
        assert read_tracks(path).rate == pytest.approx(60000 / 1001, rel=1e-6)
    assert read_tracks(path, rate=60).rate == 60
    lines = compose(NAMES, values)
    lines[2][1], lines[2][5] = "200.00", "200.00"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_tracks(save(path, lines)).rate == 100
        lines[2][0] = ""
        assert read_tracks(save(path, lines)).rate == 100


def test_a_unit_of_the_caller(tmp_path: Path) -> None:
    values = draw(NAMES)
    lines = compose(NAMES, values)
    path = save(tmp_path / "a.trc", lines)
    np.testing.assert_array_equal(read_tracks(path, unit="cm").positions, 10 * values)
    lines[2][4] = ""
    with pytest.raises(FileFormatError, match="no Units"):
        read_tracks(save(path, lines))
    np.testing.assert_array_equal(read_tracks(path, unit="mm").positions, values)


@pytest.mark.parametrize("first", [0, 5, 3])
def test_blanks_for_tabs(first: int, tmp_path: Path) -> None:
    """In all lines, in the rows, or in the names and all below them."""
    names = ["chin", "lip", "nose"]
    values = draw(names)
    values[1, 0] = 9.0
    lines = ["\t".join(line) for line in compose(names, values)]
    lines[first:] = [" ".join(line.split()) for line in lines[first:]]
    path = tmp_path / "a.trc"
    path.write_text("\n".join(lines) + "\n")
    check(path, names, values)
    path.write_text("\n".join([*lines[:-1], lines[-1].rsplit(" ", 1)[0], lines[-1]]) + "\n")
    with pytest.raises(FileFormatError, match=r"line 10: .*found 10, expected 11"):
        read_tracks(path)


def test_a_header_of_seven_words(tmp_path: Path) -> None:
    values = draw(NAMES)
    lines = compose(NAMES, values)
    lines[1], lines[2] = lines[1][:7], lines[2][:7]
    check(save(tmp_path / "a.trc", lines), NAMES, values)
