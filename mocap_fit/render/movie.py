"""Make movies of talking heads from parameter tracks and sound."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mocap_fit.drawing import CYCLE
from mocap_fit.errors import DataError
from mocap_fit.face import load_face
from mocap_fit.face.rig import Rig
from mocap_fit.phones import PhoneSequence
from mocap_fit.render.framing import View
from mocap_fit.render.liveliness import plan_liveliness
from mocap_fit.render.movie_file import MovieFile, check_frame_rate, cut_sound, get_movie_kind
from mocap_fit.render.pictures import Image
from mocap_fit.render.running_strip import Curve, RunningStrip, draw_text, select_moving, to_curves
from mocap_fit.render.sampling import sample_parameters
from mocap_fit.render.talking import Talk, draw_frames
from mocap_fit.sound import Sound, read_sound
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks, PoseTracks

Tracks = ParameterTracks | Mapping[str, ParameterTracks]

_LABEL_HEIGHT = 34
_SUBTITLE_HEIGHT = 44
_PAPER = 255
# Phones on either side of the current one, in the subtitles.
_NEIGHBOURS = 4
MAX_DURATION = 3600.0
"""Seconds: a movie is not longer."""


@dataclass(frozen=True)
class Movie:
    """A movie that has been written.

    Parameters
    ----------
    path
        The file, or the folder of pictures.
    frames
        Number of frames.
    rate
        Frame rate, hertz.
    size
        Width and height, pixels.
    with_sound
        Whether it has sound.
    """

    path: Path
    frames: int
    rate: float
    size: tuple[int, int]
    with_sound: bool

    @property
    def duration(self) -> float:
        """Duration, seconds."""
        return self.frames / self.rate


def render_movie(
    tracks: Tracks,
    path: str | os.PathLike[str],
    *,
    face: Rig | str | Path | None = None,
    sound: Sound | str | os.PathLike[str] | None = None,
    rate: float = 25.0,
    size: tuple[int, int] = (640, 640),
    view: View | Sequence[View] = "front",
    zoom: float = 1.0,
    phones: PhoneSequence | None = None,
    subtitles: bool = False,
    curves: bool | Sequence[str] = False,
    markers: MarkerTracks | None = None,
    blinks: bool = False,
    head_motion: bool | PoseTracks = False,
    seed: int = 0,
    extent: tuple[float, float] | None = None,
    jobs: int = 1,
    progress: Callable[[int, int], object] | None = None,
) -> Movie:
    """Make a movie of one talking head, or of several side by side.

    Parameters
    ----------
    tracks
        Face parameters over time; or several of them by the label that is written under each
        head.
    path
        A name in ``.mp4`` (H.264, and AAC when there is sound) or ``.gif`` (silent), or without an
        ending: a new folder of PNG pictures.
    face
        A rig, ``"built-in"`` (the default), or a rig file.
    sound
        A sound or a sound file on the clock of the tracks: it begins at 0 s, and so does the movie.
        The movie lasts until both have ended.
    rate
        Frame rate, hertz. Picture ``i`` is visible from ``i / rate`` to ``(i + 1) / rate`` and
        shows the face in the middle of that time.
    size
        Width and height of one head's picture, pixels.
    view
        ``front``, ``three-quarter`` or ``side``; several are shown together.
    zoom
        Magnification, no unit: 1 shows the head; above 1 comes closer to the mouth.
    phones
        The phones of the utterance, for the subtitles and below the curves; where the face has
        parameters of the tongue that the tracks lack, it moves by them.
    subtitles
        Whether the phones are written under the heads, the current one in the middle.
    curves
        Parameters whose curves are drawn below, a colour for each head; True takes those that
        move most.
    markers
        Recorded markers in the head frame, drawn over every head as balls.
    blinks
        Whether blinks are added, drawn at random from the seed.
    head_motion
        Whether head motion is added, drawn at random from the seed; or the pose of a head that was
        measured, in the axes of the face, whose motion about its mean is added.
    seed
        Another seed draws other blinks and head motion.
    extent
        Start and end of the movie on the clock of the tracks, seconds; by default all of tracks
        and sound.
    jobs
        Number of processes that draw. A script that uses more than one must have its work behind
        ``if __name__ == "__main__":``, as always when processes are started.
    progress
        Called after each picture with the number that are done and the number of all.

    Returns
    -------
    Movie
        The movie that was written.

    Raises
    ------
    ConfigurationError
        If the ending is unknown, or the face cannot blink.
    DataError
        If tracks, rate, size or view are out of range, subtitles have no phones, or the pose of the
        head is never known.
    FileFormatError
        If the sound cannot be read, or the movie cannot be written.
    MissingExtraError
        If ffmpeg, or a display and EGL, are missing.

    See Also
    --------
    synthesise : Compute face parameters of phones with a control model.
    read_sound : Read a sound file.

    Examples
    --------
    A small silent movie, as a folder of pictures:

    >>> import mocap_fit as mf
    >>> from mocap_fit.control.rule_based import RuleBased
    >>> phones = mf.read_phones(mf.load_sample("take_01.TextGrid"), phone_set="sv-sta")
    >>> tracks = mf.synthesise(phones, RuleBased().prepare("sv-sta")).between(0.5, 0.9)
    >>> movie = mf.render_movie(tracks, "pictures", rate=10, size=(64, 64))
    >>> movie.frames, movie.size, movie.with_sound
    (4, (64, 64), False)
    """
    get_movie_kind(path)
    rate = check_frame_rate(rate)
    heads = _label_heads(tracks)
    if subtitles and phones is None:
        raise DataError("subtitles need the phones of what is said")
    rig = _load_rig(face)
    speech = read_sound(sound) if isinstance(sound, str | os.PathLike) else sound
    start, end = _find_extent(heads, speech) if extent is None else extent
    if end - start > MAX_DURATION:
        raise DataError(
            "the movie would last longer than an hour",
            found=f"{end - start:.0f} s",
            advice="Check the start times, or take a part of the tracks (between).",
        )
    count = max(math.ceil((end - start) * rate - 1e-6), 1)
    times: FloatArray = start + (np.arange(count, dtype=np.float64) + 0.5) / rate
    views: tuple[View, ...] = (view,) if isinstance(view, str) else tuple(view)
    if not views:
        raise DataError("a movie needs a view")
    talk = Talk(
        rig,
        tuple(sample_parameters(head, times, rig, phones) for head in heads.values()),
        views,
        (int(size[0]), int(size[1])),
        zoom,
        plan_liveliness(times, rig.mesh, blinks=blinks, head_motion=head_motion, seed=seed),
        np.zeros((count, 0, 3)) if markers is None else markers.at(times),
    )
    chosen = select_moving(list(heads.values())) if curves is True else tuple(curves or ())
    page = _Page(
        talk,
        list(heads),
        phones=phones if subtitles else None,
        curves=to_curves(heads, chosen),
        strip_phones=phones if chosen else None,
        extent=(start, end),
    )
    if speech is not None:
        speech = cut_sound(speech, start, start + count / rate)
    with MovieFile(path, rate, page.size, speech) as movie:
        for number, pictures in enumerate(draw_frames(talk, jobs)):
            movie.add(page.compose(pictures, float(times[number])))
            if progress is not None:
                progress(number + 1, count)
    with_sound = speech is not None and movie.kind != "gif"
    return Movie(Path(path), count, rate, page.size, with_sound)


class _Page:
    """The arrangement of heads, labels, subtitles and curves in each picture of the movie."""

    def __init__(
        self,
        talk: Talk,
        labels: Sequence[str],
        *,
        phones: PhoneSequence | None,
        curves: Mapping[str, Sequence[Curve]],
        strip_phones: PhoneSequence | None,
        extent: tuple[float, float],
    ) -> None:
        self._views, self._heads = len(talk.views), len(labels)
        self._head = talk.size
        self._labels = list(labels) if any(labels) else []
        self._coloured = bool(curves)
        self._phones = phones
        # Several views of one head are side by side, of several heads one below the other.
        self._columns = self._heads if self._heads > 1 else self._views
        self._rows = self._views if self._heads > 1 else 1
        width = self._columns * talk.size[0]
        height = self._rows * talk.size[1]
        self._label_top = height
        height += _LABEL_HEIGHT if self._labels else 0
        self._subtitle_top = height
        height += _SUBTITLE_HEIGHT if phones is not None else 0
        self._strip_top = height
        self._strip: RunningStrip | None = None
        if curves:
            self._strip = RunningStrip(width, curves, strip_phones, *extent)
            height += self._strip.height
        # MP4 wants even numbers.
        self.size = (width + width % 2, height + height % 2)
        self._blank = np.full((self.size[1], self.size[0], 3), _PAPER, dtype=np.uint8)
        self._write_labels(width)

    def compose(self, pictures: Sequence[Sequence[Image]], time: float) -> Image:
        """Return a picture of the movie."""
        page = self._blank.copy()
        width, height = self._head
        grid = pictures if self._heads > 1 else [[row[0] for row in pictures]]
        for row, some in enumerate(grid):
            for column, picture in enumerate(some):
                page[row * height : (row + 1) * height, column * width : (column + 1) * width] = (
                    picture
                )
        if self._phones is not None:
            self._write_phones(page, self._phones, time)
        if self._strip is not None:
            strip = self._strip.at(time)
            page[self._strip_top : self._strip_top + len(strip), : strip.shape[1]] = strip
        return page

    def _write_labels(self, width: int) -> None:
        step = width / max(len(self._labels), 1)
        for i, label in enumerate(self._labels):
            colour = CYCLE[i % len(CYCLE)] if self._coloured else "black"
            text = draw_text(label, colour=colour)
            _paste(self._blank, text, (i + 0.5) * step, self._label_top + _LABEL_HEIGHT / 2)

    def _write_phones(self, page: Image, phones: PhoneSequence, time: float) -> None:
        """Write the current phone in the middle, its neighbours on either side, lighter."""
        now = int(phones.at(np.array([time]))[0])
        middle, y = self._columns * self._head[0] / 2, self._subtitle_top + _SUBTITLE_HEIGHT / 2
        if now < 0:
            return
        current = draw_text(phones[now].phone, points=17.0)
        _paste(page, current, middle, y)
        for direction in (-1, 1):
            edge = middle + direction * (current.shape[1] / 2 + 14)
            for step in range(1, _NEIGHBOURS + 1):
                other = now + direction * step
                if not 0 <= other < len(phones):
                    break
                text = draw_text(phones[other].phone, colour="0.6")
                edge += direction * text.shape[1] / 2
                _paste(page, text, edge, y)
                edge += direction * (text.shape[1] / 2 + 14)


def _paste(page: Image, text: Image, x: float, y: float) -> None:
    """Write a text on a white page, centred on a point, as far as it is on the page."""
    top, left = round(y - text.shape[0] / 2), round(x - text.shape[1] / 2)
    rows = slice(max(top, 0), min(top + text.shape[0], page.shape[0]))
    columns = slice(max(left, 0), min(left + text.shape[1], page.shape[1]))
    if rows.stop <= rows.start or columns.stop <= columns.start:
        return
    part = text[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    background = page[rows, columns]
    np.minimum(background, part, out=background)


def _label_heads(tracks: Tracks) -> dict[str, ParameterTracks]:
    if isinstance(tracks, ParameterTracks):
        return {"": tracks}
    heads = dict(tracks)
    if not heads:
        raise DataError("there are no tracks to make a movie of")
    return heads


def _find_extent(heads: Mapping[str, ParameterTracks], sound: Sound | None) -> tuple[float, float]:
    """Return start and end of the movie, seconds."""
    ends = [head.start_time + head.duration for head in heads.values()]
    if sound is None:
        start, end = min(head.start_time for head in heads.values()), max(ends)
    else:
        start, end = 0.0, max(*ends, sound.duration)
    return start, end


def _load_rig(face: Rig | str | Path | None) -> Rig:
    if face is None:
        return load_face(tongue=True)
    return load_face(face, tongue=None) if isinstance(face, str | Path) else face
