"""Models are pickled, copied, compared and used in processes and threads; plug-ins may fail."""

import copy
import pickle
import subprocess
import sys
import threading

import joblib
import numpy as np
import pytest
from control_cases import SENTENCES, corpus_of, made, spoken
from lab_levels import Levels
from threadpoolctl import threadpool_info

from mocap_fit import control
from mocap_fit.control.model_file import write_model_file
from mocap_fit.errors import DataError, FileFormatError, RegistryError
from mocap_fit.processes import limit_to_one_thread

every_model = pytest.mark.parametrize("name", control.names())


@every_model
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda model: pickle.loads(pickle.dumps(model))])
def test_a_copy_is_equal_and_independent(name, copied, trained, new_phones):
    assert copied(made(name)) == made(name)
    model = trained(name)
    other = copied(model)
    assert other == model
    wanted = model.predict(new_phones).values
    np.testing.assert_array_equal(other.predict(new_phones).values, wanted)
    for array in other._state()[1].values():
        if array.dtype.kind == "f" and array.flags.writeable:
            array += 1.0
    np.testing.assert_array_equal(model.predict(new_phones).values, wanted)


@every_model
def test_models_are_equal_when_they_were_trained_alike(name, trained, small_corpus):
    model = trained(name)
    assert model != made(name)
    assert made(name) == made(name)
    assert made(name).fit(small_corpus) == model
    assert model != "a model"
    if name not in ("cart", "rule-based"):
        other = copy.deepcopy(model)
        next(iter(other._state()[1].values())).flat[0] += 1
        assert other != model
    other = copy.deepcopy(model)
    other.rate_ = 30.0
    assert other != model
    with pytest.raises(TypeError, match="unhashable"):
        hash(model)


def test_models_with_other_settings_differ():
    assert control.create("ridge", context=3) != control.create("ridge", context=4)
    assert control.create("ann") != control.create("ann-ensemble")


def predicted(model, phones):
    return model.predict(phones).values


def test_models_are_used_in_several_threads_of_joblib(trained, new_phones):
    models = [trained(name) for name in ("ann", "cohen-massaro", "ridge")]
    wanted = [predicted(model, new_phones) for model in models]
    results = joblib.Parallel(n_jobs=2, prefer="threads")(
        joblib.delayed(predicted)(model, new_phones) for model in models
    )
    for result, values in zip(results, wanted, strict=True):
        np.testing.assert_array_equal(result, values)


@pytest.mark.slow
def test_models_are_trained_and_used_in_several_processes_of_joblib(small_corpus, new_phones):
    models = [control.create("mean"), control.create("ridge", context=2)]
    fitted = joblib.Parallel(n_jobs=2)(joblib.delayed(model.fit)(small_corpus) for model in models)
    for model, other in zip(models, fitted, strict=True):
        assert not model.is_fitted
        assert model.fit(small_corpus) == other
    results = joblib.Parallel(n_jobs=2)(
        joblib.delayed(model.predict)(new_phones) for model in fitted
    )
    for model, tracks in zip(models, results, strict=True):
        np.testing.assert_array_equal(tracks.values, model.predict(new_phones).values)


# -- one thread --------------------------------------------------------------------------------

TRAINING = """
import sys
sys.path.insert(0, sys.argv[1])
from control_cases import SENTENCES, corpus_of
from mocap_fit import control
corpus = corpus_of(SENTENCES * 4)
for name, settings in {
    "ridge": {"context": 6},
    "ann": {"max_iter": 1, "frames_behind": 5, "frames_ahead": 5},
    "cohen-massaro": {"max_iter": 2},
    "ohman": {"max_iter": 2},
}.items():
    control.create(name, **settings).fit(corpus).save(f"{sys.argv[2]}/{name}.npz")
"""


@pytest.mark.slow
def test_the_number_of_threads_does_not_change_a_byte(tmp_path, monkeypatch):
    folder = str(__import__("pathlib").Path(__file__).parent)
    for threads in ("1", "2"):
        out = tmp_path / threads
        out.mkdir()
        for library in ("OPENBLAS", "OMP", "MKL"):
            monkeypatch.setenv(f"{library}_NUM_THREADS", threads)
        subprocess.run([sys.executable, "-c", TRAINING, folder, str(out)], check=True)
    files = sorted(path.name for path in (tmp_path / "1").iterdir())
    assert len(files) == 4
    for name in files:
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes(), name


def count_threads() -> set[int]:
    return {row["num_threads"] for row in threadpool_info() if row["user_api"] == "blas"}


