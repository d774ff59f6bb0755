"""What every control model owes, run over all that are registered, and over one of a lab's own.

A model of yours joins by being installed; if its own size takes long, give a small one in
`SETTINGS` of control_cases.py.
"""

import contextlib
import dataclasses
import io
import math
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from control_cases import NAMES, RATE, SENTENCES, SETTINGS, corpus_of, made, spoken

from mocap_fit import control
from mocap_fit.control.model_file import read_model_file, write_model_file
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import (
    ConfigurationError,
    DataError,
    FileFormatError,
    MocapFitError,
    RegistryError,
)
from mocap_fit.phones import write_phones

OWN = ("mean", "phone-mean", "ridge", "rule-based")

every_model = pytest.mark.parametrize("name", control.names())


def content(corpus: Corpus) -> bytes:
    parts = []
    for utterance in corpus:
        parts += [repr(utterance.read_phones()).encode(), utterance.read_tracks().values.tobytes()]
    return b"".join(parts)


def saved(model: control.ControlModel, folder, file="model.npz") -> bytes:
    model.save(folder / file)
    return (folder / file).read_bytes()


def test_the_models_of_the_papers_and_of_a_lab_are_registered():
    assert set(OWN) <= set(control.names())
    assert control.CONTROL_MODELS.get_distribution("lab-levels") == "lab-levels"
    assert control.CONTROL_MODELS.get_distribution("rule-based") == "mocap-fit"
    with pytest.raises(RegistryError, match="rule-based"):
        control.create("hidden-markov")


@every_model
def test_a_model_is_a_dataclass_of_its_settings(name):
    model = made(name)
    assert model.name == name
    assert model.title
    assert dataclasses.is_dataclass(model)
    for key, value in SETTINGS.get(name, {}).items():
        assert model.get_params()[key] == value
    # Constructors only store arguments.
    assert {key: getattr(model, key) for key in model.get_params()} == model.get_params()
    assert not [key for key in vars(model) if key.endswith("_")]
    assert control.create(name, **model.get_params()).get_params() == model.get_params()
    with pytest.raises(ConfigurationError, match="no setting 'colour'"):
        control.create(name, colour="red")


@every_model
def test_an_untrained_model_is_refused(name, new_phones, tmp_path):
    model = made(name)
    assert not model.is_fitted
    with pytest.raises(DataError, match="not trained"):
        model.predict(new_phones)
    with pytest.raises(DataError, match="not trained"):
        model.stream()
    with pytest.raises(DataError, match="not trained"):
        model.save(tmp_path / "model.npz")
    assert not list(tmp_path.iterdir())


@every_model
def test_training_keeps_what_it_was_trained_on(name, trained, small_corpus):
    model = trained(name)
    assert model.is_fitted
    assert model.parameter_names_ == small_corpus.parameter_names == NAMES
    assert model.phone_set_.name == "sv-sta"
    assert model.rate_ == RATE
    assert model.trained_on_["utterances"] == len(small_corpus)
    assert model.trained_on_["language"] == "sv"
    assert isinstance(model.parameter_count, int)
    assert model.parameter_count >= 0
    assert model.look_ahead >= 0
    assert model.look_back >= 0
    for entry in model.log_:
        assert math.isfinite(entry.training_error)
        assert entry.training_error >= 0
        assert entry.validation_error is None


@every_model
def test_predictions_have_names_times_and_no_gaps(name, trained, new_phones):
    model = trained(name)
    tracks = model.predict(new_phones)
    assert tracks.names == NAMES
    assert tracks.rate == RATE
    assert tracks.start_time == new_phones[0].start
    assert len(tracks.values) == math.ceil(new_phones.duration * RATE - 1e-6)
    assert np.isfinite(tracks.values).all()
    assert tracks.provenance[-1].name == "predict"
    assert tracks.name == new_phones.name
    again = model.predict(new_phones)
    np.testing.assert_array_equal(tracks.values, again.values)


