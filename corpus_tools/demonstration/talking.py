"""The second part of the demo: sentences → corpus → trained models → scores → a talking head."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from corpus_tools.batch import BatchProgress
from corpus_tools.conversion.convert import convert
from corpus_tools.conversion.report import ConversionReport
from corpus_tools.simulation import Conditions, Spoken, simulate
from corpus_tools.tasks import TaskProgress, count_steps
from corpus_tools.training.evaluate import format_title, write_evaluation
from corpus_tools.training.train import split_training
from mocap_fit import control
from mocap_fit.control import ControlModel
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.errors import SmallCorpusWarning
from mocap_fit.evaluation import Evaluation, evaluate
from mocap_fit.processes import count_cores
from mocap_fit.tracks import ParameterTracks

SENTENCES = 40
EPOCHS = 30
# Kind of model → its settings here. The networks stop early: a demo must be quick.
MODELS: dict[str, dict[str, Any]] = {
    "rule-based": {},
    "phone-mean": {},
    "ridge": {},
    "cohen-massaro": {},
    "ohman": {},
    "ann": {"max_iter": EPOCHS},
    "ann-low-latency": {"max_iter": EPOCHS},
    "cart": {},
}
_HEADS = 400
_RATE = 25.0
MOVIE = "talking_head.mp4"


@dataclass(frozen=True, eq=False)
class TalkPart:
    """Result of the second part.

    Parameters
    ----------
    conversion
        How the sentences were converted.
    corpus
        The corpus.
    result
        Scores on its test sentences.
    movie
        The talking head; None where it cannot be drawn or written.
    heads
        Names of what moves its heads.
    text
        What it says.
    report
        All figures, for JSON.
    """

    conversion: ConversionReport
    corpus: Corpus
    result: Evaluation
    movie: Path | None
    heads: tuple[str, ...]
    text: str
    report: dict[str, Any]


def run_talk(
    out: Path,
    seed: int,
    conditions: Conditions,
    *,
    sentences: int,
    epochs: int,
    can_film: bool,
    progress: TaskProgress | None = None,
) -> TalkPart:
    """Simulate sentences, convert them, train, score, and make a head talk.

    Parameters
    ----------
    out
        The folder of the demo.
    seed
        Seed of all random numbers.
    conditions
        Properties of the simulated session.
    sentences
        Number of sentences that are simulated; about 3 in 10 are for the test.
    epochs
        Largest number of epochs of the networks.
    can_film
        Whether faces can be drawn and movies written here.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    TalkPart
        Corpus, scores and movie.
    """
    session, folder = out / "sentences", out / "corpus"
    simulate(
        session,
        utterances=sentences,
        seed=seed,
        conditions=conditions,
        spoken=Spoken(),
        progress=count_steps(progress, "simulating sentences", sentences),
    )

    def show(state: BatchProgress) -> None:
        if progress is not None:
            progress("converting utterances", state.finished, state.total)

    conversion = convert(session / "manifest.toml", out=folder, progress=show)
    corpus = conversion.corpus
    models = {model.title: model for model in _train(corpus, out / "models", epochs, progress)}
    test = corpus.get_split("test")
    advance = count_steps(progress, "scoring sentences", len(test))
    result = evaluate(test, models, progress=advance)
    shown = max(test, key=lambda utterance: (utterance.duration < 4.0, utterance.duration))
    (out / "evaluation").mkdir()
    title = format_title(corpus, "test")
    write_evaluation(result, models, shown, "jaw_rotation", out / "evaluation", title)
    tracks = shown.read_tracks()
    heads: dict[str, ParameterTracks] = {"measured": tracks}
    for name in _choose_models(result, models):
        heads[name] = models[name].predict(
            shown.read_phones(), tracks.rate, start_time=tracks.start_time, frames=tracks.frames
        )
    movie = out / MOVIE if can_film else None
    if movie is not None:
        _render(movie, heads, shown, progress)
    report = {
        "sentences": sentences,
        "utterances": {split: len(corpus.get_split(split)) for split in corpus.splits},
        "network_epochs_at_most": epochs,
        "scores": result.to_dict(),
        "movie": None if movie is None else {"sentence": shown.text, "heads": list(heads)},
    }
    return TalkPart(conversion, corpus, result, movie, tuple(heads), shown.text, report)


def _train(
    corpus: Corpus, folder: Path, epochs: int, progress: TaskProgress | None
) -> Iterator[ControlModel]:
    training, held_out = split_training(corpus, "clean")
    folder.mkdir()
    advance = count_steps(progress, "training models", len(MODELS))
    for name, settings in MODELS.items():
        values = {**settings, **({"max_iter": epochs} if "max_iter" in settings else {})}
        with warnings.catch_warnings():
            # The page says that they are few.
            warnings.simplefilter("ignore", SmallCorpusWarning)
            model = control.create(name, **values).fit(training, held_out)
        model.trained_on_["corpus"] = "demo"
        model.save(folder / f"{name}.model")
        advance()
        yield model


def _choose_models(result: Evaluation, models: dict[str, ControlModel]) -> tuple[str, str]:
    """Return the best of the models that learned, and the rules."""
    rules = next(name for name, model in models.items() if model.name == "rule-based")
    best = next(name for name in result.rank_models() if name != rules)
    return best, rules


def _render(
    path: Path, heads: dict[str, ParameterTracks], shown: Utterance, progress: TaskProgress | None
) -> None:
    from mocap_fit.render import render_movie

    frames = round((shown.read_tracks().start_time + shown.duration) * _RATE)
    render_movie(
        heads,
        path,
        sound=shown.sound_file,
        rate=_RATE,
        size=(_HEADS, _HEADS),
        phones=shown.read_phones(),
        subtitles=True,
        curves=("jaw_rotation", "lip_rounding"),
        jobs=min(2, count_cores()),
        progress=count_steps(progress, "drawing the talking heads", max(1, frames)),
    )
