"""Names from labels: subjects, blank and doubled labels, renaming; the same in every format."""

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mocap_fit as mf
from mocap_fit.errors import DataError, FileFormatError, MocapFitWarning
from mocap_fit.io.names import TrackNames, find_doubled, name_tracks, rename_tracks, suggest_names
from mocap_fit.tracks import MarkerTracks

sys.path.insert(0, str(Path(__file__).parents[2] / "fixtures"))
from c3d_files import c3d

FILE = Path("take.x")


def names_of(labels: list[str], **options: object) -> tuple[str, ...]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return name_tracks(labels, path=FILE, **options).names  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("labels", "names"),
    [
        (["Ann:chin", "Ann:lip"], ["chin", "lip"]),
        (["Ann:chin", "Ann : lip", "*110"], ["chin", "lip", "*110"]),
        (["Ann:chin", "Ann:*110", "*111"], ["chin", "*110", "*111"]),
        (["Ann:chin", "", "Ann:lip"], ["chin", "unlabelled 2", "lip"]),
        (["Ann:chin", "Unlabeled 1007"], ["chin", "Unlabeled 1007"]),
        (["Ann:chin", "Bo:lip"], ["Ann:chin", "Bo:lip"]),
        (["Ann:chin", "lip"], ["Ann:chin", "lip"]),
        (["Ann:chin", "chin"], ["Ann:chin", "chin"]),
        (["Ann:*1", "Bo:*1", "nose"], ["Ann:*1", "Bo:*1", "nose"]),
        (["chin:", ":lip"], ["chin:", ":lip"]),
        (["*1", "*2", ""], ["*1", "*2", "unlabelled 3"]),
        ([" chin ", "lip"], ["chin", "lip"]),
    ],
)
def test_prefixes(labels: list[str], names: list[str]) -> None:
    assert names_of(labels) == tuple(names)


def test_equal_names_of_two_subjects() -> None:
    labels = ["Ann:chin", "Bo:chin", "Bo:lip", "*3", "Ann:chin"]
    words = r"line 4: two subjects have a marker of the same name \(found 'chin' of Ann and of Bo"
    with pytest.raises(FileFormatError, match=words):
        name_tracks(labels, path=FILE, line=4)
    used = name_tracks(labels, path=FILE, subject="Bo")
    assert used == TrackNames(tuple(labels), ("chin", "lip"), (1, 2), "Bo")
    assert names_of(labels, names=list("abcde")) == tuple("abcde")
    assert names_of(labels, names=["a", "b"], subject="Bo") == ("a", "b")
    with pytest.raises(FileFormatError, match=r"found Ann, Bo, expected 'bo'\). Did you mean Bo"):
        name_tracks(labels, path=FILE, subject="bo")


def test_equal_labels() -> None:
    labels = ["S:a", "S:a", "S:a_2", "S:a", "b"]
    with pytest.warns(MocapFitWarning, match=r"'S:a' \(now also 'S:a_2_?") as caught:
        used = name_tracks(labels[:2] + labels[3:], path=FILE)
    assert len(caught) == 1
    assert used.names == ("S:a", "S:a_2", "S:a_3", "b")
    with pytest.warns(MocapFitWarning, match=r"take.x, line 3: .*'a' \(now also 'a_3'\), 'a'"):
        used = name_tracks(labels[:4], path=FILE, line=3)
    assert used.names == ("a", "a_3", "a_2", "a_4")
    assert used.renamed == {"a_3": "a", "a_4": "a"}


label = st.sampled_from(["", "a", "a_2", "a_3", "b", "*1", "S:a", "S:a_2", "T:b", "unlabelled 1"])


@given(st.lists(label, max_size=12))
def test_names_are_always_unique(labels: list[str]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        used = name_tracks(labels, path=FILE)
    assert len(set(used.names)) == len(labels) == len(used.columns)
    assert set(used.renamed) <= set(used.names)
    assert set(used.renamed.values()) <= set(used.names)


def test_many_equal_labels_take_linear_time() -> None:
    with pytest.warns(MocapFitWarning, match=r", …$"):
        assert len(set(name_tracks(["*"] * 100_000, path=FILE).names)) == 100_000


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["a"], "found 2 in the file, expected 1, as given"),
        (["a", " "], "marker 2 is blank"),
        (["a", "a "], "'a' as marker 1 and 2"),
    ],
)
def test_names_of_the_caller_are_checked(names: list[str], words: str) -> None:
    with pytest.raises(FileFormatError, match=words):
        name_tracks(["x", "y"], names, path=FILE)


def tracks_of(*names: str) -> MarkerTracks:
    return MarkerTracks(names, 50, np.arange(3.0 * len(names)).reshape(1, -1, 3))


def test_renaming() -> None:
    tracks = tracks_of("a", "b", "c")
    assert rename_tracks(tracks, {"a": "b", "b": "a"}).names == ("b", "a", "c")
    for rename, words in [
        ({"C": "x"}, r"no marker 'C' to rename \(found a, b, c\). Did you mean c"),
        ({"a": "b"}, "two markers would be called 'b'"),
        ({"a": "x", "b": "x"}, "two markers would be called 'x'"),
        ({"a": " "}, "is blank"),
    ]:
        with pytest.raises(DataError, match=words):
            rename_tracks(tracks, rename)
    # A command has one list for many files.
    assert rename_tracks(tracks, {"x": "b"}, missing_ok=True) is tracks
    with pytest.raises(DataError, match="no marker 'x'"):
        rename_tracks(tracks, {"x": "y"}, missing_ok=True)


