"""C3D files of every processor and with every oddity, from a literal writer; truth is known."""

import gzip
import math
import sys
import tracemalloc
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mocap_fit.errors import FileFormatError, MocapFitError, MocapFitWarning
from mocap_fit.io import read_tracks
from mocap_fit.tracks import Event, MarkerTracks, Origin

sys.path.insert(0, str(Path(__file__).parents[2] / "fixtures"))
from c3d_files import c3d

ORDERS = ("intel", "dec", "mips")
every_order = pytest.mark.parametrize("order", ORDERS)
every_kind = pytest.mark.parametrize("floats", [True, False], ids=["floats", "integers"])

TRUTH = np.round(
    np.array([10.0, 20.0, 30.0])
    + np.arange(8)[:, None, None] * np.array([0.1, 0.2, 0.3])
    + np.array([0.0, 100.0, -200.0])[:, None],
    1,
)


def read(path: Path, content: bytes, **options: Any) -> MarkerTracks:
    """Read a file about which there is nothing to warn of."""
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return read_tracks(path, **options)


def read_warned(path: Path, content: bytes, match: str, **options: Any) -> MarkerTracks:
    path.write_bytes(content)
    with pytest.warns(MocapFitWarning, match=match) as caught:
        tracks = read_tracks(path, **options)
    assert len(caught) == 1
    return tracks


def refuse(path: Path, content: bytes, match: str) -> None:
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(FileFormatError, match=match):
            read_tracks(path)


def check(tracks: MarkerTracks) -> None:
    assert tracks.names == ("chin", "lip", "nose")
    assert tracks.rate == 100.0
    assert tracks.start_time == 0
    assert tracks.positions.shape == TRUTH.shape
    np.testing.assert_allclose(tracks.positions, TRUTH, atol=1e-4)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "a.c3d"


# --- Processors ---------------------------------------------------------------------------------


@every_order
@every_kind
@pytest.mark.parametrize("channels", [0, 6])
def test_every_processor(order: str, floats: bool, channels: int, file: Path) -> None:
    content = c3d(TRUTH, order=order, floats=floats, channels=channels, per_frame=10)
    check(read(file, content))


@every_order
@every_kind
def test_gaps_and_what_was_not_measured(order: str, floats: bool, file: Path) -> None:
    fourth = np.full((8, 3), 0x0105)
    fourth[2, 0], fourth[3, 1] = -1, 0
    tracks = read(file, c3d(TRUTH, order=order, floats=floats, fourth=fourth))
    assert np.argwhere(tracks.origin == Origin.MISSING).tolist() == [[2, 0]]
    assert np.argwhere(tracks.origin == Origin.FILLED).tolist() == [[3, 1]]
    assert np.isnan(tracks.positions[2, 0]).all()
    assert np.isnan(tracks.positions).sum() == 3
    # Where all are 0, they say nothing.
    tracks = read(file, c3d(TRUTH, order=order, floats=floats, fourth=np.zeros((8, 3))))
    assert (tracks.origin == Origin.MEASURED).all()


@every_order
def test_minus_one_without_its_sign_is_a_gap(order: str, file: Path) -> None:
    fourth = np.ones((8, 3))
    fourth[2, 0] = 65535
    tracks = read(file, c3d(TRUTH, order=order, fourth=fourth))
    assert np.argwhere(~tracks.visible).tolist() == [[2, 0]]


def test_a_coordinate_that_is_no_number_is_a_gap(file: Path) -> None:
    values = TRUTH.copy()
    values[1, 0, 2], values[4, 2, 0] = np.nan, np.inf
    tracks = read(file, c3d(values))
    assert np.argwhere(~tracks.visible).tolist() == [[1, 0], [4, 2]]


@pytest.mark.parametrize("order", ["intel", "dec"])
@every_kind
@pytest.mark.parametrize("channels", [0, 4])
def test_as_ezc3d_reads_it(order: str, floats: bool, channels: int, file: Path, rng: Any) -> None:
    import ezc3d

    fourth = np.where(rng.random((8, 3)) < 0.2, -1, 0x0305)
    content = c3d(
        rng.uniform(-900, 900, (8, 3, 3)),
        order=order,
        floats=floats,
        fourth=fourth,
        channels=channels,
        per_frame=5,
        first=51,
        changes={("EVENT", "USED"): 1, ("EVENT", "LABELS"): ["clap"]}
        | {("EVENT", "TIMES"): np.array([[0.0], [0.55]])},
    )
    tracks = read(file, content)
    peer = ezc3d.c3d(str(file))
    points = peer["data"]["points"][:3].transpose(2, 1, 0)
    np.testing.assert_allclose(tracks.positions, points, atol=1e-4)
    assert tracks.names == tuple(peer["parameters"]["POINT"]["LABELS"]["value"])
    assert tracks.rate == peer["header"]["points"]["frame_rate"]
    assert tracks.start_time == peer["header"]["points"]["first_frame"] / tracks.rate
    assert tracks.events[0].time == pytest.approx(peer["parameters"]["EVENT"]["TIMES"]["value"][1])


