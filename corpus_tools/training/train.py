"""``mocap-fit train``: a control model from the training part of a corpus."""

from __future__ import annotations

import contextlib
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

from corpus_tools.cli import console
from corpus_tools.cli.console import Status
from mocap_fit import control
from mocap_fit.atomic_file import make_folder, write_text
from mocap_fit.control import ControlModel, LogEntry
from mocap_fit.corpus import Corpus, open_corpus
from mocap_fit.errors import ConfigurationError

Protocol = Literal["clean", "paper"]
PROTOCOLS: tuple[Protocol, ...] = ("clean", "paper")
VALIDATION = 0.1
_SECONDS = 5.0


def run(
    corpus: Path,
    *,
    model: str,
    out: Path,
    protocol: Protocol = "clean",
    validation: float = VALIDATION,
    seed: int = 0,
    settings: Sequence[str] = (),
    as_json: bool = False,
) -> Status:
    """Train a model and write it.

    Parameters
    ----------
    corpus
        A corpus's folder.
    model
        Name of a control model.
    out
        The file of the trained model; one that exists is replaced. A long training keeps how far
        it is in ``OUT.checkpoint``, and goes on from there when the command is given again.
    protocol, validation, seed
        As for `parts`.
    settings
        Settings of the model, ``KEY=VALUE`` each, values as TOML has them.
    as_json
        Print what came of it as JSON.

    Raises
    ------
    MocapFitError
        If the corpus cannot be used, or there is no such model or setting.
    """
    made = control.create(model, **parsed(settings))
    if out.is_dir():
        raise ConfigurationError(
            "a folder is where the model should be written", path=out, advice="Give a file."
        )
    whole = open_corpus(corpus)
    training, held_out = parts(whole, protocol, validation, seed)
    checkpoint = out.with_name(f"{out.name}.checkpoint")
    make_folder(out.parent)
    with training_progress(f"training {model}") as told:
        made.fit(training, held_out, progress=told, checkpoint=checkpoint)
    made.trained_on_ |= {"corpus": corpus.resolve().name, "protocol": protocol}
    made.save(out)
    checkpoint.unlink(missing_ok=True)
    report = _report(made, out, training, held_out, protocol)
    if as_json:
        console.print_json(report)
    else:
        _show(report)
    return Status.DONE


def sweep(
    corpus: Path,
    *,
    out: Path,
    protocol: Protocol = "clean",
    validation: float = VALIDATION,
    seed: int = 0,
    settings: Sequence[str] = (),
    as_json: bool = False,
) -> Status:
    """Train networks that see 0 to 15 frames ahead, and tell their errors (Figure 4).

    Parameters
    ----------
    corpus
        A corpus's folder.
    out
        A folder for ``look_ahead.csv`` and ``look_ahead.png``; a sweep that was stopped goes on
        from ``look_ahead.checkpoint`` there.
    protocol, validation, seed, settings
        As for `run`; settings are those of the networks.
    as_json
        Print the errors as JSON.
    """
    from mocap_fit.control.networks import LowLatencyNetworks
    from mocap_fit.control.networks.look_ahead_sweep import sweep_look_ahead
    from mocap_fit.drawing import save_figure
    from mocap_fit.evaluation.figures import look_ahead_figure

    model = control.create(LowLatencyNetworks.name, **parsed(settings))
    assert isinstance(model, LowLatencyNetworks)
    training, held_out = parts(open_corpus(corpus), protocol, validation, seed)
    make_folder(out)
    checkpoint = out / "look_ahead.checkpoint"
    with training_progress("training networks") as told:
        points = sweep_look_ahead(
            training, held_out, settings=model, progress=told, checkpoint=checkpoint
        )
    rows = [point._asdict() for point in points]
    lines = [",".join(rows[0]), *(",".join(f"{v:.6g}" for v in row.values()) for row in rows)]
    write_text(out / "look_ahead.csv", "\n".join(lines) + "\n")
    save_figure(
        out / "look_ahead.png",
        look_ahead_figure,
        [point.look_ahead for point in points],
        [point.error for point in points],
    )
    checkpoint.unlink(missing_ok=True)
    if as_json:
        console.print_json({"utterances": len(training), "look_ahead": rows})
    else:
        cells = [
            [str(p.frames), f"{1000 * p.look_ahead:.0f}", f"{p.error:.4f}", str(p.epoch)]
            for p in points
        ]
        screen = console.screen()
        screen.print(console.table(["frames ahead", "ms", "held-out error", "epoch"], cells))
        screen.print(f"Written: {out / 'look_ahead.csv'}, look_ahead.png", soft_wrap=True)
    return Status.DONE


