"""Pictures of a face, made off screen."""

from __future__ import annotations

import ctypes
import os
import sys
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mocap_fit.errors import DataError, MissingExtraError
from mocap_fit.face.mesh import IndexArray, Mesh, Part
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
_BACKGROUND: Colour = (0.86, 0.885, 0.915)
_BACKGROUND_TOP: Colour = (0.97, 0.975, 0.985)
_MARKER_COLOUR: Colour = (0.10, 0.45, 0.85)
# Light comes from: direction, intensity, colour. One soft key, and a half sphere of weak lights,
# brighter and cooler above than below, which keeps shadows open as daylight in a room does.
_LIGHTS: tuple[tuple[Colour, float, Colour], ...] = (
    ((0.45, 0.55, 0.80), 0.42, (1.0, 0.98, 0.95)),
    ((-0.85, 0.25, 0.60), 0.27, (0.95, 0.97, 1.0)),
    ((0.95, 0.20, 0.20), 0.30, (1.0, 0.98, 0.96)),
    ((0.0, 0.05, 1.0), 0.16, (1.0, 0.99, 0.98)),
    ((0.0, 1.0, 0.15), 0.20, (0.96, 0.98, 1.0)),
    ((0.0, -0.9, 0.5), 0.12, (1.0, 0.92, 0.88)),
    ((-0.6, 0.4, -0.8), 0.22, (0.95, 0.97, 1.0)),
    ((0.6, 0.4, -0.8), 0.22, (0.95, 0.97, 1.0)),
)
_AMBIENT = 0.20


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
        False draws in half the time, with jagged outlines.

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

        self.mesh = mesh
        self._marker_radius = marker_radius
        plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(size), lighting="none")
        plotter.set_background(_BACKGROUND, top=_BACKGROUND_TOP)
        # Multi-sampling is slow without a graphics card and missing on some; this is neither.
        plotter.render_window.SetMultiSamples(0)
        if smooth_edges:
            plotter.enable_anti_aliasing("ssaa")
        for direction, intensity, colour in _LIGHTS:
            light = pyvista.Light(
                position=direction, focal_point=(0, 0, 0), light_type="scene light"
            )
            light.intensity = intensity
            light.diffuse_color = colour
            plotter.add_light(light)
        self._plotter = plotter
        self._surfaces: list[Any] = [_surface(mesh, part) for part in mesh.parts]
        for part, surface in zip(mesh.parts, self._surfaces, strict=True):
            _add(plotter, surface, part, coloured=mesh.colours is not None)
        self._markers: Any = None
        _place_camera(plotter, mesh, view, zoom, centre)

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
        for part, surface in zip(self.mesh.parts, self._surfaces, strict=True):
            points = shape[part.vertices.start : part.vertices.stop]
            surface.points = points
            surface.point_data["Normals"] = vertex_normals(points, _own_triangles(self.mesh, part))
        self._draw_markers(markers)
        self._plotter.renderer.ResetCameraClippingRange()
        # Without this, screenshot returns the frame before.
        self._plotter.render()
        picture = self._plotter.screenshot(return_img=True)
        return np.ascontiguousarray(picture[..., :3], dtype=np.uint8)

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
        width, height = self._plotter.window_size
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

    def _draw_markers(self, markers: ArrayLike | None) -> None:
        import pyvista

        if self._markers is not None:
            self._plotter.remove_actor(self._markers, render=False)
            self._markers = None
        if markers is None:
            return
        places = np.asarray(markers, dtype=np.float64)
        if places.ndim != 2 or places.shape[1] != 3:
            raise DataError(
                "markers to draw have the wrong shape", found=places.shape, expected="(markers, 3)"
            )
        places = places[np.isfinite(places).all(axis=1)]
        if len(places):
            ball = pyvista.Sphere(
                radius=self._marker_radius, theta_resolution=16, phi_resolution=16
            )
            balls = pyvista.PolyData(places).glyph(geom=ball, scale=False, orient=False)
            self._markers = self._plotter.add_mesh(
                balls, color=_MARKER_COLOUR, ambient=0.3, specular=0.3, reset_camera=False
            )


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


def _own_triangles(mesh: Mesh, part: Part) -> IndexArray:
    return mesh.triangles[part.triangles.start : part.triangles.stop] - part.vertices.start


def _surface(mesh: Mesh, part: Part) -> Any:
    import pyvista

    vertices = mesh.vertices[part.vertices.start : part.vertices.stop]
    triangles = _own_triangles(mesh, part)
    surface: Any = pyvista.PolyData.from_regular_faces(vertices, triangles.astype(int))
    surface.point_data.active_normals = vertex_normals(vertices, triangles)
    if mesh.colours is not None:
        colours = mesh.colours[part.vertices.start : part.vertices.stop]
        surface.point_data["colours"] = np.rint(255 * np.clip(colours, 0, 1)).astype(np.uint8)
    return surface


def _add(plotter: Any, surface: Any, part: Part, *, coloured: bool) -> None:
    material = part.material
    look: dict[str, Any] = (
        {"scalars": "colours", "rgb": True} if coloured else {"color": material.colour}
    )
    actor = plotter.add_mesh(
        surface,
        ambient=_AMBIENT,
        diffuse=1.0,
        specular=material.specular,
        specular_power=material.specular_power,
        copy_mesh=False,
        **look,
    )
    # The normals are ours, so that they stay right when the vertices move.
    actor.prop.interpolation = "Phong"


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