@pytest.mark.parametrize(("code", "order"), [(1, "intel"), (2, "dec"), (3, "mips")])
def test_a_processor_without_the_83(code: int, order: str, file: Path) -> None:
    check(read(file, c3d(TRUTH, order=order, processor=code)))


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_any_layout_comes_back(data: st.DataObject, file: Path) -> None:
    points, frames = data.draw(st.integers(1, 40)), data.draw(st.integers(1, 40))
    scale = data.draw(st.sampled_from([0.01, 0.1, 0.5]))
    steps = np.random.default_rng(data.draw(st.integers(0, 99))).integers(
        -3000, 3000, (frames, points, 3)
    )
    first = data.draw(st.integers(1, 60000))
    labels = [f"m{index}" for index in range(points)]
    tracks = read(
        file,
        c3d(
            steps * scale,
            scale=scale,
            labels=labels,
            first=first,
            order=data.draw(st.sampled_from(ORDERS)),
            floats=data.draw(st.booleans()),
            channels=data.draw(st.integers(0, 9)),
            per_frame=data.draw(st.integers(1, 20)),
            parameter_block=data.draw(st.integers(2, 100)),
            padded=data.draw(st.booleans()),
            unit=data.draw(st.sampled_from(["mm", "MM", "mill"])),
        ),
    )
    assert tracks.names == tuple(labels)
    assert tracks.start_time == (first - 1) / 100
    np.testing.assert_allclose(tracks.positions, steps * scale, rtol=1e-6, atol=1e-9)


# --- Header against parameters ------------------------------------------------------------------

SIX = {"channels": 6, "per_frame": 10}


@every_kind
@pytest.mark.parametrize(
    "oddity",
    [
        {("ANALOG", "RATE"): None},
        {("ANALOG", "RATE"): 5.0},
        {("ANALOG", "RATE"): math.inf},
        {("ANALOG", "SCALE"): None},
        {("ANALOG", "OFFSET"): None},
        {("ANALOG", "OFFSET"): np.zeros(6)},
        {("ANALOG", "OFFSET"): ["none"]},
        {("ANALOG", "GEN_SCALE"): None},
        {("ANALOG", "USED"): None},
        {("ANALOG", "USED"): 3},
        {("ANALOG", "USED"): 500},
        {("ANALOG", name): None for name in ("USED", "RATE", "GEN_SCALE", "SCALE", "OFFSET")},
    ],
    ids=str,
)
def test_analog_parameters_do_not_matter(oddity: Any, floats: bool, file: Path) -> None:
    check(read(file, c3d(TRUTH, floats=floats, **SIX, changes=oddity)))


@every_kind
@pytest.mark.parametrize(
    "words", [{3: 6}, {3: 0}, {10: 0}, {10: 4}, {3: 6, 10: 1}, {3: 0, 10: 0}], ids=str
)
def test_analog_words_of_the_header_that_are_wrong(words: Any, floats: bool, file: Path) -> None:
    """Word 3 as the number of channels, for one, where it should be that of samples."""
    check(read(file, c3d(TRUTH, floats=floats, **SIX, header=words)))


@every_kind
def test_channels_in_word_3_and_no_group_of_analog_data(floats: bool, file: Path) -> None:
    names = ("USED", "RATE", "GEN_SCALE", "SCALE", "OFFSET")
    changes = {("ANALOG", name): None for name in names}
    long = np.tile(TRUTH, (20, 1, 1))
    tracks = read(file, c3d(long, floats=floats, **SIX, changes=changes, header={3: 6}))
    np.testing.assert_allclose(tracks.positions, long, atol=1e-4)


@every_kind
@pytest.mark.parametrize("cut", [30, 3000, 20000])
def test_no_other_reading_of_a_file_that_is_cut_off(cut: int, floats: bool, file: Path) -> None:
    """What contradicts the header might fit what is left by chance."""
    long = np.tile(TRUTH, (40, 1, 1))
    for used in (0, 3, 5):
        content = c3d(long, floats=floats, **SIX, changes={("ANALOG", "USED"): used}, padded=False)
        refuse(file, content[:-cut], r"contradict each other")


