"""The control models that `speak` and `stream` take: files, rules, and trained ones kept at hand.

A kind of model is trained for a language on sentences that are simulated in memory (200 to learn
from, 87 to score on, as many as Beskow had), and kept in the user's cache folder. What it was
trained on is in the model and is said when it is used. Its name there depends on the code and the
tables that it was made with, so that a newer version makes its own.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from corpus_tools.cli import console
from mocap_fit import control
from mocap_fit._version import __version__
from mocap_fit.control import CONTROL_MODELS, ControlModel
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import ConfigurationError, FileFormatError
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
# What a talking head needs and is not a kind's default: lips that close on every p, b and m.
_LIPS = ("jaw_rotation", "upper_lip_raise", "lower_lip_depression")
_SETTINGS: dict[str, dict[str, Any]] = {
    "cart": {"closures": dict.fromkeys(_LIPS, "learned")},
}


def languages() -> tuple[str, ...]:
    """The languages that models can be trained for here."""
    from corpus_tools.simulation.sentences import languages as known

    return known()


def simulated_corpus(
    language: str,
    utterances: int = UTTERANCES,
    seed: int = _SEED,
    *,
    progress: Callable[[], object] | None = None,
) -> Corpus:
    """Sentences of a language as one simulated speaker says them, without markers or sound.

    The splits are those of `mocap-fit simulate`: 87 of 287 are for the test.

    Raises
    ------
    ConfigurationError
        If there are no sentences of the language.
    """
    from corpus_tools.simulation.articulation import Articulator
    from corpus_tools.simulation.durations import spoken
    from corpus_tools.simulation.sentences import load_language
    from corpus_tools.simulation.writing import is_test
    from mocap_fit.face import load_face

    known = load_language(language)
    face = load_face()
    sentences = known.sentences(utterances, np.random.default_rng([seed, _SENTENCES]))
    speaker = Articulator(face, known.phone_set, np.random.default_rng([seed, _SPEAKER]))
    said = []
    for i, sentence in enumerate(sentences):
        timing, moving = np.random.default_rng([seed, _SAID, i]).spawn(2)
        name = f"sim{i + 1:03d}"
        phones = spoken(sentence.words, known.phone_set, timing, name=name, start=0.1, end=0.1)
        times = np.arange(int(np.floor(phones[len(phones) - 1].end * _RATE))) / _RATE
        tracks = ParameterTracks(
            face.parameter_names, _RATE, speaker.say(phones, times, moving), name=name
        )
        split = "test" if is_test(i) else "train"
        phones = phones.replace(phone_set=known.phone_set.name)
        said.append(
            Utterance.from_tracks(
                tracks, phones, split=split, speaker="simulated", text=sentence.text
            )
        )
        if progress is not None:
            progress()
    return Corpus.from_utterances(said, known.phone_set, language=language, face="built-in")


def folder() -> Path:
    """Where trained models are kept."""
    return get_cache_folder() / "models"


def cached_file(name: str, language: str, utterances: int = UTTERANCES) -> Path:
    """Where the trained model of a kind and a language is kept, or would be."""
    settings = _SETTINGS.get(name, {})
    made_with = f"{__version__} {np.__version__} {utterances} {settings}"
    digest = hashlib.sha256(made_with.encode())
    for path in _sources(name):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return folder() / f"{name}-{language}-{digest.hexdigest()[:12]}.model"


def prepared(
    name: str,
    language: str,
    *,
    utterances: int = UTTERANCES,
    fresh: bool = False,
    settings: dict[str, Any] | None = None,
    corpora: dict[str, Corpus] | None = None,
) -> ControlModel:
    """The model of a kind for a language: kept from before, or trained now and kept.

    Parameters
    ----------
    name
        One of `control.names`.
    language
        One of `languages`.
    utterances
        How many sentences it is trained and tested on.
    fresh
        Train it also where one is kept.
    settings
        Of the model. A model with settings of its own is not kept.
    corpora
        Simulated corpora by language, which is added to: of use to who prepares many.

    Raises
    ------
    RegistryError
        If there is no such model.
    ConfigurationError
        If there are no sentences of the language.
    """
    made = control.create(name, **(_SETTINGS.get(name, {}) | (settings or {})))
    if language not in languages():
        raise ConfigurationError(
            f"the model '{name}' cannot be trained for the language '{language}': there are no "
            "sentences to simulate",
            expected=f"one of {', '.join(languages())}",
            advice=f"Give the file of a trained model, or take the model '{RULE_BASED}'.",
        )
    path = cached_file(name, language, utterances)
    if not settings and not fresh and path.is_file():
        try:
            return control.load(path)
        except FileFormatError as error:
            console.say(f"warning: {error} It is made again.")
    corpora = {} if corpora is None else corpora
    if language not in corpora:
        with console.progress(f"simulating {language} sentences", utterances) as advance:
            corpora[language] = simulated_corpus(language, utterances, progress=advance)
    from corpus_tools.training.train import parts, training_progress

    training, held_out = parts(corpora[language], "clean")
    console.say(
        f"training {name} on {len(training)} simulated sentences of {language}; it is kept for "
        "the next time"
    )
    with training_progress(f"training {name}") as told:
        made.fit(training, held_out, progress=told)
    made.trained_on_ |= {"corpus": f"simulated-{language}", "seed": _SEED}
    if not settings:
        _keep(made, path)
    return made


def scored(corpus: Corpus, models: Mapping[str, ControlModel]) -> Evaluation:
    """Score models on the test sentences of a simulated corpus, and the rule-based one with them.

    Parameters
    ----------
    corpus
        From `simulated_corpus`.
    models
        Trained on it, by name.
    """
    from mocap_fit.control.rule_based import RuleBased
    from mocap_fit.evaluation import evaluate

    rules = RuleBased().prepare(corpus.phone_set, corpus.parameter_names)
    test = corpus.get_split("test")
    with console.progress("scoring sentences", len(test)) as advance:
        return evaluate(test, {RULE_BASED: rules, **models}, resamples=200, progress=advance)


def model_for(
    name: str, language: str, phone_set: PhoneSet, parameter_names: Sequence[str]
) -> ControlModel:
    """The model that a user names: a file, or a kind of model.

    Parameters
    ----------
    name
        A file that `ControlModel.save` wrote, or one of `control.names`.
    language, phone_set, parameter_names
        What it will speak, and with which face; they make the rule-based model ready.

    Raises
    ------
    MocapFitError
        If there is no such model or file, or it cannot be made for the language.
    """
    if name == RULE_BASED:
        from mocap_fit.control.rule_based import RuleBased

        names = [p for p in _articulatory() if p in parameter_names]
        return RuleBased().prepare(phone_set, names or parameter_names)
    path = Path(name)
    if name in control.names() and not path.is_file():
        return prepared(name, language)
    if path.exists() or path.suffix or len(path.parts) > 1:
        return control.load(path)
    raise ConfigurationError(
        f"there is no model '{name}'",
        expected=f"a file, or one of {', '.join(control.names())}",
    )


def described(model: ControlModel) -> str:
    """What a model is and was trained on, in a few words."""
    about = model.trained_on_
    count = int(about.get("utterances") or 0)
    if not count:
        return f"{model.title}, for phones of {model.phone_set_.name}"
    corpus = about.get("corpus") or "a corpus"
    return f"{model.title}, trained on {count} utterances of {corpus} ({model.phone_set_.name})"


def _articulatory() -> tuple[str, ...]:
    from mocap_fit.phones import ARTICULATORY_PARAMETERS

    return ARTICULATORY_PARAMETERS


def _keep(model: ControlModel, path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        model.save(path)
    except (OSError, FileFormatError) as error:
        console.say(f"warning: the model could not be kept: {error}")


def _sources(name: str) -> list[Path]:
    """Code and tables that decide what a model of that kind is."""
    places = ["mocap_fit.control", "mocap_fit.phones", "corpus_tools.simulation"]
    files = {
        path
        for place in places
        for path in Path(str(resources.files(place))).rglob("*")
        if path.suffix in (".py", ".toml")
    }
    own = sys.modules[CONTROL_MODELS.get(name).__module__].__file__
    if own is not None:
        files.add(Path(own))
    return sorted(files)
