"""Print what the demo has done."""

from __future__ import annotations

from corpus_tools.cli import console, display
from corpus_tools.cli.corpus_printing import print_conversion
from corpus_tools.demonstration.demo import DemoReport
from corpus_tools.demonstration.fitting import EXPLAINED, to_head_table, to_parameter_table
from mocap_fit.evaluation import GROUPS


def print_demo(report: DemoReport) -> None:
    """Print the errors of the fit beside their bounds, and the scores of the control models.

    Parameters
    ----------
    report
        What the demo has done.
    """
    screen = display.create_screen()
    same, other = report.fits.errors["same_head"], report.fits.errors["other_head"]
    squares, distances = same["squares"], same["distances"]
    screen.print(
        f"Simulated: {distances.frames} frames of the built-in head and {other['squares'].frames} "
        f"of another head; 30 face and 5 head markers, noise {report.conditions.noise:g} mm, "
        f"{report.conditions.drop_outs:.0%} drop-outs, the head moving."
    )
    table = display.create_table(*to_parameter_table(squares, distances, other["distances"]))
    screen.print("", table, "", sep="\n")
    screen.print(EXPLAINED)
    table = display.create_table(*to_head_table(distances, other["distances"]))
    screen.print("", table, "", sep="\n")
    screen.print(
        f"{distances.fitted} of {distances.frames} and {other['distances'].fitted} of "
        f"{other['distances'].frames} frames fitted; the rest show too few head markers.\n"
    )
    for line in report.talk.conversion.messages:
        console.say(line)
    print_conversion(report.talk.conversion)
    result = report.talk.result
    screen.print(
        f"\nControl models on {result.utterances} sentences that they have not seen (the "
        f"networks stop after at most {report.talk.report['network_epochs_at_most']} epochs):\n"
    )
    screen.print(display.create_table(*result.to_rows(GROUPS[:1])), "")
    display.print_lines("Written:", *(f"  {path}" for path in report.files))
