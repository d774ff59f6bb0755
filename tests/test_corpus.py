import copy
import hashlib
import pickle

import numpy as np
import pytest
from scipy.stats import kstest

from mocap_fit.corpus import Corpus, Utterance, draw_fraction, open_corpus, save_corpus
from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.tracks import MarkerTracks, ParameterTracks, PoseTracks

NAMES = ("jaw_rotation", "lip_rounding")


def utterance(name: str, split: str = "train", rate: float = 60.0) -> Utterance:
    values = np.random.default_rng(len(name)).normal(size=(30, 2))
    phones = PhoneSequence(
        (
            PhoneSegment(0.0, 0.2, "SIL"),
            PhoneSegment(0.2, 0.5, "AA", 1, "a", -12.5),
        ),
        phone_set="en-arpabet",
        name=name,
    ).add_step("read_phones", {"file": "x.TextGrid"})
    tracks = ParameterTracks(NAMES, rate, values, start_time=0.02, name=name)
    return Utterance.from_tracks(
        tracks, phones, split=split, text="ah", sources=("a.tsv",), checks=("ok",)
    )


def corpus(*names: str) -> Corpus:
    given = [utterance(name, "test" if name.startswith("t") else "train") for name in names]
    return Corpus.from_utterances(given, "en-arpabet")


def test_a_corpus_comes_back_from_disk_as_it_was(tmp_path):
    made = corpus("b", "a", "t")
    save_corpus(made, tmp_path / "corpus")
    read = open_corpus(tmp_path / "corpus")
    assert [u.id for u in read] == ["a", "b", "t"]
    assert (read.parameter_names, read.rate, read.language) == (NAMES, 60.0, "en")
    assert read.phone_set == made.phone_set
    for before, after in zip(made, read, strict=True):
        assert np.array_equal(before.read_tracks().values, after.read_tracks().values)
        assert after.read_tracks().start_time == before.read_tracks().start_time
        assert after.read_phones() == before.read_phones()
        for name in ("id", "split", "text", "sources", "checks", "duration"):
            assert getattr(before, name) == getattr(after, name)
    assert read["a"].sound_file is None


def test_pandas_reads_a_corpus_as_one_table(tmp_path):
    import pandas as pd

    save_corpus(corpus("a", "b"), tmp_path / "corpus")
    tracks = pd.read_parquet(tmp_path / "corpus" / "tracks")
    assert tracks.groupby("utterance").size().to_dict() == {"a": 30, "b": 30}
    phones = pd.read_parquet(tmp_path / "corpus" / "phones")
    assert phones["phone"].tolist() == ["SIL", "AA"] * 2
    assert phones["stress"].isna().tolist() == [True, False] * 2


def test_the_same_corpus_gives_the_same_bytes(tmp_path):
    for name in ("one", "two"):
        save_corpus(corpus("a", "b"), tmp_path / name)
    one = sorted(p for p in (tmp_path / "one").rglob("*") if p.is_file())
    assert len(one) == 6
    for path in one:
        assert (
            path.read_bytes()
            == (tmp_path / "two" / path.relative_to(tmp_path / "one")).read_bytes()
        )


def test_splits_and_parts():
    made = corpus("a", "b", "t")
    assert made.splits == ("test", "train")
    assert [u.id for u in made.get_split("train")] == ["a", "b"]
    with pytest.raises(DataError, match=r"no utterance in the split 'dev'.*test, train"):
        made.get_split("dev")
    with pytest.raises(DataError, match="no utterance 'c'"):
        made["c"]


def test_what_is_held_out_stays_when_utterances_are_added():
    names = [f"u{i}" for i in range(60)]
    small, large = corpus(*names[:40]), corpus(*names)
    kept, out = small.hold_out(0.2, seed=3)
    assert len(kept) + len(out) == 40
    assert 2 <= len(out) <= 16
    larger_out = {u.id for u in large.hold_out(0.2, seed=3)[1]}
    assert {u.id for u in out} <= larger_out
    assert {u.id for u in kept}.isdisjoint(larger_out)
    assert {u.id for u in out} != {u.id for u in small.hold_out(0.2, seed=4)[1]}


def test_one_utterance_has_no_part_to_hold_out():
    with pytest.raises(DataError, match="two or more"):
        corpus("a").hold_out(0.5)
    kept, out = corpus("a", "b").hold_out(0.0)
    assert (len(kept), len(out)) == (1, 1)


def test_utterances_must_fit_together():
    other = ParameterTracks(("x",), 60.0, np.zeros((3, 1)), name="o")
    with pytest.raises(DataError, match="different parameters"):
        Corpus.from_utterances(
            [utterance("a"), Utterance.from_tracks(other, utterance("a").read_phones())],
            "en-arpabet",
        )
    with pytest.raises(DataError, match=r"one id.*a"):
        corpus("a", "a")
    with pytest.raises(DataError, match="one or more"):
        Corpus.from_utterances([], "en-arpabet")
    assert (
        Corpus.from_utterances([utterance("a"), utterance("b", rate=25.0)], "en-arpabet").rate
        is None
    )