@every_order
@every_kind
@pytest.mark.parametrize(("where", "count"), [("used", 5), ("used", 300), ("header", 9)])
def test_a_wrong_number_of_points(
    order: str, floats: bool, where: str, count: int, file: Path
) -> None:
    wrong: dict[str, Any] = {"changes": {("POINT", "USED"): count}}
    if where == "header":
        wrong = {"header": {2: count}}
    long = np.tile(TRUTH, (20, 1, 1))
    content = c3d(long, order=order, floats=floats, **wrong)
    tracks = read_warned(file, content, r"3 are read")
    np.testing.assert_allclose(tracks.positions, long, atol=1e-4)


@every_order
def test_a_count_in_a_byte_has_no_sign(order: str, file: Path) -> None:
    values = np.ones((2, 200, 3))
    content = c3d(values, order=order, changes={("POINT", "USED"): bytes([1, 0, 200])})
    assert len(read(file, content).names) == 200


def test_numbers_that_fit_nothing_are_refused(file: Path) -> None:
    content = c3d(TRUTH, header={2: 200}, changes={("POINT", "USED"): 100})
    refuse(file, content, r"contradict each other.*shorter than both")


@every_order
def test_scales(order: str, file: Path) -> None:
    for floats in (True, False):
        sign = -1 if floats else 1
        for oddity in (
            {"changes": {("POINT", "SCALE"): None}},
            {"changes": {("POINT", "SCALE"): 0.0}},
            {"header_floats": {7: 0.0}},
            {"header_floats": {7: math.nan}} if order != "dec" else {},
        ):
            check(read(file, c3d(TRUTH, order=order, floats=floats, **oddity)))
        # The sign is decided by the length of the file.
        long = np.tile(TRUTH, (40, 1, 1))
        for oddity in (
            {"changes": {("POINT", "SCALE"): -0.1 * sign}},
            {"header_floats": {7: -0.1 * sign}},
        ):
            tracks = read(file, c3d(long, order=order, floats=floats, **oddity))
            np.testing.assert_allclose(tracks.positions, long, atol=1e-4)
    content = c3d(TRUTH, order=order, floats=False, header_floats={7: 0.7})
    check(read_warned(file, content, r"scale of 0\.7 and POINT:SCALE 0\.1, which is taken"))
    content = c3d(TRUTH, changes={("POINT", "SCALE"): None}, header_floats={7: 0.0})
    refuse(file, content, r"neither the header nor POINT:SCALE")


@every_order
def test_rates(order: str, file: Path) -> None:
    check(read(file, c3d(TRUTH, order=order, changes={("POINT", "RATE"): None})))
    check(read(file, c3d(TRUTH, order=order, changes={("POINT", "RATE"): 0.0})))
    check(read(file, c3d(TRUTH, order=order, header_floats={11: 0.0})))
    other = c3d(TRUTH, order=order, header_floats={11: 50.0})
    check(read_warned(file, other, r"header says 50 Hz and POINT:RATE 100 Hz, which is taken"))
    assert read_warned(file, other, r"100 Hz; 60 Hz is used", rate=60.0).rate == 60
    none = c3d(TRUTH, order=order, header_floats={11: 0.0}, changes={("POINT", "RATE"): None})
    refuse(file, none, r"found 0 Hz")
    assert read(file, none, rate=60.0).rate == 60


# --- Frames -------------------------------------------------------------------------------------


def count_up(frames: int) -> Any:
    values = np.full((frames, 1, 3), 5.0)
    values[:, 0, 0] = np.arange(frames) % 1000
    return values


