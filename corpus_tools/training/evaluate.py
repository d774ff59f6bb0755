"""``mocap-fit evaluate``: control models beside each other on held-out utterances."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from corpus_tools.cli import console
from corpus_tools.cli.console import Status
from corpus_tools.training import page
from mocap_fit import control
from mocap_fit.atomic_file import make_folder, write_text
from mocap_fit.control import ControlModel
from mocap_fit.control.cohen_massaro import CohenMassaro
from mocap_fit.corpus import Corpus, Utterance, open_corpus
from mocap_fit.drawing import save_figure
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.evaluation import (
    GROUPS,
    Evaluation,
    LandmarkScores,
    evaluate,
    figures,
    landmark_scores,
)
from mocap_fit.evaluation.landmarks import MEASURES

# Segments of a figure of dominance functions.
_DRAWN_AT_MOST = 100
_TABLE = "scores.csv", "differences.csv"


def run(
    corpus: Path,
    models: Sequence[Path],
    *,
    out: Path,
    split: str = "test",
    face: str = "built-in",
    utterance: str | None = None,
    parameter: str | None = None,
    landmarks: bool = False,
    resamples: int = 2000,
    seed: int = 0,
    as_json: bool = False,
) -> Status:
    """Score models, and write tables, figures and one page.

    Parameters
    ----------
    corpus
        A corpus's folder.
    models
        Trained models' files.
    out
        A folder; what a former evaluation wrote there is replaced.
    split
        Which utterances are scored; ``all`` for every one.
    face
        For the closure of the lips.
    utterance, parameter
        What the figure of trajectories shows; the first utterance, and jaw rotation or the first
        parameter, where not given.
    landmarks
        Compare the predicted faces with the markers themselves as well.
    resamples, seed
        Of the bootstrap.
    as_json
        Print the scores as JSON.
    """
    whole = open_corpus(corpus)
    scored = whole if split == "all" else whole.get_split(split)
    loaded = named(models)
    shown = scored.utterances[0] if utterance is None else scored[utterance]
    drawn = parameter or (
        "jaw_rotation" if "jaw_rotation" in scored.parameter_names else scored.parameter_names[0]
    )
    if drawn not in scored.parameter_names:
        raise DataError(
            f"the corpus has no parameter '{drawn}'",
            expected=f"one of {', '.join(scored.parameter_names)}",
        )
    make_folder(out)
    with console.progress("scoring utterances", len(scored)) as advance:
        result = evaluate(
            scored, loaded, face=face, resamples=resamples, seed=seed, progress=advance
        )
    beside = None
    if landmarks:
        with console.progress("comparing with the markers", len(scored)) as advance:
            beside = landmark_scores(
                scored, loaded, face=face, resamples=resamples, seed=seed, progress=advance
            )
    written = write(result, loaded, shown, drawn, out, title_of(whole, split), beside)
    if as_json:
        report = result.to_dict() | ({} if beside is None else {"landmarks": told(beside)})
        console.print_json({**report, "files": written})
    else:
        _show(result, written, beside)
    return Status.DONE


def named(files: Sequence[Path]) -> dict[str, ControlModel]:
    """Trained models by their titles; those of one title have the file's name too.

    Raises
    ------
    ConfigurationError
        If a file is given twice.
    """
    loaded = [(file, control.load(file)) for file in files]
    titles = [model.title for _, model in loaded]
    found: dict[str, ControlModel] = {}
    for file, model in loaded:
        unique = titles.count(model.title) == 1
        name = model.title if unique else f"{model.title} ({file.stem})"
        if name in found:
            raise ConfigurationError("two models have one name", path=file, found=name)
        found[name] = model
    return found


def title_of(corpus: Corpus, split: str) -> str:
    """What was scored, for the page's head."""
    name = "" if corpus.folder is None else f"of {corpus.folder.resolve().name} "
    return f"Control models {name}({'all utterances' if split == 'all' else split})"


def write(
    result: Evaluation,
    models: dict[str, ControlModel],
    shown: Utterance,
    parameter: str,
    out: Path,
    title: str,
    landmarks: LandmarkScores | None = None,
) -> list[Path]:
    """Write tables, figures and the page; returns their files, the page first."""
    import pandas as pd

    tables = dict(
        zip(_TABLE, (result.to_frame(), pd.DataFrame(result.to_dict()["differences"])), strict=True)
    )
    for name, frame in tables.items():
        write_text(out / name, frame.to_csv(index=False, float_format="%.6g"))
    write_text(out / "evaluation.json", console.json_text(result.to_dict()) + "\n")
    tracks, phones = shown.read_tracks(), shown.read_phones()
    predictions = {name: m.predict_at(phones, tracks.times) for name, m in models.items()}
    calls: dict[str, tuple[Any, ...]] = {
        "scores": (figures.score_figure, result),
        "parameters": (figures.parameter_figure, result),
        "trajectories": (
            figures.trajectory_figure,
            tracks,
            predictions,
            phones,
            parameter,
            shown.text,
        ),
    }
    for name, model in models.items():
        label = "".join(c if c.isalnum() else "_" for c in name).lower()
        if isinstance(model, CohenMassaro) and len(phones) <= _DRAWN_AT_MOST:
            calls[f"dominance_{label}"] = (
                figures.dominance_figure,
                model,
                tracks,
                phones,
                parameter,
            )
        if model.log_:
            calls[f"training_{label}"] = (figures.training_figure, model.log_, f"Training: {name}")
    files = []
    with console.progress("drawing figures", len(calls)) as advance:
        for name, call in calls.items():
            for ending in ("png", "svg"):
                save_figure(out / f"{name}.{ending}", *call)
                files.append(out / f"{name}.{ending}")
            advance()
    parts = sections(result, out, list(calls))
    if landmarks is not None:
        header, rows = landmark_table(landmarks)
        lines = [",".join(row) for row in (header, *rows)]
        write_text(out / "landmarks.csv", "\n".join(lines) + "\n")
        files.append(out / "landmarks.csv")
        parts += [page.heading("Beside the markers"), page.paragraph(_BESIDE)]
        parts.append(page.table(header, rows))
    content = page.page(title, parts)
    write_text(out / "index.html", content)
    return [out / "index.html", *(out / name for name in (*tables, "evaluation.json")), *files]