def test_doubled_names_are_settled_by_renaming(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,a_x,a_y,a_z,a_x,a_y,a_z,b_x,b_y,b_z\n0,1,2,3,4,5,6,7,8,9\n")
    with pytest.warns(MocapFitWarning, match=r"a.csv, line 1: marker names come more than once"):
        tracks = mf.read_tracks(path, rate=50)
    assert tracks.names == ("a", "a_2", "b")
    assert find_doubled(tracks) == {"a": "a", "a_2": "a"}
    mf.write_tracks(tracks, tmp_path / "b.parquet")
    again = mf.read_tracks(tmp_path / "b.parquet")
    assert find_doubled(again) == {"a": "a", "a_2": "a"}
    for rename in ({"a_2": "c"}, {"a": "c", "a_2": "a"}, {"a": "a"}):
        assert find_doubled(rename_tracks(again, rename)) == {}
    assert find_doubled(rename_tracks(again, {"b": "c"})) != {}


def test_near_names_are_suggested() -> None:
    assert suggest_names("Lip Upper", ["x", "lip_upper", "nose"]) == "Did you mean lip_upper?"
    assert suggest_names("Ann:chin", ["chin", "nose"]) == "Did you mean chin?"
    assert suggest_names("qqq", ["chin", "nose"]) is None


POSITIONS = np.arange(48.0).reshape(4, 4, 3)


def write_tsv(path: Path, labels: list[str]) -> None:
    rows = ["\t".join(f"{v:.1f}" for v in frame.ravel()) for frame in POSITIONS]
    head = ["NO_OF_FRAMES\t4", "NO_OF_MARKERS\t4", "FREQUENCY\t50", "DATA_INCLUDED\t3D"]
    path.write_text("\n".join([*head, "\t".join(["MARKER_NAMES", *labels]), *rows]) + "\n")


def write_trc(path: Path, labels: list[str]) -> None:
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
        "50\t50\t4\t4\tmm",
        "Frame#\tTime\t" + "\t\t\t".join(labels),
        "\t\t" + "\t".join(f"{axis}{k + 1}" for k in range(4) for axis in "XYZ"),
        "",
    ]
    for k, frame in enumerate(POSITIONS):
        lines.append("\t".join([str(k + 1), f"{k / 50:.3f}", *(f"{v:.1f}" for v in frame.ravel())]))
    path.write_text("\n".join(lines) + "\n")


def write_csv(path: Path, labels: list[str]) -> None:
    lines = [",".join(["time", *(f"{label}_{axis}" for label in labels for axis in "xyz")])]
    for k, frame in enumerate(POSITIONS):
        lines.append(",".join([f"{k / 50:.3f}", *(f"{v:.1f}" for v in frame.ravel())]))
    path.write_text("\n".join(lines) + "\n")


def write_c3d(path: Path, labels: list[str]) -> None:
    path.write_bytes(c3d(POSITIONS, labels=labels, rate=50.0))


WRITERS = {".tsv": write_tsv, ".trc": write_trc, ".csv": write_csv, ".c3d": write_c3d}
LABELS: dict[str, tuple[list[str], list[str], dict[str, str]]] = {
    "one subject": (["Ann:a", "Ann:b", "Ann:c", "Ann:d"], ["a", "b", "c", "d"], {}),
    "and a stray": (["Ann:a", "Ann:b", "Ann:c", "*110"], ["a", "b", "c", "*110"], {}),
    "two subjects": (["Ann:a", "Ann:b", "Bo:c", "Bo:d"], ["Ann:a", "Ann:b", "Bo:c", "Bo:d"], {}),
    "one of two": (["Ann:a", "Bo:a", "Ann:b", "Bo:b"], ["a", "b"], {"subject": "Bo"}),
    "doubled": (["a", "b", "a", "a_2"], ["a", "b", "a_3", "a_2"], {}),
    "doubled of a subject": (["S:a", "S:b", "S:a", "S:c"], ["a", "b", "a_2", "c"], {}),
    "from the caller": (["S:a", "S:a", "T:a", "a"], ["k", "l", "m", "n"], {}),
}


@pytest.mark.parametrize("kind", LABELS)
@pytest.mark.parametrize("ending", WRITERS)
def test_every_format_follows_the_same_rules(ending: str, kind: str, tmp_path: Path) -> None:
    labels, names, options = LABELS[kind]
    path = tmp_path / f"a{ending}"
    WRITERS[ending](path, labels)
    if kind == "from the caller":
        options = {"names": names}  # type: ignore[dict-item]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        tracks = mf.read_tracks(path, **options)  # type: ignore[arg-type]
    assert tracks.names == tuple(names)
    assert len(caught) == ("doubled" in kind)
    columns = [1, 3] if kind == "one of two" else [0, 1, 2, 3]
    gaps = np.isnan(tracks.positions)
    np.testing.assert_allclose(
        np.where(gaps, 0, tracks.positions), np.where(gaps, 0, POSITIONS[:, columns])
    )
    if kind == "one of two":
        with pytest.raises(FileFormatError, match=r"'a' of Ann and of Bo.*--subject"):
            mf.read_tracks(path)
