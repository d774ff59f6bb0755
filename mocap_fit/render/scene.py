"""Pictures of a face, made off screen."""

from __future__ import annotations

import ctypes
import os
import sys
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError, MissingExtraError
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.render.lighting import Lighting
from mocap_fit.tracks import FloatArray

Image = NDArray[np.uint8]
View = Literal["front", "three-quarter", "side"]
Colour = tuple[float, float, float]

# Direction from the face to the camera.
_DIRECTIONS: dict[str, tuple[float, float, float]] = {
    "front": (0.0, 0.02, 1.0),
    "three-quarter": (0.68, 0.04, 0.8),
    "side": (1.0, 0.02, 0.05),
}
_VIEW_ANGLE = 18.0
_BACKGROUND: Colour = (0.90, 0.92, 0.945)
_MARKER_COLOUR: Colour = (0.10, 0.45, 0.85)
_MARKER_LIGHT = np.array([0.4, 0.5, 0.77])
# Pictures are drawn this many times larger and made smaller again, for smooth edges; what VTK has
# for it is four times as slow without a graphics card, or missing.
_FINER = 2
_LARGEST = 8192


def prepare_off_screen() -> None:
    """Let VTK draw without a display, where there is none.

    It takes effect only before VTK is first imported; a choice that the user has made stays.
    """
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def require_off_screen() -> None:
    """Let VTK draw without a display, or say why it cannot.

    On Linux VTK then draws through EGL, and takes the whole process down where that library is
    missing: it is looked for here first. Another way that the user has chosen is not questioned.

    Raises
    ------
    MissingExtraError
        If there is neither a display nor EGL.
    """
    prepare_off_screen()
    chosen = os.environ.get("VTK_DEFAULT_OPENGL_WINDOW")
    if sys.platform != "linux" or os.environ.get("DISPLAY") or chosen != "vtkEGLRenderWindow":
        return
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        raise MissingExtraError(
            "pictures of the face cannot be drawn without a screen here",
            found="neither a display nor the library libEGL.so.1",
            advice="Debian, Ubuntu: sudo apt-get install libegl1 libgl1-mesa-dri. "
            "Fedora: sudo dnf install mesa-libEGL mesa-dri-drivers.",
        ) from None


