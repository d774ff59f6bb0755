"""Bad input of every kind: one line that names the file, the line where there is one, and why."""

import os
import sys
import time
import tracemalloc
import warnings
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mocap_fit import io
from mocap_fit.errors import FileFormatError, MocapFitError
from mocap_fit.io import READERS

OWN = ("c3d", "csv", "motive-csv", "nexus-csv", "parquet", "qualisys-tsv", "trc")

# File, line (None where a line means nothing), words of the message.
DEFECTS: list[tuple[str, int | None, str]] = [
    ("analog.tsv", 9, "ANALOG"),
    ("blank_lines.tsv", 3, "ends before its first row"),
    ("bodies_left_handed.tsv", 11, "Upper head is not a rotation"),
    ("bodies_lost.tsv", None, "no body is seen"),
    ("bodies_no_rotation.tsv", 13, "Upper head is not a rotation"),
    ("bodies_too_few_columns.tsv", 11, "found 20 cells, expected 32"),
    ("data_2d.tsv", 9, "found 2D, expected 3D or 6D"),
    ("doubled_row.tsv", 16, "found 4 after 4"),
    ("empty.tsv", None, "empty"),
    ("event_without_time.tsv", 11, "event is incomplete"),
    ("external_timebase_without_times.tsv", 4, "does not say its frame rate"),
    ("frame_left_out.tsv", 16, "frame 6 after frame 4"),
    ("header_cut_off.tsv", 8, "ends before its first row"),
    ("header_only.tsv", 11, "ends before its first row"),
    ("impossible_position.tsv", None, "1e+09 mm"),
    ("infinite_number.tsv", 13, "head left X is infinite"),
    ("infinite_rate.tsv", 4, "rate is out of range"),
    ("keyword_twice.tsv", 11, "FREQUENCY comes twice"),
    ("long_row.tsv", 16, "found 18, expected 17"),
    ("marker_count_in_words.tsv", 3, "'five'"),
    ("missing_time.tsv", 15, "no time"),
    ("more_names_than_columns.tsv", 11, "found 15, expected 18"),
    ("negative_frame_count.tsv", 1, "'-12'"),
    ("negative_rate.tsv", 4, "-100 Hz"),
    ("no_marker_names.tsv", 3, "no MARKER_NAMES"),
    ("no_rate.tsv", None, "does not say its frame rate"),
    ("no_whole_row.tsv", 12, "cut off before its first row is complete"),
    ("numbers_only.tsv", 1, "Give the names"),
    ("only_gaps.tsv", None, "no marker is seen"),
    ("picture.tsv", None, "binary"),
    ("point_among_commas.tsv", 15, "decimal comma"),
    ("prose.tsv", 1, "not those of markers"),
    ("rate_against_times.tsv", 15, "120 Hz and 100 Hz, the frame at 0.046 s, expected 0.04 s"),
    ("rate_in_words.tsv", 4, "'fast'"),
    ("short_row.tsv", 16, "found 15, expected 17"),
    ("spaces_for_tabs.tsv", 12, "found 1, expected 17"),
    ("text_in_a_number.tsv", 14, "head_right Y is not a number (found 'l26.3' in column 7"),
    ("times_going_back.tsv", 15, "0.02 after 0.03"),
    ("too_few_trajectory_types.tsv", 11, "found 2, expected 5"),
    ("two_points_in_a_number.tsv", 12, "'370.0.1'"),
    ("uneven_times.tsv", 15, "evenly"),
    ("web_page.tsv", 1, "not those of markers"),
    ("wrong_marker_count.tsv", 3, "found 6 and 5 names"),
    ("wrong_title_count.tsv", 11, "found 14 titles, expected 17"),
    ("zero_byte.tsv", None, "binary"),
    ("zero_rate.tsv", 4, "found 0 Hz"),
    ("header_cut_off.trc", 2, "cut off in its header"),
    ("header_only.trc", 6, "no row of numbers"),
    ("marker_count_in_words.trc", 3, "'many'"),
    ("no_names_line.trc", 4, "marker names"),
    ("no_trc.trc", 1, "not a TRC file"),
    ("no_unit.trc", 2, "no Units"),
    ("rate_against_times.trc", 10, "50 Hz and 100 Hz, the frame at 0.046 s, expected 0.04 s"),
    ("rate_in_words.trc", 3, "'slow'"),
    ("short_row.trc", 10, "found 14, expected 17"),
    ("text_in_a_number.trc", 10, "'0.O40'"),
    ("unknown_unit.trc", 3, "'furlong'"),
    ("zero_rate.trc", 3, "found 0 Hz"),
    ("comments_only.csv", None, "no table"),
    ("long_row.csv", 5, "found 17, expected 16"),
    ("missing_time.csv", 5, "no time"),
    ("mixed_up_axes.csv", 1, "'chin_q'"),
    ("no_markers.csv", 1, "threes"),
    ("no_rate.csv", 1, "give the rate"),
    ("no_titles.csv", 1, "numbers, not column titles"),
    ("no_z.csv", 1, "threes"),
    ("one_column.csv", 1, "column titles"),
    ("one_frame_no_rate.csv", 2, "one frame does not tell the rate"),
    ("other_column.csv", 1, "'loudness'"),
    ("several_units.csv", 1, "m, mm"),
    ("short_row.csv", 5, "found 15, expected 16"),
    ("text_in_a_number.csv", 5, "is not a number"),
    ("titles_only.csv", 2, "no row of numbers"),
    ("uneven_times.csv", 7, "found 0.02 s after the frame before, expected 0.01 s"),
    ("unknown_unit.csv", 1, "'ell'"),
    ("motive_cut_off.csv", 4, "titles of the columns are missing"),
    ("motive_frame_left_out.csv", 11, "frame 4 after frame 2"),
    ("motive_no_markers.csv", 7, "found rigid body, expected Marker"),
    ("motive_no_titles.csv", 14, "titles of the columns are missing"),
    ("motive_no_unit.csv", 1, "expected Length Units"),
    ("motive_short_row.csv", 18, "found 44, expected 45"),
    ("motive_text_in_a_number.csv", 18, "chin position z is not a number"),
    ("motive_titles_only.csv", 8, "no row of numbers"),
    ("motive_unknown_unit.csv", 1, "'Furlongs'"),
    ("nexus_frame_left_out.csv", 9, "frame 5 after frame 3"),
    ("nexus_header_cut_off.csv", 3, "cut off in its header"),
    ("nexus_names_moved.csv", None, "found 7 names and 5 trajectories"),
    ("nexus_no_rows.csv", 6, "no row of numbers"),
    ("nexus_no_titles.csv", 4, "titles of the trajectories are missing"),
    ("nexus_no_trajectories.csv", None, "found devices, expected Trajectories"),
    ("nexus_rate_in_words.csv", 2, "'fast'"),
    ("nexus_several_units.csv", None, "mm, m"),
    ("nexus_text_in_a_number.csv", 9, "chin Z is not a number"),
    ("nexus_velocities.csv", 5, "'mm/s'"),
    ("nexus_zero_rate.csv", 2, "found 0 Hz"),
    ("broken_parameters.c3d", None, "chain of parameters"),
    ("contradictory_points.c3d", None, "12 frames of 144 or 80 bytes"),
    ("data_cut_off.c3d", None, "cut off in its data"),
    ("header_cut_off.c3d", None, "cut off in its header"),
    ("no_frames.c3d", None, "no frames"),
    ("no_points.c3d", None, "no markers"),
    ("only_gaps.c3d", None, "no marker is seen"),
    ("parameters_cut_off.c3d", None, "not where the header says"),
    ("unknown_processor.c3d", None, "processor"),
    ("unknown_unit.c3d", None, "'px'"),
    ("zero_rate.c3d", None, "found 0 Hz"),
    ("cut_off.parquet", None, "Parquet"),
    ("foreign.parquet", None, "mocap-fit"),
]

