"""`mocap-fit simulate` as a whole: what a lab has, the truth beside it, the same every time."""

import hashlib
import json

import numpy as np
import pytest

from corpus_tools.cli import app as cli
from corpus_tools.conversion.entries import list_entries
from corpus_tools.conversion.manifest import load_manifest
from corpus_tools.simulation import list_languages
from corpus_tools.simulation.simulate import is_test
from mocap_fit.face import compute_lip_gap, load_face
from mocap_fit.io import read_tracks
from mocap_fit.labels import read_labels, read_phones
from mocap_fit.phones import load_phone_set, normalise_phones
from mocap_fit.sound import decode_pulses, energy_db, read_sound
from mocap_fit.tracks import read_parquet

COUNT = 2


def simulated(path, *options):
    given = ["simulate", str(path), "--utterances", str(COUNT), *map(str, options)]
    assert cli.main(given) == 0
    return path


def hashes(path):
    return {
        file.relative_to(path).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in sorted(path.rglob("*"))
        if file.is_file()
    }


@pytest.fixture(scope="module")
def corpora(tmp_path_factory):
    root = tmp_path_factory.mktemp("corpora")
    return {lang: simulated(root / lang, "--lang", lang) for lang in list_languages()}


@pytest.fixture(scope="module")
def spoken_by_espeak(tmp_path_factory):
    pytest.importorskip("espeakng_loader")
    path = tmp_path_factory.mktemp("espeak") / "en"
    return simulated(path, "--lang", "en", "--durations", "espeak")


@pytest.fixture(params=[*list_languages(), "espeak"])
def corpus(request, corpora):
    if request.param == "espeak":
        return request.getfixturevalue("spoken_by_espeak")
    return corpora[request.param]


def names(path):
    return [file.stem for file in sorted((path / "recordings").iterdir())]


def test_the_manifest_is_one(corpus):
    manifest = load_manifest(corpus / "manifest.toml")
    assert manifest.sync.kind == "pulses"
    assert manifest.sync.channel == 2
    found = list_entries(manifest, corpus)
    assert [entry.id for entry in found] == names(corpus) == ["sim001", "sim002"]
    for entry in found:
        assert entry.text.endswith((".", "?"))
        assert (corpus / entry.reference).is_file()
        for pattern in (
            manifest.recordings.pattern,
            manifest.labels.pattern,
            manifest.sound.pattern,
        ):
            assert (corpus / pattern.format(id=entry.id)).is_file()


def test_labels_are_phones_of_the_set_with_their_stress(corpus):
    manifest = load_manifest(corpus / "manifest.toml")
    phone_set = load_phone_set(manifest.phone_set)
    symbols = set(phone_set.list_symbols())
    for entry in list_entries(manifest, corpus):
        file = corpus / "labels" / f"{entry.id}.TextGrid"
        labels = read_labels(file)
        assert {label.text for label in labels.get_tier("phones").entries} <= symbols
        words = [label.text for label in labels.get_tier("words").entries if label.text]
        assert " ".join(words).lower() == entry.text.lower().replace(",", "").rstrip(".?")
        phones = normalise_phones(read_phones(file), phone_set)
        np.testing.assert_allclose(phones.starts[1:], phones.ends[:-1], atol=1e-6)
        assert phones[0].start == 0
        sound = read_sound(corpus / "sound" / f"{entry.id}.wav")
        assert phones[len(phones) - 1].end == pytest.approx(sound.duration, abs=1e-4)
        assert any(segment.stress == 1 for segment in phones)


def test_pulses_give_the_clock_that_the_truth_names(corpus):
    clocks = json.loads((corpus / "truth" / "sync.json").read_text())
    assert list(clocks) == names(corpus)
    starts = set()
    for name, clock in clocks.items():
        sound = read_sound(corpus / "sound" / f"{name}.wav")
        recording = read_tracks(corpus / "recordings" / f"{name}.tsv")
        truth = read_parquet(corpus / "truth" / "tracks" / f"{name}.parquet")
        pose = read_parquet(corpus / "truth" / "head" / f"{name}.parquet")
        assert sound.channels == 2
        found = decode_pulses(sound.get_channel(2), sound.rate, recording.rate, recording.frames)
        assert found.present.all()
        assert found.start_time == pytest.approx(clock["start_time"], abs=0.5 / sound.rate)
        assert found.samples[0] == clock["first_pulse_sample"]
        assert recording.frames == truth.frames == pose.frames == clock["frames"]
        assert truth.start_time == pose.start_time == clock["start_time"] > 0.04
        assert recording.start_time == 0
        assert clock["drift_ppm"] == 20
        # The recording ends before the sound does.
        assert truth.times[-1] < sound.duration - 0.04
        starts.add(clock["start_time"])
    assert len(starts) == COUNT


