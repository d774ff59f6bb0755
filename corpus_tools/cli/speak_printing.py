"""Print what the commands of the talking head have done."""

from __future__ import annotations

from typing import TYPE_CHECKING

from corpus_tools.cli import display
from corpus_tools.talking.speak_models import describe_model
from mocap_fit.evaluation.closure import CLOSED

if TYPE_CHECKING:
    from corpus_tools.talking.export import ExportReport
    from corpus_tools.talking.prepare_voices import VoicesReport
    from corpus_tools.talking.speak import SpeakReport


def print_speech(report: SpeakReport) -> None:
    """Print what a talking head says.

    Parameters
    ----------
    report
        The movie.
    """
    lines = [head.get("about") or f"measured tracks of {head['tracks']}" for head in report.heads]
    if report.phones:
        lines.append("Phones: " + " ".join(report.phones))
    for head, lips in report.lips.items():
        scores = lips.score(CLOSED)
        shares = [
            f"lips {verb} on {share.hits} of {share.count} {phones}"
            for share, verb, phones in (
                (scores.closed, "close", "p, b, m"),
                (scores.contact, "touch the teeth", "f, v"),
            )
            if share.count
        ]
        if shares:
            lines.append(f"{head}: {', '.join(shares)}")
    sound = "with sound" if report.sound else "silent"
    lines.append(
        f"{report.frames} frames, {report.duration:.2f} s at {report.rate:g} frames/s, "
        f"{sound}: {report.file}"
    )
    display.print_lines(*lines)


def print_voices(report: VoicesReport) -> None:
    """Print the models that are prepared, and their scores.

    Parameters
    ----------
    report
        The models.
    """
    lines = [
        f"{voice.language}: {describe_model(voice.model)}"
        for voice in report.voices
        if voice.model is not None
    ]
    for voice in report.voices:
        if voice.scores:
            result = report.evaluations[voice.language]
            error, closed = voice.scores["rmse_percent"], 100 * voice.scores["bilabials_closed"]
            lines.append(
                f"{voice.language}: {voice.name}: error {error:.1f} % of the range, lips close by "
                f"themselves on {closed:.1f} % of the p, b, m in {result.utterances} test sentences"
            )
    display.print_lines(*lines, f"Kept in {report.folder}")


def print_export(report: ExportReport) -> None:
    """Print what was exported.

    Parameters
    ----------
    report
        The file.
    """
    near = ""
    if report.morph_targets is not None:
        near = (
            f", {len(report.morph_targets)} morph targets, within "
            f"{report.largest_error:.2f} mm of the face"
        )
    display.print_lines(f"{report.frames} frames{near}: {report.file}")
