"""``mocap-fit evaluate``: compare control models on held-out utterances."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from corpus_tools import html_page
from corpus_tools.json_file import write_json
from corpus_tools.tasks import TaskProgress, count_steps
from mocap_fit import control, evaluation
from mocap_fit.atomic_file import make_folder, write_text
from mocap_fit.control import ControlModel
from mocap_fit.control.cohen_massaro import CohenMassaro
from mocap_fit.corpus import Corpus, Utterance, open_corpus
from mocap_fit.drawing import save_figure
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.evaluation import GROUPS, Evaluation, LandmarkScores, figures
from mocap_fit.evaluation.landmarks import FITTED, MEASURES
from mocap_fit.evaluation.tables import LIP_COLUMNS, format_lips, format_markdown

LANDMARKS_EXPLAINED = (
    "Correlation of the predicted face with the markers themselves, over the frames that are not "
    "silent, each utterance's mean taken from both; the fitted tracks show what the fit leaves."
)
# Largest number of segments in a figure of dominance functions.
_SEGMENTS = 100
# Steps of a training from which its curve is drawn.
_ITERATIONS = 3


@dataclass(frozen=True, eq=False)
class EvaluationReport:
    """What a run of `evaluate` has measured and written.

    Parameters
    ----------
    scores
        Scores of the models.
    landmarks
        Correlations with the markers; None where they were not computed.
    files
        Files of tables and figures, the page first.
    """

    scores: Evaluation
    landmarks: LandmarkScores | None
    files: tuple[Path, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON can hold it.

        Returns
        -------
        dict[str, Any]
            Scores, correlations and files.
        """
        content, landmarks = self.scores.to_dict(), self.landmarks
        if landmarks is not None:
            models = {}
            for i, name in enumerate(landmarks.models):
                models[name] = dict(zip(MEASURES, landmarks.correlation[i].tolist(), strict=True))
                models[name] |= {key: getattr(landmarks, key)[i] for key in ("mean", "low", "high")}
            content["landmarks"] = {"frames": landmarks.frames, "models": models}
        return {**content, "files": list(self.files)}

    def __repr__(self) -> str:
        header, rows = self.scores.to_rows(GROUPS[:1])
        lines = [f"EvaluationReport({self.scores.utterances} utterances, page={self.files[0]})"]
        lines += ["  " + "  ".join(row) for row in (header, *rows)]
        return "\n".join([*lines, *self.scores.notes])


def evaluate(
    corpus: str | os.PathLike[str],
    models: Sequence[str | os.PathLike[str]],
    *,
    out: str | os.PathLike[str],
    split: str = "test",
    face: str = "built-in",
    utterance: str | None = None,
    parameter: str | None = None,
    landmarks: bool = False,
    resamples: int = 2000,
    seed: int = 0,
    progress: TaskProgress | None = None,
) -> EvaluationReport:
    """Score trained control models, and write tables, figures and one page.

    Parameters
    ----------
    corpus
        Folder of a corpus.
    models
        Files of trained models.
    out
        Folder of the results; those of an earlier evaluation are replaced.
    split
        Name of the split that is scored; ``all`` for every utterance.
    face
        The face for the closure of the lips: ``built-in``, or a rig file.
    utterance
        Name of the utterance whose trajectories are drawn; by default the first.
    parameter
        Name of the parameter that is drawn; by default jaw rotation, or else the first.
    landmarks
        Whether the predicted faces are compared with the markers as well.
    resamples
        Number of samples of the bootstrap.
    seed
        Seed of the bootstrap.
    progress
        Called with a task, the number of its steps that are done, and of all.

    Returns
    -------
    EvaluationReport
        Scores and files.

    Raises
    ------
    MocapFitError
        If corpus or models cannot be used, or a file cannot be written.
    """
    opened, folder = open_corpus(corpus), Path(out)
    scored = opened if split == "all" else opened.get_split(split)
    loaded = load_models([Path(model) for model in models])
    shown = scored.utterances[0] if utterance is None else scored[utterance]
    names = scored.parameter_names
    drawn = parameter or ("jaw_rotation" if "jaw_rotation" in names else names[0])
    if drawn not in names:
        raise DataError(
            f"the corpus has no parameter '{drawn}'", expected=f"one of {', '.join(names)}"
        )
    make_folder(folder)
    how: dict[str, Any] = {"face": face, "resamples": resamples, "seed": seed}
    advance = count_steps(progress, "scoring utterances", len(scored))
    result = evaluation.evaluate(scored, loaded, **how, progress=advance)
    beside = None
    if landmarks:
        advance = count_steps(progress, "comparing with the markers", len(scored))
        beside = evaluation.evaluate_landmarks(scored, loaded, **how, progress=advance)
    title = format_title(opened, split)
    files = write_evaluation(result, loaded, shown, drawn, folder, title, beside, progress)
    return EvaluationReport(result, beside, tuple(files))


