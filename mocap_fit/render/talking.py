"""Draw the talking heads of a movie, frame by frame, in this process or in several."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import cache

from mocap_fit.errors import DataError
from mocap_fit.face.contact import resolve_contact
from mocap_fit.face.rig import Rig
from mocap_fit.processes import DeadProcess, run_in_processes
from mocap_fit.render.framing import View
from mocap_fit.render.liveliness import Liveliness, LivelyFace
from mocap_fit.render.pictures import Image
from mocap_fit.render.scene import FaceScene
from mocap_fit.tracks import FloatArray

# Frames that a process draws before it returns them.
_BATCH = 8


@dataclass(frozen=True, eq=False)
class Talk:
    """The movement of all heads of a movie, and the views in which they are drawn.

    Parameters
    ----------
    rig
        The face that all heads have.
    parameters
        Face parameters of each head in the order of the rig, ``(frames, parameters)``, 1 is the
        full gesture.
    views
        Every head is drawn once in each view.
    size
        Width and height of one picture of a head, pixels.
    zoom
        Magnification, no unit: 1 shows the head; above 1 comes closer to the mouth.
    life
        Blinks and head motion, which all heads share.
    markers
        Markers in the head frame, drawn over every head, ``(frames, markers, 3)``, millimetres.
    """

    rig: Rig
    parameters: tuple[FloatArray, ...]
    views: tuple[View, ...]
    size: tuple[int, int]
    zoom: float
    life: Liveliness
    markers: FloatArray

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.parameters[0])


class _Heads:
    """The scenes of a talk: one for each view, which all heads share."""

    def __init__(self, talk: Talk) -> None:
        self._talk = talk
        mesh = talk.rig.mesh
        self._lively = LivelyFace(mesh, blinks=bool(talk.life.blinks.any()))
        self._stack = ExitStack()
        self._scenes = [
            self._stack.enter_context(FaceScene(mesh, view=view, size=talk.size, zoom=talk.zoom))
            for view in talk.views
        ]

    def draw(self, number: int) -> list[list[Image]]:
        """Return the pictures of a frame: a row for each view, with one for each head."""
        talk, life = self._talk, self._talk.life
        turn, shift = life.turns[number], life.shifts[number]
        markers = self._lively.carry(talk.markers[number], turn, shift)
        shapes = [
            deform_face(talk.rig, self._lively, values[number], life, number)
            for values in talk.parameters
        ]
        return [[scene.draw(shape, markers=markers) for shape in shapes] for scene in self._scenes]

    def close(self) -> None:
        self._stack.close()


def deform_face(
    rig: Rig,
    lively: LivelyFace,
    values: FloatArray,
    life: Liveliness,
    number: int,
    *,
    contact: bool = True,
) -> FloatArray:
    """Return the vertices of a face as they are drawn: all that moves them is done here.

    Parameters
    ----------
    rig
        The face.
    lively
        Its lids and its neck.
    values
        Its parameters in the order of the rig, ``(parameters,)``, 1 is the full gesture.
    life
        Blinks and head motion of all frames.
    number
        Number of the frame, from 0.
    contact
        False for what it would be if lips, teeth and tongue could pass through each other.

    Returns
    -------
    ndarray
        Positions, ``(vertices, 3)``, millimetres.
    """
    vertices = rig.deform(values)
    if contact:
        vertices = resolve_contact(vertices, rig.mesh)
    blink = float(life.blinks[number])
    return lively.move(vertices, blink, life.turns[number], life.shifts[number])


def draw_frames(talk: Talk, jobs: int = 1) -> Iterator[list[list[Image]]]:
    """Draw all frames, in order.

    Parameters
    ----------
    talk
        The heads and their movement.
    jobs
        Number of processes that draw; 1 draws in this one. The pictures are the same.

    Yields
    ------
    list
        Pictures of a frame, ``(height, width, 3)`` each: a row for each view, with one picture
        for each head.

    Raises
    ------
    DataError
        If a process that draws ends early.
    """
    if jobs <= 1 or talk.frames <= _BATCH:
        with closing(_Heads(talk)) as heads:
            for number in range(talk.frames):
                yield heads.draw(number)
        return
    batches = [
        range(talk.frames)[first : first + _BATCH] for first in range(0, talk.frames, _BATCH)
    ]
    results = run_in_processes(
        _draw, talk, batches, jobs, lambda *how_far: None, copies=False, in_order=True
    )
    # Batches that are ready before their turn.
    early: dict[int, list[list[list[Image]]]] = {}
    following = 0
    with closing(results):
        for index, pictures in results:
            if isinstance(pictures, DeadProcess):
                raise DataError(
                    "a process that draws was killed, or ran out of memory",
                    advice="Draw in fewer processes, or smaller pictures.",
                )
            early[index] = pictures
            while following in early:
                yield from early.pop(following)
                following += 1


# A process draws one talk, batch after batch, and its scenes end with it.
_open_heads = cache(_Heads)


def _draw(
    talk: Talk, batch: range, progress: Callable[[int, int], object]
) -> list[list[list[Image]]]:
    heads = _open_heads(talk)
    return [heads.draw(number) for number in batch]
