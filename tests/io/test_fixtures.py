"""The fixtures are what their script makes."""

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from mocap_fit.io import read_tracks


def test_the_script_makes_the_same_files(
    made: ModuleType, recordings: Path, defects: Path, tmp_path: Path
) -> None:
    made.make(tmp_path)
    for folder in (recordings, defects):
        fresh = {path.name: path.read_bytes() for path in (tmp_path / folder.name).iterdir()}
        kept = {path.name: path.read_bytes() for path in folder.iterdir()}
        assert fresh.keys() == kept.keys()
        # Parquet and C3D name the version of the library that wrote them.
        texts = {name for name in kept if not name.endswith((".parquet", ".c3d"))}
        assert [name for name in texts if fresh[name] != kept[name]] == []


@pytest.mark.parametrize("name", ["points.c3d", "markers.parquet"])
def test_the_script_makes_the_same_tracks(
    name: str, made: ModuleType, recordings: Path, tmp_path: Path
) -> None:
    made.make(tmp_path)
    fresh, kept = read_tracks(tmp_path / "recordings" / name), read_tracks(recordings / name)
    np.testing.assert_array_equal(fresh.positions, kept.positions)
    assert fresh.events == kept.events


def test_they_are_small(recordings: Path, defects: Path) -> None:
    sizes = [path.stat().st_size for folder in (recordings, defects) for path in folder.iterdir()]
    assert max(sizes) < 40_000
    assert sum(sizes) < 500_000