READER_OF = {
    ".tsv": "qualisys-tsv",
    ".trc": "trc",
    ".csv": "csv",
    ".c3d": "c3d",
    ".parquet": "parquet",
    "motive": "motive-csv",
    "nexus": "nexus-csv",
}

every_reader = pytest.mark.parametrize("reader", OWN)


def refused(path: Path, reader: str | None = None) -> MocapFitError:
    """The error for a file, which is a single line that names the file."""
    read = io.read if reader is None else READERS.get(reader).read
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(MocapFitError) as caught:
            read(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return caught.value


def test_every_defect_has_a_test(defects: Path) -> None:
    assert sorted(name for name, *_ in DEFECTS) == sorted(path.name for path in defects.iterdir())
    assert len(DEFECTS) >= 40


@pytest.mark.parametrize("named", [False, True], ids=["found", "named"])
@pytest.mark.parametrize(("name", "line", "words"), DEFECTS, ids=[name for name, *_ in DEFECTS])
def test_a_defect_is_told(
    name: str, line: int | None, words: str, named: bool, defects: Path
) -> None:
    path = defects / name
    reader = READER_OF.get(name.split("_")[0], READER_OF[path.suffix])
    error = refused(path, reader if named else None)
    assert words in str(error)
    assert error.line == line


@every_reader
@pytest.mark.parametrize("name", [name for name, *_ in DEFECTS])
def test_any_reader_refuses_any_defect(reader: str, name: str, defects: Path) -> None:
    assert READERS.get(reader).sniff(defects / name) in (True, False)
    refused(defects / name, reader)


@every_reader
def test_a_missing_file(reader: str, tmp_path: Path) -> None:
    path = tmp_path / "absent.tsv"
    assert "no such file" in str(refused(path, reader))
    assert "no such file" in str(refused(path))
    assert READERS.get(reader).sniff(path) is False


@every_reader
def test_a_folder(reader: str, tmp_path: Path) -> None:
    assert "folder" in str(refused(tmp_path, reader))
    assert READERS.get(reader).sniff(tmp_path) is False


@every_reader
def test_an_empty_file(reader: str, tmp_path: Path) -> None:
    path = tmp_path / "nothing"
    path.touch()
    assert "empty" in str(refused(path, reader))
    assert READERS.get(reader).sniff(path) is False


@every_reader
def test_an_impossible_path(reader: str) -> None:
    with pytest.raises(FileFormatError):
        READERS.get(reader).read("a\0b.tsv")
    with pytest.raises(FileFormatError):
        READERS.get(reader).read("x" * 5000)


@every_reader
@pytest.mark.skipif(sys.platform == "win32", reason="no pipes with names")
def test_a_pipe_is_not_waited_for(reader: str, tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    assert "ordinary file" in str(refused(path, reader))


@every_reader
@pytest.mark.skipif(
    sys.platform == "win32" or not hasattr(os, "geteuid") or os.geteuid() == 0,
    reason="this user may read everything",
)
def test_a_forbidden_file(reader: str, tmp_path: Path, recordings: Path) -> None:
    path = tmp_path / "secret.tsv"
    path.write_bytes((recordings / "qualisys_3d.tsv").read_bytes())
    path.chmod(0)
    assert "cannot be read" in str(refused(path, reader))


def test_an_unknown_format_is_told_with_the_known_ones(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    path.write_bytes(b"RIFF....AVI LIST")
    message = str(refused(path))
    assert "no reader takes this file" in message
    assert all(name in message for name in OWN)


@pytest.mark.parametrize("start", [b"", b"NO_OF_FRAMES\t3\nMARKER_NAMES\t", b"PathFileType\t4\n"])
@pytest.mark.parametrize("ending", [".tsv", ".csv", ".trc", ".c3d", ".parquet", ".xyz"])
def test_a_line_of_a_hundred_megabytes(ending: str, start: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"long{ending}"
    with path.open("wb") as file:
        file.write(start)
        file.seek(100 * 2**20)
        file.write(b"end\n")
        # A hole reads as zero bytes; letters where the readers look.
        file.seek(len(start))
        file.write(b"A" * (9 * 2**20))
    tracemalloc.start()
    begin = time.process_time()
    refused(path)
    took = time.process_time() - begin
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert took < 5
    assert peak < 60 * 2**20


@every_reader
@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(content=st.binary(min_size=1, max_size=2000))
def test_garbage(reader: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "garbage"
    path.write_bytes(content)
    assert READERS.get(reader).sniff(path) in (True, False)
    refused(path, reader)


@pytest.mark.parametrize(
    "name",
    [
        "qualisys_3d_version_2.tsv",
        "qualisys_6d.tsv",
        "opensim_metres.trc",
        "semicolons.csv",
        "two_rows.csv",
        "motive.csv",
        "nexus_subject_sections.csv",
        "points.c3d",
        "markers.parquet",
    ],
)
@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_damaged_recording_is_read_or_refused(
    name: str, data: st.DataObject, recordings: Path, tmp_path: Path
) -> None:
    content = bytearray((recordings / name).read_bytes())
    changes = st.tuples(st.integers(0, len(content) - 1), st.integers(0, 255))
    for place, value in data.draw(st.lists(changes, max_size=5)):
        content[place] = value
    path = tmp_path / name
    path.write_bytes(content[: data.draw(st.integers(1, len(content)))])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            frames, message = io.read(path).frames, ""
        except MocapFitError as error:
            frames, message = 0, str(error)
    assert (frames > 0) != (path.name in message)
    assert "\n" not in message
