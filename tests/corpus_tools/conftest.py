"""A small simulated session that the tests of the commands share."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from corpus_tools.cli import app as cli
from mocap_fit.io import READERS
from mocap_fit.labels import LABEL_READERS


@dataclass(frozen=True)
class Folder:
    """A folder that `mocap-fit simulate` wrote."""

    path: Path
    layout: str = "face30-head5"

    @property
    def reference(self) -> Path:
        return self.path / "reference.tsv"

    @property
    def recordings(self) -> list[Path]:
        return sorted((self.path / "recordings").iterdir())

    @property
    def truth(self) -> list[Path]:
        return sorted((self.path / "truth" / "tracks").iterdir())

    @property
    def poses(self) -> list[Path]:
        return sorted((self.path / "truth" / "head").iterdir())


def simulated(path: Path, *options: object) -> Folder:
    given = [str(option) for option in options]
    if "--duration" not in given:
        given += ["--duration", "0.5"]
    assert cli.main(["simulate", str(path), *given]) == 0
    return Folder(path)


@pytest.fixture(scope="session")
def simulate() -> Callable[..., Folder]:
    """Run the command: a folder and options; half a second a recording where not told otherwise."""
    return simulated


@pytest.fixture(scope="session")
def session(tmp_path_factory) -> Folder:
    """Two recordings of half a second; not to be changed."""
    return simulated(tmp_path_factory.mktemp("simulated") / "session", "--utterances", 2)


@pytest.fixture(scope="session")
def lab(tmp_path_factory) -> Path:
    """Three simulated sentences as a lab has them, with a manifest; not to be changed."""
    path = tmp_path_factory.mktemp("lab") / "lab"
    options = ["--utterances", "3", "--rate", "30"]
    assert cli.main(["simulate", str(path), *options]) == 0
    return path


@pytest.fixture(scope="session")
def lab_corpus(lab, tmp_path_factory) -> Path:
    """The corpus of the lab; not to be changed."""
    out = tmp_path_factory.mktemp("lab_corpus") / "new" / "corpus"
    assert cli.main(["convert", str(lab), "--out", str(out)]) == 0
    return out


@pytest.fixture
def crash_reader(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plug-in reader for files that end their reader; processes that are started have it too."""
    monkeypatch.syspath_prepend(Path(__file__).parent / "plug_in")
    for registry in (READERS, LABEL_READERS):
        monkeypatch.setattr(registry, "_entries", None)
        monkeypatch.setattr(registry, "_loaded", {})
