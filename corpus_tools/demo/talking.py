"""The second part of the demo: sentences → corpus → trained models → scores → a talking head."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from corpus_tools import simulation as simulate
from corpus_tools.cli import console
from corpus_tools.conversion import convert
from corpus_tools.training import evaluate as scoring
from corpus_tools.training.train import parts
from mocap_fit import control
from mocap_fit.control import ControlModel
from mocap_fit.corpus import Corpus, open_corpus
from mocap_fit.evaluation import Evaluation, evaluate
from mocap_fit.processes import count_cores
from mocap_fit.tracks import ParameterTracks

SENTENCES = 40
EPOCHS = 30
#: Kind of model → its settings here. The networks stop early: a demo is no training.
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
    """What the second part found.

    Parameters
    ----------
    corpus
        The corpus that was converted.
    result
        Scores on its test sentences.
    movie
        The talking head; None where it cannot be drawn or written.
    heads
        What its heads are moved by.
    text
        What it says.
    report
        For programs.
    """

    corpus: Corpus
    result: Evaluation
    movie: Path | None
    heads: tuple[str, ...]
    text: str
    report: dict[str, Any]


def talk_part(
    out: Path,
    seed: int,
    conditions: simulate.Conditions,
    *,
    sentences: int,
    epochs: int,
    can_film: bool,
    as_json: bool,
) -> TalkPart:
    """Simulate sentences, convert them, train, score, and make a head talk.

    Parameters
    ----------
    out
        The folder of the demo.
    seed
        The same seed gives the same numbers.
    conditions
        What the simulated session is like.
    sentences
        How many are simulated; about 3 in 10 are for the test.
    epochs
        Of the networks, at most.
    can_film
        Whether faces can be drawn and movies written here.
    as_json
        Keep stdout free for the report.
    """
    session, folder = out / "sentences", out / "corpus"
    with console.progress("simulating sentences", sentences) as advance:
        simulate.run(
            session,
            utterances=sentences,
            seed=seed,
            layout="face30-head5",
            conditions=conditions,
            spoken=simulate.Spoken(),
            progress=lambda _: advance(),
        )
    with contextlib.redirect_stdout(sys.stderr if as_json else sys.stdout):
        convert.run(session / "manifest.toml", out=folder, jobs=1)
    corpus = open_corpus(folder)
    models = {model.title: model for model in _trained(corpus, out / "models", epochs)}
    test = corpus.get_split("test")
    with console.progress("scoring sentences", len(test)) as advance:
        result = evaluate(test, models, progress=advance)
    shown = max(test, key=lambda utterance: (utterance.duration < 4.0, utterance.duration))
    (out / "evaluation").mkdir()
    scoring.write(
        result, models, shown, "jaw_rotation", out / "evaluation", scoring.title_of(corpus, "test")
    )
    best, rules = _shown_models(result, models)
    heads: dict[str, ParameterTracks] = {"measured": shown.read_tracks()}
    for name in (best, rules):
        model, tracks = models[name], shown.read_tracks()
        heads[name] = model.predict(
            shown.read_phones(), tracks.rate, start_time=tracks.start_time, frames=tracks.frames
        )
    movie = out / MOVIE if can_film else None
    if movie is not None:
        _film(movie, heads, shown)
    report = {
        "sentences": sentences,
        "utterances": {split: len(corpus.get_split(split)) for split in corpus.splits},
        "network_epochs_at_most": epochs,
        "scores": result.to_dict(),
        "movie": None if movie is None else {"sentence": shown.text, "heads": list(heads)},
    }
    return TalkPart(corpus, result, movie, tuple(heads), shown.text, report)


def _trained(corpus: Corpus, folder: Path, epochs: int) -> Iterator[ControlModel]:
    training, held_out = parts(corpus, "clean")
    folder.mkdir()
    with console.progress("training models", len(MODELS)) as advance:
        for name, settings in MODELS.items():
            given = {**settings, **({"max_iter": epochs} if "max_iter" in settings else {})}
            model = control.create(name, **given).fit(training, held_out)
            model.trained_on_["corpus"] = "demo"
            model.save(folder / f"{name}.model")
            advance()
            yield model


def _shown_models(result: Evaluation, models: dict[str, ControlModel]) -> tuple[str, str]:
    """The best of the models that learned, and the rules."""
    rules = next(name for name, model in models.items() if model.name == "rule-based")
    best = next(name for name in result.ranking() if name != rules)
    return best, rules


def _film(path: Path, heads: dict[str, ParameterTracks], shown: Any) -> None:
    from mocap_fit.render import render_movie

    duration = shown.read_tracks().start_time + shown.duration
    frames = round(duration * _RATE)
    with console.progress("drawing the talking heads", max(1, frames)) as advance:
        render_movie(
            heads,
            path,
            sound=shown.sound_file,
            rate=_RATE,
            size=(_HEADS, _HEADS),
            phones=shown.read_phones(),
            subtitles=True,
            curves=("jaw_rotation", "lip_rounding"),
            blinks=True,
            jobs=min(2, count_cores()),
            progress=lambda *_: advance(),
        )
