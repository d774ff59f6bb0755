"""What the TSV writer writes, the reader reads."""

import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.io import read_tracks, write_qualisys_tsv
from mocap_fit.io.names import name_tracks
from mocap_fit.tracks import Event, MarkerTracks, Origin

VISIBLE_TEXT = st.text(
    st.characters(blacklist_categories=("Cc", "Cs", "Zl", "Zp"), blacklist_characters="\t\r\n"),
    min_size=1,
    max_size=12,
).filter(lambda text: text == text.strip())


@st.composite
def recordings_to_write(draw: st.DrawFn) -> MarkerTracks:
    names = draw(st.lists(VISIBLE_TEXT, min_size=1, max_size=4, unique=True))
    coordinate = st.one_of(
        st.floats(-5000, 5000), st.sampled_from([0.0, -0.0, 0.0004, -0.0004, 0.0005, 1e-9])
    )
    positions = draw(
        arrays.arrays(np.float64, (draw(st.integers(1, 6)), len(names), 3), elements=coordinate)
    )
    gaps = draw(arrays.arrays(bool, positions.shape[:2]))
    gaps[0, 0] = False
    positions[gaps] = np.nan
    rate = draw(st.one_of(st.integers(1, 2000), st.floats(0.5, 2000)))
    kinds = draw(
        st.lists(
            st.sampled_from([Origin.MEASURED, Origin.FILLED, Origin.VIRTUAL]),
            min_size=len(names),
            max_size=len(names),
        )
    )
    return MarkerTracks(
        tuple(names),
        rate,
        positions,
        np.broadcast_to(np.array(kinds, dtype=np.uint8), gaps.shape),
        start_time=draw(st.floats(0, 1000)),
        events=tuple(
            Event(name, time)
            for name, time in draw(
                st.lists(st.tuples(VISIBLE_TEXT, st.floats(0, 1000)), max_size=3)
            )
        ),
    )


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    tracks=recordings_to_write(),
    decimals=st.integers(3, 9),
    titles=st.booleans(),
    gaps=st.sampled_from(["zero", "blank", "nan"]),
)
def test_round_trip(
    tracks: MarkerTracks, decimals: int, titles: bool, gaps: str, tmp_path: Path
) -> None:
    path = tmp_path / "recording.tsv"
    write_qualisys_tsv(tracks, path, decimals=decimals, titles=titles, gaps=gaps)  # type: ignore[arg-type]
    with warnings.catch_warnings():
        # Hypothesis likes markers that are near each other: "are these metres?"
        warnings.simplefilter("ignore")
        # A prefix that all names share goes, as that of a subject.
        expected = name_tracks(tracks.names, path=path).names
        back = read_tracks(path)
    assert back.names == expected
    assert back.rate == tracks.rate
    np.testing.assert_array_equal(back.visible, tracks.visible)
    np.testing.assert_array_equal(back.origin, tracks.origin)
    difference = np.abs(back.positions - tracks.positions)[tracks.visible]
    assert difference.max() <= 0.5 * 10.0**-decimals * (1 + 1e-6) + 1e-12
    assert back.start_time == pytest.approx(tracks.start_time, abs=1e-5)
    assert [event.name for event in back.events] == [event.name for event in tracks.events]
    np.testing.assert_allclose(
        [event.time for event in back.events], [event.time for event in tracks.events], atol=1e-5
    )


def test_the_file_is_what_qtm_writes(made: ModuleType, tmp_path: Path) -> None:
    tracks = MarkerTracks(
        ("a b", "ö"), 120, [[[1, 2, 3], [np.nan] * 3], [[4, 5, 6.5], [-7, 0, 8]]], start_time=0.01
    )
    path = tmp_path / "a.tsv"
    write_qualisys_tsv(tracks, path, trajectory_types=False)
    lines = path.read_bytes().decode().split("\r\n")
    assert lines == [
        "NO_OF_FRAMES\t2",
        "NO_OF_CAMERAS\t0",
        "NO_OF_MARKERS\t2",
        "FREQUENCY\t120",
        "NO_OF_ANALOG\t0",
        "ANALOG_FREQUENCY\t0",
        "DESCRIPTION\t--",
        "DATA_INCLUDED\t3D",
        "MARKER_NAMES\ta b\tö",
        "Frame\tTime\ta b X\ta b Y\ta b Z\tö X\tö Y\tö Z",
        "1\t0.01000\t1.000\t2.000\t3.000\t0.000\t0.000\t0.000",
        "2\t0.01833\t4.000\t5.000\t6.500\t-7.000\t0.000\t8.000",
        "",
    ]


def test_a_recording_written_again_is_the_same(recordings: Path, tmp_path: Path) -> None:
    tracks = read_tracks(recordings / "qualisys_3d_version_2.tsv")
    first, second = tmp_path / "first.tsv", tmp_path / "second.tsv"
    write_qualisys_tsv(tracks, first)
    write_qualisys_tsv(read_tracks(first), second)
    assert first.read_bytes() == second.read_bytes()


def test_without_frame_and_time(made: ModuleType, tmp_path: Path) -> None:
    tracks = MarkerTracks(made.MARKERS, 100, made.positions(), start_time=3)
    write_qualisys_tsv(tracks, tmp_path / "a.tsv", frame_and_time=False, gaps="blank")
    back = read_tracks(tmp_path / "a.tsv")
    assert back.start_time == 0
    np.testing.assert_allclose(back.positions, tracks.positions, atol=1e-9)


def test_several_origins_are_mixed(tmp_path: Path) -> None:
    tracks = MarkerTracks(
        ("a",), 50, np.ones((2, 1, 3)), np.array([[Origin.MEASURED], [Origin.FILLED]])
    )
    write_qualisys_tsv(tracks, tmp_path / "a.tsv")
    assert "TRAJECTORY_TYPES\tMixed" in (tmp_path / "a.tsv").read_text()
    assert (read_tracks(tmp_path / "a.tsv").origin == Origin.MEASURED).all()


def test_a_point_at_the_origin_stays_visible(tmp_path: Path) -> None:
    tracks = MarkerTracks(("a", "b"), 50, [[[0, 0, 0], [0.0001, -0.0003, 0]]])
    write_qualisys_tsv(tracks, tmp_path / "a.tsv")
    back = read_tracks(tmp_path / "a.tsv")
    assert back.visible.all()
    assert np.abs(back.positions - tracks.positions).max() < 0.0005


@pytest.mark.parametrize("name", ["a\tb", "a\nb", " a", "a ", "a\x00b", ""])
def test_a_name_that_would_break_the_file(name: str, tmp_path: Path) -> None:
    tracks = MarkerTracks((name,), 50, np.ones((1, 1, 3)))
    with pytest.raises(DataError):
        write_qualisys_tsv(tracks, tmp_path / "a.tsv")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("setting", [{"decimals": 0}, {"decimals": 20}, {"gaps": "stars"}])
def test_an_impossible_setting(setting: dict[str, object], tmp_path: Path) -> None:
    tracks = MarkerTracks(("a",), 50, np.ones((1, 1, 3)))
    with pytest.raises(DataError):
        write_qualisys_tsv(tracks, tmp_path / "a.tsv", **setting)  # type: ignore[arg-type]


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    tracks = MarkerTracks(("a",), 50, np.ones((1, 1, 3)))
    with pytest.raises(FileFormatError, match=r"cannot be written"):
        write_qualisys_tsv(tracks, tmp_path / "absent" / "a.tsv")
    (tmp_path / "taken").mkdir()
    with pytest.raises(FileFormatError, match=r"cannot be written"):
        write_qualisys_tsv(tracks, tmp_path / "taken")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