def test_training_and_prediction_run_on_one_thread(small_corpus, new_phones, monkeypatch):
    from threadpoolctl import threadpool_limits

    seen = []

    def watched(method):
        def call(*arguments):
            seen.append(count_threads())
            return method(*arguments)

        return call

    monkeypatch.setattr(Levels, "_fit", watched(Levels._fit))
    monkeypatch.setattr(Levels, "_predict", watched(Levels._predict))
    with threadpool_limits(2, user_api="blas"):
        before = count_threads()
        model = Levels().fit(small_corpus)
        model.predict(new_phones)
        assert count_threads() == before
    assert seen == [{1}, {1}]


def test_limits_of_several_threads_of_a_program_overlap():
    from threadpoolctl import threadpool_limits

    with threadpool_limits(2, user_api="blas"):
        before = count_threads()
        entered, leave = threading.Event(), threading.Event()

        def work():
            with limit_to_one_thread():
                entered.set()
                leave.wait(600)

        worker = threading.Thread(target=work)
        with limit_to_one_thread():
            worker.start()
            entered.wait(600)
        # The other thread still computes.
        assert count_threads() == {1}
        leave.set()
        worker.join()
        assert count_threads() == before


# -- plug-ins that fail ------------------------------------------------------------------------


def fail(*arguments):
    raise ZeroDivisionError("by my own mistake")


NAMED = r"'lab-levels' of lab-levels.*by my own mistake"


def test_a_plug_in_that_fails_is_named_with_its_distribution(
    trained, small_corpus, new_phones, tmp_path, monkeypatch
):
    model = trained("lab-levels")
    model.save(tmp_path / "model.npz")
    for method, call in {
        "_fit": lambda: Levels().fit(small_corpus),
        "_predict": lambda: model.predict(new_phones),
        "_state": lambda: model.save(tmp_path / "other.npz"),
        "__init__": lambda: control.create("lab-levels"),
    }.items():
        with monkeypatch.context() as patch:
            patch.setattr(Levels, method, fail)
            with pytest.raises(RegistryError, match=NAMED) as caught:
                call()
        assert isinstance(caught.value.__cause__, ZeroDivisionError)
    assert not (tmp_path / "other.npz").exists()
    with monkeypatch.context() as patch:
        patch.setattr(Levels, "_restore", fail)
        with pytest.raises(FileFormatError, match=rf"model\.npz.*{NAMED}"):
            control.load(tmp_path / "model.npz")
    with monkeypatch.context() as patch:
        patch.setattr(Levels, "_predict", lambda self, phones, times: np.zeros((3, 1)))
        with pytest.raises(RegistryError, match=r"lab-levels.*\(3, 1\) values"):
            model.predict(new_phones)
        patch.setattr(Levels, "_state", lambda self: ({"a": object()}, {}))
        with pytest.raises(RegistryError, match=r"lab-levels.*JSON"):
            model.save(tmp_path / "other.npz")


def test_what_a_plug_in_says_in_our_errors_passes(trained, new_phones, monkeypatch):
    def refuse(self, phones, times):
        raise DataError("too few phones")

    monkeypatch.setattr(Levels, "_predict", refuse)
    with pytest.raises(DataError, match="too few phones"):
        trained("lab-levels").predict(new_phones)


def test_an_error_of_the_callers_progress_is_not_the_plug_ins(small_corpus):
    with pytest.raises(ZeroDivisionError, match="my own"):
        Levels().fit(small_corpus, progress=fail)


def test_our_own_mistakes_pass_as_they_are(small_corpus, tmp_path, monkeypatch):
    from mocap_fit.control.baselines import Mean

    control.create("mean").fit(small_corpus).save(tmp_path / "model.npz")
    monkeypatch.setattr(Mean, "_fit", fail)
    monkeypatch.setattr(Mean, "_restore", fail)
    with pytest.raises(ZeroDivisionError):
        control.create("mean").fit(small_corpus)
    with pytest.raises(ZeroDivisionError):
        control.load(tmp_path / "model.npz")


def test_a_model_of_another_format_is_refused_with_advice(tmp_path, monkeypatch):
    monkeypatch.setattr("mocap_fit.control.model_file.FORMAT_VERSION", 1)
    write_model_file({"model": "mean"}, {}, tmp_path / "model.npz")
    monkeypatch.undo()
    with pytest.raises(FileFormatError, match=r"format_version 1.*expected 2.*train"):
        control.load(tmp_path / "model.npz")


def test_corpora_are_pickled_with_the_models(small_corpus):
    other = pickle.loads(pickle.dumps(small_corpus))
    assert control.create("mean").fit(other) == control.create("mean").fit(small_corpus)
    assert len(corpus_of(SENTENCES[:1])) == 1
    assert len(spoken("sil", 1)) == 1