def load_models(files: Sequence[Path]) -> dict[str, ControlModel]:
    """Load trained models by their titles; those with equal titles get the file's name too.

    Parameters
    ----------
    files
        Files of the models.

    Returns
    -------
    dict[str, ControlModel]
        The models.

    Raises
    ------
    ConfigurationError
        If a file is given twice.
    """
    loaded = [(file, control.load(file)) for file in files]
    titles = [model.title for _, model in loaded]
    models: dict[str, ControlModel] = {}
    for file, model in loaded:
        name = model.title + ("" if titles.count(model.title) == 1 else f" ({file.stem})")
        if name in models:
            raise ConfigurationError("two models have one name", path=file, found=name)
        models[name] = model
    return models


def format_title(corpus: Corpus, split: str) -> str:
    """Return the title of the page: what is scored.

    Parameters
    ----------
    corpus
        The corpus.
    split
        Name of the split; ``all`` for every utterance.

    Returns
    -------
    str
        The title.
    """
    name = "" if corpus.folder is None else f"of {corpus.folder.resolve().name} "
    return f"Control models {name}({'all utterances' if split == 'all' else split})"


def write_evaluation(
    result: Evaluation,
    models: dict[str, ControlModel],
    shown: Utterance,
    parameter: str,
    out: Path,
    title: str,
    landmarks: LandmarkScores | None = None,
    progress: TaskProgress | None = None,
) -> list[Path]:
    """Write tables, figures and the page of an evaluation.

    Parameters
    ----------
    result
        The scores.
    models
        The models by their names.
    shown
        The utterance whose trajectories are drawn.
    parameter
        The parameter that is drawn.
    out
        An existing folder.
    title
        Title of the page.
    landmarks
        Correlations with the markers; None where there are none.
    progress
        Called with a task, the number of its steps that are done, and of all.

    Returns
    -------
    list[Path]
        The files, the page first.
    """
    import pandas as pd

    tables = {
        "scores.csv": result.to_frame(),
        "differences.csv": pd.DataFrame(result.to_dict()["differences"]),
    }
    for name, frame in tables.items():
        write_text(out / name, frame.to_csv(index=False, float_format="%.6g"))
    write_json(out / "evaluation.json", result.to_dict())
    tracks, phones = shown.read_tracks(), shown.read_phones()
    predictions = {name: m.predict_at(phones, tracks.times) for name, m in models.items()}
    shown_curves = (tracks, predictions, phones, parameter, shown.text)
    calls: dict[str, tuple[Any, ...]] = {
        "scores": (figures.plot_scores, result),
        "parameters": (figures.plot_parameters, result),
        "trajectories": (figures.plot_trajectories, *shown_curves),
    }
    for name, model in models.items():
        label = "".join(c if c.isalnum() else "_" for c in name).lower()
        if isinstance(model, CohenMassaro) and len(phones) <= _SEGMENTS:
            functions = (model, tracks, phones, parameter)
            calls[f"dominance_{label}"] = (figures.plot_dominances, *functions)
        # Fewer are no training that a curve would show.
        if len(model.log_) >= _ITERATIONS:
            calls[f"training_{label}"] = (figures.plot_training, model.log_, f"Training: {name}")
    files = []
    advance = count_steps(progress, "drawing figures", len(calls))
    for name, call in calls.items():
        for ending in ("png", "svg"):
            save_figure(out / f"{name}.{ending}", *call)
            files.append(out / f"{name}.{ending}")
        advance()
    parts = format_sections(result, out, list(calls))
    if landmarks is not None:
        header, rows = landmarks.to_rows()
        # The file has plain names, as the other tables have.
        marked = [[result.mark(row[0]), *row[1:]] for row in rows]
        lines = [",".join(row) for row in (header, *rows)]
        write_text(out / "landmarks.csv", "\n".join(lines) + "\n")
        files.append(out / "landmarks.csv")
        parts += [
            html_page.format_heading("Compared with the markers"),
            html_page.format_paragraph(LANDMARKS_EXPLAINED),
            html_page.format_table(header, marked),
            *map(html_page.format_paragraph, result.notes),
        ]
    write_text(out / "scores.md", format_scores(result, landmarks))
    write_text(out / "index.html", html_page.format_page(title, parts))
    first = ("index.html", *tables, "scores.md", "evaluation.json")
    return [*(out / name for name in first), *files]