@every_model
def test_every_rate_and_every_start_gives_the_same_movement(name, trained, new_phones):
    model = trained(name)
    slow, fast = model.predict(new_phones, 25.0), model.predict(new_phones, 200.0)
    np.testing.assert_allclose(slow.values, fast.values[::8], atol=1e-6)
    part = model.predict(new_phones, 25.0, start_time=slow.times[4], frames=7)
    assert part.values.shape == (7, len(NAMES))
    np.testing.assert_allclose(part.values, slow.values[4:11], atol=1e-6)
    assert len(model.predict(new_phones, 1.0).values) == math.ceil(len(slow.values) / 25)
    for rate in (0.0, -5.0, math.nan):
        with pytest.raises(DataError, match="frame rate"):
            model.predict(new_phones, rate)


@every_model
def test_any_time_has_parameters(name, trained, new_phones):
    model = trained(name)
    end = new_phones[-1].end
    before_and_after = np.array([-2.0, -0.01, end, end + 0.01, end + 2.0])
    assert np.isfinite(model.predict_at(new_phones, before_and_after)).all()
    assert model.predict_at(new_phones, np.zeros(0)).shape == (0, len(NAMES))
    # The centre of every phone, where the distance to it is 0.
    centres = np.array([segment.centre for segment in new_phones])
    assert np.isfinite(model.predict_at(new_phones, centres)).all()


@every_model
def test_what_is_not_labelled_is_no_gap_in_the_movement(name, trained, new_phones):
    kept = [s for k, s in enumerate(new_phones) if k % 4 != 2]
    tracks = trained(name).predict(new_phones.replace(segments=tuple(kept)))
    assert np.isfinite(tracks.values).all()


@every_model
def test_the_clock_does_not_matter(name, trained, new_phones):
    moved_on = tuple(
        dataclasses.replace(s, start=s.start + 100.0, end=s.end + 100.0) for s in new_phones
    )
    here = trained(name).predict(new_phones)
    there = trained(name).predict(new_phones.replace(segments=moved_on), frames=len(here.values))
    assert there.start_time == new_phones[0].start + 100.0
    # Frames at the very border of two phones may fall to either.
    apart = np.abs(here.values - there.values).max(axis=1)
    assert np.count_nonzero(apart > 1e-6) <= 2


@every_model
@pytest.mark.parametrize("rate", [None, 30.0])
def test_a_stream_gives_the_frames_of_predict(name, trained, new_phones, rate):
    model = trained(name)
    wanted = model.predict(new_phones, rate).values
    stream = model.stream(rate)
    frames, known = [], []
    for segment in new_phones:
        stream.push(segment)
        known.append(segment)
        given = stream.pull()
        frames.extend(given)
        if math.isfinite(model.look_ahead):
            # Live: nothing is held back longer than it must be.
            sure = (known[-1].end - known[0].start - model.look_ahead) * stream.rate
            assert len(frames) >= math.floor(sure - 1e-6)
    frames.extend(stream.finish())
    assert len(frames) == len(wanted)
    np.testing.assert_allclose(np.array(frames), wanted, atol=1e-9)
    with pytest.raises(DataError, match="has ended"):
        stream.push(new_phones[-1])


@every_model
def test_phones_beyond_the_look_ahead_and_the_look_back_change_nothing(name, trained):
    model = trained(name)
    long = " ".join(["M 'A: L I: S 'O: T A B 'I: R"] * 6)
    phones = spoken(long, 3)
    middle = 0.5 * (phones[0].start + phones[-1].end)
    times = np.array([middle])
    swapped = {"M": "S", "A:": "U:", "L": "F", "I:": "Y:", "S": "P", "O:": "A"}

    def changed(segment, change):
        return (
            dataclasses.replace(segment, phone=swapped.get(segment.phone, "N"))
            if change
            else segment
        )

    after = tuple(changed(s, s.start > middle + model.look_ahead + 1e-6) for s in phones)
    before = tuple(changed(s, s.end < middle - model.look_back - 1e-6) for s in phones)
    if math.isfinite(model.look_ahead):
        assert after != phones.segments, "the sentence is too short for this test"
    if math.isfinite(model.look_back):
        assert before != phones.segments, "the sentence is too short for this test"
    wanted = model.predict_at(phones, times)
    for segments in (after, before):
        found = model.predict_at(phones.replace(segments=segments), times)
        np.testing.assert_allclose(found, wanted, atol=1e-9)