def parts(
    corpus: Corpus, protocol: Protocol, fraction: float = VALIDATION, seed: int = 0
) -> tuple[Corpus, Corpus]:
    """What is learned from, and what tells when to stop (Beskow section 4.1).

    Parameters
    ----------
    corpus
        With splits ``train`` and ``test``.
    protocol
        ``clean``: a split ``validation`` if the corpus has one, else a part of the training
        sentences, tells when to stop, and the test set stays unseen. ``paper``: the test set
        itself does, as in the paper, so that scores on it flatter.
    fraction, seed
        How much of the training sentences is held out, and the draw.
    """
    if protocol == "paper":
        return corpus.get_split("train"), corpus.get_split("test")
    if "validation" in corpus.splits:
        return corpus.get_split("train"), corpus.get_split("validation")
    return corpus.get_split("train").hold_out(fraction, seed)


def parsed(settings: Sequence[str]) -> dict[str, Any]:
    """Settings from ``KEY=VALUE``; what is not a TOML value is text.

    Raises
    ------
    ConfigurationError
        If one has no = or no key.
    """
    found: dict[str, Any] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        key = key.strip().replace("-", "_")
        if not equals or not key.isidentifier():
            raise ConfigurationError(
                "a setting of the model is not understood", found=setting, expected="KEY=VALUE"
            )
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            value = text
        found[key] = tuple(value) if isinstance(value, list) else value
    return found


@contextlib.contextmanager
def training_progress(task: str) -> Iterator[Callable[[LogEntry], object]]:
    """Show how far a training is, on stderr: the newest errors, every few seconds."""
    last = time.monotonic()

    def show(entry: LogEntry) -> None:
        nonlocal last
        if time.monotonic() - last < _SECONDS:
            return
        last = time.monotonic()
        part = f", {entry.part.replace('_', ' ')}" if entry.part else ""
        held = entry.validation_error
        beside = "" if held is None else f", held out {held:.4f}"
        console.say(
            f"{task}{part}: iteration {entry.iteration}, error {entry.training_error:.4f}{beside}"
        )

    yield show


def _report(
    model: ControlModel, out: Path, training: Corpus, held_out: Corpus, protocol: Protocol
) -> dict[str, Any]:
    return {
        "model": model.name,
        "title": model.title,
        "file": out,
        "settings": model.get_params(),
        "protocol": protocol,
        "free_parameters": model.parameter_count,
        "look_ahead_s": model.look_ahead,
        "utterances": len(training),
        "held_out_utterances": len(held_out),
        "log": [entry.__dict__ for entry in model.log_],
        **errors_of(model),
    }


def errors_of(model: ControlModel) -> dict[str, float | None]:
    """Root mean square errors at the end of training, over all parts; None where not measured."""
    ends = {entry.part: entry for entry in model.log_}.values()
    best = {
        part: min(
            (e for e in model.log_ if e.part == part),
            key=lambda e: e.training_error if e.validation_error is None else e.validation_error,
        )
        for part in {entry.part for entry in ends}
    }.values()
    held = [entry.validation_error for entry in best if entry.validation_error is not None]

    def together(errors: Sequence[float]) -> float | None:
        return (sum(e * e for e in errors) / len(errors)) ** 0.5 if errors else None

    return {
        "training_error": together([entry.training_error for entry in best]),
        "held_out_error": together(held),
    }


def _show(report: dict[str, Any]) -> None:
    screen = console.screen()
    screen.print(
        f"{report['title']}: {report['free_parameters']} free parameters, trained on "
        f"{report['utterances']} utterances; {report['held_out_utterances']} told when to stop."
    )
    if report["training_error"] is not None:
        held = report["held_out_error"]
        beside = "" if held is None else f", {held:.4f} on what was held out"
        screen.print(
            f"Root mean square error: {report['training_error']:.4f} in training{beside} "
            "(1 is the full gesture)."
        )
    screen.print(f"Written: {report['file']}", soft_wrap=True)
