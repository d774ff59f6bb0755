"""A movie of talking heads: parameter tracks in, pictures with sound out."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.face import load_face
from mocap_fit.face.rig import Rig
from mocap_fit.phones import PhoneSequence
from mocap_fit.render.liveliness import liveliness
from mocap_fit.render.movie_file import MovieFile, checked_rate, movie_kind, sound_between
from mocap_fit.render.running_strip import (
    COLOURS,
    Curve,
    RunningStrip,
    curves_of,
    lettering,
    moving_most,
)
from mocap_fit.render.scene import View
from mocap_fit.render.talking import Talk, checked_views, drawn, markers_at, parameters_at
from mocap_fit.sound import Sound, read_sound
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks

Image = NDArray[np.uint8]
Tracks = ParameterTracks | Mapping[str, ParameterTracks]

_LABEL_HEIGHT = 34
_SUBTITLE_HEIGHT = 44
_PAPER = 255
_ZOOM = 1.3
# Phones beside the one that is heard, in the subtitles.
_NEIGHBOURS = 4
_LONGEST = 3600.0


@dataclass(frozen=True)
class Movie:
    """A movie that has been written.

    Parameters
    ----------
    path
        Of the file, or of the folder of pictures.
    frames
        How many.
    rate
        Frames per second.
    size
        Width and height, pixels.
    with_sound
        Whether it is heard.
    """

    path: Path
    frames: int
    rate: float
    size: tuple[int, int]
    with_sound: bool

    @property
    def duration(self) -> float:
        """Seconds."""
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
    zoom: float = _ZOOM,
    phones: PhoneSequence | None = None,
    subtitles: bool = False,
    curves: bool | Sequence[str] = False,
    markers: MarkerTracks | None = None,
    blinks: bool = False,
    head_motion: bool = False,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[int, int], object] | None = None,
) -> Movie:
    """Make a movie of one talking head, or of several side by side.

    Parameters
    ----------
    tracks
        Face parameters over time; or several, by the label that is written under each head.
    path
        ``.mp4`` (H.264, and AAC when there is sound), ``.gif`` (silent), or a name without an
        ending: a new folder of PNG pictures.
    face
        The rig, ``"built-in"`` (the default), or a rig file.
    sound
        A sound, or a wav file, on the clock of the tracks: it begins at 0 s, and so does the
        movie. The movie lasts until both have ended.
    rate
        Pictures per second. Picture ``i`` is seen from ``i / rate`` to ``(i + 1) / rate`` and
        shows the face in the middle of that time.
    size
        Width and height of one head's picture, pixels.
    view
        ``front``, ``three-quarter`` or ``side``; several are shown together.
    zoom
        Above 1.3 is closer.
    phones
        What is said, for the subtitles and below the curves.
    subtitles
        Write the phones under the heads, the one that is heard in the middle.
    curves
        Parameters whose curves run along below, a colour a head; True takes those that move most.
    markers
        Recorded markers in the frame of the head, drawn over every head as balls.
    blinks, head_motion
        Add what a lively head does; both are drawn from the seed, not measured.
    seed
        See `mocap_fit.render.liveliness`.
    jobs
        How many processes draw. A script that asks for more than one must have its work behind
        ``if __name__ == "__main__":``, as always when processes are started.
    progress
        Called after each picture with how many are done and how many there are.

    Returns
    -------
    Movie
        What was written. Nothing is, if something is wrong.

    Raises
    ------
    ConfigurationError
        If the ending is unknown, or the face cannot do what is asked.
    DataError
        If tracks, rate, size or view are not possible, or subtitles are asked for without phones.
    FileFormatError
        If the sound cannot be read, or the movie not written.
    MissingExtraError
        If ffmpeg or a way to draw is missing.
    """
    movie_kind(path)
    rate = checked_rate(rate)
    heads = _labelled(tracks)
    if subtitles and phones is None:
        raise DataError("subtitles need the phones of what is said")
    rig = _rig(face)
    heard = read_sound(sound) if isinstance(sound, str | os.PathLike) else sound
    start, end = _span(heads, heard)
    count = max(math.ceil((end - start) * rate - 1e-6), 1)
    times: FloatArray = start + (np.arange(count, dtype=np.float64) + 0.5) / rate
    views = checked_views(view)
    talk = Talk(
        rig,
        tuple(parameters_at(head, times, rig) for head in heads.values()),
        views,
        (int(size[0]), int(size[1])),
        zoom,
        liveliness(times, blinks=blinks, head_motion=head_motion, seed=seed),
        markers_at(markers, times),
    )
    chosen = moving_most(list(heads.values())) if curves is True else tuple(curves or ())
    page = _Page(
        talk,
        list(heads),
        phones=phones if subtitles else None,
        curves=curves_of(heads, chosen),
        strip_phones=phones if chosen else None,
        span=(start, end),
    )
    if heard is not None:
        heard = sound_between(heard, start, start + len(times) / rate)
    with MovieFile(path, rate, page.size, heard) as movie:
        for number, pictures in enumerate(drawn(talk, jobs)):
            movie.add(page.composed(pictures, float(times[number])))
            if progress is not None:
                progress(number + 1, len(times))
    with_sound = heard is not None and movie.kind == "mp4"
    return Movie(Path(path), len(times), rate, page.size, with_sound)


class _Page:
    """Where heads, labels, subtitles and curves are in each picture of the movie."""

    def __init__(
        self,
        talk: Talk,
        labels: Sequence[str],
        *,
        phones: PhoneSequence | None,
        curves: Mapping[str, Sequence[Curve]],
        strip_phones: PhoneSequence | None,
        span: tuple[float, float],
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
            self._strip = RunningStrip(width, curves, strip_phones, *span)
            height += self._strip.height
        # MP4 wants even numbers.
        self.size = (width + width % 2, height + height % 2)
        self._blank = np.full((self.size[1], self.size[0], 3), _PAPER, dtype=np.uint8)
        self._write_labels(width)

    def composed(self, pictures: Sequence[Sequence[Image]], time: float) -> Image:
        """Put a frame together."""
        page = self._blank.copy()
        width, height = self._head
        placed = pictures if self._heads > 1 else [[row[0] for row in pictures]]
        for row, some in enumerate(placed):
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
            colour = COLOURS[i % len(COLOURS)] if self._coloured else "black"
            text = lettering(label, colour=colour)
            _put(self._blank, text, (i + 0.5) * step, self._label_top + _LABEL_HEIGHT / 2)

    def _write_phones(self, page: Image, phones: PhoneSequence, time: float) -> None:
        """The phone that is heard in the middle, its neighbours beside it, lighter."""
        now = int(phones.at(np.array([time]))[0])
        middle, y = self._columns * self._head[0] / 2, self._subtitle_top + _SUBTITLE_HEIGHT / 2
        if now < 0:
            return
        heard = lettering(phones[now].phone, points=17.0)
        _put(page, heard, middle, y)
        for direction in (-1, 1):
            edge = middle + direction * (heard.shape[1] / 2 + 14)
            for step in range(1, _NEIGHBOURS + 1):
                other = now + direction * step
                if not 0 <= other < len(phones):
                    break
                text = lettering(phones[other].phone, colour="0.6")
                edge += direction * text.shape[1] / 2
                _put(page, text, edge, y)
                edge += direction * (text.shape[1] / 2 + 14)


def _put(page: Image, text: Image, x: float, y: float) -> None:
    """Write on white paper, centred on a place, as far as it is on the page."""
    top, left = round(y - text.shape[0] / 2), round(x - text.shape[1] / 2)
    rows = slice(max(top, 0), min(top + text.shape[0], page.shape[0]))
    columns = slice(max(left, 0), min(left + text.shape[1], page.shape[1]))
    if rows.stop <= rows.start or columns.stop <= columns.start:
        return
    part = text[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    place = page[rows, columns]
    np.minimum(place, part, out=place)


def _labelled(tracks: Tracks) -> dict[str, ParameterTracks]:
    if isinstance(tracks, ParameterTracks):
        return {"": tracks}
    heads = dict(tracks)
    if not heads:
        raise DataError("there are no tracks to make a movie of")
    return heads


def _span(heads: Mapping[str, ParameterTracks], sound: Sound | None) -> tuple[float, float]:
    """From when to when the movie is, seconds."""
    ends = [head.start_time + head.duration for head in heads.values()]
    if sound is None:
        start, end = min(head.start_time for head in heads.values()), max(ends)
    else:
        start, end = 0.0, max(*ends, sound.duration)
    if end - start > _LONGEST:
        raise DataError(
            "the movie would last longer than an hour",
            found=f"{end - start:.0f} s",
            advice="Check the start times, or take a stretch of the tracks (between).",
        )
    return start, end


def _rig(face: Rig | str | Path | None) -> Rig:
    if face is None:
        return load_face()
    return load_face(face) if isinstance(face, str | Path) else face
