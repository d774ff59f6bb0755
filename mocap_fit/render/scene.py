"""Draw pictures of a face off screen."""

from __future__ import annotations

import ctypes
import os
import sys
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError, MissingExtraError
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.render.framing import DIRECTIONS, VIEW_ANGLE, View, frame_face
from mocap_fit.render.lighting import Lighting
from mocap_fit.render.pictures import Image
from mocap_fit.tracks import FloatArray

Colour = tuple[float, float, float]

_BACKGROUND: Colour = (0.90, 0.92, 0.945)
_MARKER_COLOUR: Colour = (0.10, 0.45, 0.85)
_MARKER_LIGHT = np.array([0.4, 0.5, 0.77])
# Pictures are drawn this many times larger and made smaller again, for smooth edges; what VTK has
# for it is four times as slow without a graphics card, or missing.
_FINER = 2
_LARGEST = 8192
_ROWS_A_STEP = 32
# Millimetres by which a head can move towards the camera or away from it.
_MARGIN = 200.0
_SHADER = """//VTK::System::Dec
//VTK::Output::Dec
in vec4 vertexColorVSOutput;
void main() { gl_FragData[0] = vec4(vertexColorVSOutput.rgb, 1.0); }
"""
# Millimetres below the chin: with less, a mesh has no neck that could fade into the background.
_NECK = 40.0
# Parts of which nobody sees the other side.
_BACKED_PARTS = ("brow", "eye", "hair", "shirt")


