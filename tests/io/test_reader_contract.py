"""What every reader owes, run over all that are registered and all recordings made for them."""

import json
import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from mocap_fit import io
from mocap_fit.errors import (
    DataError,
    FileFormatError,
    MocapFitError,
    MocapFitWarning,
    RegistryError,
)
from mocap_fit.io import READERS
from mocap_fit.tracks import MarkerTracks, ParameterTracks, PoseTracks, Tracks

OWN = ("c3d", "csv", "motive-csv", "nexus-csv", "parquet", "qualisys-tsv", "trc")

# Files that do not say all of themselves, and what the caller says.
SAID = {
    "qualisys_3d_no_header.tsv": {"names": ["a", "b", "c", "d", "e"], "rate": 100.0},
    "timeless.csv": {"rate": 100.0},
    "two_subjects.c3d": {"subject": "Bo"},
}

# Files that say nothing about the rate, or are read as they were written.
SILENT = ("timeless.csv", "qualisys_3d_no_header.tsv", "markers.parquet", "poses.parquet")
SILENT += ("parameters.parquet",)

RECORDINGS = {
    "qualisys-tsv": (
        "qualisys_3d.tsv",
        "qualisys_3d_bare.tsv",
        "qualisys_3d_untitled.tsv",
        "qualisys_3d_timeless.tsv",
        "qualisys_3d_version_2.tsv",
        "qualisys_3d_data_types.tsv",
        "qualisys_3d_windows_1252.tsv",
        "qualisys_3d_utf_8_mark.tsv",
        "qualisys_3d_utf_16.tsv",
        "qualisys_3d_old_mac.tsv",
        "qualisys_3d_external_timebase.tsv",
        "qualisys_3d_decimal_comma.tsv",
        "qualisys_3d_blank_gaps.tsv",
        "qualisys_3d_nan_gaps.tsv",
        "qualisys_3d_titles_only.tsv",
        "qualisys_3d_no_header.tsv",
        "qualisys_3d_one_frame.tsv",
        "qualisys_3d_cut_off.tsv",
        "qualisys_3d_cut_off_after_row.tsv",
        "qualisys_6d.tsv",
        "qualisys_6d_frame_time.tsv",
    ),
    "trc": ("motion_analysis.trc", "opensim_metres.trc"),
    "csv": (
        "commas.csv",
        "semicolons.csv",
        "tabs.csv",
        "two_rows.csv",
        "quoted_milliseconds.csv",
        "metres.csv",
        "timeless.csv",
    ),
    "motive-csv": (
        "motive.csv",
        "motive_subject_metres.csv",
        "motive_expected.csv",
        "motive_spreadsheet.csv",
    ),
    "nexus-csv": (
        "nexus.csv",
        "nexus_subject_sections.csv",
        "nexus_ascii.txt",
        "nexus_old.csv",
        "nexus_spreadsheet.csv",
    ),
    "c3d": (
        "points.c3d",
        "subject_metres.c3d",
        "two_subjects.c3d",
        "many_labels.c3d",
        "dec_floats.c3d",
        "mips_integers.c3d",
    ),
    "parquet": ("markers.parquet", "poses.parquet", "parameters.parquet"),
}
PAIRS = [(reader, name) for reader, names in RECORDINGS.items() for name in names]
UNMARKED = {"qualisys_3d_no_header.tsv"}  # Numbers alone: nothing to recognise.

every_recording = pytest.mark.parametrize(("reader", "name"), PAIRS)
every_reader = pytest.mark.parametrize("reader", OWN)


