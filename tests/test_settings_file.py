"""Settings in TOML files, by shipped name or by path."""

import copy
import pickle

import pytest
from pydantic import Field, ValidationError

from mocap_fit.errors import ConfigurationError, FileFormatError, MissingFileError
from mocap_fit.settings_file import StrictModel, list_shipped, load_settings


class Item(StrictModel):
    name: str
    weight: float = Field(default=1.0, gt=0)


class Shelf(StrictModel):
    items: tuple[Item, ...]
    rate: float | None = None


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with files of settings, in a folder and beside its code."""
    folder = tmp_path / "shop"
    (folder / "shelves").mkdir(parents=True)
    (folder / "__init__.py").write_text("")
    (folder / "plain.toml").write_text("items = []")
    (folder / "shelves" / "small.toml").write_text('items = [{ name = "cup" }]')
    (folder / "shelves" / "empty.toml").write_text("items = []")
    (folder / "shelves" / "notes.txt").write_text("")
    monkeypatch.syspath_prepend(str(tmp_path))
    return "shop"


def load(source, **options):
    return load_settings(Shelf, source, noun="shelf", **options)


def test_shipped_files_are_listed_and_loaded_by_name(package):
    assert list_shipped(package, "shelves") == ("empty", "small")
    assert list_shipped(package) == ("plain",)
    shelf = load("small", package=package, folder="shelves")
    assert shelf == Shelf(items=(Item(name="cup"),))
    assert load("plain", package=package) == Shelf(items=())


def test_files_are_loaded_by_path_with_and_without_shipped_ones(package, tmp_path):
    file = tmp_path / "my.toml"
    file.write_text("items = []\nrate = 60")
    assert load(file).rate == 60.0
    assert load(str(file), package=package, folder="shelves").rate == 60.0


def test_a_name_that_is_none_lists_the_shipped_ones(package, tmp_path):
    with pytest.raises(MissingFileError, match=r"^larg: there is no such shelf.*empty, small\.$"):
        load("larg", package=package, folder="shelves")
    with pytest.raises(FileNotFoundError, match=r"no such shelf\. Give a TOML file\.$"):
        load(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("content", "kind", "words"),
    [
        (b"items = ", ConfigurationError, "the shelf is not TOML"),
        (b"a = " + b"[" * 5000, ConfigurationError, "the shelf is not TOML"),
        (b"\xff\xfe", FileFormatError, "the shelf cannot be read"),
        (b"", ConfigurationError, "the shelf is wrong at items: this is missing"),
        (b"items = []\nsize = 1", ConfigurationError, "at size: there is no such setting"),
        (b"items = []\nrate = inf", ConfigurationError, "at rate: .*finite"),
        (b"items = 3", ConfigurationError, "at items: give a list, in square brackets"),
        (
            b'items = [{ name = "a" }, { weight = 2 }]',
            ConfigurationError,
            "at items.1.name: this is missing",
        ),
        (
            b'items = [{ name = "a" }, { name = "b", weight = 0 }]',
            ConfigurationError,
            "at items.1 'b'.weight: .*greater than 0",
        ),
    ],
)
def test_what_is_wrong_with_a_file_is_said_with_its_key(tmp_path, content, kind, words):
    file = tmp_path / "my.toml"
    file.write_bytes(content)
    with pytest.raises(kind, match=words) as caught:
        load(file)
    assert str(caught.value).startswith(f"{file}: ")


def test_settings_are_read_only_compared_and_copied():
    shelf = Shelf(items=(Item(name="cup"),))
    with pytest.raises(ValidationError, match="frozen"):
        shelf.rate = 1.0
    assert copy.deepcopy(shelf) == pickle.loads(pickle.dumps(shelf)) == shelf
    assert shelf != Shelf(items=())