def prepare_off_screen() -> None:
    """Let VTK draw without a display, where there is none.

    It takes effect only before VTK is first imported; a choice of the user is not changed.
    """
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def require_off_screen() -> None:
    """Let VTK draw without a display, or raise an error that says why it cannot.

    On Linux VTK then draws through EGL, and ends the process where that library is missing: it is
    searched here first. Another choice of the user is not checked.

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
    """A face that is set up once and then drawn in any shape.

    Use it in a ``with`` block, or call `close`, so that the window's memory is freed.

    Parameters
    ----------
    mesh
        The face.
    view
        Position of the camera: ``front``, ``three-quarter`` or ``side`` (the speaker's left).
    size
        Width and height of the picture, pixels.
    zoom
        Magnification, no unit: 1 shows the head; above 1 comes closer to the mouth.
    centre
        The point in the middle of the picture instead, ``(3,)``, millimetres.
    marker_radius
        Radius of the balls that markers are drawn as, millimetres.
    smooth_edges
        False draws in half the time or less, with jagged outlines.

    Raises
    ------
    DataError
        If the view is unknown, or the size or the zoom is out of range.
    MissingExtraError
        If this machine has neither a display nor EGL.
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
        _check_view(view, size, zoom)
        require_off_screen()
        import pyvista
        from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

        self.mesh = mesh
        self._size = (int(size[0]), int(size[1]))
        self._finer = _FINER if smooth_edges and _FINER * max(size) <= _LARGEST else 1
        drawn_size = [self._finer * pixels for pixels in self._size]
        # A notebook must not show it.
        plotter: Any = pyvista.Plotter(
            off_screen=True, window_size=drawn_size, lighting="none", notebook=False
        )
        plotter.set_background(_BACKGROUND)
        plotter.render_window.SetMultiSamples(0)
        # Nobody looks at the window itself.
        plotter.render_window.SetFrameBlitModeToNoBlit()
        self._plotter = plotter
        self._lighting = Lighting(mesh)
        self._fading = find_fading(mesh)
        self._face = Surface(plotter, mesh.vertices, list_outside_triangles(mesh)[0])
        self._balls = _Balls(plotter, marker_radius)
        camera = frame_face(mesh, view, zoom, centre)
        plotter.camera.focal_point, plotter.camera.position = camera.target, camera.position
        plotter.camera.up, plotter.camera.view_angle = (0.0, 1.0, 0.0), VIEW_ANGLE
        # `show` sets the window up; it must come before the first picture, and only once.
        plotter.show(auto_close=False)
        # All that can move stays between these planes: they need not be found for every picture.
        plotter.renderer.GetCullers().RemoveAllItems()
        distance = float(np.linalg.norm(camera.position - camera.target))
        reach = float(np.linalg.norm(mesh.vertices - camera.target, axis=1).max()) + _MARGIN
        plotter.camera.clipping_range = (max(distance - reach, 0.02 * distance), distance + reach)
        self._pixels = vtkUnsignedCharArray()

    def draw(self, vertices: ArrayLike | None = None, *, markers: ArrayLike | None = None) -> Image:
        """Draw the face in one shape.

        Parameters
        ----------
        vertices
            The shape, ``(vertices, 3)``, millimetres; the mesh at rest if None.
        markers
            Markers to draw as balls, ``(markers, 3)``, millimetres; one that is missing (NaN) is
            not drawn.

        Returns
        -------
        ndarray
            Red, green and blue, ``(height, width, 3)``, 0 to 255.

        Raises
        ------
        DataError
            If the vertices are not those of this mesh, or not finite, or markers are not points.
        """
        shape = self._check_vertices(vertices)
        colours = self._lighting.compute_colours(shape, self.camera_position)
        rows, share = self._fading
        colours[rows] = (1 - share) * colours[rows] + share * 255 * np.array(_BACKGROUND)
        self._face.update(shape, colours)
        self._balls.update(_check_markers(markers))
        # Without this, the previous picture is read.
        self._plotter.render_window.Render()
        pixels = self._read_window()
        if self._finer == 2:
            pixels = _reduce_by_half(pixels)
        with_alpha = np.ascontiguousarray(pixels).view(np.uint8).reshape(*pixels.shape, 4)
        picture = np.empty((*pixels.shape, 3), dtype=np.uint8)
        for channel in range(3):  # five times as fast as all at once
            picture[..., channel] = with_alpha[..., channel]
        return picture

    @property
    def camera_position(self) -> FloatArray:
        """Position of the camera, ``(3,)``, millimetres."""
        return np.array(self._plotter.camera.position, dtype=np.float64)

    def project(self, points: ArrayLike) -> FloatArray:
        """Project points of the face to the picture.

        Parameters
        ----------
        points
            Points, ``(points, 3)``, millimetres.

        Returns
        -------
        ndarray
            Distances from the left and from the top, ``(points, 2)``, pixels; NaN for missing
            points.
        """
        positions = np.asarray(points, dtype=np.float64)
        width, height = self._size
        matrix = self._plotter.camera.GetCompositeProjectionTransformMatrix(width / height, -1, 1)
        rows = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
        clip = positions @ rows[:, :3].T + rows[:, 3]
        across = clip[:, :2] / clip[:, 3:]
        return np.asarray((np.array([1.0, -1.0]) * across + 1.0) / 2 * (width, height))

    def close(self) -> None:
        """Free the window's memory."""
        self._plotter.close()

    def __enter__(self) -> FaceScene:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _check_vertices(self, vertices: ArrayLike | None) -> FloatArray:
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

    def _read_window(self) -> NDArray[np.uint32]:
        """Return the window, from its top: red, green, blue and alpha in one number."""
        from vtkmodules.util import numpy_support

        to_numpy: Any = numpy_support.vtk_to_numpy
        width, height = (self._finer * pixels for pixels in self._size)
        self._plotter.render_window.GetRGBACharPixelData(
            0, 0, width - 1, height - 1, 0, self._pixels
        )
        pixels = np.asarray(to_numpy(self._pixels)).view(np.uint32)
        return pixels.reshape(height, width)[::-1]


class Surface:
    """Triangles with a colour at each vertex, drawn as they are, without VTK's lights.

    Parameters
    ----------
    plotter
        A plotter of pyvista.
    vertices
        Positions, ``(vertices, 3)``, millimetres.
    triangles
        Vertex indices, ``(triangles, 3)``, no unit, counter-clockwise seen from outside.
    """

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
        # Colours as they are: half the work of VTK's own shader, which may discard what it drew.
        self.actor.GetShaderProperty().SetFragmentShaderCode(_SHADER)

    def update(self, vertices: FloatArray, colours: NDArray[np.uint8]) -> None:
        """Move the vertices and colour them, in place.

        Parameters
        ----------
        vertices
            Positions, ``(vertices, 3)``, millimetres.
        colours
            Red, green and blue, ``(vertices, 3)``, 0 to 255.
        """
        self._surface.points[:] = vertices
        self._surface.point_data["colours"][:] = colours
        self._points.Modified()
        self._surface.GetPointData().GetScalars().Modified()


class _Balls:
    """Balls at markers, shaded once and then only moved."""

    def __init__(self, plotter: Any, radius: float) -> None:
        self._plotter, self._radius = plotter, radius
        self._surface: Surface | None = None
        self._count = 0

    def update(self, positions: FloatArray) -> None:
        """Put a ball at each position, ``(markers, 3)``; one that is NaN is not visible."""
        if len(positions) != self._count:
            self._count = len(positions)
            if self._surface is not None:
                self._plotter.remove_actor(self._surface.actor, render=False)
                self._surface = None
        if not len(positions):
            return
        import pyvista

        ball: Any = pyvista.Sphere(radius=1.0, theta_resolution=14, phi_resolution=14)
        shape = np.asarray(ball.points, dtype=np.float64)
        if self._surface is None:
            triangles = np.asarray(ball.regular_faces, dtype=np.int64)
            steps = len(shape) * np.arange(len(positions))[:, None, None]
            every = (triangles + steps).reshape(-1, 3)
            self._surface = Surface(self._plotter, np.tile(shape, (len(positions), 1)), every)
        visible = np.asarray(np.isfinite(positions).all(axis=1))
        # A ball of no size is not drawn; it is put where it does not extend the camera's range.
        middle = positions[visible].mean(axis=0) if visible.any() else 0.0
        centres = np.where(visible[:, None], positions, middle)
        radii = np.where(visible, self._radius, 0.0)
        vertices = centres[:, None] + radii[:, None, None] * shape
        light = 0.62 + 0.38 * (shape @ _MARKER_LIGHT)
        colours = np.rint(255 * np.clip(np.outer(light, _MARKER_COLOUR), 0, 1)).astype(np.uint8)
        self._surface.update(vertices.reshape(-1, 3), np.tile(colours, (len(positions), 1)))


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

    Parameters
    ----------
    mesh
        The face.
    vertices
        The shape, ``(vertices, 3)``, millimetres; the mesh at rest if None.
    view
        Position of the camera: ``front``, ``three-quarter`` or ``side`` (the speaker's left).
    size
        Width and height of the picture, pixels.
    zoom
        Magnification, no unit: 1 shows the head; above 1 comes closer to the mouth.
    centre
        The point in the middle of the picture instead, ``(3,)``, millimetres.
    markers
        Markers to draw as balls, ``(markers, 3)``, millimetres; one that is missing (NaN) is not
        drawn.

    Returns
    -------
    ndarray
        Red, green and blue, ``(height, width, 3)``, 0 to 255.

    Raises
    ------
    DataError
        If the view is unknown, or size, zoom, vertices or markers are out of range.
    MissingExtraError
        If this machine has neither a display nor EGL.
    """
    with FaceScene(mesh, view=view, size=size, zoom=zoom, centre=centre) as scene:
        return scene.draw(vertices, markers=markers)


def _check_view(view: str, size: tuple[int, int], zoom: float) -> None:
    if view not in DIRECTIONS:
        raise DataError(f"there is no view '{view}'", expected=f"one of {', '.join(DIRECTIONS)}")
    if len(size) != 2 or min(size) < 16 or max(size) > 8192:
        raise DataError(
            "a picture of this size cannot be drawn",
            found=size,
            expected="width and height from 16 to 8192 pixels",
        )
    if not np.isfinite(zoom) or zoom <= 0:
        raise DataError("the zoom must be above 0", found=zoom)


def _check_markers(markers: ArrayLike | None) -> FloatArray:
    if markers is None:
        return np.zeros((0, 3))
    positions = np.asarray(markers, dtype=np.float64)
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise DataError(
            "markers to draw have the wrong shape", found=positions.shape, expected="(markers, 3)"
        )
    return positions


def _reduce_by_half(pixels: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Return half the rows and columns: the mean of four pixels, all channels at once."""
    smaller = np.empty((len(pixels) // 2, pixels.shape[1] // 2), dtype=np.uint32)
    # Some rows at a time, which stay in the processor's cache.
    for start in range(0, len(smaller), _ROWS_A_STEP):
        part = pixels[2 * start : 2 * (start + _ROWS_A_STEP)]
        upper, lower = part[::2], part[1::2]
        # The mean of two bytes is the bits in both and half of those in one; once rounded down,
        # once up.
        rows = (upper & lower) + (((upper ^ lower) & 0xFEFEFEFE) >> 1)
        left, right = rows[:, ::2], rows[:, 1::2]
        mean = (left | right) - (((left ^ right) & 0xFEFEFEFE) >> 1)
        smaller[start : start + _ROWS_A_STEP] = mean
    return smaller


def find_fading(mesh: Mesh) -> tuple[IndexArray, FloatArray]:
    """Find the lower edge of neck or shoulders, which fades into the background.

    Parameters
    ----------
    mesh
        The face.

    Returns
    -------
    rows
        Vertex indices, ``(members,)``.
    share
        How much of them has faded, ``(members, 1)``, 0 to 1.
    """
    if "2.1" not in mesh.feature_points:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 1))
    height = mesh.vertices[:, 1]
    chin, low = float(height[mesh.get_feature_point("2.1")]), float(height.min())
    share = np.clip((low + 0.3 * (chin - low) - height) / (0.25 * (chin - low) + 1e-9), 0.0, 1.0)
    rows = np.flatnonzero((share > 0) & (chin - low > _NECK))
    return rows, share[rows, None]


def list_outside_triangles(mesh: Mesh) -> tuple[IndexArray, int]:
    """List the triangles that can be seen, those of open sheets once more for their other side.

    Triangles that face away from the camera are not drawn, which saves a third of the time. That
    is right for closed surfaces, or nearly closed ones, whose normals point out, and for what lies
    on them. Skin under hair is not drawn at all.

    Parameters
    ----------
    mesh
        The face.

    Returns
    -------
    triangles
        Vertex indices, ``(triangles, 3)``.
    count
        How many of them are the mesh's; those that are turned round come after them.
    """
    hidden = np.zeros(len(mesh.vertices), dtype=bool)
    hidden[mesh.regions.get("under_hair", [])] = True
    triangles = [mesh.triangles[~hidden[mesh.triangles].all(axis=1)]]
    for part in mesh.parts:
        part_triangles = mesh.triangles[part.triangles.start : part.triangles.stop]
        is_backed = part.name.partition("_")[0] in _BACKED_PARTS
        if not is_backed and not _is_closed(mesh.vertices, part_triangles):
            triangles.append(part_triangles[:, ::-1])
    return np.concatenate(triangles), len(triangles[0])


def _is_closed(vertices: FloatArray, triangles: IndexArray) -> bool:
    """Return whether a surface is nearly closed and its normals point out."""
    first = triangles.ravel()
    second = np.roll(triangles, -1, axis=1).ravel()
    edges, opposite = first * len(vertices) + second, second * len(vertices) + first
    a, b, c = (vertices[triangles[:, corner]] - vertices[first].mean(axis=0) for corner in range(3))
    volume = float(np.einsum("ij,ij->", np.cross(a, b), c))
    return bool(np.isin(edges, opposite).mean() > 0.97 and volume > 0)