def test_an_utterance_in_memory_has_no_markers():
    with pytest.raises(DataError, match="in memory and has no markers"):
        _ = utterance("a").read_markers()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda f: (f / "corpus.toml").unlink(), "not a corpus.*convert"),
        (lambda f: (f / "corpus.toml").write_text("x = "), "not TOML"),
        (lambda f: (f / "corpus.toml").write_text("format_version = 9"), "format_version 9"),
        (
            lambda f: (f / "corpus.toml").write_text("format_version = 1"),
            "language: this is missing",
        ),
        (lambda f: (f / "utterances.parquet").unlink(), "utterances.parquet.*no such file"),
        (lambda f: (f / "utterances.parquet").write_bytes(b"PAR1"), "not a whole Parquet"),
        (
            lambda f: (f / "corpus.toml").write_text(
                (f / "corpus.toml").read_text().replace("en-arpabet", "martian")
            ),
            "phone set of the corpus",
        ),
    ],
)
def test_a_damaged_corpus_is_refused(tmp_path, spoil, words):
    save_corpus(corpus("a"), tmp_path / "corpus")
    spoil(tmp_path / "corpus")
    with pytest.raises(FileFormatError, match=words):
        open_corpus(tmp_path / "corpus")


def test_files_of_an_utterance_that_are_wrong_are_named(tmp_path):
    save_corpus(corpus("a"), tmp_path / "corpus")
    read = open_corpus(tmp_path / "corpus")
    tracks = tmp_path / "corpus" / "tracks" / "a.parquet"
    phones = tmp_path / "corpus" / "phones" / "a.parquet"
    content = tracks.read_bytes()
    tracks.write_bytes(phones.read_bytes())
    with pytest.raises(FileFormatError, match=r"a\.parquet.*cannot be used as tracks.*phones"):
        _ = read["a"].read_tracks()
    phones.write_bytes(content)
    with pytest.raises(FileFormatError, match="cannot be used as phones"):
        _ = read["a"].read_phones()
    with pytest.raises(FileFormatError, match="cannot be made"):
        save_corpus(corpus("a"), tmp_path / "corpus")


def test_corpora_and_utterances_are_equal_by_content_wherever_they_are(tmp_path):
    in_memory = corpus("a", "b", "t")
    save_corpus(in_memory, tmp_path / "one")
    save_corpus(corpus("a", "b", "t"), tmp_path / "two")
    one, two = open_corpus(tmp_path / "one"), open_corpus(tmp_path / "two")
    assert one == open_corpus(tmp_path / "one")
    assert one["a"] == two["a"] == in_memory["a"]
    assert hash(one["a"]) == hash(in_memory["a"])
    assert one["a"] != one["b"]
    assert one != one.select(["a", "b"])
    assert one != "a corpus"
    assert one["a"] != "an utterance"
    assert utterance("a") == utterance("a")
    tracks, phones = utterance("a").read_tracks(), utterance("a").read_phones()
    about = {"split": "train", "text": "ah", "sources": ("a.tsv",), "checks": ("ok",)}
    assert utterance("a") == Utterance.from_tracks(tracks, phones, **about)
    moved = tracks.replace(values=tracks.values + 1e-9)
    assert utterance("a") != Utterance.from_tracks(moved, phones, **about)
    other = phones.replace(segments=phones.segments[:1])
    assert utterance("a") != Utterance.from_tracks(tracks, other, **about)
    assert utterance("a") != Utterance.from_tracks(tracks, phones, **{**about, "text": "oh"})


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda c: pickle.loads(pickle.dumps(c))])
def test_corpora_can_be_pickled_and_copied(twin, tmp_path):
    save_corpus(corpus("a", "b"), tmp_path / "corpus")
    for original in (corpus("a", "b"), open_corpus(tmp_path / "corpus")):
        assert twin(original) == original
        assert twin(original)["a"] == original["a"]
        assert isinstance(twin(original).utterances, tuple)


def test_a_pickled_corpus_holds_nothing_of_what_was_read(tmp_path):
    save_corpus(corpus("a", "b"), tmp_path / "corpus")
    read = open_corpus(tmp_path / "corpus")
    before = pickle.dumps(read)
    read["a"].read_tracks(), read["a"].read_phones()
    assert pickle.dumps(read) == before


def test_people_see_a_few_lines(tmp_path):
    shown = corpus("a", "b", "t")
    assert repr(shown) == (
        "Corpus of 3 utterances (test 1, train 2), 1.5 s\n"
        "  phone set 'en-arpabet', 2 parameters, 60 Hz"
    )
    assert repr(shown["a"]) == "Utterance('a', split='train', 0.50 s, 'ah')"
    long = Utterance("x", text="word " * 20)
    assert len(repr(long)) < 90
    page = shown._repr_html_()
    assert "<td>train</td><td>2</td><td>1.0</td>" in page
    mixed = Corpus.from_utterances([utterance("a"), utterance("b", rate=25.0)], "en-arpabet")
    assert "several rates" in repr(mixed)
    odd = Corpus.from_utterances([utterance("a", split="<b>")], "en-arpabet")
    assert "<b>" not in odd._repr_html_()


def test_markers_and_head_motion_can_be_held_in_memory():
    markers = MarkerTracks(("m",), 60.0, np.zeros((30, 1, 3)))
    still = np.tile(np.eye(3), (30, 1, 1, 1))
    head = PoseTracks(("head",), 60.0, still, np.zeros((30, 1, 3)), np.zeros((30, 1)))
    tracks, phones = utterance("a").read_tracks(), utterance("a").read_phones()
    held = Utterance.from_tracks(tracks, phones, markers=markers, head=head)
    assert held.read_markers() is markers
    assert held.read_head() is head


def test_what_is_drawn_by_name_is_even():
    """A number of SHA-256: by hand for one name; even over many, with another seed another."""
    digest = hashlib.sha256(b"3\0a").hexdigest()
    assert draw_fraction("a", 3) == int(digest[:16], 16) / 2**64
    numbers = np.array([draw_fraction(f"u{i}", 0) for i in range(2000)])
    assert kstest(numbers, "uniform").pvalue > 0.01
