import numpy as np
import pytest

from mocap_fit.corpus import Corpus, Utterance, open_corpus, save_corpus
from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.tracks import ParameterTracks

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
    ).with_step("read_phones", {"file": "x.TextGrid"})
    tracks = ParameterTracks(NAMES, rate, values, start_time=0.02, name=name)
    return Utterance.of(tracks, phones, split=split, text="ah", sources=("a.tsv",), checks=("ok",))


def corpus(*names: str) -> Corpus:
    given = [utterance(name, "test" if name.startswith("t") else "train") for name in names]
    return Corpus.of(given, "en-arpabet")


def test_a_corpus_comes_back_from_disk_as_it_was(tmp_path):
    made = corpus("b", "a", "t")
    save_corpus(made, tmp_path / "corpus")
    read = open_corpus(tmp_path / "corpus")
    assert [u.id for u in read] == ["a", "b", "t"]
    assert (read.parameter_names, read.rate, read.language) == (NAMES, 60.0, "en")
    assert read.phone_set == made.phone_set
    for before, after in zip(made, read, strict=True):
        assert np.array_equal(before.tracks.values, after.tracks.values)
        assert after.tracks.start_time == before.tracks.start_time
        assert after.phones == before.phones
        for name in ("id", "split", "text", "sources", "checks", "duration"):
            assert getattr(before, name) == getattr(after, name)
    assert read["a"].sound is None


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
    assert [u.id for u in made.split("train")] == ["a", "b"]
    with pytest.raises(DataError, match=r"no utterance in the split 'dev'.*test, train"):
        made.split("dev")
    with pytest.raises(DataError, match="no utterance 'c'"):
        made["c"]


def test_what_is_held_out_stays_when_utterances_are_added():
    names = [f"u{i}" for i in range(60)]
    small, large = corpus(*names[:40]), corpus(*names)
    kept, out = small.held_out(0.2, seed=3)
    assert len(kept) + len(out) == 40
    assert 2 <= len(out) <= 16
    larger_out = {u.id for u in large.held_out(0.2, seed=3)[1]}
    assert {u.id for u in out} <= larger_out
    assert {u.id for u in kept}.isdisjoint(larger_out)
    assert {u.id for u in out} != {u.id for u in small.held_out(0.2, seed=4)[1]}


def test_one_utterance_has_no_part_to_hold_out():
    with pytest.raises(DataError, match="two or more"):
        corpus("a").held_out(0.5)
    kept, out = corpus("a", "b").held_out(0.0)
    assert (len(kept), len(out)) == (1, 1)


def test_utterances_must_fit_together():
    other = ParameterTracks(("x",), 60.0, np.zeros((3, 1)), name="o")
    with pytest.raises(DataError, match="different parameters"):
        Corpus.of([utterance("a"), Utterance.of(other, utterance("a").phones)], "en-arpabet")
    with pytest.raises(DataError, match=r"one id.*a"):
        corpus("a", "a")
    with pytest.raises(DataError, match="one or more"):
        Corpus.of([], "en-arpabet")
    assert Corpus.of([utterance("a"), utterance("b", rate=25.0)], "en-arpabet").rate is None


def test_an_utterance_in_memory_has_no_markers():
    with pytest.raises(DataError, match="in memory and has no markers"):
        _ = utterance("a").markers


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda f: (f / "corpus.toml").unlink(), "not a corpus.*convert"),
        (lambda f: (f / "corpus.toml").write_text("x = "), "not TOML"),
        (lambda f: (f / "corpus.toml").write_text("format_version = 9"), "format_version 9"),
        (lambda f: (f / "corpus.toml").write_text("format_version = 1"), "lacks something"),
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
        _ = read["a"].tracks
    phones.write_bytes(content)
    with pytest.raises(FileFormatError, match="cannot be used as phones"):
        _ = read["a"].phones
    with pytest.raises(FileFormatError, match="cannot be made"):
        save_corpus(corpus("a"), tmp_path / "corpus")
