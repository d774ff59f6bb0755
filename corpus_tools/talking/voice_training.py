"""Train the control models of the talking head on sentences that are simulated in memory.

One speaker says 200 sentences to learn from and 87 to score on, as many as Beskow had.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from corpus_tools.tasks import TaskProgress, count_steps
from mocap_fit import control
from mocap_fit.control import ControlModel, LogEntry
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.tracks import ParameterTracks

if TYPE_CHECKING:
    from mocap_fit.evaluation import Evaluation

UTTERANCES = 287
_RATE = 60.0
_SEED = 7
_SENTENCES, _SPEAKER, _SAID = 1, 2, 3
# Settings for a talking head, whose lips close on every p, b and m.
_LIPS = ("jaw_rotation", "upper_lip_raise", "lower_lip_depression")
MODEL_SETTINGS: dict[str, dict[str, Any]] = {"cart": {"closures": dict.fromkeys(_LIPS, "learned")}}
# Seconds on one core of a machine with nothing else to do, and for the simulation of sentences.
_SECONDS = {
    "ann": 25.0,
    "ann-ensemble": 70.0,
    "ann-low-latency": 27.0,
    "cart": 1.0,
    "cohen-massaro": 12.0,
    "ohman": 1.0,
    "ridge": 2.0,
}
_SIMULATION = 6.0


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


def estimate_training(models: Mapping[str, Sequence[str]]) -> str:
    """Return how long it takes to train models, in words.

    Parameters
    ----------
    models
        Names of control models by language; those of plug-ins are left out.

    Returns
    -------
    str
        Such as ``about 2 minutes on a machine with nothing else to do``.
    """
    seconds = sum(
        _SIMULATION + sum(_SECONDS.get(name, 0.0) for name in names) for names in models.values()
    )
    if seconds < 90:
        time = f"{5 * math.ceil(seconds / 5)} seconds"
    else:
        time = f"{math.ceil(seconds / 60)} minutes"
    return f"about {time} on a machine with nothing else to do"


def train_model(name: str, corpus: Corpus, *, progress: TaskProgress | None = None) -> ControlModel:
    """Train a model of a kind as it is shipped, and as `speak` does it.

    Parameters
    ----------
    name
        Name of a control model.
    corpus
        From `simulate_corpus`.
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
    """
    from corpus_tools.training.train import format_entry, split_training

    model = control.create(name, **MODEL_SETTINGS.get(name, {}))
    training, held_out = split_training(corpus, "clean")
    show = progress or (lambda task, done, total: None)
    count = f"{len(training)} simulated sentences of {corpus.language}"
    show(f"training {name} on {count}", 0, None)

    def show_entry(entry: LogEntry) -> None:
        show(format_entry(f"training {name}", entry), entry.iteration + 1, None)

    model.fit(training, held_out, progress=show_entry)
    model.trained_on_ |= {"corpus": f"simulated-{corpus.language}", "seed": _SEED}
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
    return evaluate(test, {RuleBased.name: rules, **models}, resamples=200, progress=advance)