TWO_WORDS = [72610 % 65536, 72610 // 65536]


@every_kind
@pytest.mark.parametrize(
    "oddity",
    [
        {"changes": {("POINT", "LONG_FRAMES"): 72610.0}},
        {"changes": {("POINT", "LONG_FRAMES"): TWO_WORDS}},
        {"changes": {("POINT", "FRAMES"): 72610.0}},
        {"changes": {("POINT", "FRAMES"): TWO_WORDS}},
        {
            "changes": {
                ("TRIAL", "ACTUAL_START_FIELD"): [1, 0],
                ("TRIAL", "ACTUAL_END_FIELD"): TWO_WORDS,
            }
        },
        # Upper bits that are lost, not a number that is known to be too small.
        {"changes": {("POINT", "LONG_FRAMES"): 72610.0}, "header": {5: 72610}},
    ],
    ids=["float", "words", "FRAMES float", "FRAMES words", "trial", "wrapped"],
)
def test_more_frames_than_16_bits_hold(oddity: Any, floats: bool, file: Path) -> None:
    tracks = read(file, c3d(count_up(72610), labels=["a"], floats=floats, scale=1.0, **oddity))
    assert tracks.frames == 72610
    np.testing.assert_array_equal(tracks.positions[:, 0, 0], np.arange(72610) % 1000)


@every_kind
def test_more_frames_by_the_length_of_the_file(floats: bool, file: Path) -> None:
    changes = {
        ("TRIAL", "ACTUAL_START_FIELD"): [1, 0],
        ("TRIAL", "ACTUAL_END_FIELD"): [-1, 0],
    }
    for wrong in ({}, changes):
        content = c3d(count_up(66000), labels=["a"], floats=floats, scale=1.0, changes=wrong)
        tracks = read_warned(file, content, r"says 65535 frames and holds 66000")
        assert tracks.frames == 66000
        assert tracks.positions[-1, 0].tolist() == [999, 5, 5]


@every_kind
def test_upper_bits_that_all_have_lost(floats: bool, file: Path) -> None:
    lost = {"header": {5: 66000 - 65536}, "changes": {("POINT", "FRAMES"): 66000 - 65536}}
    content = c3d(count_up(66000), labels=["a"], floats=floats, scale=1.0, **lost)
    assert read_warned(file, content, r"says 464 frames and holds 66000").frames == 66000


@every_kind
def test_zeros_at_the_end_are_no_frames(floats: bool, file: Path) -> None:
    content = c3d(count_up(65535), labels=["a"], floats=floats, scale=1.0)
    assert read(file, content + bytes(200_000)).frames == 65535
    content = c3d(count_up(66000), labels=["a"], floats=floats, scale=1.0)
    content += bytes(200_000)
    assert read_warned(file, content, r"says 65535 frames and holds 66000").frames == 66000


@every_kind
def test_what_follows_the_last_frame_is_told(floats: bool, file: Path) -> None:
    content = c3d(TRUTH, floats=floats)
    check(read(file, content + bytes(5000)))
    check(read_warned(file, content + b"\1" * 5000, r"goes on for \d+ bytes behind its last"))


@pytest.mark.parametrize("frames", [65535, 40000])
def test_frames_that_need_all_16_bits(frames: int, file: Path) -> None:
    content = c3d(count_up(frames), labels=["a"], floats=False, scale=1.0)
    assert read(file, content).frames == frames


@every_kind
def test_frames_that_the_header_does_not_have(floats: bool, file: Path) -> None:
    for words in ({4: 0, 5: 0}, {4: 5, 5: 2}):
        content = c3d(TRUTH, floats=floats, header=words)
        file.write_bytes(content)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MocapFitWarning)
            assert read_tracks(file).frames == 8
    refuse(file, c3d(TRUTH, header={5: 0}, changes={("POINT", "FRAMES"): 0}), r"no frames")


@every_kind
def test_padding_is_no_frame(floats: bool, file: Path) -> None:
    content = c3d(TRUTH, floats=floats, changes={("POINT", "FRAMES"): 12})
    for padding in (0, 512, 2048):
        tracks = read_warned(file, content + bytes(padding), r"and POINT:FRAMES 12; 8 are read")
        check(tracks)


@every_kind
def test_a_trial_of_another_length(floats: bool, file: Path) -> None:
    changes = {("TRIAL", "ACTUAL_START_FIELD"): [1, 0], ("TRIAL", "ACTUAL_END_FIELD"): [6, 0]}
    content = c3d(TRUTH, floats=floats, changes=changes)
    check(read_warned(file, content, r"header says 8 frames and TRIAL 6; 8 are read"))


@every_kind
def test_a_header_with_too_few_frames(floats: bool, file: Path) -> None:
    """What the parameters and the length of the file agree on is taken."""
    content = c3d(TRUTH, floats=floats, header={5: 5})
    check(read_warned(file, content, r"header says 5 frames and POINT:FRAMES 8; 8 are read"))
    content = c3d(count_up(36220), labels=["a"], floats=floats, scale=1.0, header={5: 32767})
    assert read_warned(file, content, r"and POINT:FRAMES 36220; 36220 are read").frames == 36220


@every_kind
def test_a_header_with_too_many_frames(floats: bool, file: Path) -> None:
    content = c3d(TRUTH, floats=floats, header={5: 9}, padded=False)
    check(read_warned(file, content, r"header says 9 frames and POINT:FRAMES 8; 8 are read"))


