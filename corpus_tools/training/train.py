"""``mocap-fit train``: a control model from the training part of a corpus."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mocap_fit import control
from mocap_fit.atomic_file import check_targets, make_folder, write_text
from mocap_fit.control import ControlModel, LogEntry
from mocap_fit.corpus import Corpus, open_corpus
from mocap_fit.errors import ConfigurationError
from mocap_fit.processes import limit_to_one_thread

_Path = str | os.PathLike[str]
Protocol = Literal["clean", "paper"]
PROTOCOLS: tuple[Protocol, ...] = ("clean", "paper")
VALIDATION = 0.1


@dataclass(frozen=True, eq=False)
class TrainReport:
    """What a run of `train` has done.

    Parameters
    ----------
    model
        The trained model.
    file
        Its file.
    protocol
        ``clean`` or ``paper``.
    utterances
        Number of utterances it was trained on.
    held_out_utterances
        Number of utterances that said when to stop.
    """

    model: ControlModel
    file: Path
    protocol: Protocol
    utterances: int
    held_out_utterances: int

    @property
    def errors(self) -> dict[str, float | None]:
        """Root mean square errors at the best iteration, over all parts; None if not measured."""
        return _combine_errors(self.model.log_)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON can hold it.

        Returns
        -------
        dict[str, Any]
            Name, settings, sizes, log and errors of the model.
        """
        model = self.model
        return {
            "model": model.name,
            "title": model.title,
            "file": self.file,
            "settings": model.get_params(),
            "protocol": self.protocol,
            "free_parameters": model.parameter_count,
            "look_ahead_s": model.look_ahead,
            "utterances": self.utterances,
            "held_out_utterances": self.held_out_utterances,
            "log": [entry.__dict__ for entry in model.log_],
            **self.errors,
        }

    def __repr__(self) -> str:
        return f"TrainReport({self.model.title}: {self.utterances} utterances, file={self.file})"


