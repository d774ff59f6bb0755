"""The bodies in space: a face that moves, small solids at markers, lines between points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.face import Rig
from mocap_fit.face.contact import resolve_contact
from mocap_fit.render.lighting import Lighting
from mocap_fit.render.scene import Surface, list_outside_triangles
from mocap_fit.tracks import FloatArray

MEASURED = (36, 112, 204)
HEAD_MARKER = (92, 104, 122)
FILLED = (222, 130, 20)
DROPPED = (205, 44, 40)
VIRTUAL = (250, 250, 250)
PICKED = (255, 214, 0)
# Millimetres: a residual of this is drawn red.
_BAD = 2.0
RADIUS = 1.7
"""Of a marker, millimetres."""

MOST_DIFFERENT = 4.0
"""Millimetres: a difference of this is drawn red."""
# Millimetres: no difference.
_SAME = 0.3


def colour_residuals(residuals: FloatArray) -> NDArray[np.uint8]:
    """Colour residuals: green is none, yellow 1 mm, red 2 mm and more.

    Parameters
    ----------
    residuals
        Distances, ``(markers,)``, millimetres.

    Returns
    -------
    ndarray
        Red, green and blue, ``(markers, 3)``.
    """
    part = np.clip(np.nan_to_num(residuals) / _BAD, 0.0, 1.0)
    stops = np.array([0.0, 0.5, 1.0])
    colours = np.array([(40, 165, 80), (235, 190, 30), (215, 35, 35)], dtype=np.float64)
    return np.stack([np.interp(part, stops, c) for c in colours.T], axis=1).astype(np.uint8)


class Shapes:
    """Small solids at points: balls, cubes and octahedra of one topology.

    Parameters
    ----------
    plotter
        A plotter of pyvista.
    count
        Number of points.
    """

    def __init__(self, plotter: Any, count: int) -> None:
        import pyvista

        ball: Any = pyvista.Sphere(radius=1.0, theta_resolution=12, phi_resolution=10)
        points = np.asarray(ball.points, dtype=np.float64)
        self._forms = {
            "ball": points,
            "cube": 0.85 * points / np.abs(points).max(axis=1, keepdims=True),
            "octahedron": 1.5 * points / np.abs(points).sum(axis=1, keepdims=True),
        }
        self._normals = points
        triangles = np.asarray(ball.regular_faces, dtype=np.int64)
        every = (triangles + len(points) * np.arange(count)[:, None, None]).reshape(-1, 3)
        self._surface = Surface(plotter, np.zeros((count * len(points), 3)), every)

    def update(
        self,
        positions: FloatArray,
        radii: FloatArray,
        colours: NDArray[np.uint8],
        forms: Sequence[str],
        light: FloatArray,
    ) -> None:
        """Move and colour them; one at NaN is not visible.

        Parameters
        ----------
        positions
            Points, ``(points, 3)``, millimetres.
        radii
            Their sizes, ``(points,)``, millimetres.
        colours
            Red, green and blue, ``(points, 3)``.
        forms
            ``ball``, ``cube`` or ``octahedron``, one for each.
        light
            Direction to the light, ``(3,)``, no unit.
        """
        there = np.asarray(np.isfinite(positions).all(axis=1))
        middle = positions[there].mean(axis=0) if there.any() else np.zeros(3)
        centres = np.where(there[:, None], positions, middle)
        sizes = np.where(there, radii, 0.0)
        shape = np.stack([self._forms[form] for form in forms])
        vertices = centres[:, None] + sizes[:, None, None] * shape
        shade = 0.62 + 0.38 * (self._normals @ light)
        shaded = shade[None, :, None] * colours[:, None, :]
        self._surface.update(
            vertices.reshape(-1, 3), np.clip(shaded, 0, 255).astype(np.uint8).reshape(-1, 3)
        )


class Lines:
    """Lines between pairs of points, each of one colour.

    Parameters
    ----------
    plotter
        A plotter of pyvista.
    count
        Number of lines.
    """

    def __init__(self, plotter: Any, count: int) -> None:
        import pyvista

        pairs = np.column_stack([np.full(count, 2), np.arange(2 * count).reshape(-1, 2)])
        self._data: Any = pyvista.PolyData(np.zeros((2 * count, 3), np.float32), lines=pairs)
        self._data.point_data["colours"] = np.zeros((2 * count, 3), dtype=np.uint8)
        self.actor = plotter.add_mesh(
            self._data,
            scalars="colours",
            rgb=True,
            lighting=False,
            line_width=3,
            copy_mesh=False,
            reset_camera=False,
            show_scalar_bar=False,
        )

    def update(self, starts: FloatArray, ends: FloatArray, colours: NDArray[np.uint8]) -> None:
        """Move and colour them; one with an end at NaN is not visible.

        Parameters
        ----------
        starts, ends
            Points, ``(lines, 3)``, millimetres.
        colours
            Red, green and blue, ``(lines, 3)``.
        """
        there = np.asarray(np.isfinite(starts + ends).all(axis=1))
        middle = starts[there].mean(axis=0) if there.any() else np.zeros(3)
        points = np.stack([starts, ends], axis=1)
        points[~there] = middle
        self._data.points[:] = points.reshape(-1, 3)
        self._data.point_data["colours"][:] = np.repeat(colours, 2, axis=0)
        self._data.GetPoints().Modified()
        self._data.GetPointData().GetScalars().Modified()


class Head:
    """A face that moves.

    Parameters
    ----------
    plotter
        A plotter of pyvista.
    rig
        The face.
    """

    def __init__(self, plotter: Any, rig: Rig) -> None:
        self._rig = rig
        self._lighting = Lighting(rig.mesh)
        triangles, _ = list_outside_triangles(rig.mesh)
        self._surface = Surface(plotter, rig.mesh.vertices, triangles)
        self.shape = self.vertices = rig.mesh.vertices

    def update(
        self,
        values: FloatArray,
        camera: FloatArray,
        motion: tuple[FloatArray, FloatArray],
        colours: FloatArray | None = None,
        other: FloatArray | None = None,
    ) -> None:
        """Move it.

        Parameters
        ----------
        values
            Parameters in the order of the rig, ``(parameters,)``.
        camera
            Position of the camera, ``(3,)``, millimetres.
        motion
            Rotation ``(3, 3)`` and translation ``(3,)`` of the head, millimetres.
        colours
            What the light falls on in place of its colours, ``(vertices, 3)``, 0 to 1; NaN keeps
            them.
        other
            Vertices of a head that it is compared with, ``(vertices, 3)``, millimetres: it is
            coloured where it is elsewhere.
        """
        self.shape = resolve_contact(self._rig.deform(values), self._rig.mesh)
        light = self._lighting.compute_colours(self.shape, camera)
        if other is not None:
            colours = colour_difference(np.linalg.norm(self.shape - other, axis=1))
        if colours is not None:
            grey = light.mean(axis=1, keepdims=True) / 215.0
            light = np.where(np.isnan(colours), light, np.clip(255 * colours * grey, 0, 255))
            light = light.astype(np.uint8)
        self.vertices = self.shape @ motion[0].T + motion[1]
        self._surface.update(self.vertices, light)


def colour_difference(distances: FloatArray) -> FloatArray:
    """Colour a head where it differs from another one: yellow a little, red 4 mm and more.

    Parameters
    ----------
    distances
        Distances of the vertices, ``(vertices,)``, millimetres.

    Returns
    -------
    ndarray
        Red, green and blue, ``(vertices, 3)``, 0 to 1; NaN where there is no difference.
    """
    part = np.clip(distances / MOST_DIFFERENT, 0.0, 1.0)[:, None]
    colours = (1 - part) * np.array([1.0, 0.88, 0.45]) + part * np.array([0.92, 0.12, 0.08])
    return np.where(distances[:, None] < _SAME, np.nan, colours)
