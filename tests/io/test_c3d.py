"""C3D files: points, units, subjects, residuals, events, many labels."""

import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io import read_tracks
from mocap_fit.tracks import Event, Origin


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def test_points(recordings: Path, made: ModuleType) -> None:
    tracks = read_tracks(recordings / "points.c3d")
    assert tracks.names == made.PLAIN_MARKERS
    assert tracks.rate == made.RATE
    assert tracks.start_time == 0
    # C3D stores single precision.
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=1e-6)
    assert (tracks.origin[made.GAP] == Origin.MISSING).all()


def test_a_zero_residual_without_cameras_is_filled(recordings: Path) -> None:
    tracks = read_tracks(recordings / "points.c3d")
    filled = np.argwhere(tracks.origin == Origin.FILLED)
    assert filled.tolist() == [[2, 0]]


def test_residuals_that_are_all_zero_say_nothing(recordings: Path) -> None:
    tracks = read_tracks(recordings / "two_subjects.c3d", subject="Bo")
    assert set(np.unique(tracks.origin)) == {Origin.MISSING, Origin.MEASURED}


def test_events_have_contexts_and_seconds(recordings: Path) -> None:
    tracks = read_tracks(recordings / "points.c3d")
    assert [event.name for event in tracks.events] == ["start", "Left blink"]
    # One minute and 0.05 s.
    assert tracks.events[0] == Event("start", 0.0)
    assert tracks.events[1].time == pytest.approx(60.05)


def test_metres_become_millimetres_and_the_first_frame_a_time(
    recordings: Path, made: ModuleType
) -> None:
    tracks = read_tracks(recordings / "subject_metres.c3d")
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=1e-6)
    assert tracks.start_time == 0.5
    assert tracks.provenance[0].arguments["unit"] == "m"


@pytest.mark.parametrize(("unit", "factor"), [("cm", 10), ("in", 25.4), ("MM", 1)])
def test_units(unit: str, factor: float, made: ModuleType, tmp_path: Path) -> None:
    path = write(tmp_path / "a.c3d", made.c3d(tmp_path, unit=unit))
    np.testing.assert_allclose(read_tracks(path).positions, factor * made.positions(), rtol=1e-6)


def test_a_missing_unit_is_taken_for_millimetres_and_told(made: ModuleType, tmp_path: Path) -> None:
    path = write(tmp_path / "a.c3d", made.c3d(tmp_path, unit=""))
    with pytest.warns(MocapFitWarning, match=r"does not say its unit"):
        tracks = read_tracks(path)
    np.testing.assert_allclose(tracks.positions, made.positions(), rtol=1e-6)


def test_one_subject_is_left_out_of_the_names(recordings: Path, made: ModuleType) -> None:
    tracks = read_tracks(recordings / "subject_metres.c3d")
    assert tracks.names == made.PLAIN_MARKERS
    assert tracks.provenance[0].arguments["subject"] == "Anna"


def test_one_of_two_subjects_is_read(recordings: Path) -> None:
    with pytest.raises(FileFormatError, match=r"'chin' of Anna and of Bo.*--subject Bo"):
        read_tracks(recordings / "two_subjects.c3d")
    tracks = read_tracks(recordings / "two_subjects.c3d", subject="Bo")
    assert tracks.names == ("chin", "nose", "brow", "ear")
    assert tracks.provenance[0].arguments["subject"] == "Bo"


def test_more_labels_than_one_parameter_holds(recordings: Path) -> None:
    tracks = read_tracks(recordings / "many_labels.c3d")
    assert tracks.names == tuple(f"m{index}" for index in range(260))
    assert tracks.positions[0, 259].tolist() == [260, 260, 260]


def test_blank_labels_get_names(made: ModuleType, tmp_path: Path) -> None:
    path = write(tmp_path / "a.c3d", made.c3d(tmp_path, names=["a", "", "b", "", "c"]))
    assert read_tracks(path).names == ("a", "unlabelled 2", "b", "unlabelled 4", "c")


def test_angles_are_no_positions(made: ModuleType, tmp_path: Path) -> None:
    import ezc3d

    path = write(tmp_path / "a.c3d", made.c3d(tmp_path))
    content = ezc3d.c3d(str(path))
    content.add_parameter("POINT", "ANGLES", ["chin", "head left"])
    content.write(str(path))
    with pytest.warns(MocapFitWarning, match=r"left out.*head left, chin"):
        tracks = read_tracks(path)
    assert tracks.names == ("head_right", "HEAD TOP", "nasa")


@pytest.mark.parametrize("seed", range(4))
def test_damage_does_not_end_the_program(seed: int, recordings: Path, tmp_path: Path) -> None:
    """Bytes changed in header and parameters, which ezc3d does not survive."""
    from mocap_fit.errors import MocapFitError

    rng = np.random.default_rng(seed)
    content = np.frombuffer((recordings / "points.c3d").read_bytes(), dtype=np.uint8)
    outcomes = set()
    for _ in range(60):
        damaged = content.copy()
        places = rng.integers(0, 1800, size=rng.integers(1, 12))
        damaged[places] = rng.integers(0, 256, size=len(places))
        path = write(tmp_path / "a.c3d", damaged.tobytes())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                outcomes.add(read_tracks(path).frames)
            except MocapFitError:
                outcomes.add(0)
    assert 0 in outcomes
    assert outcomes <= {0, 12}