@dataclass(frozen=True, eq=False)
class SweepReport:
    """What a run of `sweep_look_ahead` has measured.

    Parameters
    ----------
    utterances
        Number of utterances that the networks were trained on.
    look_ahead
        One record per network: ``frames`` (of 1/60 s), ``look_ahead`` in seconds, ``error`` on
        what was held out, and the ``epoch`` of that error.
    files
        A table and a figure.
    """

    utterances: int
    look_ahead: tuple[Mapping[str, float], ...]
    files: tuple[Path, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON can hold it.

        Returns
        -------
        dict[str, Any]
            ``utterances`` and ``look_ahead``.
        """
        return {"utterances": self.utterances, "look_ahead": list(self.look_ahead)}

    def __repr__(self) -> str:
        return f"SweepReport({len(self.look_ahead)} networks, file={self.files[0]})"


@limit_to_one_thread()
def train(
    corpus: _Path,
    model: str | ControlModel,
    *,
    out: _Path,
    settings: Mapping[str, Any] | None = None,
    protocol: Protocol = "clean",
    validation: float = VALIDATION,
    seed: int = 0,
    progress: Callable[[LogEntry], object] | None = None,
) -> TrainReport:
    """Train a control model on the training part of a corpus, and write it.

    Parameters
    ----------
    corpus
        Folder of a corpus.
    model
        Name of a control model, or one that is not trained yet.
    out
        File of the trained model; one that exists is replaced. A long training saves its state in
        ``OUT.checkpoint``, and goes on from there when it is started again.
    settings
        Settings of a model that is given by its name.
    protocol
        ``clean``: training stops by a part of the training sentences; ``paper``: by the test set.
    validation
        Share of the training sentences that is held out, 0 to 1.
    seed
        Seed of the draw of what is held out.
    progress
        Called with every entry of the training's log.

    Returns
    -------
    TrainReport
        The trained model and its file.

    Raises
    ------
    MocapFitError
        If the corpus cannot be used, or there is no such model or setting.
    """
    untrained = control.create(model, **(settings or {})) if isinstance(model, str) else model
    folder, file = Path(corpus), Path(out)
    if file.is_dir():
        raise ConfigurationError(
            "a folder is where the model should be written", path=out, advice="Give a file."
        )
    training, held_out = split_training(open_corpus(folder), protocol, validation, seed)
    checkpoint = file.with_name(f"{file.name}.checkpoint")
    check_targets([file], folder.rglob("*"))
    make_folder(file.parent)
    trained = untrained.fit(training, held_out, progress=progress, checkpoint=checkpoint)
    trained.trained_on_ |= {"corpus": folder.resolve().name, "protocol": protocol}
    trained.save(file)
    checkpoint.unlink(missing_ok=True)
    return TrainReport(trained, file, protocol, len(training), len(held_out))


@limit_to_one_thread()
def sweep_look_ahead(
    corpus: _Path,
    *,
    out: _Path,
    settings: Mapping[str, Any] | None = None,
    protocol: Protocol = "clean",
    validation: float = VALIDATION,
    seed: int = 0,
    progress: Callable[[LogEntry], object] | None = None,
) -> SweepReport:
    """Train networks that see 0 to 15 frames ahead, and write their errors (Beskow figure 4).

    Parameters
    ----------
    corpus
        Folder of a corpus.
    out
        Folder of ``look_ahead.csv`` and ``look_ahead.png``; a sweep that was stopped goes on from
        ``look_ahead.checkpoint`` there.
    settings
        Settings of the networks.
    protocol
        ``clean``: training stops by a part of the training sentences; ``paper``: by the test set.
    validation
        Share of the training sentences that is held out, 0 to 1.
    seed
        Seed of the draw of what is held out.
    progress
        Called with every entry of the training's log.

    Returns
    -------
    SweepReport
        The errors.

    Raises
    ------
    MocapFitError
        If the corpus cannot be used, or there is no such setting.
    """
    from mocap_fit.control.networks import LowLatencyNetworks
    from mocap_fit.control.networks.look_ahead_sweep import sweep_look_ahead as train_networks
    from mocap_fit.drawing import save_figure
    from mocap_fit.evaluation.figures import plot_look_ahead

    model = control.create(LowLatencyNetworks.name, **(settings or {}))
    assert isinstance(model, LowLatencyNetworks)
    folder = Path(out)
    training, held_out = split_training(open_corpus(corpus), protocol, validation, seed)
    make_folder(folder)
    checkpoint = folder / "look_ahead.checkpoint"
    points = train_networks(
        training, held_out, settings=model, progress=progress, checkpoint=checkpoint
    )
    rows = tuple(point._asdict() for point in points)
    lines = [",".join(rows[0]), *(",".join(f"{v:.6g}" for v in row.values()) for row in rows)]
    table, figure = folder / "look_ahead.csv", folder / "look_ahead.png"
    write_text(table, "\n".join(lines) + "\n")
    look_ahead, errors = [point.look_ahead for point in points], [point.error for point in points]
    save_figure(figure, plot_look_ahead, look_ahead, errors)
    checkpoint.unlink(missing_ok=True)
    return SweepReport(len(training), rows, (table, figure))


def split_training(
    corpus: Corpus, protocol: Protocol, fraction: float = VALIDATION, seed: int = 0
) -> tuple[Corpus, Corpus]:
    """Split a corpus into what is learned from and what says when to stop (Beskow section 4.1).

    Parameters
    ----------
    corpus
        With splits ``train`` and ``test``.
    protocol
        ``clean``: training stops by a split ``validation`` if the corpus has one, else by a part
        of the training sentences, and the test set stays unseen. ``paper``: by the test set
        itself, as in the paper, so that scores on it are too good.
    fraction
        Share of the training sentences that is held out, 0 to 1.
    seed
        Seed of the draw of what is held out.

    Returns
    -------
    tuple[Corpus, Corpus]
        What is learned from, and what is held out.
    """
    training = corpus.get_split("train")
    if protocol == "paper":
        return training, corpus.get_split("test")
    if "validation" in corpus.splits:
        return training, corpus.get_split("validation")
    return training.hold_out(fraction, seed)


def format_entry(task: str, entry: LogEntry) -> str:
    """Return an entry of a training's log in words.

    Parameters
    ----------
    task
        What is being trained, such as ``training cart``.
    entry
        The entry.

    Returns
    -------
    str
        The text.
    """
    part = f", {entry.part.replace('_', ' ')}" if entry.part else ""
    error = entry.validation_error
    held_out = "" if error is None else f", held out {error:.4f}"
    return f"{task}{part}: iteration {entry.iteration}, error {entry.training_error:.4f}{held_out}"


def _combine_errors(log: Sequence[LogEntry]) -> dict[str, float | None]:
    best = [
        min(
            (entry for entry in log if entry.part == part),
            key=lambda e: e.training_error if e.validation_error is None else e.validation_error,
        )
        for part in dict.fromkeys(entry.part for entry in log)
    ]
    held_out = [entry.validation_error for entry in best if entry.validation_error is not None]

    def combine(errors: Sequence[float]) -> float | None:
        return (sum(e * e for e in errors) / len(errors)) ** 0.5 if errors else None

    return {
        "training_error": combine([entry.training_error for entry in best]),
        "held_out_error": combine(held_out),
    }
