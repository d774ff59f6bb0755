import json

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mocap_fit.errors import DataError, FileFormatError, MissingFileError
from mocap_fit.tracks import (
    Event,
    MarkerTracks,
    Origin,
    ParameterTracks,
    PoseTracks,
    from_frame,
    read_parquet,
    to_frame,
    write_parquet,
)
from mocap_fit.tracks.parquet_file import read_description, read_kind
from mocap_fit.tracks.storage import is_tracks_file

NUMBERS = st.floats(allow_infinity=False, allow_nan=True, width=64)
ANY_NUMBERS = st.floats(allow_infinity=True, allow_nan=True, width=64)
NAMES = st.lists(
    st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=8),
    min_size=1,
    max_size=3,
    unique=True,
).filter(lambda names: not {"time", "utterance", "residual_mm"} & set(names))
RATES = st.floats(1e-3, 1e6)


def same(one, other) -> bool:
    """Equal in every field, to the last bit, NaN like NaN."""
    assert type(one) is type(other)
    for field in vars(one):
        left, right = getattr(one, field), getattr(other, field)
        if isinstance(left, np.ndarray):
            np.testing.assert_array_equal(left, right)
            assert left.dtype == right.dtype
        else:
            assert left == right
    return True


@st.composite
def marker_tracks(draw):
    names = draw(NAMES)
    frames = draw(st.integers(0, 4))
    positions = draw(arrays(np.float64, (frames, len(names), 3), elements=NUMBERS))
    tracks = MarkerTracks(
        tuple(names),
        draw(RATES),
        positions,
        start_time=draw(st.floats(-1e6, 1e6)),
        name=draw(st.text(st.characters(exclude_categories=["Cs"]), max_size=5)),
        events=(Event("clap", 0.1 + 0.2),),
    )
    codes = draw(arrays(np.uint8, tracks.origin.shape, elements=st.integers(1, 3)))
    return tracks.replace(origin=np.where(tracks.visible, codes, 0)).add_step("made", {"n": 1.5})


@st.composite
def parameter_tracks(draw):
    names = draw(NAMES.filter(lambda n: not any(name.endswith("_sd") for name in n)))
    frames = draw(st.integers(0, 4))
    return ParameterTracks(
        tuple(names),
        draw(RATES),
        draw(arrays(np.float64, (frames, len(names)), elements=NUMBERS)),
        draw(arrays(np.float64, (frames, len(names)), elements=ANY_NUMBERS)),
        draw(arrays(np.float64, frames, elements=ANY_NUMBERS)),
        name="utterance 1",
    )


@st.composite
def pose_tracks(draw):
    names = draw(NAMES)
    shape = (draw(st.integers(0, 3)), len(names))
    return PoseTracks(
        tuple(names),
        draw(RATES),
        draw(arrays(np.float64, (*shape, 3, 3), elements=NUMBERS)),
        draw(arrays(np.float64, (*shape, 3), elements=NUMBERS)),
        draw(arrays(np.float64, shape, elements=NUMBERS)),
    )


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.one_of(marker_tracks(), parameter_tracks(), pose_tracks()))
def test_nothing_is_lost_on_the_way_to_disk_and_pandas(tmp_path, tracks):
    path = tmp_path / "tracks.parquet"
    write_parquet(tracks, path)
    first = path.read_bytes()
    assert same(read_parquet(path), tracks)
    assert same(from_frame(to_frame(tracks)), tracks)
    write_parquet(read_parquet(path), path)
    assert path.read_bytes() == first


def parameters(**changes) -> ParameterTracks:
    values = np.arange(10.0).reshape(5, 2)
    return ParameterTracks(
        ("jaw", "lip"), 60, values, values / 10, values[:, 0], name="u1", start_time=0.02
    ).replace(**changes)


def test_the_columns_of_a_corpus_are_as_the_design_says(tmp_path):
    path = tmp_path / "u1.parquet"
    write_parquet(parameters(), path, {"energy_db": np.arange(5.0)})
    table = pd.read_parquet(path)
    assert list(table.columns) == [
        "utterance",
        "time",
        "jaw",
        "lip",
        "jaw_sd",
        "lip_sd",
        "residual_mm",
        "energy_db",
    ]
    assert set(table["utterance"]) == {"u1"}
    np.testing.assert_array_equal(table["time"], parameters().times)
    np.testing.assert_array_equal(table["lip"], parameters()["lip"])
    assert same(read_parquet(path), parameters())


