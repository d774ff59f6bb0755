"""The control models of `speak` and `stream`: files, rules, and trained ones in a cache.

A kind of model is trained for a language on sentences that are simulated in memory (200 to learn
from, 87 to score on, as many as Beskow had), and kept in the user's cache folder. What it was
trained on is in the model and is said when it is used. Its name there depends on the code and the
tables that it was made with, so that a newer version makes its own.
"""

from __future__ import annotations

import hashlib
import sys
import warnings
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from corpus_tools.tasks import TaskProgress, count_steps
from mocap_fit import control
from mocap_fit._version import __version__
from mocap_fit.control import CONTROL_MODELS, ControlModel, LogEntry
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import ConfigurationError, FileFormatError, MocapFitWarning
from mocap_fit.face.builtin.cache import get_cache_folder
from mocap_fit.phones import PhoneSet
from mocap_fit.tracks import ParameterTracks

if TYPE_CHECKING:
    from mocap_fit.evaluation import Evaluation

RULE_BASED = "rule-based"
UTTERANCES = 287
_RATE = 60.0
_SEED = 7
_SENTENCES, _SPEAKER, _SAID = 1, 2, 3
# Settings for a talking head, whose lips close on every p, b and m.
_LIPS = ("jaw_rotation", "upper_lip_raise", "lower_lip_depression")
_SETTINGS: dict[str, dict[str, Any]] = {"cart": {"closures": dict.fromkeys(_LIPS, "learned")}}


def list_languages() -> tuple[str, ...]:
    """Return the languages that models can be trained for here.

    Returns
    -------
    tuple[str, ...]
        Such as ``sv``.
    """
    from corpus_tools.simulation.sentences import list_languages as known

    return known()


def simulate_corpus(
    language: str, utterances: int = UTTERANCES, *, progress: TaskProgress | None = None
) -> Corpus:
    """Simulate sentences as one speaker says them, without markers or sound.

    The splits are those of `mocap-fit simulate`: 87 of 287 are for the test.

    Parameters
    ----------
    language
        The language.
    utterances
        Number of sentences.
    progress
        Called with the task, the number of sentences done, and of all.

    Returns
    -------
    Corpus
        The sentences.

    Raises
    ------
    ConfigurationError
        If there are no sentences of the language.
    """
    from corpus_tools.simulation.articulation import Articulator
    from corpus_tools.simulation.durations import time_words as pronounce
    from corpus_tools.simulation.sentences import load_language
    from corpus_tools.simulation.simulate import is_test
    from mocap_fit.face import load_face

    known = load_language(language)
    face = load_face()
    sentences = known.draw_sentences(utterances, np.random.default_rng([_SEED, _SENTENCES]))
    speaker = Articulator(face, known.phone_set, np.random.default_rng([_SEED, _SPEAKER]))
    spoken = []
    advance = count_steps(progress, f"simulating {language} sentences", utterances)
    for i, sentence in enumerate(sentences):
        timing, moving = np.random.default_rng([_SEED, _SAID, i]).spawn(2)
        name = f"sim{i + 1:03d}"
        phones = pronounce(sentence.words, known.phone_set, timing, name=name, start=0.1, end=0.1)
        times = np.arange(int(np.floor(phones[len(phones) - 1].end * _RATE))) / _RATE
        values = speaker.say(phones, times, moving)
        tracks = ParameterTracks(face.parameter_names, _RATE, values, name=name)
        phones = phones.replace(phone_set=known.phone_set.name)
        split, text = "test" if is_test(i) else "train", sentence.text
        spoken.append(
            Utterance.from_tracks(tracks, phones, split=split, speaker="simulated", text=text)
        )
        advance()
    return Corpus.from_utterances(spoken, known.phone_set, language=language, face="built-in")


def get_folder() -> Path:
    """Return the folder of the trained models.

    Returns
    -------
    Path
        In the user's cache.
    """
    return get_cache_folder() / "models"


def locate_model(name: str, language: str, utterances: int = UTTERANCES) -> Path:
    """Return the file of the trained model of a kind and a language, also where there is none.

    Parameters
    ----------
    name
        Name of a control model.
    language
        The language.
    utterances
        Number of sentences that it is trained and tested on.

    Returns
    -------
    Path
        The file.
    """
    settings = _SETTINGS.get(name, {})
    origin = f"{__version__} {np.__version__} {utterances} {settings}"
    digest = hashlib.sha256(origin.encode())
    for path in _list_sources(name):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return get_folder() / f"{name}-{language}-{digest.hexdigest()[:12]}.model"


