"""The commands of the talking head; `app` puts them on the command line."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from corpus_tools.cli import arguments, display
from corpus_tools.cli.arguments import Argument, AsJson, Option

if TYPE_CHECKING:
    from mocap_fit.render.framing import View

_VIEWS: tuple[View, ...] = ("front", "three-quarter", "side")
_Model = Annotated[
    list[str] | None,
    Option(
        "--model",
        metavar="FILE|NAME",
        help=(
            "A trained model, or a kind: rule-based, cart, …; repeatable: side by side. "
            "By default cohen-massaro for sv, cs and en, rule-based for other languages."
        ),
    ),
]
_Language = Annotated[
    str, Option("--lang", help="sv, cs, en, or any voice of espeak-ng, such as de.")
]
_Articulation = Annotated[
    float,
    Option(
        min=0.0, max=3.0, help="Factor of the movements: 1.3 is clear speech. Lips close anyway."
    ),
]


def _speak(
    text: Annotated[str | None, Argument(metavar="TEXT", help="What is said.")] = None,
    out: Annotated[
        Path | None,
        Option(help="FILE.mp4, FILE.gif, FILE.html (one page), or a new folder for PNG pictures."),
    ] = None,
    labels: Annotated[Path | None, Option(help="Labelled phones instead of a text.")] = None,
    tracks: Annotated[
        Path | None, Option(help="Measured tracks; with --labels and --model beside.")
    ] = None,
    audio: Annotated[Path | None, Option(help="The sound of labels or tracks.")] = None,
    language: _Language = "",
    model: _Model = None,
    nearest: Annotated[
        bool,
        Option(
            "--nearest",
            help="Let models of another phone set say the nearest sounds that they know.",
        ),
    ] = False,
    articulation: _Articulation = 1.0,
    phone_set: Annotated[
        str | None, Option(help="What the labels are written in: a name or a file.")
    ] = None,
    tier: Annotated[str | None, Option(help="The tier of the phones.")] = None,
    speed: Annotated[float, Option(help="Words per minute.")] = 160.0,
    rate: Annotated[float, Option(min=1, max=240, help="Frames per second.")] = 25.0,
    view: Annotated[
        list[str] | None, Option(metavar="VIEW", help="front, three-quarter or side; repeatable.")
    ] = None,
    size: Annotated[int, Option(min=64, max=4096, help="Pixels each way of a head.")] = 640,
    zoom: Annotated[
        float, Option(min=0.2, max=20, help="1 shows the head; above 1: closer to the mouth.")
    ] = 1.0,
    subtitles: Annotated[
        bool, Option("--subtitles", help="Write the phones under the heads.")
    ] = False,
    curves: Annotated[
        bool, Option("--curves", help="Let the parameters' curves run along below.")
    ] = False,
    still: Annotated[
        bool,
        Option("--still", help="No blinks, and a head at rest, as always with --tracks."),
    ] = False,
    seed: Annotated[
        int, Option(min=0, help="Seed of blinks and head motion, the same in all conditions.")
    ] = 0,
    markers: Annotated[
        Path | None, Option(help="A recording, drawn over the head; with --reference.")
    ] = None,
    reference: Annotated[
        str | None,
        Option(metavar="FILE[@START-END]", help="The speaker's reference pose (span in seconds)."),
    ] = None,
    layout: Annotated[
        str | None, Option(help="The marker layout of the speaker; by default the one that fits.")
    ] = None,
    head: Annotated[
        Path | None, Option(help="With --tracks: a corpus's head/ID.parquet; the head moves so.")
    ] = None,
    face: arguments.Face = "built-in",
    keep: Annotated[Path | None, Option(help="A folder for tracks, labels, sound.")] = None,
    overwrite: arguments.Overwrite = False,
    jobs: Annotated[
        int, Option(min=0, help="Processes that draw; 0 for as many as are worth it.")
    ] = 0,
    prepare: Annotated[
        bool,
        Option(
            "--prepare", help="Train and save the models of --lang and --model (by default all)."
        ),
    ] = False,
    fresh: Annotated[
        bool, Option("--fresh", help="With --prepare: train again what is saved already.")
    ] = False,
    check: Annotated[
        bool, Option("--check", help="With --prepare: score them on simulated test sentences.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Let a talking head say a text, labelled phones, or what was measured.

    The default model of sv, cs and en speaks at once. Others that are named by their kind are
    trained on simulated sentences of the language when they are first used, which takes seconds
    or minutes, and saved; `mocap-fit speak --prepare` trains them all beforehand.
    """
    from corpus_tools.cli import speak_printing
    from corpus_tools.talking import speak as speaking

    if prepare:
        from corpus_tools.talking.prepare_voices import prepare_voices

        wanted = [language] if language else []
        with display.show_progress() as progress:
            voices = prepare_voices(
                wanted, model or (), fresh=fresh, check=check, progress=progress
            )
        display.print_report(voices, speak_printing.print_voices, as_json=as_json)
        return
    if (text is None) + (labels is None) + (tracks is None) == 3:
        raise typer.BadParameter("give a TEXT, --labels, or --tracks", param_hint="TEXT")
    if text is not None and (labels is not None or tracks is not None):
        raise typer.BadParameter(
            "a text is spoken by itself: leave out --labels and --tracks", param_hint="TEXT"
        )
    if text is not None and audio is not None:
        raise typer.BadParameter("a text has its own sound", param_hint="--audio")
    if (layout and not reference) or (reference and not (markers or head)):
        raise typer.BadParameter(
            "--reference goes with --markers or --head, and --layout with --reference",
            param_hint="--reference",
        )
    if head is not None and tracks is None:
        raise typer.BadParameter("a measured head goes with --tracks", param_hint="--head")
    if out is None:
        raise typer.BadParameter("say where to: --out FILE.mp4, or FILE.html", param_hint="--out")
    views = tuple(arguments.check_choice(name, _VIEWS, "--view") for name in view or ["front"])
    source = speaking.Source(text, labels, tracks, audio, language or "en", phone_set, tier, speed)
    look = speaking.Look(
        rate,
        (size, size),
        views,
        zoom,
        subtitles,
        curves,
        still,
        seed,
        face,
        markers,
        head,
        reference,
        layout,
    )
    with display.show_progress() as progress:
        report = speaking.speak(
            source,
            out,
            models=model or (),
            look=look,
            nearest=nearest,
            articulation=articulation,
            keep=keep,
            overwrite=overwrite,
            jobs=jobs,
            progress=progress,
        )
    display.print_report(report, speak_printing.print_speech, as_json=as_json)