@every_model
def test_a_saved_model_is_the_same_model(name, trained, new_phones, tmp_path):
    model = trained(name)
    first = saved(model, tmp_path)
    loaded = control.load(tmp_path / "model.npz")
    assert type(loaded) is type(model)
    assert loaded.get_params() == model.get_params()
    assert loaded.parameter_names_ == model.parameter_names_
    assert loaded.phone_set_.list_symbols() == model.phone_set_.list_symbols()
    assert loaded.rate_ == model.rate_
    assert loaded.trained_on_ == model.trained_on_
    assert loaded.log_ == model.log_
    assert loaded.parameter_count == model.parameter_count
    assert loaded.look_ahead == model.look_ahead
    np.testing.assert_array_equal(
        loaded.predict(new_phones).values, model.predict(new_phones).values
    )
    assert saved(loaded, tmp_path, "again.npz") == first
    assert sorted(p.name for p in tmp_path.iterdir()) == ["again.npz", "model.npz"]


@pytest.mark.slow
def test_models_predict_the_same_in_a_fresh_process(trained, new_phones, tmp_path):
    wanted = {}
    for name in control.names():
        trained(name).save(tmp_path / f"{name}.npz")
        wanted[name] = trained(name).predict(new_phones).values
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from pathlib import Path\n"
        "import numpy as np\n"
        "from mocap_fit import control\n"
        "from mocap_fit.phones import read_stored_phones\n"
        "folder = Path(sys.argv[2])\n"
        "phones = read_stored_phones(folder / 'phones.parquet')\n"
        "found = {p.stem: control.load(p).predict(phones).values for p in folder.glob('*.npz')}\n"
        "np.savez(folder / 'found', **found)\n"
    )
    write_phones(new_phones, tmp_path / "phones.parquet")
    plug_in = str(Path(__file__).parent / "plug_in")
    subprocess.run([sys.executable, "-c", code, plug_in, str(tmp_path)], check=True)
    with np.load(tmp_path / "found.npz") as found:
        assert set(found.files) == set(wanted)
        for name, values in wanted.items():
            np.testing.assert_array_equal(found[name], values, err_msg=name)


@every_model
def test_the_same_input_gives_the_same_bytes_and_leaves_the_corpus_alone(
    name, trained, small_corpus, tmp_path
):
    before = content(small_corpus)
    again = made(name).fit(small_corpus)
    assert content(small_corpus) == before
    assert saved(again, tmp_path) == saved(trained(name), tmp_path, "first.npz")


@every_model
def test_training_with_a_validation_part_logs_its_error(
    name, small_corpus, small_validation, new_phones
):
    told = []
    model = made(name).fit(small_corpus, small_validation, progress=told.append)
    assert list(model.log_) == told
    for entry in model.log_:
        assert math.isfinite(entry.validation_error)
    assert model.trained_on_["validation_utterances"] == len(small_validation)
    assert np.isfinite(model.predict(new_phones).values).all()


@every_model
def test_a_checkpoint_changes_nothing(name, small_corpus, small_validation, tmp_path):
    path = tmp_path / "checkpoint"
    plain = saved(made(name).fit(small_corpus, small_validation), tmp_path, "plain.npz")
    for file in ("first.npz", "resumed.npz"):
        model = made(name).fit(small_corpus, small_validation, checkpoint=path)
        assert saved(model, tmp_path, file) == plain
    # One of another corpus does not fit, and is not gone on from.
    other = made(name).fit(small_validation, checkpoint=path)
    assert saved(other, tmp_path, "other.npz") == saved(
        made(name).fit(small_validation), tmp_path, "other_plain.npz"
    )


@every_model
def test_foreign_and_unknown_phones_are_refused(name, trained, new_phones):
    model = trained(name)
    with pytest.raises(DataError, match="no phones"):
        model.predict(new_phones.replace(segments=()))
    with pytest.raises(DataError, match=r"cs-ipa.*sv-sta.*map_phones"):
        model.predict(new_phones.replace(phone_set="cs-ipa"))
    segments = list(new_phones)
    segments[2] = dataclasses.replace(segments[2], phone="XX")
    segments[4] = dataclasses.replace(segments[4], phone="QQ")
    with pytest.raises(DataError, match="QQ, XX"):
        model.predict(new_phones.replace(segments=tuple(segments)))


@every_model
def test_phones_that_the_corpus_lacked_have_a_movement(name, trained):
    phones = spoken("sil TJ 'Y NG 2S 'AU p 2D Ö4 H sil", 5)
    assert np.isfinite(trained(name).predict(phones).values).all()