def prepare_model(
    name: str,
    language: str,
    *,
    utterances: int = UTTERANCES,
    fresh: bool = False,
    corpora: dict[str, Corpus] | None = None,
    progress: TaskProgress | None = None,
) -> ControlModel:
    """Return the model of a kind for a language: from the cache, or trained now.

    Parameters
    ----------
    name
        Name of a control model.
    language
        A language that there are sentences of.
    utterances
        Number of sentences that it is trained and tested on.
    fresh
        Whether it is trained again where one is in the cache.
    corpora
        Simulated corpora by language, to which a new one is added.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    ControlModel
        A trained model.

    Raises
    ------
    RegistryError
        If there is no such model.
    ConfigurationError
        If there are no sentences of the language.
    """
    model = control.create(name, **_SETTINGS.get(name, {}))
    if language not in list_languages():
        raise ConfigurationError(
            f"the model '{name}' cannot be trained for the language '{language}': there are no "
            "sentences to simulate",
            expected=f"one of {', '.join(list_languages())}",
            advice=f"Give the file of a trained model, or take the model '{RULE_BASED}'.",
        )
    path = locate_model(name, language, utterances)
    if not fresh and path.is_file():
        try:
            return control.load(path)
        except FileFormatError as error:
            warnings.warn(f"{error} It is made again.", MocapFitWarning, stacklevel=2)
    corpora = {} if corpora is None else corpora
    if language not in corpora:
        corpora[language] = simulate_corpus(language, utterances, progress=progress)
    from corpus_tools.training.train import format_entry, split_training

    training, held_out = split_training(corpora[language], "clean")
    show = progress or (lambda task, done, total: None)
    count = f"{len(training)} simulated sentences of {language}"
    show(f"training {name} on {count}; it is kept for the next time", 0, None)

    def show_entry(entry: LogEntry) -> None:
        show(format_entry(f"training {name}", entry), entry.iteration + 1, None)

    model.fit(training, held_out, progress=show_entry)
    model.trained_on_ |= {"corpus": f"simulated-{language}", "seed": _SEED}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        model.save(path)
    except (OSError, FileFormatError) as error:
        message = f"the model could not be saved for the next time: {error}"
        warnings.warn(message, MocapFitWarning, stacklevel=2)
    return model


def score_models(
    corpus: Corpus, models: Mapping[str, ControlModel], *, progress: TaskProgress | None = None
) -> Evaluation:
    """Score models, and the rule-based one, on the test sentences of a simulated corpus.

    Parameters
    ----------
    corpus
        From `simulate_corpus`.
    models
        Models that were trained on it, by name.
    progress
        Called with the task, the number of sentences done, and of all.

    Returns
    -------
    Evaluation
        The scores.
    """
    from mocap_fit.control.rule_based import RuleBased
    from mocap_fit.evaluation import evaluate

    rules = RuleBased().prepare(corpus.phone_set, corpus.parameter_names)
    test = corpus.get_split("test")
    advance = count_steps(progress, "scoring sentences", len(test))
    return evaluate(test, {RULE_BASED: rules, **models}, resamples=200, progress=advance)


def find_model(
    name: str,
    language: str,
    phone_set: PhoneSet,
    parameter_names: Sequence[str],
    *,
    progress: TaskProgress | None = None,
) -> ControlModel:
    """Return the model that a user names: from a file, or of a kind.

    Parameters
    ----------
    name
        A file that `ControlModel.save` wrote, or the name of a control model.
    language
        The language that it will speak.
    phone_set
        The phone set of what it will speak.
    parameter_names
        Parameters of the face that it will move.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    ControlModel
        The model, trained.

    Raises
    ------
    MocapFitError
        If there is no such model or file, or it cannot be made for the language.
    """
    if name == RULE_BASED:
        from mocap_fit.control.rule_based import RuleBased
        from mocap_fit.phones import ARTICULATORY_PARAMETERS

        names = [p for p in ARTICULATORY_PARAMETERS if p in parameter_names]
        return RuleBased().prepare(phone_set, names or parameter_names)
    path = Path(name)
    if name in control.names() and not path.is_file():
        return prepare_model(name, language, progress=progress)
    if path.exists() or path.suffix or len(path.parts) > 1:
        return control.load(path)
    raise ConfigurationError(
        f"there is no model '{name}'", expected=f"a file, or one of {', '.join(control.names())}"
    )


def describe_model(model: ControlModel) -> str:
    """Return what a model is and was trained on, in a few words.

    Parameters
    ----------
    model
        The model.

    Returns
    -------
    str
        Such as ``Rule-based, for phones of sv-sta``.
    """
    about = model.trained_on_
    count = int(about.get("utterances") or 0)
    if not count:
        return f"{model.title}, for phones of {model.phone_set_.name}"
    corpus = about.get("corpus") or "a corpus"
    return f"{model.title}, trained on {count} utterances of {corpus} ({model.phone_set_.name})"


def _list_sources(name: str) -> list[Path]:
    """Return the files of code and tables that a model of that kind depends on."""
    files: set[Path] = set()
    for package in ("mocap_fit.control", "mocap_fit.phones", "corpus_tools.simulation"):
        folder = Path(str(resources.files(package)))
        files |= {path for path in folder.rglob("*") if path.suffix in (".py", ".toml")}
    plug_in = sys.modules[CONTROL_MODELS.get(name).__module__].__file__
    if plug_in is not None:
        files.add(Path(plug_in))
    return sorted(files)