def _stream(
    model: Annotated[str, Option(metavar="FILE|NAME", help="A trained model, or a kind of model.")],
    language: _Language = "en",
    rate: Annotated[
        float | None, Option(min=1, max=1000, help="Frames per second; by default the model's.")
    ] = None,
    articulation: _Articulation = 1.0,
) -> None:
    """Read phones from stdin, write frames to stdout as soon as they are certain.

    One phone per line: START END PHONE [STRESS], or JSON with these keys. An empty line ends an
    utterance. One frame per line, as JSON: time, and the parameters by name. Models that look
    ahead a limited time are live (`mocap-fit info` says which); others wait for the empty line.
    """
    from corpus_tools.talking.stream import stream as run

    with display.show_progress() as progress:
        # Not a loop over the file, which could read ahead.
        lines = iter(sys.stdin.readline, "")
        frames = run(
            model,
            lines,
            language=language,
            rate=rate,
            articulation=articulation,
            progress=progress,
        )
        for frame in frames:
            # Whoever animates waits for it.
            print(json.dumps(frame), flush=True)


def _export(
    tracks: Annotated[Path, Argument(metavar="TRACKS", help="Face parameters (Parquet).")],
    to: Annotated[str, Option(help="gltf, fap or csv.")],
    out: Annotated[Path, Option(help="The file.")],
    face: arguments.Face = "built-in",
    rate: Annotated[
        float | None, Option(min=1, max=240, help="Frames per second; by default the tracks'.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write face parameters for other programs: glTF, MPEG-4 FAP, CSV."""
    from corpus_tools.cli import speak_printing
    from corpus_tools.talking import export as exporting

    to_format = arguments.check_choice(to, exporting.FORMATS, "--to")
    report = exporting.export(tracks, to_format, out, face=face, rate=rate)
    display.print_report(report, speak_printing.print_export, as_json=as_json)


COMMANDS = {"speak": _speak, "stream": _stream, "export": _export}
"""Functions by the names of their commands."""