@every_model
def test_missing_values_do_not_count(name, small_corpus, new_phones):
    utterances = []
    for position, utterance in enumerate(small_corpus):
        values = utterance.read_tracks().values.copy()
        values[5:12, 0] = np.nan
        values[position::4, 3] = np.nan
        values[:, 7] = np.nan
        utterances.append(
            Utterance.from_tracks(
                utterance.read_tracks().replace(values=values), utterance.read_phones()
            )
        )
    model = made(name).fit(Corpus.from_utterances(utterances, "sv-sta"))
    assert np.isfinite(model.predict(new_phones).values).all()
    for entry in model.log_:
        assert math.isfinite(entry.training_error)


@every_model
@pytest.mark.parametrize("sentence", ["sil M 'A: M A sil", "'A:", "S", "sil", "P T S", "'A: O:"])
def test_one_short_utterance_is_enough_to_train_on(name, sentence, new_phones):
    corpus = corpus_of([sentence])
    model = made(name).fit(corpus)
    assert np.isfinite(model.predict(corpus.utterances[0].read_phones()).values).all()
    assert np.isfinite(model.predict(new_phones).values).all()


@every_model
@pytest.mark.parametrize("sentence", ["'A:", "S", "sil", "sil sil sil", "P T S", "'A: O: 'I:"])
def test_every_kind_of_utterance_has_a_movement(name, trained, sentence):
    assert np.isfinite(trained(name).predict(spoken(sentence, 1)).values).all()


@every_model
@pytest.mark.parametrize("names", [("mouth_open",), ("lip_rounding", "brow", "jaw_shift")])
def test_other_parameters_than_the_ten_are_learned(name, names, new_phones):
    model = made(name).fit(corpus_of(SENTENCES[:4], names=names))
    tracks = model.predict(new_phones)
    assert tracks.names == names
    assert tracks.values.shape[1] == len(names)
    assert np.isfinite(tracks.values).all()


@every_model
def test_a_phone_set_without_end_is_learned(name, tmp_path):
    pytest.importorskip("panphon")
    model = made(name).fit(corpus_of(["sil m ˈa l i sil", "sil p u t ˈo sil"], "ipa"))
    tracks = model.predict(spoken("sil b ˈy ʃ ø sil", 3, "ipa"))
    assert np.isfinite(tracks.values).all()
    model.save(tmp_path / "model.npz")
    loaded = control.load(tmp_path / "model.npz")
    again = loaded.predict(spoken("sil b ˈy ʃ ø sil", 3, "ipa"))
    np.testing.assert_array_equal(again.values, tracks.values)


@every_model
def test_a_constant_parameter_stays_constant(name, small_corpus, new_phones):
    utterances = []
    for utterance in small_corpus:
        values = utterance.read_tracks().values.copy()
        values[:, 2] = 0.25
        utterances.append(
            Utterance.from_tracks(
                utterance.read_tracks().replace(values=values), utterance.read_phones()
            )
        )
    model = made(name).fit(Corpus.from_utterances(utterances, "sv-sta"))
    found = model.predict(new_phones).values
    assert np.isfinite(found).all()