def test_a_table_of_another_program_is_understood(tmp_path):
    path = tmp_path / "u1.parquet"
    marker = MarkerTracks(("a", "b c"), 29.97, np.arange(24.0).reshape(4, 2, 3), start_time=1.0)
    write_parquet(marker, path)
    read = from_frame(pd.read_parquet(path).drop(columns=["a_origin"]))
    assert isinstance(read, MarkerTracks)
    assert read.names == marker.names
    assert read.rate == pytest.approx(29.97, rel=1e-9)
    assert read.start_time == 1.0
    np.testing.assert_array_equal(read.positions, marker.positions)
    plain = from_frame(pd.DataFrame({"jaw": [0.0, None, 1.0]}), rate=50)
    assert isinstance(plain, ParameterTracks)
    np.testing.assert_array_equal(plain.values[:, 0], [0, np.nan, 1])


def test_a_part_of_a_table_knows_its_time():
    part = from_frame(to_frame(parameters()).iloc[2:4])
    assert part.frames == 2
    assert part.start_time == pytest.approx(0.02 + 2 / 60)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.iloc[[0, 1, 3, 4]], "evenly spaced"),
        (lambda t: t.assign(jaw="open"), "'jaw' does not hold numbers"),
        (lambda t: t.drop(columns=["lip"]), "lacks a column"),
    ],
)
def test_a_table_that_cannot_be_tracks_is_refused(change, words):
    with pytest.raises(DataError, match=words):
        from_frame(change(to_frame(parameters())))


def test_tables_without_notes_are_checked_too():
    table = to_frame(parameters())
    table.attrs = {}
    two = pd.concat([table, table.assign(utterance="u2")])
    with pytest.raises(DataError, match="more than one utterance"):
        from_frame(two)
    with pytest.raises(DataError, match="rate"):
        from_frame(table.drop(columns="time"))
    with pytest.raises(DataError, match="rate"):
        from_frame(table.assign(time=1.0))
    markers = to_frame(MarkerTracks(("a",), 60, np.zeros((2, 1, 3))))
    with pytest.raises(DataError, match="origin"):
        from_frame(markers.assign(a_origin=9))


def test_columns_that_would_share_a_name_are_refused(tmp_path):
    path = tmp_path / "x.parquet"
    for names in (("jaw", "jaw_sd"), ("time", "lip"), ("residual_mm", "lip")):
        with pytest.raises(DataError, match="one name"):
            write_parquet(parameters(names=names), path)
    with pytest.raises(DataError, match="one name"):
        write_parquet(parameters(), path, {"jaw": np.zeros(5)})
    with pytest.raises(DataError, match="length"):
        write_parquet(parameters(), path, {"more": np.zeros(4)})
    with pytest.raises(DataError, match="cannot be stored"):
        write_parquet(parameters().add_step("odd", {"thing": object()}), path)
    assert list(tmp_path.iterdir()) == []


def test_numpy_values_in_a_provenance_are_stored(tmp_path):
    tracks = parameters().add_step("a", {"x": np.float64(1.5), "y": np.arange(2), "z": (1, 2)})
    write_parquet(tracks, tmp_path / "x.parquet")
    step = read_parquet(tmp_path / "x.parquet").provenance[-1]
    assert dict(step.arguments) == {"x": 1.5, "y": [0, 1], "z": [1, 2]}


