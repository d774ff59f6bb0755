"""Edit lists: each edit does what it says, and nothing else; bad ones are refused in words."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

import mocap_fit as mf
from mocap_fit.edits import (
    DropMarker,
    DropSpan,
    EditHistory,
    EditList,
    Merge,
    Mirror,
    MoveBoundary,
    Relabel,
    Rename,
    SetReference,
    Split,
    Swap,
    load_edits,
    locate_edits,
    read_edits,
    start_edits,
    write_edits,
)
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError
from mocap_fit.labels import Label, Labels, Tier, to_phones
from mocap_fit.tracks import MarkerTracks, Origin

NO_SUM = "0" * 64
LIST = EditList(recording="take.tsv", sha256=NO_SUM)


@pytest.fixture
def take(rng):
    positions = rng.normal(size=(100, 4, 3))
    positions[10:12, 0] = np.nan
    return MarkerTracks(("a", "b", "c", "d"), 50.0, positions, start_time=1.0)


def phones(*texts):
    entries = tuple(Label(k / 10, (k + 1) / 10, text) for k, text in enumerate(texts))
    return Labels((Tier("phones", entries),), 0.0, len(texts) / 10, name="take")


def entries(labels):
    return [(entry.start, entry.end, entry.text) for entry in labels.tiers[0].entries]


class TestMarkers:
    def test_a_span_is_from_its_start_to_before_its_end(self, take):
        after = LIST.add(DropSpan(markers=("b",), start=1.2, end=1.4)).apply(take)
        gone = ~after.visible[:, 1]
        assert list(np.flatnonzero(gone)) == list(range(10, 20))
        assert (after.origin[10:20, 1] == Origin.MISSING).all()
        others = after.positions[:, [0, 2, 3]]
        np.testing.assert_array_equal(others, take.positions[:, [0, 2, 3]])

    def test_all_markers_where_none_is_named_and_all_times_where_none_is_given(self, take):
        assert not LIST.add(DropSpan()).apply(take).visible.any()

    def test_a_swap_takes_gaps_and_origins_with_it(self, take):
        after = LIST.add(Swap(markers=("a", "c"), start=1.2, end=1.22)).apply(take)
        np.testing.assert_array_equal(after["c"][10], take["a"][10])
        np.testing.assert_array_equal(after["a"][10], take["c"][10])
        np.testing.assert_array_equal(after.positions[11:], take.positions[11:])
        assert not after.visible[10, 2]

    @given(
        start=st.floats(1.0, 2.9),
        pair=st.sampled_from([("a", "b"), ("d", "a"), ("c", "b")]),
        axis=st.sampled_from("xyz"),
    )
    def test_swaps_and_mirrors_undo_themselves(self, start, pair, axis):
        positions = np.random.default_rng(1).normal(size=(100, 4, 3))
        take = MarkerTracks(("a", "b", "c", "d"), 50.0, positions, start_time=1.0)
        twice = [Swap(markers=pair, start=start)] * 2 + [Mirror(axis=axis)] * 2
        assert LIST.add(*twice).apply(take).equals(take)

    def test_edits_are_applied_in_their_order(self, take):
        after = LIST.add(Rename(old="a", new="z"), DropMarker(marker="b")).apply(take)
        assert after.names == ("z", "c", "d")
        with pytest.raises(DataError, match=r"edit 2 .*\(drop_marker\).*no marker 'a'"):
            LIST.add(Rename(old="a", new="z"), DropMarker(marker="a")).apply(take)

    def test_a_mirror_turns_one_axis_round(self, take):
        after = LIST.add(Mirror(axis="y")).apply(take)
        np.testing.assert_array_equal(after.positions, take.positions * [1, -1, 1])

    def test_the_provenance_has_the_edits_and_the_take_is_as_it_was(self, take):
        copy = take.positions.copy()
        steps = LIST.add(Mirror(), Relabel(time=1, phone="A")).apply(take).provenance
        assert steps[-1].arguments == {
            "edits": [
                {"edit": "mirror", "axis": "x"},
                {"edit": "relabel", "time": 1.0, "phone": "A", "former": ""},
            ]
        }
        np.testing.assert_array_equal(take.positions, copy)
        assert LIST.apply(take) is take

    @pytest.mark.parametrize(
        ("edit", "words"),
        [
            (Swap(markers=("a", "nose")), "no marker 'nose'"),
            (DropSpan(markers=("nose",)), "no marker 'nose'"),
            (DropMarker(marker="nose"), "no marker 'nose'"),
            (Rename(old="nose", new="n"), "no marker 'nose'"),
            (Rename(old="a", new="b"), "two markers would be called 'b'"),
            (DropSpan(start=7, end=8), "within 1.000 to 2.980 s"),
            (Swap(markers=("a", "b"), start=0, end=0.5), "within 1.000 to 2.980 s"),
        ],
    )
    def test_what_does_not_fit_the_recording_is_refused(self, take, edit, words):
        with pytest.raises(DataError, match=words) as caught:
            LIST.add(edit).apply(take)
        assert "edit 1 of the edit list" in str(caught.value)


class TestPhones:
    def test_a_boundary_moves_for_both_phones(self):
        after = LIST.add(MoveBoundary(time=0.1004, to=0.13)).apply_to_labels(phones("a", "b", "c"))
        assert entries(after) == [(0, 0.13, "a"), (0.13, 0.2, "b"), (0.2, 3 / 10, "c")]

    def test_phones_are_relabelled_split_and_merged(self):
        edits = LIST.add(
            Relabel(time=0.15, phone="x", former="b"),
            Split(time=0.25, phones=("p", "q")),
            Merge(time=0.1, phone="m"),
        )
        after = edits.apply_to_labels(phones("a", "b", "c"))
        assert entries(after) == [(0, 0.2, "m"), (0.2, 0.25, "p"), (0.25, 3 / 10, "q")]

    def test_splitting_and_merging_leave_the_times_as_they_were(self):
        before = phones("a", "b", "c")
        edits = LIST.add(Split(time=0.17, phones=("p", "q")), Merge(time=0.17, phone="b"))
        assert edits.apply_to_labels(before) == before

    def test_other_tiers_stay(self):
        words = Tier("words", (Label(0, 0.2, "ab"),))
        labels = Labels((words, *phones("a", "b").tiers), 0, 0.2)
        after = LIST.add(Relabel(time=0, phone="z")).apply_to_labels(labels)
        assert after.get_tier("words") is words
        assert [segment.phone for segment in to_phones(after)] == ["z", "b"]

    @pytest.mark.parametrize(
        ("edit", "words"),
        [
            (MoveBoundary(time=0.15, to=0.16), "nearest, at 0.1 s"),
            (MoveBoundary(time=0.1, to=0.2), "pass a boundary of 'b'"),
            (MoveBoundary(time=0.1, to=-1), "pass a boundary of 'a'"),
            (MoveBoundary(time=0.1, to=0.25), "pass a boundary of 'b'"),
            (Relabel(time=0.05, phone="x", former="c"), r"found a, expected c"),
            (Relabel(time=4, phone="x"), "no phone is labelled at 4 s"),
            (Split(time=0.1, phones=("x", "y")), "cannot be split at its start"),
            (Merge(time=0, phone="x"), "no two phones meet at 0 s"),
            (Merge(time=0.05, phone="x"), "no phone begins or ends at 0.05 s"),
        ],
    )
    def test_what_does_not_fit_the_labels_is_refused(self, edit, words):
        with pytest.raises(DataError, match=words):
            LIST.add(edit).apply_to_labels(phones("a", "b", "c"))

    def test_boundaries_that_were_moved_over_each_other_are_refused(self):
        edits = LIST.add(MoveBoundary(time=0.1, to=0.19), MoveBoundary(time=0.2, to=0.15))
        with pytest.raises(DataError, match="edit 2"):
            edits.apply_to_labels(phones("a", "b", "c"))

    def test_a_phone_must_be_in_the_set_or_in_the_table(self):
        phone_set = mf.load_phone_set("sv-sta")
        edits = LIST.add(Relabel(time=0, phone="foo"))
        with pytest.raises(DataError, match="'foo' is not in the phone set 'sv-sta'"):
            edits.apply_to_labels(phones("S", "V"), phone_set=phone_set)
        assert edits.apply_to_labels(phones("S", "V"), phone_set=phone_set, table={"foo": "A"})

    def test_labels_without_a_phone_are_refused(self):
        with pytest.raises(DataError, match="no label at all"):
            LIST.add(Relabel(time=0, phone="a")).apply_to_labels(phones())


class TestFiles:
    def test_what_is_written_is_read(self, tmp_path):
        recording = tmp_path / "take.tsv"
        recording.write_bytes(b"some bytes")
        edits = start_edits(recording).add(
            Swap(markers=('a"\\\n', "é\x7f"), start=0.1, end=0.2),
            SetReference(start=0.2, end=0.5),
            DropSpan(start=3),
            Split(time=0.1, phones=("a", "b")),
        )
        write_edits(edits, tmp_path / "take.tsv.edits.toml")
        assert load_edits(recording) == edits
        assert edits.reference == SetReference(start=0.2, end=0.5)
        with pytest.raises(FileFormatError, match="no such edit list"):
            load_edits(recording, tmp_path / "nowhere")

    def test_lists_are_beside_the_recording_or_elsewhere(self, tmp_path):
        recording, other = tmp_path / "take.c3d", tmp_path / "lists"
        other.mkdir()
        assert locate_edits(recording) is None
        assert locate_edits(recording, other) is None
        (other / "take.c3d.edits.toml").touch()
        assert locate_edits(recording, other) == other / "take.c3d.edits.toml"
        assert locate_edits(recording, tmp_path / "my.toml") == tmp_path / "my.toml"

    def test_another_recording_is_refused(self, tmp_path):
        recording = tmp_path / "take.tsv"
        recording.write_bytes(b"before")
        write_edits(start_edits(recording), tmp_path / "take.tsv.edits.toml")
        recording.write_bytes(b"after")
        with pytest.raises(ConfigurationError, match="another recording") as caught:
            load_edits(recording)
        assert f"{recording} with the SHA-256 {start_edits(recording).sha256}" in str(caught.value)
        assert caught.value.path.endswith("take.tsv.edits.toml")

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ('edit = "explode"', r"edits\.0"),
            ('edit = "swap"\nmarkers = ["a"]', r"edits\.0\.markers"),
            ('edit = "swap"\nmarkers = ["a", "a"]', "itself"),
            ('edit = "drop_span"\nstart = "soon"', r"edits\.0\.start"),
            ('edit = "drop_span"\nstart = nan', r"edits\.0\.start"),
            ('edit = "drop_span"\nstart = 2\nend = 2', "not after the start"),
            ('edit = "mirror"\naxis = "w"', r"edits\.0\.axis"),
            ('edit = "mirror"\ncolour = 1', r"edits\.0\.colour"),
            ('edit = "relabel"\ntime = 1', r"edits\.0\.phone: this is missing"),
            ('edit = "relabel"\ntime = 1\nphone = ""', r"edits\.0\.phone"),
            ("time = 1", r"edits\.0"),
        ],
    )
    def test_wrong_lists_are_refused_where_they_are_wrong(self, tmp_path, text, words):
        path = tmp_path / "x.edits.toml"
        path.write_text(f'sha256 = "{NO_SUM}"\n[[edits]]\n{text}\n', encoding="utf-8")
        with pytest.raises(ConfigurationError, match=words) as caught:
            read_edits(path)
        assert str(path) in str(caught.value)

    def test_a_sum_is_needed(self, tmp_path):
        path = tmp_path / "x.edits.toml"
        path.write_text('sha256 = "abc"\n')
        with pytest.raises(ConfigurationError, match="sha256"):
            read_edits(path)
        with pytest.raises(FileFormatError, match="no such edit list"):
            read_edits(tmp_path / "other.toml")

    def test_wrong_edits_in_python_are_refused(self):
        with pytest.raises(ValidationError, match="not after the start"):
            DropSpan(start=2, end=1)

    def test_a_list_says_in_words_what_it_does(self):
        edits = LIST.add(
            Swap(markers=("a", "b"), start=1, end=2.5),
            Mirror(),
            DropSpan(),
            MoveBoundary(time=1, to=2),
        )
        assert edits.describe() == [
            "swap: start 1 s, end 2.5 s, a, b",
            "mirror: x",
            "drop span: all",
            "move boundary: time 1 s, to 2 s",
        ]

    def test_a_list_has_a_sum_of_its_content(self):
        assert LIST.digest == EditList(recording="take.tsv", sha256=NO_SUM).digest
        assert LIST.digest != LIST.add(Mirror()).digest


def test_edits_are_taken_back_and_brought_back():
    history = EditHistory(LIST)
    assert not history.undo()
    history.add(Mirror())
    history.add(DropMarker(marker="a"))
    assert [history.undo() for _ in range(3)] == [True, True, False]
    assert history.edits == LIST
    assert history.redo()
    assert history.edits == LIST.add(Mirror())
    history.add(Mirror(axis="z"))
    assert not history.redo()
    assert history.edits == LIST.add(Mirror(), Mirror(axis="z"))