@every_model
def test_a_damaged_file_is_refused_with_a_reason(name, trained, tmp_path):
    path, bad = tmp_path / "model.npz", tmp_path / "bad.npz"
    whole = saved(trained(name), tmp_path)
    for size in (0, 1, 30, len(whole) // 2, len(whole) - 30):
        bad.write_bytes(whole[:size])
        with pytest.raises(FileFormatError, match=r"bad\.npz"):
            control.load(bad)
    header, arrays = read_model_file(path)
    for key in header:
        if key == "format_version":
            continue
        without = {k: v for k, v in header.items() if k != key}
        write_model_file(without, arrays, bad)
        with pytest.raises(FileFormatError, match=r"bad\.npz"):
            control.load(bad)
    for key, array in arrays.items():
        others = {k: v for k, v in arrays.items() if k != key}
        spoiled = [others, {**others, key: array[..., :-1]}]
        if array.dtype.kind == "f" and array.size:
            spoiled.append(
                {
                    **others,
                    key: np.where(np.arange(array.size).reshape(array.shape) == 0, np.nan, array),
                }
            )
        for each in spoiled:
            write_model_file(header, each, bad)
            with pytest.raises(FileFormatError, match=r"bad\.npz"):
                control.load(bad)
    for rate in (0.0, math.inf):
        write_model_file({**header, "rate": rate}, arrays, bad)
        with pytest.raises(FileFormatError, match="a rate of"):
            control.load(bad)
    write_model_file({**header, "model": "hidden-markov"}, arrays, bad)
    with pytest.raises(RegistryError, match="hidden-markov"):
        control.load(bad)
    write_model_file({**header, "settings": {"colour": "red"}}, arrays, bad)
    with pytest.raises(FileFormatError, match="colour"):
        control.load(bad)


@every_model
def test_a_changed_byte_never_ends_in_anything_but_our_error(name, trained, tmp_path, rng):
    whole = bytearray(saved(trained(name), tmp_path))
    bad = tmp_path / "bad.npz"
    for position in rng.integers(0, len(whole), 60):
        changed = whole.copy()
        changed[position] ^= 1 << int(rng.integers(0, 8))
        bad.write_bytes(changed)
        with contextlib.suppress(MocapFitError):
            loaded = control.load(bad)
            assert loaded.name in control.names()


def test_a_changed_byte_of_the_archive_s_own_tables_is_refused_in_our_words(trained, tmp_path):
    whole = saved(trained("mean"), tmp_path)
    bad = tmp_path / "bad.npz"
    tables = [match.start() for match in re.finditer(b"PK", whole)]
    refused = 0
    for position in sorted({at + offset for at in tables for offset in range(46)}):
        if position < len(whole):
            bad.write_bytes(
                whole[:position] + bytes([whole[position] ^ 0xFF]) + whole[position + 1 :]
            )
            try:
                control.load(bad)
            except FileFormatError:
                refused += 1
    assert refused > 30


def test_nothing_in_a_model_file_is_run(tmp_path):
    class Trap:
        def __reduce__(self):
            return (print, ("run",))

    buffer = io.BytesIO()
    np.save(buffer, np.array([Trap()], dtype=object), allow_pickle=True)
    with zipfile.ZipFile(tmp_path / "bad.npz", "w") as archive:
        archive.writestr("header.npy", buffer.getvalue())
    with pytest.raises(FileFormatError, match=r"bad\.npz"):
        control.load(tmp_path / "bad.npz")


@every_model
def test_a_corpus_that_cannot_be_trained_on_is_refused(name, small_corpus, small_validation):
    with pytest.raises(DataError, match="no utterance"):
        made(name).fit(dataclasses.replace(small_corpus, utterances=()))
    other = corpus_of(SENTENCES[:2], names=("jaw_rotation",))
    with pytest.raises(DataError, match="validation part"):
        made(name).fit(small_corpus, other)


@every_model
def test_a_training_that_fails_leaves_the_model_as_it_was(name, small_corpus, new_phones):
    class Stopped(Exception):
        pass

    def stop(entry):
        raise Stopped

    model, small = (
        made(name),
        dataclasses.replace(small_corpus, utterances=small_corpus.utterances[:1]),
    )
    failed = False
    try:
        model.fit(small, progress=stop)
    except Stopped:
        failed = True
        assert not model.is_fitted
        with pytest.raises(DataError, match="not trained"):
            model.predict(new_phones)
    model.fit(small)
    wanted = model.predict(new_phones).values
    if failed:
        with pytest.raises(Stopped):
            model.fit(small_corpus, progress=stop)
    else:
        # One that logs nothing has nothing to stop at.
        assert not model.log_
    np.testing.assert_array_equal(model.predict(new_phones).values, wanted)


@every_model
def test_the_parameters_of_an_untrained_model_are_counted(name, small_corpus):
    model = made(name)
    if "phone_set" not in model.get_params():
        pytest.skip("its parameters do not depend on a phone set")
    planned = control.create(name, **{**model.get_params(), "phone_set": "sv-sta"})
    counted = planned.parameter_count
    assert planned.fit(small_corpus).parameter_count == counted
    czech = control.create(name, **{**model.get_params(), "phone_set": "cs-ipa"})
    with pytest.raises(DataError, match=r"sv-sta.*cs-ipa"):
        czech.fit(small_corpus)
