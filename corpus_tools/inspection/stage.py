"""What is seen in space: a head, markers, and lines between measured and virtual ones."""

from __future__ import annotations

import contextlib
from functools import cached_property
from typing import Any, Literal

import numpy as np

from corpus_tools.inspection.bodies import (
    DROPPED,
    FILLED,
    HEAD_MARKER,
    MEASURED,
    PICKED,
    RADIUS,
    VIRTUAL,
    Head,
    Lines,
    Shapes,
    colour_residuals,
)
from corpus_tools.inspection.material import Material
from mocap_fit.errors import DataError
from mocap_fit.fitting.coordinates import locate_expected
from mocap_fit.render.framing import DIRECTIONS, VIEW_ANGLE, frame_face
from mocap_fit.render.sampling import sample_parameters
from mocap_fit.tracks import FloatArray, MarkerTracks, Origin
from mocap_fit.tracks.rigid import estimate_rigid_transform, estimate_similarity_transform
from mocap_fit.tracks.rigid_sets import compute_median

StageView = Literal["front", "three-quarter", "side", "top"]
# From the middle to the camera.
_DIRECTIONS = {name: np.array(each) for name, each in DIRECTIONS.items()} | {
    "top": np.array([0.0, 1.0, 0.02])
}
# Millimetres: heads that are compared are this far from the middle.
_ASIDE = 115.0
VIEWS: tuple[StageView, ...] = ("front", "three-quarter", "side", "top")


