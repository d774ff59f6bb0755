"""The talking heads of a movie, frame by frame, in this process or over several."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import DataError
from mocap_fit.face.rig import Rig
from mocap_fit.processes import DeadProcess, run_in_processes
from mocap_fit.render.liveliness import Liveliness, LivelyFace
from mocap_fit.render.scene import FaceScene, View
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks

Image = NDArray[np.uint8]

# Frames that a process draws before it hands them over.
_BATCH = 8


@dataclass(frozen=True, eq=False)
class Talk:
    """Everything that the heads of a movie do, and from where they are seen.

    Parameters
    ----------
    rig
        The face that all heads have.
    parameters
        A head each: `(frames, parameters)`, in the order of the rig.
    views
        Every head is drawn once from each.
    size
        Width and height of one picture of a head, pixels.
    zoom
        See `FaceScene`.
    life
        Blinks and head motion, of all heads alike.
    markers
        `(frames, markers, 3)`, mm, in the head frame; none are drawn where there are none.
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
        """How many frames there are."""
        return len(self.parameters[0])


class _Heads:
    """Scenes for all that a talk shows; all heads of one view share one."""

    def __init__(self, talk: Talk) -> None:
        self._talk = talk
        mesh = talk.rig.mesh
        self._lively = LivelyFace(mesh, blinks=bool(talk.life.blinks.any()))
        self._stack = ExitStack()
        self._scenes = [
            self._stack.enter_context(
                FaceScene(mesh, view=view, size=talk.size, zoom=talk.zoom, centre=_middle(talk.rig))
            )
            for view in talk.views
        ]

    def frame(self, number: int) -> list[list[Image]]:
        """The pictures of a frame: a row a view, in it one a head."""
        talk, life = self._talk, self._talk.life
        turn, shift = life.turns[number], life.shifts[number]
        markers = self._lively.carried(talk.markers[number], turn, shift)
        shapes = []
        for values in talk.parameters:
            vertices = talk.rig.deform(values[number])
            shapes.append(self._lively.moved(vertices, float(life.blinks[number]), turn, shift))
        return [[scene.image(shape, markers=markers) for shape in shapes] for scene in self._scenes]

    def close(self) -> None:
        self._stack.close()


def drawn(talk: Talk, jobs: int = 1) -> Iterator[list[list[Image]]]:
    """Draw all frames, in order.

    Parameters
    ----------
    talk
        What is drawn.
    jobs
        How many processes draw; 1 draws here. The pictures are the same.

    Yields
    ------
    list
        A row a view, in it one picture a head.

    Raises
    ------
    DataError
        If a process that draws ends early.
    """
    if jobs <= 1 or talk.frames <= _BATCH:
        with closing(_Heads(talk)) as heads:
            for number in range(talk.frames):
                yield heads.frame(number)
        return
    batches = [
        range(talk.frames)[first : first + _BATCH] for first in range(0, talk.frames, _BATCH)
    ]
    results = run_in_processes(
        _draw, talk, batches, jobs, lambda *how_far: None, copies=False, in_order=True
    )
    # Those that come before one whose process died.
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
_heads_of = cache(_Heads)


def _draw(talk: Talk, batch: range, told: Callable[[int, int], object]) -> list[list[list[Image]]]:
    heads = _heads_of(talk)
    return [heads.frame(number) for number in batch]


def parameters_at(tracks: ParameterTracks, times: FloatArray, rig: Rig) -> FloatArray:
    """Parameters of a rig at any times, from tracks of some of them.

    Values between frames lie on monotone cubics, which reach the extremes of a closure and never
    go beyond them. Before and after the tracks the face stays as it is at their ends; missing
    values are bridged, and parameters that are not in the tracks are at rest. What leaves the
    bounds of the rig is drawn at the bound.

    Returns
    -------
    FloatArray
        `(times, parameters)`, in the order of the rig.

    Raises
    ------
    DataError
        If the tracks have a parameter that the face lacks, or no frame.
    """
    names = rig.parameter_names
    unknown = [name for name in tracks.names if name not in names]
    if unknown:
        raise DataError(
            f"the face has no parameter {', '.join(unknown)}",
            expected=f"some of {', '.join(names)}",
            advice="Give the face that the tracks were made with.",
        )
    values = np.zeros((len(times), len(names)))
    values[:, [names.index(name) for name in tracks.names]] = np.nan_to_num(tracks.at(times))
    low, high = rig.bounds.T
    return np.asarray(np.clip(values, low, high))


def markers_at(markers: MarkerTracks | None, times: FloatArray) -> FloatArray:
    """Places of markers at any times, `(times, markers, 3)`; missing where a frame beside is."""
    if markers is None:
        return np.zeros((len(times), 0, 3))
    return markers.at(times)


def _middle(rig: Rig) -> FloatArray:
    """What the camera looks at: between the eyes and the chin, where a face has them."""
    mesh = rig.mesh
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    nose = mesh.feature_points.get("9.3")
    if nose is not None:
        middle[1] = 0.5 * (middle[1] + mesh.vertices[nose, 1])
    return np.asarray(middle)


def checked_views(views: View | Sequence[View]) -> tuple[View, ...]:
    """One view or several, as a tuple."""
    chosen: tuple[View, ...] = (views,) if isinstance(views, str) else tuple(views)
    if not chosen:
        raise DataError("a movie needs a view")
    return chosen