def format_scores(result: Evaluation, landmarks: LandmarkScores | None = None) -> str:
    """Return all averages as one table of Markdown.

    Parameters
    ----------
    result
        The scores.
    landmarks
        Correlations with the markers, which then take the place of those with the tracks.

    Returns
    -------
    str
        A row a model, the best first, and with landmarks one of the fitted tracks.
    """
    header, rows = result.to_rows(GROUPS[:1])
    if landmarks is not None:
        cells = {name: [error, *lips] for name, _, error, _, *lips in rows}
        cells[FITTED] = ["0", *(format_lips(result.lips["target"]) if result.lips else [])]
        header = ["model", *MEASURES, "mean", header[2], *header[4:]]
        rows = []
        for name, *each, low, high in landmarks.to_rows()[1]:
            label = result.mark(name)
            rows.append([label, *each[:-1], f"{each[-1]} [{low}, {high}]", *cells[label]])
    return format_markdown(header, rows) + "\n"


def format_sections(result: Evaluation, out: Path, pictures: Sequence[str]) -> list[str]:
    """Return what a page shows of an evaluation.

    Parameters
    ----------
    result
        The scores.
    out
        Folder of the figures.
    pictures
        Names of the figures, without their ending.

    Returns
    -------
    list[str]
        Parts of the page.
    """
    captions = {
        "scores": "Average over the parameters, with 95 % intervals by bootstrap over utterances.",
        "parameters": "Each parameter on its own.",
        "trajectories": "One utterance: grey is the target.",
    }
    parts = [
        html_page.format_paragraph(
            f"{result.utterances} utterances, {result.frames[0]} frames of speech. RMSE in per "
            "cent of each parameter's range, Pearson's correlation, both averaged over the "
            "parameters; in brackets the 95 % interval by bootstrap over utterances."
        ),
        html_page.format_table(*result.to_rows()),
        *map(html_page.format_paragraph, result.notes),
    ]
    if result.lips:
        lips = result.lips["target"]
        cells = zip(LIP_COLUMNS, format_lips(lips), strict=True)
        target = ", ".join(" ".join(cell) for cell in cells)
        parts.append(
            html_page.format_paragraph(
                f"Lips closed: the part of the {lips.closed.count} bilabials whose largest gap, "
                "along the lips from corner to corner, falls to 10 % of that of open vowels. "
                f"Lip at teeth: the part of the {lips.contact.count} labiodentals whose lower lip "
                "comes within 2 mm of the upper teeth, or as near as half of the measured ones "
                "where those stay farther away. Vowels open: the part of the "
                f"{lips.opened.count} open vowels that do not touch. Fastest: the largest speed of "
                f"the gap. In brackets Wilson's 95 % interval. In the measured "
                f"tracks: {target}."
            )
        )
    if len(result.models) > 1:
        parts += [
            html_page.format_heading("Differences between models"),
            html_page.format_paragraph(
                "Average RMSE over all but silence, of the first less the second, on the same "
                "bootstrap samples; p is two-sided."
            ),
            html_page.format_table(*result.to_difference_rows()),
        ]
    parts.append(html_page.format_heading("Figures"))
    parts += [
        html_page.format_picture(out / f"{name}.png", captions.get(name, "")) for name in pictures
    ]
    return parts