def test_every_truncation_is_refused_and_says_so(tmp_path):
    path = tmp_path / "x.parquet"
    write_parquet(parameters(), path)
    whole = path.read_bytes()
    for length in [0, 1, 4, 11, len(whole) // 2, len(whole) - 9, len(whole) - 1]:
        path.write_bytes(whole[:length])
        with pytest.raises(FileFormatError, match="not a whole Parquet file") as caught:
            read_parquet(path)
        assert "\n" not in str(caught.value)
        assert str(path) in str(caught.value)


def test_damage_in_the_middle_is_refused_or_harmless(tmp_path, rng):
    path = tmp_path / "x.parquet"
    write_parquet(parameters(), path)
    whole = path.read_bytes()
    refused = 0
    for _ in range(200):
        damaged = bytearray(whole)
        damaged[rng.integers(len(whole) // 2)] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        try:
            read = read_parquet(path)
        except FileFormatError:
            refused += 1
        else:
            np.testing.assert_array_equal(read.values, parameters().values)
    assert refused > 50


def with_metadata(path, change) -> None:
    table = pq.read_table(path)
    metadata = json.loads(table.schema.metadata[b"mocap_fit"])
    metadata = change(metadata)
    text = metadata if isinstance(metadata, str) else json.dumps(metadata)
    pq.write_table(table.replace_schema_metadata({"mocap_fit": text}), path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: m | {"format_version": 2}, "later format.*format_version 2.*at most 1"),
        (lambda m: m | {"format_version": "one"}, "later format"),
        (lambda m: m | {"rate": -1}, "rate"),
        (lambda m: m | {"names": ["jaw", "tongue"]}, "lacks a column.*tongue"),
        (lambda m: m | {"kind": "noise"}, "cannot be used|damaged"),
        (lambda m: {k: v for k, v in m.items() if k != "rate"}, "damaged"),
        (lambda m: m | {"provenance": 5}, "damaged"),
        (lambda m: [], "damaged"),
        (lambda m: "{", "damaged"),
    ],
)
def test_a_description_that_is_wrong_is_refused(tmp_path, change, words):
    path = tmp_path / "x.parquet"
    write_parquet(parameters(), path)
    with_metadata(path, change)
    with pytest.raises(FileFormatError, match=words):
        read_parquet(path)


def test_foreign_and_absent_files_are_refused(tmp_path):
    path = tmp_path / "x.parquet"
    pq.write_table(pa.table({"a": [1, 2]}), path)
    with pytest.raises(FileFormatError, match=r"does not hold tracks.*columns a.*from_frame"):
        read_parquet(path)
    path.write_text("frame,time\n1,2\n")
    with pytest.raises(FileFormatError, match="not a whole Parquet file"):
        read_parquet(path)
    with pytest.raises(MissingFileError, match="no such file"):
        read_parquet(tmp_path / "nowhere.parquet")
    with pytest.raises(FileFormatError, match="this is a folder"):
        read_parquet(tmp_path)


def test_a_file_that_cannot_be_written_leaves_nothing_behind(tmp_path):
    with pytest.raises(FileFormatError, match="cannot be written"):
        write_parquet(parameters(), tmp_path / "no folder" / "x.parquet")
    folder = tmp_path / "x.parquet"
    folder.mkdir()
    with pytest.raises(FileFormatError, match="cannot be written"):
        write_parquet(parameters(), folder)
    assert list(tmp_path.iterdir()) == [folder]


def test_origins_survive(tmp_path):
    positions = np.zeros((3, 1, 3))
    positions[1] = np.nan
    origin = [[Origin.VIRTUAL], [Origin.MISSING], [Origin.FILLED]]
    tracks = MarkerTracks(("a",), 60, positions, np.array(origin))
    write_parquet(tracks, tmp_path / "x.parquet")
    assert read_parquet(tmp_path / "x.parquet").origin.tolist() == [[3], [0], [2]]


def test_a_file_says_what_it_holds_without_being_read(tmp_path):
    path = tmp_path / "x.parquet"
    write_parquet(parameters(), path)
    assert is_tracks_file(path)
    assert read_kind(path) == "parameters"
    assert read_description(path)["names"] == list(parameters().names)
    assert read_parquet(path).provenance == parameters().provenance
    pq.write_table(pa.table({"a": [1, 2]}), path)
    assert read_description(path) is read_kind(path) is None
    path.write_text("no Parquet")
    assert read_description(path) is None
    assert not is_tracks_file(path)
    assert not is_tracks_file(tmp_path / "none.parquet")


@pytest.mark.parametrize(("late", "refused"), [(0.24, False), (0.26, True)])
def test_a_time_may_be_off_by_a_quarter_of_a_frame(late, refused):
    frame = pd.DataFrame({"time": np.arange(6) / 50, "jaw": np.arange(6.0)})
    frame.loc[3, "time"] += late / 50
    if refused:
        with pytest.raises(DataError, match=r"frame 3: the times are not evenly spaced"):
            from_frame(frame, "parameters", rate=50)
    else:
        assert from_frame(frame, "parameters", rate=50).frames == 6


def test_a_single_parameter_has_residuals_too(tmp_path):
    one = parameters().select(["lip"])
    write_parquet(one, tmp_path / "x.parquet")
    assert list(to_frame(one)) == ["utterance", "time", "lip", "lip_sd", "residual_mm"]
    np.testing.assert_array_equal(read_parquet(tmp_path / "x.parquet").residuals, one.residuals)


def test_a_rate_of_a_table_has_nine_digits_and_its_start_a_billionth():
    table = to_frame(parameters())
    table.attrs = {}
    assert from_frame(table.iloc[:2], "parameters").rate == pytest.approx(60, abs=2e-9)
    assert from_frame(table, "parameters").rate == 60
    third = ParameterTracks(("jaw",), 100 / 3, np.zeros((4, 1)))
    table = to_frame(third)
    table.attrs = {}
    assert from_frame(table, "parameters").rate == round(100 / 3, 9)
    # Noted times are taken as they are unless they differ by more than a billionth of a second.
    noted = to_frame(parameters(start_time=0.0))
    for late, start in ((0.9e-9, 0.0), (1.1e-9, 1.1e-9)):
        assert from_frame(noted.assign(time=noted["time"] + late)).start_time == start


def test_what_is_given_is_stronger_than_what_is_noted():
    table = to_frame(parameters())
    assert from_frame(table, start_time=0.02).start_time == 0.02
    moved = from_frame(table.drop(columns="time"), rate=30, start_time=5.0)
    assert (moved.rate, moved.start_time, moved.frames) == (30, 5.0, 5)
    assert from_frame(table.iloc[2:], start_time=5.0).start_time == 5.0
    with pytest.raises(DataError, match="frame 1: the times are not evenly spaced"):
        from_frame(table, rate=30)
    empty = from_frame(table.iloc[:0])
    assert (empty.frames, empty.rate, empty.start_time) == (0, 60.0, 0.02)


def test_kinds_are_guessed_by_the_endings_of_columns():
    pose = PoseTracks(("head",), 50, np.tile(np.eye(3), (2, 1, 1, 1)), np.zeros((2, 1, 3)))
    marker = MarkerTracks(("m",), 50, np.zeros((2, 1, 3)))
    for tracks in (pose, marker, parameters()):
        table = to_frame(tracks)
        table.attrs = {}
        assert type(from_frame(table)) is type(tracks)
        assert from_frame(table).names == tracks.names
    # Standard deviations belong to a parameter of that name, and are one where there is none.
    alone = pd.DataFrame({"jaw": [0.0, 1.0], "jaw_sd": [0.1, 0.2], "lip_sd": [1.0, 2.0]})
    assert from_frame(alone, rate=50).names == ("jaw", "lip_sd")
    assert from_frame(alone, rate=50).name == ""


def test_columns_of_markers_and_poses_have_the_names_of_the_reference(tmp_path):
    pose = PoseTracks(("head",), 50, np.arange(18.0).reshape(2, 1, 3, 3), np.ones((2, 1, 3)))
    table = to_frame(pose)
    matrix = [f"head_r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3)]
    places = ["head_x", "head_y", "head_z"]
    assert list(table) == ["utterance", "time", *places, *matrix, "head_residual_mm"]
    assert table["head_r21"].tolist() == [3.0, 12.0]
    markers = to_frame(MarkerTracks(("a", "b"), 50, np.arange(12.0).reshape(2, 2, 3)))
    assert list(markers)[2:] == [f"{m}_{c}" for m in "ab" for c in ("x", "y", "z", "origin")]
    assert markers["b_y"].tolist() == [4.0, 10.0]


def test_one_row_tells_no_rate():
    table = to_frame(parameters()).iloc[:1]
    table.attrs = {}
    with pytest.raises(DataError, match="the table does not tell its rate"):
        from_frame(table)
    assert from_frame(table, rate=25).rate == 25