class FaceScene:
    """A face set up once for drawing, then drawn in any shape.

    Use it in a ``with`` block, or call `close`, so that the window's memory is freed.

    Parameters
    ----------
    mesh
        The face.
    view
        Where the camera stands: ``front``, ``three-quarter`` or ``side`` (the speaker's left).
    size
        Width and height of the picture in pixels.
    zoom
        1 shows the whole mesh; above 1 is closer.
    centre
        `(3,)`, mm: what the camera looks at; the middle of the mesh where None.
    marker_radius
        Radius of the balls that markers are drawn as (mm).
    smooth_edges
        False draws in half the time or less, with jagged outlines.

    Raises
    ------
    DataError
        If the view, the size or the zoom is not possible.
    MissingExtraError
        If this machine cannot draw; see `require_off_screen`.
    """

    def __init__(
        self,
        mesh: Mesh,
        *,
        view: View = "front",
        size: tuple[int, int] = (640, 640),
        zoom: float = 1.0,
        centre: ArrayLike | None = None,
        marker_radius: float = 1.6,
        smooth_edges: bool = True,
    ) -> None:
        _check(view, size, zoom)
        require_off_screen()
        import pyvista
        from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

        self.mesh = mesh
        self._size = (int(size[0]), int(size[1]))
        self._finer = _FINER if smooth_edges and _FINER * max(size) <= _LARGEST else 1
        drawn = [self._finer * pixels for pixels in self._size]
        plotter: Any = pyvista.Plotter(off_screen=True, window_size=drawn, lighting="none")
        plotter.set_background(_BACKGROUND)
        plotter.render_window.SetMultiSamples(0)
        self._plotter = plotter
        self._lighting = Lighting(mesh)
        self._face = _Surface(plotter, mesh.vertices, _seen_from_outside(mesh))
        self._balls = _Balls(plotter, marker_radius)
        _place_camera(plotter, mesh, view, zoom, centre)
        # `show` sets the window up; it must come before the first picture, and only once.
        plotter.show(auto_close=False)
        self._pixels = vtkUnsignedCharArray()

    def image(
        self, vertices: ArrayLike | None = None, *, markers: ArrayLike | None = None
    ) -> Image:
        """Draw the face in one shape.

        Parameters
        ----------
        vertices
            `(vertices, 3)`, mm; the mesh at rest where None.
        markers
            `(markers, 3)`, mm, drawn as balls; a missing marker (NaN) is not drawn.

        Returns
        -------
        ndarray
            `(height, width, 3)`, uint8: red, green and blue.

        Raises
        ------
        DataError
            If the vertices are not those of this mesh, or not finite, or markers are not points.
        """
        shape = self._checked(vertices)
        self._face.update(shape, self._lighting.colours(shape, self.camera_position))
        self._balls.update(_checked_markers(markers))
        self._plotter.renderer.ResetCameraClippingRange()
        # Without this, what is read is the picture before.
        self._plotter.render_window.Render()
        pixels = self._read()
        if self._finer == 2:
            pixels = _half_as_large(pixels)
        picture = np.ascontiguousarray(pixels).view(np.uint8)
        return np.ascontiguousarray(picture.reshape(*pixels.shape, 4)[..., :3])

    @property
    def camera_position(self) -> FloatArray:
        """Where the camera stands, `(3,)`, mm."""
        return np.array(self._plotter.camera.position, dtype=np.float64)

    def project(self, points: ArrayLike) -> FloatArray:
        """Where points of the face are in the picture.

        Parameters
        ----------
        points
            `(points, 3)`, mm.

        Returns
        -------
        ndarray
            `(points, 2)`: pixels from the left and from the top; NaN for missing points.
        """
        places = np.asarray(points, dtype=np.float64)
        width, height = self._size
        matrix = self._plotter.camera.GetCompositeProjectionTransformMatrix(width / height, -1, 1)
        rows = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
        clip = places @ rows[:, :3].T + rows[:, 3]
        across = clip[:, :2] / clip[:, 3:]
        return np.asarray((np.array([1.0, -1.0]) * across + 1.0) / 2 * (width, height))

    def close(self) -> None:
        """Free the window's memory."""
        self._plotter.close()

    def __enter__(self) -> FaceScene:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _checked(self, vertices: ArrayLike | None) -> FloatArray:
        if vertices is None:
            return self.mesh.vertices
        shape = np.asarray(vertices, dtype=np.float64)
        if shape.shape != self.mesh.vertices.shape:
            raise DataError(
                "these are not the vertices of the face that is drawn",
                found=shape.shape,
                expected=self.mesh.vertices.shape,
            )
        if not np.isfinite(shape).all():
            raise DataError(
                "a vertex of the face to draw is not a finite number",
                found=f"vertex {int((~np.isfinite(shape)).any(axis=1).argmax())}",
            )
        return shape

    def _read(self) -> NDArray[np.uint32]:
        """The window as it is now, from its top: red, green, blue and alpha in one number."""
        from vtkmodules.util import numpy_support

        to_numpy: Any = numpy_support.vtk_to_numpy
        width, height = (self._finer * pixels for pixels in self._size)
        self._plotter.render_window.GetRGBACharPixelData(
            0, 0, width - 1, height - 1, 0, self._pixels
        )
        pixels = np.asarray(to_numpy(self._pixels)).view(np.uint32)
        return pixels.reshape(height, width)[::-1]


class _Surface:
    """Triangles with a colour at each vertex, drawn as they are, without VTK's lights."""

    def __init__(self, plotter: Any, vertices: FloatArray, triangles: IndexArray) -> None:
        import pyvista

        points: Any = vertices.astype(np.float32)
        surface: Any = pyvista.PolyData.from_regular_faces(points, triangles.astype(int))
        surface.point_data["colours"] = np.zeros((len(vertices), 3), dtype=np.uint8)
        self._surface = surface
        self._points = surface.GetPoints()
        self.actor = plotter.add_mesh(
            surface,
            scalars="colours",
            rgb=True,
            lighting=False,
            copy_mesh=False,
            reset_camera=False,
            show_scalar_bar=False,
            culling="back",
        )

    def update(self, vertices: FloatArray, colours: NDArray[np.uint8]) -> None:
        """Move the vertices and paint them, in place."""
        self._surface.points[:] = vertices
        self._surface.point_data["colours"][:] = colours
        self._points.Modified()
        self._surface.GetPointData().GetScalars().Modified()


class _Balls:
    """Balls at markers, shaded once and then only moved."""

    def __init__(self, plotter: Any, radius: float) -> None:
        self._plotter, self._radius = plotter, radius
        self._surface: _Surface | None = None
        self._count = 0

    def update(self, places: FloatArray) -> None:
        """Put a ball at each place, `(markers, 3)`; one that is NaN is not seen."""
        import pyvista

        ball: Any = pyvista.Sphere(radius=1.0, theta_resolution=14, phi_resolution=14)
        shape = np.asarray(ball.points, dtype=np.float64)
        if len(places) != self._count:
            self._count = len(places)
            if self._surface is not None:
                self._plotter.remove_actor(self._surface.actor, render=False)
                self._surface = None
        if not len(places):
            return
        if self._surface is None:
            triangles = np.asarray(ball.regular_faces, dtype=np.int64)
            steps = len(shape) * np.arange(len(places))[:, None, None]
            every = (triangles + steps).reshape(-1, 3)
            self._surface = _Surface(self._plotter, np.tile(shape, (len(places), 1)), every)
        seen = np.asarray(np.isfinite(places).all(axis=1))
        # A ball of no size is not drawn; it lies where the camera's range is not stretched by it.
        centres = np.where(
            seen[:, None], places, np.nan_to_num(places[seen].mean(axis=0)) if seen.any() else 0.0
        )
        radii = np.where(seen, self._radius, 0.0)
        vertices = centres[:, None] + radii[:, None, None] * shape
        light = 0.62 + 0.38 * (shape @ _MARKER_LIGHT)
        colours = np.rint(255 * np.clip(np.outer(light, _MARKER_COLOUR), 0, 1)).astype(np.uint8)
        self._surface.update(vertices.reshape(-1, 3), np.tile(colours, (len(places), 1)))


