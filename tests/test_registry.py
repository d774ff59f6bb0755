"""The registry, with distributions that are made for the test and found as real ones are."""

import sys

import pytest

from mocap_fit.errors import DataError, FileFormatError, MocapFitWarning, RegistryError
from mocap_fit.registry import Registry

GROUP = "mocap_fit.test_plugins"


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Put a distribution with entry points and a module on the path."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def put(distribution: str, entries: dict[str, str], modules: dict[str, str] | None = None):
        folder = tmp_path / f"{distribution.replace('-', '_')}-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n"
        )
        lines = [f"[{GROUP}]", *(f"{name} = {value}" for name, value in entries.items())]
        (folder / "entry_points.txt").write_text("\n".join(lines) + "\n")
        for name, text in (modules or {}).items():
            (tmp_path / f"{name}.py").write_text(text)
            monkeypatch.delitem(sys.modules, name, raising=False)

    return put


def test_plug_ins_are_found_by_name_and_imported_when_first_asked_for(install):
    install(
        "lab-formats",
        {"vicon": "lab_vicon", "arena": "lab_arena:Reader"},
        {"lab_vicon": "kind = 'module'", "lab_arena": "class Reader:\n    kind = 'class'"},
    )
    registry = Registry(GROUP, "reader")
    assert registry.names() == ("arena", "vicon")
    assert registry.get_distribution("vicon") == "lab-formats"
    assert "lab_vicon" not in sys.modules
    assert registry.get("vicon").kind == "module"
    assert "lab_vicon" in sys.modules
    assert "lab_arena" not in sys.modules
    assert registry.get("arena") is registry.get("arena")
    assert registry.get("arena").kind == "class"


def test_an_unknown_name_is_an_error_that_lists_the_known_ones(install):
    install("lab-formats", {"vicon": "lab_vicon", "arena": "lab_arena"})
    with pytest.raises(RegistryError, match=r"no reader 'acclaim'.*one of arena, vicon.*spelling"):
        Registry(GROUP, "reader").get("acclaim")
    with pytest.raises(RegistryError, match="none installed"):
        Registry("mocap_fit.no_such_group", "rig").get("parke")
    assert Registry("mocap_fit.no_such_group", "rig").names() == ()


def test_two_distributions_that_claim_one_name_are_both_named(install):
    install("lab-one", {"vicon": "one_vicon"})
    install("lab-two", {"vicon": "two_vicon"})
    with pytest.raises(RegistryError) as caught:
        Registry(GROUP, "reader").names()
    message = str(caught.value)
    assert "'vicon'" in message
    assert "lab-one (one_vicon)" in message
    assert "lab-two (two_vicon)" in message
    assert "Uninstall one" in message


def test_the_same_entry_listed_twice_is_no_collision(install):
    install("lab-one", {"vicon": "one_vicon"}, {"one_vicon": "kind = 1"})
    install("lab-one-again", {"vicon": "one_vicon"})
    assert Registry(GROUP, "reader").get("vicon").kind == 1


@pytest.mark.parametrize(
    ("value", "text", "words"),
    [
        ("broken_module", "import no_such_module_anywhere", "ModuleNotFoundError"),
        ("broken_module", "1 / 0", "ZeroDivisionError"),
        ("broken_module", "def (", "SyntaxError"),
        ("broken_module:Nothing", "", "AttributeError"),
    ],
)
def test_a_plug_in_that_cannot_be_loaded_is_one_line_that_names_its_source(
    install, value, text, words
):
    install("lab-broken", {"broken": value}, {"broken_module": text})
    with pytest.raises(RegistryError) as caught:
        Registry(GROUP, "reader").get("broken")
    message = str(caught.value)
    assert "'broken' of lab-broken cannot be loaded" in message
    assert words in message
    assert "\n" not in message


def test_our_own_plug_ins_are_installed_and_load():
    readers = Registry("mocap_fit.readers", "reader")
    assert {"qualisys-tsv", "c3d", "trc", "csv", "parquet"} <= set(readers.names())
    for name in readers.names():
        assert callable(readers.get(name).read)
    rigs = Registry("mocap_fit.rigs", "rig")
    assert "parke" in rigs.names()
    assert rigs.get_distribution("parke") == "mocap-fit"


READER = """
extensions = {extensions!r}

def sniff(path):
    {sniff}

def read(path):
    {read}
"""


@pytest.fixture
def readers(install, tmp_path):
    """A registry of readers of one distribution, given what each does to know its files."""

    def put(distribution="lab-formats", **kinds):
        modules = {
            f"lab_{name}": READER.format(extensions=extensions, sniff=sniff, read="return path")
            for name, (extensions, sniff) in kinds.items()
        }
        install(distribution, {name: f"lab_{name}" for name in kinds}, modules)
        return Registry(GROUP, "reader")

    return put


def fail(registry, name, error):
    with registry.guard(name):
        raise error


def test_a_reader_is_found_by_content_then_by_extension_then_by_name(readers, tmp_path):
    file = tmp_path / "take.TSV"
    registry = readers(
        beta=((".csv",), "return path.suffix != '.log'"),
        alpha=((".csv",), "return path.suffix != '.log'"),
        gamma=((".tsv",), "return 'take' in path.name"),
        delta=((".log",), "return False"),
    )
    assert registry.find(file) == "gamma"
    assert registry.find(tmp_path / "take.xyz") == "alpha"
    assert registry.find(tmp_path / "other.xyz") == "alpha"
    # Nobody knows it, but one has its extension.
    assert registry.find(tmp_path / "other.log") == "delta"
    nothing = Registry("mocap_fit.no_such_group", "label reader")
    with pytest.raises(FileFormatError, match=r"take\.TSV: no label reader takes this file"):
        nothing.find(file)


def test_an_extension_of_several_readers_may_decide_or_not(readers, tmp_path):
    registry = readers(beta=((".lab",), "return False"), alpha=((".lab",), "return False"))
    file = tmp_path / "a.lab"
    assert registry.find(file) == "alpha"
    with pytest.raises(FileFormatError, match=r"expected alpha \(\.lab\), beta \(\.lab\)"):
        registry.find(file, ambiguous_extensions=False)
    with pytest.raises(FileFormatError, match="no reader takes"):
        registry.find(tmp_path / "a.txt")


def test_a_reader_that_fails_is_named_with_its_distribution(readers, tmp_path):
    registry = readers(broken=((".lab",), "return {}['key']"))
    with pytest.raises(RegistryError) as caught:
        registry.find(tmp_path / "a.lab")
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'a.lab'}: the reader 'broken' of lab-formats failed")
    assert "KeyError: 'key'" in message
    assert "authors of lab-formats" in message
    for error in (DataError("no marker"), PermissionError(13, "no"), MemoryError()):
        with pytest.raises(type(error)) as caught:
            fail(registry, "broken", error)
        assert caught.value is error
    with pytest.raises(RegistryError, match=r"^the reader 'broken' of lab-formats failed"):
        fail(registry, "broken", ValueError("no"))


def test_a_mistake_of_ours_stays_what_it_is(readers):
    registry = readers("mocap-fit", ours=((".lab",), "return True"))
    with pytest.raises(ZeroDivisionError):
        fail(registry, "ours", ZeroDivisionError())


def test_a_reader_that_cannot_be_loaded_is_passed_over(readers, install, tmp_path):
    registry = readers(good=((".lab",), "return True"))
    install("lab-broken", {"bad": "no_such_module_anywhere"})
    with pytest.warns(MocapFitWarning, match="'bad' of lab-broken cannot be loaded"):
        assert registry.find(tmp_path / "a.lab") == "good"
