"""Qualisys TSV exports: every variant gives the truth that the fixtures were made from."""

import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io import qualisys_tsv, read_poses, read_tracks
from mocap_fit.tracks import Event, MarkerTracks, Origin

WHOLE = (
    "qualisys_3d",
    "qualisys_3d_bare",
    "qualisys_3d_untitled",
    "qualisys_3d_timeless",
    "qualisys_3d_version_2",
    "qualisys_3d_data_types",
    "qualisys_3d_windows_1252",
    "qualisys_3d_utf_8_mark",
    "qualisys_3d_utf_16",
    "qualisys_3d_old_mac",
    "qualisys_3d_external_timebase",
    "qualisys_3d_decimal_comma",
    "qualisys_3d_blank_gaps",
    "qualisys_3d_nan_gaps",
    "qualisys_3d_titles_only",
)
TIMELESS = ("qualisys_3d_bare", "qualisys_3d_timeless")


def export(path: Path, lines: list[str], ending: str = "\r\n") -> Path:
    path.write_bytes("".join(line + ending for line in lines).encode())
    return path


@pytest.mark.parametrize("name", WHOLE)
def test_every_variant_gives_the_truth(name: str, recordings: Path, made: ModuleType) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tracks = read_tracks(recordings / f"{name}.tsv")
    assert tracks.names == made.MARKERS
    assert tracks.rate == made.RATE
    assert tracks.start_time == (0.0 if name in TIMELESS else 0.01)
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=0, atol=1e-9)


def test_a_switched_off_header_needs_names_and_rate(recordings: Path, made: ModuleType) -> None:
    path = recordings / "qualisys_3d_no_header.tsv"
    with pytest.raises(FileFormatError, match=r"names=\[\.\.\.\]"):
        read_tracks(path)
    with pytest.raises(FileFormatError, match=r"rate=\.\.\."):
        read_tracks(path, names=made.MARKERS)
    tracks = read_tracks(path, names=made.MARKERS, rate=made.RATE)
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=0, atol=1e-9)


def test_without_header_the_times_tell_the_rate(made: ModuleType, tmp_path: Path) -> None:
    path = export(tmp_path / "numbers.tsv", made.rows())
    tracks = read_tracks(path, names=made.MARKERS)
    assert tracks.rate == made.RATE
    assert tracks.start_time == 0.01
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=0, atol=1e-9)


def test_trajectory_types_and_events(recordings: Path, made: ModuleType) -> None:
    tracks = read_tracks(recordings / "qualisys_3d_version_2.tsv")
    assert tracks.origin[0].tolist() == [
        Origin.MEASURED,
        Origin.MEASURED,
        Origin.FILLED,
        Origin.VIRTUAL,
        Origin.MEASURED,
    ]
    assert (tracks.origin[made.GAP] == Origin.MISSING).all()
    assert tracks.events == (Event("start", 0.0), Event("första ordet", 0.05))


def test_an_unknown_trajectory_type_is_told(made: ModuleType, tmp_path: Path) -> None:
    types = "TRAJECTORY_TYPES\t" + "\t".join(["Measured"] * 4 + ["Guessed"])
    path = export(tmp_path / "a.tsv", [*made.header(after=[types]), *made.rows()])
    with pytest.warns(MocapFitWarning, match=r"line 11: the trajectory type Guessed"):
        tracks = read_tracks(path)
    assert tracks.origin[0, 4] == Origin.MEASURED


def test_an_unknown_version_is_told(made: ModuleType, tmp_path: Path) -> None:
    lines = [*made.header(before=["FILE_VERSION\t3.1.0"]), *made.rows()]
    with pytest.warns(MocapFitWarning, match=r"version 3\.1\.0"):
        read_tracks(export(tmp_path / "a.tsv", lines))


def test_an_event_without_time_has_that_of_its_frame(made: ModuleType, tmp_path: Path) -> None:
    path = export(tmp_path / "a.tsv", [*made.header(after=["EVENT\tblink\t11"]), *made.rows()])
    assert read_tracks(path).events == (Event("blink", 0.1),)


def test_a_cut_off_recording_keeps_its_whole_rows(recordings: Path, made: ModuleType) -> None:
    with pytest.warns(MocapFitWarning, match=r"line 23: .* 11 complete rows .* announces 12"):
        tracks = read_tracks(recordings / "qualisys_3d_cut_off.tsv")
    np.testing.assert_allclose(tracks.positions, made.positions()[:11], rtol=0, atol=1e-9)
    with pytest.warns(MocapFitWarning, match=r"10 complete rows .* announces 12"):
        tracks = read_tracks(recordings / "qualisys_3d_cut_off_after_row.tsv")
    assert tracks.frames == 10


def test_a_cut_at_any_byte_never_changes_a_number(made: ModuleType, tmp_path: Path) -> None:
    whole = made.text([*made.header(), made.titles(), *made.rows()])
    truth = np.nan_to_num(made.positions())
    row = len(made.rows()[-1]) + 2
    path = tmp_path / "cut.tsv"
    for cut in range(len(whole) - 2 * row, len(whole)):
        path.write_bytes(whole[:cut])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tracks = read_tracks(path)
        assert tracks.frames in (10, 11, 12)
        difference = np.nan_to_num(tracks.positions) - truth[: tracks.frames]
        assert np.abs(difference).max() < 1e-9, cut


def test_more_rows_than_announced_are_kept_and_told(made: ModuleType, tmp_path: Path) -> None:
    path = export(tmp_path / "a.tsv", [*made.header(frames=10), made.titles(), *made.rows()])
    with pytest.warns(MocapFitWarning, match=r"12 complete rows .* announces 10"):
        assert read_tracks(path).frames == 12