@every_kind
@pytest.mark.parametrize("cut", [1, 30, 100])
def test_a_file_that_is_cut_off_is_read_as_far_as_it_goes(
    cut: int, floats: bool, file: Path
) -> None:
    content = c3d(TRUTH, floats=floats, channels=2, padded=False)
    left = 8 - -(-cut // (56 if floats else 28))
    tracks = read_warned(file, content[:-cut], rf"cut off: {left} of 8 frames are there")
    np.testing.assert_allclose(tracks.positions, TRUTH[:left], atol=1e-4)


def test_a_file_without_one_frame_is_refused(file: Path) -> None:
    content = c3d(TRUTH, padded=False)
    refuse(file, content[: -8 * 48 + 20], r"cut off in its data \(found no frame, expected 8")
    refuse(file, content[: -8 * 48], r"data are not where")
    refuse(file, content[:600], r"data are not where")
    refuse(file, content[:514], r"cut off in its header")
    refuse(file, content[:100], r"cut off in its header")


@pytest.mark.parametrize(
    ("first", "trial", "seconds"),
    [
        (1, None, 0.0),
        (0, None, 0.0),
        (5701, None, 57.0),
        (40001, None, 400.0),
        (70001, 70001, 700.0),
        (65535, 200000, 1999.99),
        (1, 101, 1.0),
    ],
)
@every_order
def test_start_of_a_trimmed_take(
    first: int, trial: int | None, seconds: float, order: str, file: Path
) -> None:
    changes = {}
    if trial is not None:
        for name, number in (("START", trial), ("END", trial + 7)):
            changes["TRIAL", f"ACTUAL_{name}_FIELD"] = [number % 65536, number // 65536]
    last = min(first % 65536 + 7, 65535)
    tracks = read(file, c3d(TRUTH, order=order, first=first, header={5: last}, changes=changes))
    assert tracks.start_time == pytest.approx(seconds)
    assert tracks.frames == 8


# --- Where things are ---------------------------------------------------------------------------


@every_order
@pytest.mark.parametrize(
    "where",
    [
        {"parameter_block": 11},
        {"parameter_block": 120},
        {"data_block": 20},
        {"parameter_block": 11, "data_block": 40},
        {"parameter_block": 3, "data_block": 2},
        {"blocks": 0},
        {"blocks": 200},
        {"lead": b"\0\0"},
        {"lead": b"\xff\xff"},
        {"changes": {("POINT", "DATA_START"): 0}},
        {"changes": {("POINT", "DATA_START"): 2}},
        {"changes": {("POINT", "DATA_START"): None}},
        {"header": {9: 0}},
        {"header": {9: 2}},
        {"header": {9: 60000}},
        {"header": {9: 0}, "changes": {("POINT", "DATA_START"): None}},
    ],
    ids=str,
)
def test_parameters_and_data_are_anywhere(where: Any, order: str, file: Path) -> None:
    check(read(file, c3d(TRUTH, order=order, **where)))


def test_data_that_the_header_puts_into_the_parameters(file: Path) -> None:
    changes = {("NOTES", f"LINE_{number}"): "x" * 200 for number in range(9)}
    check(read(file, c3d(TRUTH, changes=changes, header={9: 3})))


# --- Parameters ---------------------------------------------------------------------------------


@every_order
@pytest.mark.parametrize("length", [None, 0, 1, 127, 128, 163, 255])
def test_descriptions_of_any_length(length: int | None, order: str, file: Path) -> None:
    description = None if length is None else b"d" * length
    check(read(file, c3d(TRUTH, order=order, description=description)))


@every_order
@pytest.mark.parametrize(
    "rows",
    [
        lambda rows: rows[::-1],
        lambda rows: [row for row in rows if row[0] != -2],
        lambda rows: [(9, "USED", 77, b""), *rows, (9, "ORPHAN", 1, b"")],
        lambda rows: [(number, name.lower(), *rest) for number, name, *rest in rows],
        lambda rows: [*rows, (2, "ODD", b"\x08\0" + bytes(8), b"")],
        lambda rows: [*rows, (2, "EMPTY", b"\xff\2\0\xff", b"")],
        lambda rows: [*rows, (2, "HUGE", b"\xff\7\0\xff\xff\xff\xff\xff\xff", b"")],
        lambda rows: [*rows, (2, "a\x01\xe9", 1, b"")],
    ],
    ids=["backwards", "no group", "orphans", "lower case", "8 bytes", "empty", "huge", "name"],
)
def test_chains_of_parameters(rows: Any, order: str, file: Path) -> None:
    path, content = file, c3d(TRUTH, order=order, rows=rows, last_pointer=1)
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        check(read_tracks(path))


@every_order
def test_locked_parameters_and_a_last_pointer(order: str, file: Path) -> None:
    check(read(file, c3d(TRUTH, order=order, locked=True)))
    check(read(file, c3d(TRUTH, order=order, last_pointer=1)))


def test_long_parameters_need_a_pointer_without_a_sign(file: Path) -> None:
    changes = {("ANALYSIS", "VALUES"): np.zeros((100, 90)), ("ANALYSIS", "AFTER"): 1}
    check(read(file, c3d(TRUTH, changes=changes)))


def test_a_broken_chain_is_told(file: Path) -> None:
    changes = {("NOTES", "LINE"): "x" * 20, ("NOTES", "OTHER"): 1}
    content = c3d(TRUTH, changes=changes)
    at = content.index(b"LINE") + 4
    broken = content[:at] + b"\xff\x7f" + content[at + 2 :]
    check(read_warned(file, broken, r"chain of parameters is broken \(the pointer of LINE"))
    at = content.index(b"LABELS") + 6
    broken = content[:at] + b"\xff\x7f" + content[at + 2 :]
    check(read_warned(file, broken, r"chain of parameters is broken \(the pointer of LABELS"))
    # The same pointer, and nothing behind it that could be found.
    refuse(file, broken[: at + 16].ljust(1024, b"\x01") + broken[1024:], r"chain.*is broken")


def test_labels(file: Path) -> None:
    labels = ["chin", "", "kind näsa"]
    tracks = read(file, c3d(TRUTH, labels=labels))
    assert tracks.names == ("chin", "unlabelled 2", "kind näsa")
    content = c3d(TRUTH, changes={("POINT", "LABELS"): ["chin"]})
    assert read(file, content).names == ("chin", "unlabelled 2", "unlabelled 3")
    content = c3d(TRUTH, changes={("POINT", "LABELS"): ["chin", "lip", "nose", "more", "yet"]})
    check(read(file, content))
    content = c3d(TRUTH, changes={("POINT", "LABELS"): None})
    assert read(file, content).names == ("unlabelled 1", "unlabelled 2", "unlabelled 3")
    parts = {("POINT", "LABELS"): ["chin"], ("POINT", "LABELS2"): ["lip"]}
    check(read(file, c3d(TRUTH, changes=parts | {("POINT", "LABELS3"): ["nose"]})))
    content = c3d(TRUTH[:, :1], changes={("POINT", "LABELS"): "chin"})
    assert read(file, content).names == ("chin",)
    content = c3d(TRUTH, changes={("POINT", "LABELS"): b"\xff\2\5\3chin\0lip\0xnose\xe4"})
    assert read(file, content).names == ("chin", "lip", "noseä")
    content = c3d(TRUTH, labels=["chin", "RTHI", "RTHI"])
    assert read_warned(file, content, r"more than once").names == ("chin", "RTHI", "RTHI_2")


@pytest.mark.parametrize("place", ["ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "ANGLES2"])
def test_what_is_no_position_is_left_out(place: str, file: Path) -> None:
    changes: dict[Any, Any] = {("POINT", place): ["nose", "absent"]}
    if place == "ANGLES2":
        changes["POINT", "ANGLES"] = ["other"]
    tracks = read_warned(file, c3d(TRUTH, changes=changes), r"left out.*: nose$")
    assert tracks.names == ("chin", "lip")
    np.testing.assert_allclose(tracks.positions, TRUTH[:, :2], atol=1e-4)
    labels = ["Ann:chin", "Ann:lip", "Ann:nose"]
    tracks = read_warned(file, c3d(TRUTH, labels=labels, changes=changes), r"left out")
    assert tracks.names == ("chin", "lip")


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        *(("mete", 1000), ("met", 1000), ("Metr", 1000), ("METERS", 1000), ("m", 1000)),
        *(("mill", 1), ("milli", 1), ("MM", 1), ("cent", 10), ("cm\0\0", 10), ("deci", 100)),
        *(("inch", 25.4), ("feet", 304.8), ("foot", 304.8)),
    ],
)
def test_units(unit: str, factor: float, file: Path) -> None:
    tracks = read(file, c3d(TRUTH / factor, unit=unit))
    np.testing.assert_allclose(tracks.positions, TRUTH, rtol=1e-5)


def test_units_of_nobody(file: Path) -> None:
    check(read_warned(file, c3d(TRUTH, changes={("POINT", "UNITS"): None}), r"its unit of length"))
    check(read_warned(file, c3d(TRUTH, changes={("POINT", "UNITS"): [" "]}), r"its unit of length"))
    refuse(file, c3d(TRUTH, unit="me"), r"'me'")
    check(read(file, c3d(TRUTH, unit="me"), unit="mm"))


# --- Events -------------------------------------------------------------------------------------

CLAPS = (Event("clap", 57.5), Event("Left Clap2", 62.5))


@every_order
@pytest.mark.parametrize(
    "times",
    [
        np.array([[0, 1], [57.5, 2.5]]),
        np.array([0, 57.5, 1, 2.5]),
        np.array([57.5, 62.5]),
        np.array([[0, 57.5], [1, 2.5], [9, 9]]),
        np.array([[0, 1, 0], [57.5, 2.5, 0]]),
        np.array([[[0, 1]], [[57.5, 2.5]]]),
    ],
    ids=lambda times: str(times.shape),
)
def test_events_of_any_shape(times: Any, order: str, file: Path) -> None:
    if times.shape == (3, 2):
        # Minutes of all, then their seconds.
        times = np.array([[0, 57.5], [1, 2.5], [0, 0]])
    changes = {
        ("EVENT", "USED"): 3 if times.shape == (3, 2) else 2,
        ("EVENT", "LABELS"): ["clap", "Clap2", "end"],
        ("EVENT", "CONTEXTS"): ["General", "Left"],
        ("EVENT", "TIMES"): times,
    }
    tracks = read(file, c3d(TRUTH, order=order, changes=changes))
    assert tracks.events[:2] == CLAPS


def test_events_that_say_less(file: Path) -> None:
    times = np.array([[0, 1], [57.5, 2.5]])
    changes: dict[Any, Any] = {("EVENT", "TIMES"): times}
    names = [event.name for event in read(file, c3d(TRUTH, changes=changes)).events]
    assert names == ["event 1", "event 2"]
    assert not read(file, c3d(TRUTH, changes=changes | {("EVENT", "USED"): 0})).events
    content = c3d(TRUTH, changes={("EVENT", "USED"): 2, ("EVENT", "LABELS"): ["a", "b"]})
    assert not read(file, content).events
    content = c3d(TRUTH, changes=changes | {("EVENT", "USED"): 3})
    assert len(read_warned(file, content, r"1 of 3 events have no time").events) == 2
    changes["EVENT", "TIMES"] = times[:, 1:]
    content = c3d(TRUTH, changes=changes | {("EVENT", "USED"): 2})
    assert read_warned(file, content, r"1 of 2 events have no time").events[0].time == 62.5
    changes["EVENT", "TIMES"] = times = times.copy()
    times[0, 0] = math.nan
    content = c3d(TRUTH, changes=changes | {("EVENT", "USED"): 2})
    assert len(read_warned(file, content, r"1 of 2 events have no time").events) == 1


@every_order
def test_events_of_the_header(order: str, file: Path) -> None:
    events = [("RIC", 2.75), ("RHS", 5.5), ("RTO", 7.25)]
    tracks = read(file, c3d(TRUTH, order=order, header_events=events))
    assert tracks.events == tuple(Event(*event) for event in events)


# --- What is refused ----------------------------------------------------------------------------

NOTHING = np.zeros((8, 0, 3))


@every_order
@pytest.mark.parametrize(
    ("oddity", "words"),
    [
        ({"channels": 2}, r"holds analog data only, no markers"),
        ({"changes": {("ROTATION", "USED"): 2}}, r"holds rotations only, no markers"),
        (
            {"channels": 2, "changes": {("ROTATION", "USED"): 2}},
            r"holds rotations and analog data only, no markers",
        ),
        ({}, r"holds no markers"),
    ],
)
def test_files_without_markers_are_not_damaged(
    oddity: Any, words: str, order: str, file: Path
) -> None:
    content = c3d(NOTHING, order=order, **oddity) + bytes(512)
    refuse(file, content, words)
    with pytest.raises(FileFormatError) as caught:
        read_tracks(file)
    assert "damaged" not in str(caught.value)


def test_angles_alone_are_no_markers(file: Path) -> None:
    changes = {("POINT", "ANGLES"): ["chin", "lip", "nose"]}
    refuse(file, c3d(TRUTH, changes=changes), r"no positions of markers.*3 angles")


def test_rotations_behind_the_points_are_no_frames(file: Path) -> None:
    """Which matters where the length of the file says how many there are."""
    content = c3d(
        count_up(66000),
        labels=["a"],
        floats=False,
        scale=1.0,
        changes={("ROTATION", "USED"): 1, ("ROTATION", "DATA_START"): 1035},
    )
    content = content[: 1034 * 512].ljust(1034 * 512, b"\0") + b"\1" * 5000
    assert read_warned(file, content, r"holds 66000").frames == 66000


@pytest.mark.parametrize("block", [0, 1, 3, 60000])
def test_rotations_that_are_not_where_they_should_be(block: int, file: Path) -> None:
    changes = {("ROTATION", "USED"): 1, ("ROTATION", "DATA_START"): block}
    long = np.tile(TRUTH, (20, 1, 1))
    file.write_bytes(c3d(long, changes=changes) + b"\1" * 5000)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        tracks = read_tracks(file)
    np.testing.assert_allclose(tracks.positions, long, atol=1e-4)


@pytest.mark.parametrize("word", [2, 3, 4, 5, 9, 10])
@every_kind
def test_a_claim_costs_no_memory(word: int, floats: bool, file: Path) -> None:
    content = c3d(TRUTH, floats=floats, header={word: 65534})
    file.write_bytes(content)
    tracemalloc.start()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        try:
            check(read_tracks(file))
        except FileFormatError:
            pass
        except AssertionError:
            assert word == 4
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 5e6


@pytest.mark.parametrize("order", ORDERS)
@every_kind
def test_damage_of_any_kind_is_one_clear_error(order: str, floats: bool, file: Path) -> None:
    rng = np.random.default_rng(3)
    changes = {("EVENT", "USED"): 1, ("EVENT", "TIMES"): np.ones((2, 1))}
    good = np.frombuffer(
        c3d(TRUTH, order=order, floats=floats, channels=2, changes=changes), np.uint8
    )
    for _ in range(80):
        damaged = good.copy()
        where = rng.integers(0, 1024 if rng.random() < 0.8 else len(good), rng.integers(1, 8))
        damaged[where] = rng.integers(0, 256, len(where))
        file.write_bytes(damaged.tobytes()[: rng.integers(1, len(good) + 1)])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", MocapFitWarning)
            try:
                frames, message = read_tracks(file).frames, ""
            except MocapFitError as error:
                frames, message = 0, str(error)
        assert (frames > 0) != (str(file) in message)


# --- The cases ----------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def cases(data_folder: Path) -> Path:
    folder = data_folder.parent / "cases"
    if not folder.is_dir():
        pytest.skip(f"no cases in {folder}")
    return folder


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("description_255", {}),
        ("description_163", {}),
        ("analog_without_SCALE_float", {}),
        ("int_analog_no_rate", {}),
        ("int_no_point_scale", {}),
        ("int_frames_larger", {}),
        ("trimmed_far_in", {"start_time": 700.0}),
        ("subject_star", {"names": ("chin", "lip", "*110")}),
        ("dup_unused", {"names": ("chin", "RTHI", "RTHI_2")}),
        ("events_flat_times", {"start_time": 57.0}),
        ("float_offset_analog", {}),
        ("unit_mete", {}),
    ],
)
def test_cases(name: str, expected: dict[str, Any], cases: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        tracks = read_tracks(cases / f"{name}.c3d")
    assert (tracks.frames, tracks.rate) == (8, 100.0)
    assert tracks.names == expected.get("names", ("chin", "lip", "nose"))
    assert tracks.start_time == pytest.approx(expected.get("start_time", 0.0))
    assert tracks.visible.all()
    np.testing.assert_allclose(tracks.positions[:4, 0], TRUTH[:4, 0], atol=1e-3)
    if name == "events_flat_times":
        assert [event.name for event in tracks.events] == ["clap", "Clap2"]
        assert [event.time for event in tracks.events] == pytest.approx([57.1, 62.5])


@pytest.mark.real_data
def test_other_cases(cases: Path, file: Path) -> None:
    with pytest.raises(FileFormatError, match=r"analog data only, no markers") as caught:
        read_tracks(cases / "analog_only.c3d")
    assert "damaged" not in str(caught.value)
    content = gzip.decompress((cases / "more_than_65535_frames.c3d.gz").read_bytes())
    tracks = read_warned(file, content, r"says 65535 frames and holds 66000")
    np.testing.assert_array_equal(tracks.positions[:, 0, 0], np.arange(66000) % 1000)
    tracks = read(file, (cases / "hard" / "c3d_6686b263.c3d").read_bytes())
    assert (tracks.frames, tracks.start_time) == (12, 0.5)