def sections(result: Evaluation, out: Path, pictures: Sequence[str]) -> list[str]:
    """What the page shows of an evaluation whose figures are in a folder."""
    captions = {
        "scores": "Average over the parameters, with 95 % intervals by bootstrap over utterances.",
        "parameters": "Each parameter on its own.",
        "trajectories": "One utterance: grey is the target.",
    }
    parts = [
        page.paragraph(
            f"{result.utterances} utterances that no model was trained on, "
            f"{result.frames[0]} frames of speech. RMSE in per cent of each parameter's range, "
            "Pearson's correlation, both averaged over the parameters; in brackets the 95 % "
            "interval by bootstrap over utterances."
        ),
        page.table(*score_table(result)),
    ]
    if result.closed:
        parts.append(
            page.paragraph(
                f"Lips closed: the part of the {result.bilabials} bilabials whose inner lip gap "
                "falls under 10 % of that of open vowels. "
                f"Measured tracks: {percent(result.closed['target'])}."
            )
        )
    if len(result.models) > 1:
        parts += [
            page.heading("Differences between models"),
            page.paragraph(
                "Average RMSE over all but silence, of the first less the second, on the same "
                "bootstrap samples; p is two-sided."
            ),
            page.table(*difference_table(result)),
        ]
    parts.append(page.heading("Figures"))
    parts += [page.picture(out / f"{name}.png", captions.get(name, "")) for name in pictures]
    return parts


def percent(part: float | None) -> str:
    """A part as per cent, or a dash."""
    return "–" if part is None or part != part else f"{100 * part:.1f} %"


def score_table(result: Evaluation) -> tuple[list[str], list[list[str]]]:
    """Table 2: header and a row a model, the best first."""
    header = ["model", "free parameters"]
    for group in GROUPS:
        label = "all but silence" if group == "all" else group
        header += [f"RMSE %, {label}", f"r, {label}"]
    if result.closed:
        header.append("lips closed")
    rmse, correlation = result.averages("rmse"), result.averages("correlation")
    rows = []
    for name in result.ranking():
        i = result.models.index(name)
        row = [name, str(result.parameter_counts[i])]
        for g in range(len(GROUPS)):
            value, low, high = (part[i, g] for part in rmse)
            row.append(f"{value:.2f} [{low:.2f}, {high:.2f}]")
            value, low, high = (part[i, g] for part in correlation)
            row.append(f"{value:.3f} [{low:.3f}, {high:.3f}]")
        if result.closed:
            row.append(percent(result.closed[name]))
        rows.append(row)
    return header, rows


def difference_table(result: Evaluation) -> tuple[list[str], list[list[str]]]:
    """Every pair of models in the order of their errors: header and rows."""
    order = result.ranking()
    rows = []
    for i, first in enumerate(order):
        for second in order[i + 1 :]:
            found = result.difference(first, second)
            rows.append(
                [
                    first,
                    second,
                    f"{found.value:+.3f}",
                    f"[{found.low:+.3f}, {found.high:+.3f}]",
                    f"{found.p:.3f}",
                ]
            )
    return ["first", "second", "difference (%)", "95 % interval", "p"], rows


_BESIDE = (
    "Correlation of the predicted face with the markers themselves, over the frames that are not "
    "silent, each utterance's mean taken from both; the fitted tracks show what the fit leaves."
)


def landmark_table(found: LandmarkScores) -> tuple[list[str], list[list[str]]]:
    """Correlations with the markers: header and a row a model, the best first."""
    header = ["model", *MEASURES, "mean", "from", "to"]
    order = sorted(range(len(found.models)), key=lambda i: -found.mean[i])
    numbers = np.column_stack([found.correlation, found.mean, found.low, found.high])
    return header, [[found.models[i], *(f"{v:.3f}" for v in numbers[i])] for i in order]


def told(found: LandmarkScores) -> dict[str, Any]:
    """Correlations with the markers, as JSON can hold them."""
    return {
        "frames": found.frames,
        "models": {
            name: {
                **dict(zip(MEASURES, found.correlation[i].tolist(), strict=True)),
                "mean": found.mean[i],
                "low": found.low[i],
                "high": found.high[i],
            }
            for i, name in enumerate(found.models)
        },
    }


def _show(result: Evaluation, written: Sequence[Path], landmarks: LandmarkScores | None) -> None:
    screen = console.screen()
    screen.print(
        f"{result.utterances} utterances, {result.frames[0]} frames of speech; all but silence, "
        "average over the parameters, 95 % intervals over utterances:\n"
    )
    screen.print(console.table(*short_table(result)), "")
    if landmarks is not None:
        screen.print(_BESIDE, "", console.table(*landmark_table(landmarks)), "", sep="\n")
    screen.print("Written:")
    for path in written:
        screen.print(f"  {path}", soft_wrap=True)


def short_table(result: Evaluation) -> tuple[list[str], list[list[str]]]:
    """The part of `score_table` that fits into a terminal: all but silence."""
    header, rows = score_table(result)
    kept = [0, 2, 3, *([len(header) - 1] if result.closed else [])]
    short = [header[i].replace(", all but silence", "") for i in kept]
    return short, [[row[i] for i in kept] for row in rows]