class Stage:
    """Everything in space.

    Parameters
    ----------
    plotter
        A plotter of pyvista.
    material
        What is shown.
    other
        What it is compared with.
    """

    def __init__(self, plotter: Any, material: Material, other: Material | None = None) -> None:
        self._plotter = plotter
        self.material, self.other = material, other
        self.with_motion = False
        self.stretch = 1.0
        # What is measured is round the mouth.
        self.zoom = 1.25 if material.tracks else 1.0
        self.picked: str | None = None
        self.overrides: dict[str, float] = {}
        self._set_up_markers()
        self._heads: list[Head] = []
        self._shown = self._choose_heads()
        self._sampled = []
        for source, label in self._shown:
            head, rig = source.heads[label], material.rig
            assert rig is not None
            frames = sample_parameters(head, head.times, rig)
            self._sampled.append((head.start_time, head.rate, frames))
        if material.rig is not None:
            count = min(len(self._shown), 2)
            self._heads = [Head(plotter, material.rig) for _ in range(max(count, 1))]
        self._shapes = Shapes(plotter, len(self.names)) if self.names else None
        bound = self.bound_names
        self._dots = Shapes(plotter, len(bound)) if bound else None
        self._lines = Lines(plotter, len(bound)) if bound else None
        self.positions = np.full((len(self.names), 3), np.nan)
        self.residuals = np.full(len(bound), np.nan)
        self._middle, self._extent = self._measure_middle()

    def _choose_heads(self) -> list[tuple[Material, str]]:
        if self.material.rig is None:
            return []
        shown = [(self.material, label) for label in self.material.heads]
        if self.other is not None:
            shown = shown[:1] + [(self.other, label) for label in self.other.heads]
        return shown

    def _set_up_markers(self) -> None:
        material = self.material
        self._tracks: MarkerTracks | None = material.measured or material.recording
        self._is_layout = self._tracks is None and not material.heads
        layout = material.layout
        self.names: tuple[str, ...] = () if self._tracks is None else self._tracks.names
        self._fixed: FloatArray | None = None
        if self._is_layout and layout is not None:
            self.names = tuple(marker.name for marker in layout.markers)
            self._fixed = locate_expected(layout, self.names)
        rigid = set() if layout is None else {marker.name for marker in layout.head_markers}
        self._is_head = np.array([name in rigid for name in self.names], dtype=bool)
        speaker = material.speaker
        self.bound_names: tuple[str, ...] = ()
        if speaker is not None and material.heads:
            self.bound_names = tuple(n for n in speaker.binding.names if n in self.names)
            order = {name: k for k, name in enumerate(speaker.binding.names)}
            self._of_binding = np.array([order[name] for name in self.bound_names], dtype=int)
            self._of_names = np.array([self.names.index(n) for n in self.bound_names], dtype=int)
        self.region_colours: dict[str, tuple[int, int, int]] = {}
        self._regions = self._colour_regions() if self._is_layout else None

    @cached_property
    def _raw(self) -> MarkerTracks | None:
        """The recording with its motion, where its middle frame is where the face is."""
        measured, raw = self.material.measured, self.material.recording
        if measured is None or raw is None:
            return None
        names = [name for name in measured.names if name in raw.names]
        still = measured.positions[:, measured.indices(names)]
        moving = raw.positions[:, raw.indices(names)]
        if still.shape != moving.shape:
            return None
        seen = (np.isfinite(still) & np.isfinite(moving)).all(axis=2)
        # Of the frames with most markers, the one in the middle.
        frames = np.flatnonzero(seen.sum(axis=1) == seen.sum(axis=1).max(initial=0))
        if not len(frames):
            return None
        middle = frames[len(frames) // 2]
        try:
            scale, turn, shift = estimate_similarity_transform(moving[middle], still[middle])
        except DataError:
            return None
        selected = raw.select(names)
        return selected.replace(positions=scale * selected.positions @ turn.T + shift)

    def _colour_regions(self) -> FloatArray | None:
        """Return a colour for each vertex of a region that a marker is tied to."""
        from matplotlib import colormaps

        material = self.material
        if material.rig is None or material.layout is None:
            return None
        mesh = material.rig.mesh
        colours = np.full((len(mesh.vertices), 3), np.nan)
        names = list(dict.fromkeys(r for m in material.layout.markers for r in m.region))
        palette = colormaps["tab20"].colors  # type: ignore[attr-defined]
        for k, name in enumerate(names):
            if mesh.has_region(name):
                shade = 0.45 + 0.55 * np.array(palette[(2 * k + k // 10) % 20])
                colours[mesh.get_region(name)] = shade
                red, green, blue = (int(255 * c) for c in shade)
                self.region_colours[name] = red, green, blue
        return colours

    @property
    def has_frames(self) -> bool:
        """Whether markers move."""
        return self._tracks is not None

    @property
    def has_residuals(self) -> bool:
        """Whether markers are compared with those on the face."""
        return bool(self.bound_names)

    @property
    def compares(self) -> bool:
        """Whether there are two heads."""
        return len(self._heads) > 1

    @property
    def head_vertices(self) -> FloatArray | None:
        """Vertices of the first head as they are drawn, ``(vertices, 3)``, mm; None without."""
        return self._heads[0].vertices if self._heads else None

    @property
    def camera_position(self) -> FloatArray:
        """Position of the camera, ``(3,)``, millimetres."""
        return np.array(self._plotter.camera.position, dtype=np.float64)

    def list_feature_points(self) -> dict[str, FloatArray]:
        """List the feature points of the face that the camera sees, where a layout is shown.

        Returns
        -------
        dict of str to ndarray
            Positions by name, ``(3,)`` each, millimetres.
        """
        vertices, rig = self.head_vertices, self.material.rig
        if not self._is_layout or vertices is None or rig is None:
            return {}
        normals = rig.mesh.compute_normals(vertices)
        towards = self.camera_position - vertices
        facing = np.einsum("vi,vi->v", normals, towards) > 0.1 * np.linalg.norm(towards, axis=1)
        return {
            name: vertices[vertex]
            for name, vertex in rig.mesh.feature_points.items()
            if facing[vertex]
        }

    # ---- camera -----------------------------------------------------------------------------

    def set_view(self, view: StageView, zoom: float = 1.0) -> None:
        """Put the camera in front, at the side or above.

        Parameters
        ----------
        view
            ``front``, ``three-quarter``, ``side`` or ``top``.
        zoom
            Magnification, no unit: above 1 is closer.
        """
        camera, rig = self._plotter.camera, self.material.rig
        direction, up = (
            _DIRECTIONS[view],
            np.array([0.0, 0.0, -1.0] if view == "top" else [0, 1, 0]),
        )
        if rig is not None:
            framed = frame_face(rig.mesh, "front", zoom * self.zoom)
            target, distance = framed.target, np.linalg.norm(framed.position - framed.target)
        else:
            target = self._middle
            distance = 0.56 * self._extent / np.tan(np.radians(VIEW_ANGLE) / 2) / zoom
            direction, up = (each @ self._find_axes() for each in (direction, up))
        position = target + direction / np.linalg.norm(direction) * distance
        camera.focal_point, camera.position, camera.up = target, position, up
        camera.view_angle = VIEW_ANGLE
        self._limit_depth()

    def _get_right(self) -> FloatArray:
        """Return the direction to the right as the camera sees it, ``(3,)``."""
        camera = self._plotter.camera
        right = np.cross(camera.GetDirectionOfProjection(), camera.GetViewUp())
        return np.asarray(right / np.linalg.norm(right))

    def _get_light(self) -> FloatArray:
        """Return the direction to the light, above the camera at its right, ``(3,)``."""
        camera = self._plotter.camera
        back, up = -np.array(camera.GetDirectionOfProjection()), np.array(camera.GetViewUp())
        return np.asarray(0.4 * self._get_right() + 0.5 * up + 0.77 * back)

    def zoom_in(self, factor: float) -> None:
        """Move the camera.

        Parameters
        ----------
        factor
            Magnification, no unit: above 1 comes closer.
        """
        self._plotter.camera.Dolly(factor)
        self._limit_depth()

    def _limit_depth(self) -> None:
        """Let the camera see as far as anything may be: cheaper than to look where it is."""
        away = float(np.linalg.norm(self.camera_position - self._middle))
        near = max(away - 2 * self._extent, 0.02 * self._extent)
        self._plotter.camera.clipping_range = near, away + 2 * self._extent

    def _measure_middle(self) -> tuple[FloatArray, float]:
        """Return the middle of all, and its size."""
        if self.material.rig is not None:
            points = self.material.rig.mesh.vertices
        elif self._tracks is not None and self._tracks.visible.any():
            points = self._tracks.positions[self._tracks.visible]
            low, high = np.quantile(points, (0.02, 0.98), axis=0)
            return 0.5 * (low + high), 1.25 * float((high - low).max())
        else:
            points = np.array([[-100.0, -100.0, -100.0], [100.0, 100.0, 100.0]])
        low, high = points.min(axis=0), points.max(axis=0)
        return 0.5 * (low + high), float((high - low).max())

    def _find_axes(self) -> FloatArray:
        """Return axes where z points up and the face looks along the flattest one, ``(3, 3)``."""
        assert self._tracks is not None
        middle = compute_median(self._tracks.positions)
        middle = middle[np.isfinite(middle).all(axis=1)]
        flat = np.array([0.0, 1.0, 0.0])
        if len(middle) > 3:
            least = np.linalg.svd(middle - middle.mean(axis=0))[2][-1]
            level = np.array([least[0], least[1], 0.0])
            flat = level / np.linalg.norm(level) if np.linalg.norm(level) > 0.3 else flat
        vertical = np.array([0.0, 0.0, 1.0])
        return np.stack([np.cross(vertical, flat), vertical, flat])

    def project(self, points: FloatArray, size: tuple[int, int]) -> FloatArray:
        """Project points to the picture of the stage.

        Parameters
        ----------
        points
            Points, ``(points, 3)``, millimetres.
        size
            Width and height of the stage, pixels.

        Returns
        -------
        ndarray
            Distances from the left and from the top, ``(points, 2)``, pixels.
        """
        width, height = size
        matrix = self._plotter.camera.GetCompositeProjectionTransformMatrix(width / height, -1, 1)
        rows = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
        clip = points @ rows[:, :3].T + rows[:, 3]
        across = clip[:, :2] / clip[:, 3:]
        return np.asarray((np.array([1.0, -1.0]) * across + 1.0) / 2 * (width, height))

    # ---- frames -----------------------------------------------------------------------------

    def get_values(self, time: float, number: int = 0) -> FloatArray | None:
        """Return the parameters of a head, in the order of the rig.

        Parameters
        ----------
        time
            The time, seconds.
        number
            Which of the heads.

        Returns
        -------
        ndarray or None
            ``(parameters,)``; None without a face.
        """
        rig = self.material.rig
        if rig is None:
            return None
        values = np.zeros(len(rig.parameter_names))
        if number < len(self._shown):
            start, rate, frames = self._sampled[number]
            position = min(max((time - start) * rate, 0.0), len(frames) - 1.0)
            before = int(position)
            after = min(before + 1, len(frames) - 1)
            values = frames[before] + (position - before) * (frames[after] - frames[before])
        if number == 0:
            for name, value in self.overrides.items():
                values[rig.parameter_names.index(name)] = value
        return values

    def update(self, time: float) -> None:
        """Show a time.

        Parameters
        ----------
        time
            The time, seconds.
        """
        positions, forms, (turn, shift) = self._locate_markers(time)
        camera = self.camera_position
        # Two heads are side by side, from wherever one looks.
        aside = self._get_right() * (_ASIDE if len(self._heads) > 1 else 0.0)
        positions, motion = positions - aside, (turn, shift - aside)
        for number, head in enumerate(self._heads):
            values = self.get_values(time, number)
            assert values is not None
            shifted = turn, shift + (2 * number - 1) * aside
            other = self._heads[0].shape if number else None
            head.update(values, camera, shifted, self._regions, other)
        if self.bound_names and self._lines is not None and self._dots is not None:
            self._update_virtual(time, positions, forms, motion)
        self.positions = positions
        if self._shapes is not None:
            colours = np.array([MEASURED] * len(self.names), dtype=np.uint8)
            colours[self._is_head] = HEAD_MARKER
            colours[[form == "cube" for form in forms]] = FILLED
            colours[[form == "octahedron" for form in forms]] = DROPPED
            # A body has larger markers than a face.
            radius = RADIUS if self.material.rig is not None else max(RADIUS, self._extent / 130)
            radii = np.full(len(self.names), radius)
            if self.picked in self.names:
                index = self.names.index(self.picked)
                colours[index], radii[index] = PICKED, 1.7 * radius
            self._shapes.update(positions, radii, colours, forms, self._get_light())
        self._limit_depth()

    def _locate_markers(
        self, time: float
    ) -> tuple[FloatArray, list[str], tuple[FloatArray, FloatArray]]:
        """Return where markers are, their forms, and the motion of the head."""
        count = len(self.names)
        forms = ["ball"] * count
        motion = (np.eye(3), np.zeros(3))
        if self._fixed is not None:
            return self._fixed.copy(), forms, motion
        tracks = self._tracks
        if tracks is None or not tracks.frames:
            return np.full((count, 3), np.nan), forms, motion
        frame = round((time - tracks.start_time) * tracks.rate)
        if not 0 <= frame < tracks.frames:
            return np.full((count, 3), np.nan), forms, motion
        positions = tracks.positions[frame].copy()
        if self.with_motion and self._raw is not None and frame < self._raw.frames:
            moved = np.full_like(positions, np.nan)
            common = [self.names.index(name) for name in self._raw.names]
            moved[common] = self._raw.positions[frame]
            with contextlib.suppress(DataError):
                motion = estimate_rigid_transform(positions, moved)
            positions = moved
        origin = tracks.origin[frame]
        for index in np.flatnonzero(origin != Origin.MEASURED):
            forms[index] = "octahedron" if origin[index] == Origin.MISSING else "cube"
        return positions, forms, motion

    def _update_virtual(
        self,
        time: float,
        positions: FloatArray,
        forms: list[str],
        motion: tuple[FloatArray, FloatArray],
    ) -> None:
        """Show the markers on the face; one that is missing is shown where the face has it."""
        speaker = self.material.speaker
        values = self.get_values(time)
        assert speaker is not None
        assert values is not None
        assert self._lines is not None
        assert self._dots is not None
        virtual = speaker.binding.evaluate(values)[0][self._of_binding]
        virtual = virtual @ motion[0].T + motion[1]
        measured = positions[self._of_names]
        scale = speaker.binding.orientation.scale
        self.residuals = np.linalg.norm(measured - virtual, axis=1) / scale
        colours = colour_residuals(self.residuals)
        self._lines.update(virtual, virtual + self.stretch * (measured - virtual), colours)
        white = np.array([VIRTUAL] * len(virtual), dtype=np.uint8)
        balls = ["ball"] * len(virtual)
        self._dots.update(virtual, np.full(len(virtual), 0.8), white, balls, self._get_light())
        missing = np.isnan(measured).any(axis=1)
        positions[self._of_names[missing]] = virtual[missing]
        if self.stretch != 1.0:
            seen = ~missing
            stretched = virtual + self.stretch * (measured - virtual)
            positions[self._of_names[seen]] = stretched[seen]

    def pick(self, x: float, y: float, size: tuple[int, int]) -> str | None:
        """Return the marker near a point of the stage's picture.

        Parameters
        ----------
        x, y
            Distances in pixels from the left and from the top.
        size
            Width and height of the stage, pixels.

        Returns
        -------
        str or None
            Its name.
        """
        if not len(self.names):
            return None
        apart = np.linalg.norm(self.project(self.positions, size) - (x, y), axis=1)
        apart = np.where(np.isnan(apart), np.inf, apart)
        nearest = int(apart.argmin())
        return self.names[nearest] if apart[nearest] < 12 else None