def quiet_read(path: Path, **arguments: object) -> Tracks:
    """Read without the warnings that some of the files are made to give."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return io.read(path, **{**SAID.get(path.name, {}), **arguments})  # type: ignore[arg-type]


def test_own_readers_are_registered() -> None:
    assert set(OWN) <= set(READERS.names())


def test_every_recording_has_a_test(recordings: Path) -> None:
    assert sorted(name for _, name in PAIRS) == sorted(path.name for path in recordings.iterdir())


@every_reader
def test_a_reader_describes_itself(reader: str) -> None:
    module = READERS.get(reader)
    assert reader == module.NAME
    assert module.description
    assert module.extensions
    assert all(ending.startswith(".") and ending.islower() for ending in module.extensions)


@every_recording
def test_sniff_takes_its_own_and_refuses_all_others(
    reader: str, name: str, recordings: Path
) -> None:
    takers = {other for other in OWN if READERS.get(other).sniff(recordings / name)}
    assert takers == (set() if name in UNMARKED else {reader})


@every_recording
def test_the_reader_is_found(reader: str, name: str, recordings: Path) -> None:
    assert io.find_reader(recordings / name) == reader


@every_recording
def test_the_reader_is_found_under_a_misleading_name(
    reader: str, name: str, recordings: Path, tmp_path: Path
) -> None:
    if name in UNMARKED:
        pytest.skip("a file of numbers alone is known by its ending only")
    other = tmp_path / "recording.c3d"
    other.write_bytes((recordings / name).read_bytes())
    assert io.find_reader(other) == reader


@every_recording
def test_tracks_are_whole(reader: str, name: str, recordings: Path) -> None:
    tracks = quiet_read(recordings / name)
    if isinstance(tracks, MarkerTracks):
        arrays = [tracks.positions]
        assert tracks.visible.any()
        assert not (tracks.visible & np.isnan(tracks.positions).any(axis=2)).any()
    elif isinstance(tracks, PoseTracks):
        arrays = [tracks.rotations, tracks.translations, tracks.residuals]
    else:
        arrays = [tracks.values]
    for array in arrays:
        assert array.dtype == np.float64
        assert len(array) == tracks.frames
        assert not np.isinf(array).any()
    assert tracks.rate == 100.0
    assert tracks.name == Path(name).stem
    if reader != "parquet":
        assert [step.name for step in tracks.provenance] == ["read"]
        assert tracks.provenance[0].arguments["reader"] == reader
        assert tracks.provenance[0].arguments["file"] == name
        assert str(recordings) not in json.dumps(tracks.provenance[0].to_dict())


@every_recording
def test_names_and_rate_of_the_caller_win(reader: str, name: str, recordings: Path) -> None:
    count = len(quiet_read(recordings / name).names)
    names = [f"track {index}" for index in range(count)]
    tracks = quiet_read(recordings / name, names=names, rate=60.0)
    assert tracks.names == tuple(names)
    assert tracks.rate == 60.0
    assert tracks.provenance[-1].arguments["rate"] == 60.0
    if name not in SILENT:
        with pytest.warns(MocapFitWarning, match=f"{name}: the file says 100 Hz; 60 Hz is used"):
            io.read(recordings / name, **{**SAID.get(name, {}), "rate": 60.0})  # type: ignore[arg-type]
    assert tracks.provenance[-1].arguments["names"] == names


@every_recording
@pytest.mark.parametrize("rate", [0.0, -50.0, float("nan"), float("inf")])
def test_an_impossible_rate_of_the_caller_is_refused(
    reader: str, name: str, rate: float, recordings: Path
) -> None:
    with pytest.raises(MocapFitError, match=name):
        quiet_read(recordings / name, rate=rate)


@every_recording
def test_a_wrong_number_of_names_is_refused(reader: str, name: str, recordings: Path) -> None:
    with pytest.raises(MocapFitError, match=name):
        quiet_read(recordings / name, names=["one", "two", "three"])


@every_recording
def test_the_unit_of_the_caller_wins(reader: str, name: str, recordings: Path) -> None:
    if name == "parameters.parquet":
        with pytest.raises(FileFormatError, match="parameters have no unit of length"):
            quiet_read(recordings / name, unit="m")
        return
    millimetres, metres = (quiet_read(recordings / name, unit=unit) for unit in ("mm", "m"))
    np.testing.assert_allclose(metres.main_array, 1000 * millimetres.main_array, rtol=1e-12)
    assert metres.provenance[-1].arguments["unit"] == "m"
    with pytest.raises(FileFormatError, match=f"{name}.*the unit of length is not known.*'ell'"):
        quiet_read(recordings / name, unit="ell")


@every_recording
def test_a_subject_that_no_name_has_is_warned_of(reader: str, name: str, recordings: Path) -> None:
    if "subject" in name:
        with pytest.raises(FileFormatError, match=f"{name}.*: the file has no such subject"):
            quiet_read(recordings / name, subject="Ann")
        return
    with pytest.warns(MocapFitWarning, match=f"{name}: no .* name has a subject"):
        io.read(recordings / name, **{**SAID.get(name, {}), "subject": "Ann"})  # type: ignore[arg-type]


@every_recording
def test_tracks_are_renamed(reader: str, name: str, recordings: Path) -> None:
    tracks = quiet_read(recordings / name)
    first = tracks.names[0]
    renamed = quiet_read(recordings / name, rename={first: "another"})
    assert renamed.names == ("another", *tracks.names[1:])
    np.testing.assert_array_equal(renamed.main_array, tracks.main_array)
    assert renamed.provenance[-1].arguments == {"names": {first: "another"}}
    with pytest.raises(DataError, match=f"{name}: there is no .* 'absent' to rename .found"):
        quiet_read(recordings / name, rename={"absent": "another"})


@every_recording
def test_twice_read_is_the_same(reader: str, name: str, recordings: Path) -> None:
    first, second = quiet_read(recordings / name), quiet_read(recordings / name)
    assert first.provenance == second.provenance
    assert first.events == second.events
    if isinstance(first, MarkerTracks):
        np.testing.assert_array_equal(first.positions, second.positions)  # type: ignore[union-attr]


@every_recording
def test_describe_is_plain(reader: str, name: str, recordings: Path) -> None:
    if name in SAID:
        pytest.skip("does not say its names or its rate")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        told = io.describe(recordings / name)
    tracks = quiet_read(recordings / name)
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert told["format"] == reader
    assert told["frames"] == tracks.frames
    assert told["duration"] == pytest.approx(tracks.frames / 100)
    noun = {"markers": "markers", "poses": "bodies", "parameters": "parameters"}[told["content"]]
    assert [entry["name"] for entry in told[noun]] == list(tracks.names)
    assert all(0 <= entry["gap_rate"] <= 1 for entry in told[noun])


def test_describe_tells_gaps_and_events(recordings: Path, made: ModuleType) -> None:
    told = io.describe(recordings / "qualisys_3d_version_2.tsv")
    rates = {entry["name"]: entry["gap_rate"] for entry in told["markers"]}
    assert rates.pop("näsa") == pytest.approx(2 / made.FRAMES)
    assert set(rates.values()) == {0.0}
    assert told["events"][1] == {"name": "första ordet", "time": 0.05}
    assert told["units"] == "mm"


@every_reader
@pytest.mark.parametrize("other", OWN)
def test_a_reader_refuses_files_of_another(reader: str, other: str, recordings: Path) -> None:
    if reader == other:
        pytest.skip("its own")
    # A row of titles above numbers is a CSV table too, if one asks for that.
    for name in set(RECORDINGS[other]) - {"qualisys_3d_titles_only.tsv"}:
        with pytest.raises(MocapFitError, match=name) as caught:
            READERS.get(reader).read(recordings / name)
        assert "\n" not in str(caught.value)


def test_markers_are_asked_for(recordings: Path) -> None:
    assert isinstance(io.read_tracks(recordings / "points.c3d"), MarkerTracks)
    with pytest.raises(DataError, match=r"read_poses"):
        io.read_tracks(recordings / "qualisys_6d.tsv")
    with pytest.raises(DataError, match=r"parameters"):
        io.read_tracks(recordings / "parameters.parquet")


def test_poses_are_asked_for(recordings: Path) -> None:
    assert isinstance(io.read_poses(recordings / "qualisys_6d.tsv"), PoseTracks)
    assert isinstance(io.read(recordings / "parameters.parquet"), ParameterTracks)
    with pytest.raises(DataError, match=r"read_tracks"):
        io.read_poses(recordings / "qualisys_3d.tsv")


def test_a_reader_can_be_chosen(recordings: Path) -> None:
    with pytest.raises(FileFormatError, match=r"not a C3D file"):
        io.read(recordings / "qualisys_3d.tsv", reader="c3d")
    with pytest.raises(RegistryError, match=r"no reader 'excel'"):
        io.read(recordings / "qualisys_3d.tsv", reader="excel")


def test_the_ending_decides_between_two_that_take_a_file(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    greedy = type("Greedy", (), {"description": "all", "extensions": (".xyz",)})()
    greedy.sniff = lambda path: True
    known = {name: READERS.get(name) for name in OWN} | {"a-greedy-one": greedy}
    monkeypatch.setattr(READERS, "names", lambda: tuple(sorted(known)))
    monkeypatch.setattr(READERS, "get", known.__getitem__)
    assert io.find_reader(recordings / "qualisys_3d.tsv") == "qualisys-tsv"
    copy = tmp_path / "copy.xyz"
    copy.write_bytes((recordings / "qualisys_3d.tsv").read_bytes())
    assert io.find_reader(copy) == "a-greedy-one"