def test_one_frame_is_a_recording(recordings: Path, made: ModuleType) -> None:
    tracks = read_tracks(recordings / "qualisys_3d_one_frame.tsv")
    np.testing.assert_allclose(tracks.positions, made.positions()[:1], rtol=0, atol=1e-9)


def test_no_line_end_after_the_last_row(made: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "a.tsv"
    path.write_bytes(made.text([*made.header(), made.titles(), *made.rows()])[:-2])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_tracks(path).frames == made.FRAMES


def test_a_zero_coordinate_is_no_gap(made: ModuleType, tmp_path: Path) -> None:
    values = made.positions()
    values[0, 0] = [0, 0, 5]
    values[1, 0] = [0, 0, 0]
    tracks = read_tracks(
        export(tmp_path / "a.tsv", [*made.header(), made.titles(), *made.rows(values=values)])
    )
    assert tracks.positions[0, 0].tolist() == [0, 0, 5]
    assert np.isnan(tracks.positions[1, 0]).all()


def test_a_row_of_gaps_without_frame_and_time(made: ModuleType, tmp_path: Path) -> None:
    values = made.positions()
    values[3] = np.nan
    lines = made.rows(gap="", frame_and_time=False, values=values)
    tracks = read_tracks(export(tmp_path / "a.tsv", [*made.header(), *lines]))
    assert tracks.frames == made.FRAMES
    assert not tracks.visible[3].any()


@pytest.mark.parametrize("rate", [24, 25, 29.97, 59.94, 60, 100, 120, 200, 240, 500, 120000 / 1001])
def test_the_rate_of_an_external_timebase_is_exact(
    rate: float, made: ModuleType, tmp_path: Path
) -> None:
    lines = [
        "\t".join([str(frame + 1), f"{(frame + 1) / rate:.5f}", *["1.000"] * 3])
        for frame in range(200)
    ]
    header = made.header(frames=200, markers=1, names=["m"], rate="EXT")
    path = export(tmp_path / "a.tsv", [*header, *lines])
    assert read_tracks(path).rate == pytest.approx(rate, rel=2e-6)


def test_an_odd_rate_of_an_external_timebase(made: ModuleType, tmp_path: Path) -> None:
    lines = [f"{frame + 1}\t{frame / 87.654:.5f}\t1.0\t2.0\t3.0" for frame in range(900)]
    header = made.header(frames=900, markers=1, names=["m"], rate="EXT")
    assert read_tracks(export(tmp_path / "a.tsv", [*header, *lines])).rate == pytest.approx(
        87.654, rel=1e-6
    )


def test_the_callers_rate_settles_a_contradiction(defects: Path) -> None:
    tracks = read_tracks(defects / "rate_against_times.tsv", rate=100)
    assert tracks.rate == 100.0
    assert tracks.provenance[0].arguments["rate"] == 100.0


def test_metres_are_suspected(made: ModuleType, tmp_path: Path) -> None:
    lines = [*made.header(), made.titles(), *made.rows(values=made.positions() / 1000)]
    with pytest.warns(MocapFitWarning, match=r"are these metres"):
        read_tracks(export(tmp_path / "a.tsv", lines))


@pytest.mark.parametrize("name", ["qualisys_6d", "qualisys_6d_frame_time"])
def test_bodies(name: str, recordings: Path, made: ModuleType) -> None:
    tracks = read_poses(recordings / f"{name}.tsv")
    rotations, translations, residuals = made.poses()
    assert tracks.names == made.BODIES
    assert tracks.rate == made.RATE
    np.testing.assert_allclose(tracks.rotations, rotations, atol=2e-5)
    np.testing.assert_allclose(tracks.translations, translations, atol=1e-9)
    np.testing.assert_allclose(tracks.residuals, residuals, atol=1e-9)
    assert np.isnan(tracks.rotations[made.LOST]).all()
    seen = tracks.rotations[~np.isnan(tracks.residuals)]
    np.testing.assert_allclose(
        seen @ seen.swapaxes(1, 2), np.broadcast_to(np.eye(3), seen.shape), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(seen), 1, atol=1e-12)


def test_a_body_lost_as_blanks(made: ModuleType, tmp_path: Path) -> None:
    lines = made.body_rows(blank_columns=True, frame_and_time=False)
    cells = lines[3].split("\t")
    cells[:16] = [""] * 16
    lines[3] = "\t".join(cells)
    tracks = read_poses(export(tmp_path / "a.tsv", [*made.body_header(), *lines]))
    assert np.isnan(tracks.rotations[3, 0]).all()
    assert not np.isnan(tracks.rotations[3, 1]).any()


def test_bodies_without_header(made: ModuleType, tmp_path: Path) -> None:
    lines = made.body_rows(blank_columns=True, frame_and_time=False)
    tracks = read_poses(export(tmp_path / "a.tsv", lines), names=made.BODIES, rate=100)
    np.testing.assert_allclose(tracks.translations, made.poses()[1], atol=1e-9)


def test_ten_thousand_names_are_a_header(made: ModuleType, tmp_path: Path) -> None:
    names = [f"a rather long name of a marker {index}" for index in range(2000)]
    header = made.header(frames=1, markers=2000, names=names)
    tracks = read_tracks(
        export(tmp_path / "a.tsv", [*header, made.titles(names), "1\t0.0\t" + "1.5\t" * 6000])
    )
    assert isinstance(tracks, MarkerTracks)
    assert tracks.names == tuple(names)


def test_sniff_wants_a_keyword_of_the_format(tmp_path: Path) -> None:
    assert not qualisys_tsv.sniff(export(tmp_path / "a.tsv", ["NO_OF_THINGS\t3"]))
    assert qualisys_tsv.sniff(export(tmp_path / "b.tsv", ["", "FILE_VERSION\t2.0.0"]))