def render_face(
    mesh: Mesh,
    vertices: ArrayLike | None = None,
    *,
    view: View = "front",
    size: tuple[int, int] = (640, 640),
    zoom: float = 1.0,
    centre: ArrayLike | None = None,
    markers: ArrayLike | None = None,
) -> Image:
    """Draw a face once; for many pictures of one face, use `FaceScene`.

    Parameters are those of `FaceScene` and `FaceScene.image`, and so is the result.
    """
    with FaceScene(mesh, view=view, size=size, zoom=zoom, centre=centre) as scene:
        return scene.image(vertices, markers=markers)


def vertex_normals(vertices: FloatArray, triangles: IndexArray) -> FloatArray:
    """Unit normals of vertices, `(vertices, 3)`: the area-weighted mean of the triangles around."""
    corners = vertices[triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.stack(
        [
            np.bincount(triangles.ravel(), np.repeat(across[:, axis], 3), len(vertices))
            for axis in range(3)
        ],
        axis=1,
    )
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(length > 0, length, 1.0))


def _check(view: str, size: tuple[int, int], zoom: float) -> None:
    if view not in _DIRECTIONS:
        raise DataError(f"there is no view '{view}'", expected=f"one of {', '.join(_DIRECTIONS)}")
    if len(size) != 2 or min(size) < 16 or max(size) > 8192:
        raise DataError(
            "a picture of this size cannot be made",
            found=size,
            expected="width and height from 16 to 8192 pixels",
        )
    if not np.isfinite(zoom) or zoom <= 0:
        raise DataError("the zoom must be above 0", found=zoom)


def _checked_markers(markers: ArrayLike | None) -> FloatArray:
    if markers is None:
        return np.zeros((0, 3))
    places = np.asarray(markers, dtype=np.float64)
    if places.ndim != 2 or places.shape[1] != 3:
        raise DataError(
            "markers to draw have the wrong shape", found=places.shape, expected="(markers, 3)"
        )
    return places


def _half_as_large(pixels: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Each pixel the mean of four, all channels of a pixel at once."""
    upper, lower = pixels[::2], pixels[1::2]
    # The mean of two bytes is what they share and half of what they do not; once rounded down,
    # once up.
    rows = (upper & lower) + (((upper ^ lower) & 0xFEFEFEFE) >> 1)
    left, right = rows[:, ::2], rows[:, 1::2]
    return np.asarray((left | right) - (((left ^ right) & 0xFEFEFEFE) >> 1))


def _seen_from_outside(mesh: Mesh) -> IndexArray:
    """The triangles, and those of open sheets once more with the other side in front.

    What turns away from the camera is not drawn, which saves a third of the time. That is right
    for what is closed, or nearly, with its outside outside.
    """
    triangles = [mesh.triangles]
    for part in mesh.parts:
        own = mesh.triangles[part.triangles.start : part.triangles.stop]
        if not _closed_and_outside_out(mesh.vertices, own):
            triangles.append(own[:, ::-1])
    return np.concatenate(triangles)


def _closed_and_outside_out(vertices: FloatArray, triangles: IndexArray) -> bool:
    first = triangles.ravel()
    second = np.roll(triangles, -1, axis=1).ravel()
    there, back = first * len(vertices) + second, second * len(vertices) + first
    a, b, c = (vertices[triangles[:, corner]] - vertices[first].mean(axis=0) for corner in range(3))
    volume = float(np.einsum("ij,ij->", np.cross(a, b), c))
    return bool(np.isin(there, back).mean() > 0.97 and volume > 0)


def _place_camera(
    plotter: Any, mesh: Mesh, view: str, zoom: float, centre: ArrayLike | None
) -> None:
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    looked_at = 0.5 * (low + high) if centre is None else np.asarray(centre, dtype=np.float64)
    direction = np.array(_DIRECTIONS[view])
    distance = 0.56 * (high[1] - low[1]) / np.tan(np.radians(_VIEW_ANGLE) / 2) / zoom
    camera = plotter.camera
    camera.focal_point = looked_at
    camera.position = looked_at + direction / np.linalg.norm(direction) * distance
    camera.up = (0.0, 1.0, 0.0)
    camera.view_angle = _VIEW_ANGLE
