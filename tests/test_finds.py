"""What fuzzing found: each ends in one error in words, or is read, and never again otherwise."""

import warnings
from pathlib import Path

import pytest

from mocap_fit.control import load
from mocap_fit.errors import MocapFitError, MocapFitWarning
from mocap_fit.io import read, write_tracks

FINDS = sorted((Path(__file__).parents[1] / "fixtures" / "finds").iterdir())


def use(path: Path, copy: Path) -> None:
    if path.suffix == ".model":
        load(path)
    write_tracks(read(path), copy)


@pytest.mark.parametrize("path", FINDS, ids=[path.name for path in FINDS])
def test_a_find_of_the_fuzzer_is_read_or_refused_in_words(path: Path, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", MocapFitWarning)
        with pytest.raises(MocapFitError, match=r"\((found|expected) "):
            use(path, tmp_path / "copy.tsv")