def test_face_and_sound_agree_with_the_labels(corpus):
    """What makes a corpus worth training on: closures where labels say so, and loud vowels."""
    manifest = load_manifest(corpus / "manifest.toml")
    phone_set, face = load_phone_set(manifest.phone_set), load_face()
    closures, energies = [], {"vowel": [], "silence": []}
    for name in names(corpus):
        phones = normalise_phones(read_phones(corpus / "labels" / f"{name}.TextGrid"), phone_set)
        truth = read_parquet(corpus / "truth" / "tracks" / f"{name}.parquet")
        sound = read_sound(corpus / "sound" / f"{name}.wav").drop_channel(2)
        levels = energy_db(sound, 0.5 * (phones.starts + phones.ends))
        for segment, level in zip(phones, levels, strict=True):
            phone = phone_set.get_phone(segment)
            if "bilabial_stop" in phone.get_classes():
                values = [np.interp(segment.centre, truth.times, row) for row in truth.values.T]
                closures.append(compute_lip_gap(face, np.array([values]))[0])
            if phone.kind in energies:
                energies[phone.kind].append(level)
    assert all(gap < 0.5 for gap in closures)
    assert min(energies["vowel"]) > max(energies["silence"]) + 6


def test_the_same_seed_gives_the_same_bytes(corpora, tmp_path):
    assert hashes(simulated(tmp_path / "again", "--lang", "cs")) == hashes(corpora["cs"])


@pytest.mark.slow
def test_espeak_says_the_same_again(spoken_by_espeak, tmp_path):
    again = simulated(tmp_path / "again", "--lang", "en", "--durations", "espeak")
    assert hashes(again) == hashes(spoken_by_espeak)


def test_more_sentences_leave_the_first_as_they_were(corpora, tmp_path):
    more = hashes(simulated(tmp_path / "more", "--utterances", COUNT + 1))
    first = hashes(corpora["sv"])
    different = {name for name in first if more[name] != first[name]}
    assert different == {"sentences.tsv", "truth/sync.json"}
    assert len(more) == len(first) + 5


def test_another_seed_says_something_else(corpora, tmp_path):
    other = hashes(simulated(tmp_path / "other", "--seed", 1))
    first = hashes(corpora["sv"])
    assert other.keys() == first.keys()
    assert {name for name in first if other[name] == first[name]} == {"manifest.toml"}


def test_another_speaker_says_the_same(corpora, tmp_path):
    other = simulated(tmp_path / "other", "--other-speaker")
    for kind in ("labels", "sound"):
        assert hashes(other / kind) == hashes(corpora["sv"] / kind)
    assert not set(hashes(other / "recordings").values()) & set(
        hashes(corpora["sv"] / "recordings").values()
    )


def test_drift_and_rate(tmp_path):
    path = simulated(tmp_path / "s", "--drift", -300, "--rate", 100)
    sound = read_sound(path / "sound" / "sim001.wav")
    found = decode_pulses(sound.get_channel(2), sound.rate, 100.0)
    assert found.drift_ppm == pytest.approx(-300, abs=15)
    assert load_manifest(path / "manifest.toml").rate == 100


def test_splits_are_87_of_287():
    assert sum(map(is_test, range(287))) == 87
    assert sum(map(is_test, range(2870))) == 870
    assert 0 < sum(map(is_test, range(10))) < 6


def test_a_layout_of_ones_own_goes_along(tmp_path):
    from importlib import resources

    shipped = resources.files("mocap_fit.fitting").joinpath("layouts", "face30-head5.toml")
    mine = tmp_path / "mine.toml"
    mine.write_text(shipped.read_text(encoding="utf-8"), encoding="utf-8")
    path = simulated(tmp_path / "s", "--layout", mine)
    layout = load_manifest(path / "manifest.toml").layout
    assert (path / layout).read_text(encoding="utf-8") == mine.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--lang", "fi"], "--lang"),
        (["--durations", "guessed"], "--durations"),
        (["--duration", "2", "--lang", "sv"], "--duration"),
        (["--duration", "2", "--durations", "model"], "--duration"),
        (["--drift", "5000"], "--drift"),
    ],
)
def test_wrong_calls(options, named, tmp_path, capsys):
    assert cli.main(["simulate", str(tmp_path / "s"), *options]) == 2
    assert named in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


def test_without_the_extra_nothing_is_written(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("mocap_fit.synthesis.text_to_phones.find_spec", lambda name: None)
    assert cli.main(["simulate", str(tmp_path / "s"), "--durations", "espeak"]) == 1
    assert "mocap-fit[speech]" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


@pytest.mark.slow
def test_what_convert_finds_is_the_truth(corpora, tmp_path):
    from mocap_fit import open_corpus

    path = corpora["en"]
    out = tmp_path / "corpus"
    call = ["convert", str(path / "manifest.toml"), "--root", str(path), "--out", str(out)]
    assert cli.main(call) == 0
    corpus = open_corpus(out)
    assert [utterance.id for utterance in corpus] == names(path)
    for utterance in corpus:
        truth = read_parquet(path / "truth" / "tracks" / f"{utterance.id}.parquet")
        tracks = utterance.read_tracks()
        assert tracks.start_time == pytest.approx(truth.start_time, abs=1e-3)
        close = np.abs(tracks.values - truth.values)
        assert np.nanmedian(close) < 0.06
        for name in ("jaw_rotation", "lip_rounding", "lower_lip_depression"):
            found, true = tracks[name], truth[name]
            seen = np.isfinite(found)
            assert np.corrcoef(found[seen], true[seen])[0, 1] > 0.9
