"""``mocap-fit inspect``: look at a recording, a fit, a corpus, a model or a layout, and mend it."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from corpus_tools.tasks import TaskProgress
from mocap_fit.errors import DataError

if TYPE_CHECKING:
    from corpus_tools.inspection.material import Material
    from corpus_tools.inspection.window import Window
    from mocap_fit.fitting.reference_pose import ReferenceSpan

_Path = str | os.PathLike[str]
# Frames a second of a movie.
_RATE = 25.0


@dataclass(frozen=True, eq=False)
class Inspection:
    """What was looked at.

    Parameters
    ----------
    material
        What there was to show.
    other
        What it was compared with; None without.
    files
        Files that were written.
    suggestion
        The best reference pose in the recording; None where it was not asked for.
    """

    material: Material
    other: Material | None
    files: tuple[Path, ...]
    suggestion: ReferenceSpan | None = None

    def __repr__(self) -> str:
        files = ", ".join(map(str, self.files)) or "no file"
        return f"Inspection({self.material.title}, {len(self.material.findings)} findings, {files})"


def inspect(
    path: _Path,
    other: _Path | None = None,
    *,
    html: _Path | None = None,
    between: tuple[float, float] | None = None,
    models: Sequence[str] = (),
    screenshot: _Path | None = None,
    movie: _Path | None = None,
    at: float | None = None,
    view: Literal["front", "three-quarter", "side", "top"] = "front",
    size: tuple[int, int] = (1280, 800),
    names: bool = False,
    tab: str | None = None,
    suggest_reference: bool = False,
    reference: _Path | None = None,
    layout: str | None = None,
    face: str | None = None,
    recording: _Path | None = None,
    labels: _Path | None = None,
    sound: _Path | None = None,
    phone_set: str | None = None,
    edits: _Path | None = None,
    utterance: str | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
    rename: Mapping[str, str] | None = None,
    progress: TaskProgress | None = None,
) -> Inspection:
    """Look at something in a window, or write it as a web page or as pictures of that window.

    Parameters
    ----------
    path
        A recording, a fit, a corpus, the parameters of one of its utterances, a trained model, or
        a marker layout: a file or the name of a shipped one.
    other
        What it is compared with, such as another fit of the same recording; of a control model
        what it says of the phones, where these are known.
    html
        A web page in one file, in place of the window.
    between
        Start and end of the part that is on the page, seconds; all by default, up to five minutes.
    models
        Files or names of control models, whose movements of the phones are shown too.
    screenshot
        A PNG file of the window, in place of the window.
    movie
        A movie of the window (MP4, GIF or a folder of PNG), in place of the window.
    at
        Time that is shown, seconds; the middle by default.
    view
        From where the head is seen.
    size
        Width and height of the window, pixels.
    names
        Whether every marker has its name.
    tab
        The list that is shown: ``findings``, ``utterances``, ``parameters``, ``markers``,
        ``edits`` or ``keys``.
    suggest_reference
        Whether the stillest span with closed lips is searched in place of the window.
    reference
        The recording of the reference pose; found beside the recording by default.
    layout
        Name or file of the marker layout; found by the names of markers by default.
    face
        ``built-in``, or a rig file.
    recording
        The recording that a fit is of.
    labels
        The labels; those of the same name beside the recording by default.
    sound
        The sound; that of the same name beside the recording by default.
    phone_set
        Name or file of the phone set of the labels.
    edits
        The edit list, or the folder of the lists; beside the recording by default.
    utterance
        Id of the utterance of a corpus; the first by default.
    rate
        Frame rate of the recordings, hertz, in place of what the files say.
    unit
        Unit of length of the files, such as ``m``, in place of what they say.
    subject
        Subject whose markers are read, where files name several.
    rename
        New names of markers by those in the files.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    Inspection
        What there was to show, and the files that were written.

    Raises
    ------
    MocapFitError
        If something cannot be read or written.
    MissingExtraError
        If there is no screen for a window, or nothing that draws without one.
    """
    from corpus_tools.inspection.gather import gather
    from corpus_tools.inspection.sources import Sources
    from corpus_tools.inspection.web_page import predict_beside, write_material
    from mocap_fit.atomic_file import check_targets
    from mocap_fit.fitting.reference_pose import parse_reference
    from mocap_fit.io import ReadOptions
    from mocap_fit.render.pictures import save_picture
    from mocap_fit.render.scene import prepare_off_screen

    pictures = [Path(each) for each in (screenshot, movie) if each is not None]
    wanted = [*pictures] if html is None else [Path(html), *pictures]
    pose = None if reference is None else parse_reference(reference).path
    inputs = [path, other, pose, layout, face, recording, labels, sound, phone_set, edits, *models]
    check_targets(wanted, [each for each in inputs if each is not None])
    sources = Sources(
        reference=reference,
        layout=layout,
        face=face,
        recording=recording,
        labels=labels,
        sound=sound,
        phone_set=phone_set,
        edits=edits,
        utterance=utterance,
        options=ReadOptions(rate, unit, subject, rename or {}),
    )
    material = predict_beside(gather(path, sources), models, progress)
    if suggest_reference:
        return Inspection(material, None, (), _suggest(material))
    compared = None
    if other is not None and material.phones and zipfile.is_zipfile(other):
        beside = predict_beside(material, [os.fspath(other)], progress).heads
        label = list(beside)[-1]
        compared = material.replace(title=label, heads={label: beside[label]})
    elif other is not None:
        compared = gather(other, sources)
    if html is not None:
        write_material(material, html, compared, between, progress)
    if html is not None and not pictures:
        return Inspection(material, compared, tuple(wanted))
    if pictures:
        prepare_off_screen()
    from corpus_tools.inspection.window import Window

    window = Window(material, compared, sources=sources, size=size, off_screen=bool(pictures))
    try:
        window.set_up(at=at, view=view, names=names, tab=tab)
        if screenshot is not None:
            save_picture(window.capture(), screenshot)
        if movie is not None:
            _write_movie(window, Path(movie), progress)
        if not pictures:
            window.show()
    finally:
        window.close()
    return Inspection(material, compared, tuple(wanted))


def _suggest(material: Material) -> ReferenceSpan:
    from mocap_fit.fitting import suggest_reference
    from mocap_fit.fitting.marker_names import match_names

    # Spans are on the recording's clock, as its file is read.
    recording, layout = material.unedited, material.layout
    if recording is None or layout is None:
        raise DataError(
            f"there is no reference pose to search for in {material.title}",
            expected="a recording whose layout is known",
            advice="Give the layout with --layout.",
        )
    return suggest_reference(match_names(layout, recording), layout)


def _write_movie(window: Window, path: Path, progress: TaskProgress | None) -> None:
    from mocap_fit.render.movie_file import MovieFile, cut_sound

    line, sound = window.line, window.material.sound
    count = int((line.last - line.first) * _RATE)
    if count < 1:
        raise DataError("there is nothing that moves for a movie", found=window.material.title)
    cut = None if sound is None else cut_sound(sound, line.first, line.first + count / _RATE)
    with MovieFile(path, _RATE, window.size, cut) as file:
        for number in range(count):
            line.move_cursor(line.first + number / _RATE)
            window.draw()
            file.add(window.capture())
            if progress is not None:
                progress("drawing frames", number + 1, count)
