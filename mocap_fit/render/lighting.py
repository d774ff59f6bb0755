"""Light on a face, computed vertex by vertex.

Without a graphics card most of a picture's time goes into lighting each of its pixels. A face has
far fewer vertices than pixels, and its vertices are dense where its shape is: light is computed
for them alone, here, and the picture only blends it. So the number of lights costs nothing, and
the inside of the mouth can be as dark as its opening leaves it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.render.mouth_light import MouthLight
from mocap_fit.tracks import FloatArray

Single = NDArray[np.float32]
Colour = tuple[float, float, float]

# Direction, intensity, colour of each light. One soft key from above the speaker's left, a
# weaker fill, and light from the sides and from behind that keeps the outline of cheek and chin.
_LIGHTS: tuple[tuple[Colour, float, Colour], ...] = (
    ((0.45, 0.60, 0.80), 0.46, (1.0, 0.98, 0.95)),
    ((-0.85, 0.25, 0.60), 0.27, (0.95, 0.97, 1.0)),
    ((0.95, 0.20, 0.20), 0.22, (1.0, 0.98, 0.96)),
    ((0.0, 0.05, 1.0), 0.12, (1.0, 0.99, 0.98)),
    ((-0.6, 0.4, -0.8), 0.22, (0.95, 0.97, 1.0)),
    ((0.6, 0.4, -0.8), 0.22, (0.95, 0.97, 1.0)),
)
# Ambient light, from above and from below.
_FROM_ABOVE = np.array([0.40, 0.42, 0.44], dtype=np.float32)
_FROM_BELOW = np.array([0.235, 0.205, 0.19], dtype=np.float32)
# Skin is translucent: it is lit a little beyond where light meets it, red light the farthest.
_WRAP = np.array([0.22, 0.10, 0.07], dtype=np.float32)
# The chin's shadow on the throat: how dark, and how far it reaches to the sides, down, back (mm).
_SHADOW = 0.34
_SHADOW_SIZE = np.array([44.0, 40.0, 60.0], dtype=np.float32)
# Regions of the skin that shine more, or less, than the rest, and how far that fades (edges).
_SHINY = {"nose": 0.36, "forehead": 0.22, "chin": 0.17, "eyelids_left": 0.2, "eyelids_right": 0.2}
_FADING = 4


class Lighting:
    """The light on a mesh, as a colour at every vertex.

    Parameters
    ----------
    mesh
        The face; its colours, or the materials of its parts, determine how each vertex looks.
    """

    def __init__(self, mesh: Mesh) -> None:
        # Corner by corner, which is three times as fast to gather.
        self._corners = np.ascontiguousarray(mesh.triangles.T)
        self._sum_around = _build_triangle_sums(mesh.triangles, len(mesh.vertices))
        self._albedo, self._specular, self._power = _read_materials(mesh, self._sum_around)
        # The sharper a highlight, the brighter.
        self._gloss = self._specular * np.sqrt(self._power / 30.0)
        self._wrapped = np.flatnonzero(_find_skin(mesh))
        self._mouth = MouthLight(mesh)
        self._chin = mesh.feature_points.get("2.1")
        self._below = np.zeros(0, dtype=np.int64)
        if self._chin is not None:
            # As far as an opening jaw can move it.
            height = mesh.vertices[:, 1] < mesh.vertices[self._chin, 1] + 12.0
            self._below = np.flatnonzero(height & _find_skin(mesh))
        key, strength, _ = _LIGHTS[0]
        self._key, self._strength = np.array(key, dtype=np.float32) / np.linalg.norm(key), strength
        self._light, self._light_on_skin = _expand_light(0.0 * _WRAP), _expand_light(_WRAP)

    def compute_colours(self, vertices: FloatArray, camera: ArrayLike) -> NDArray[np.uint8]:
        """Compute the colour of each vertex as the camera sees it.

        Parameters
        ----------
        vertices
            The mesh in some shape, ``(vertices, 3)``, millimetres.
        camera
            Position of the camera, ``(3,)``, millimetres.

        Returns
        -------
        ndarray
            Red, green and blue, ``(vertices, 3)``, 0 to 255.
        """
        positions = vertices.astype(np.float32)
        normals = self._compute_normals(positions)
        directions = _expand_directions(normals)
        light = directions @ self._light
        light[self._wrapped] = directions[self._wrapped] @ self._light_on_skin
        shine = self._compute_highlights(positions, normals, np.asarray(camera, dtype=np.float32))
        seen = (self._albedo * light + shine[:, None]) * self.compute_reaching(vertices)
        return np.asarray(np.clip(255.0 * seen + 0.5, 0.0, 255.0).astype(np.uint8))

    def compute_reaching(self, vertices: FloatArray) -> Single:
        """Compute the share of light that reaches each vertex, into the mouth and below the chin.

        Parameters
        ----------
        vertices
            The mesh in some shape, ``(vertices, 3)``, millimetres.

        Returns
        -------
        ndarray
            Red, green and blue, ``(vertices, 3)``, 0 to 1.
        """
        reaching = self._mouth.compute(vertices).astype(np.float32)
        return reaching * self._shade_throat(vertices.astype(np.float32))[:, None]

    def describe(self) -> dict[str, Any]:
        """Return what the light is made of, for programs that compute it themselves.

        Returns
        -------
        dict[str, Any]
            ``albedo`` ``(vertices, 3)``, 0 to 255, ``specular`` (0 to 255) and ``power`` of every
            vertex; the indices of ``skin``; the ``light`` on other surfaces and ``light_on_skin``,
            nine numbers a colour; direction and strength of the ``key`` light.
        """
        return {
            "albedo": np.rint(255 * self._albedo).astype(np.uint8),
            "specular": np.rint(255 * self._specular).astype(np.uint8),
            "power": np.rint(self._power).clip(1, 255).astype(np.uint8),
            "skin": self._wrapped.astype(np.int32),
            "light": self._light.tolist(),
            "light_on_skin": self._light_on_skin.tolist(),
            "key": self._key.tolist(),
            "strength": self._strength,
        }

    def _compute_normals(self, positions: Single) -> Single:
        corners = np.ascontiguousarray(positions.T).take(self._corners, axis=1)
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        across = np.empty((first.shape[1], 3), dtype=np.float32)
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            across[:, i] = first[j] * second[k] - first[k] * second[j]
        normals = np.asarray(self._sum_around @ across)
        lengths = np.sqrt(np.einsum("ij,ij->i", normals, normals))
        return np.asarray(normals / np.where(lengths > 0, lengths, 1.0)[:, None])

    def _shade_throat(self, positions: Single) -> Single:
        """Return the share of light that the chin leaves to the throat, ``(vertices,)``."""
        light = np.ones(len(positions), dtype=np.float32)
        if self._chin is None:
            return light
        chin = positions[self._chin]
        away = positions[self._below] - (chin - np.array([0.0, 16.0, 30.0], dtype=np.float32))
        near = np.exp(-np.einsum("ij,ij,j->i", away, away, _SHADOW_SIZE**-2.0))
        under = np.clip((chin[1] + 3.0 - positions[self._below, 1]) / 14.0, 0.0, 1.0)
        light[self._below] -= _SHADOW * near * under
        return light

    def _compute_highlights(self, positions: Single, normals: Single, camera: Single) -> Single:
        """Return the highlight of the key light, ``(vertices,)`` (Blinn 1977)."""
        towards = camera - positions
        towards /= np.sqrt(np.einsum("ij,ij->i", towards, towards))[:, None]
        halfway = towards + self._key
        along = np.einsum("ij,ij->i", normals, halfway)
        along /= np.sqrt(np.einsum("ij,ij->i", halfway, halfway))
        shine = np.zeros(len(positions), dtype=np.float32)
        lit = (along > 0.5) & (normals @ self._key > 0.0)
        shine[lit] = self._strength * self._gloss[lit] * along[lit] ** self._power[lit]
        return shine


def _expand_directions(directions: Single) -> Single:
    """Return the polynomials of second degree that all soft light is made of, ``(points, 9)``."""
    x, y, z = directions.T
    terms = np.empty((len(directions), 9), dtype=np.float32)
    terms[:, 0], terms[:, 1:4] = 1.0, directions
    terms[:, 4], terms[:, 5], terms[:, 6] = x * y, y * z, x * z
    terms[:, 7], terms[:, 8] = x * x - y * y, z * z
    return terms


def _expand_light(wrap: Single) -> Single:
    """Return the light on a surface in `_expand_directions` of its normal, ``(9, 3)``.

    Nine numbers hold all but about 1 % of the light that a matt surface reflects (Ramamoorthi and
    Hanrahan, "An efficient representation for irradiance environment maps", 2001).
    """
    steps = np.arange(2000)
    height, turn = 1 - (2 * steps + 1) / len(steps), steps * np.pi * (3 - np.sqrt(5))
    wide = np.sqrt(1 - height**2)
    normals = np.stack([wide * np.cos(turn), height, wide * np.sin(turn)], axis=1)
    half = 0.5 + 0.5 * height[:, None]
    light = half * _FROM_ABOVE + (1.0 - half) * _FROM_BELOW
    for direction, strength, colour in _LIGHTS:
        facing = normals @ (np.array(direction) / np.linalg.norm(direction))
        share = np.maximum(facing[:, None] + wrap, 0.0) / (1.0 + wrap)
        light += strength * share * np.array(colour)
    terms = _expand_directions(normals.astype(np.float32))
    return np.asarray(np.linalg.lstsq(terms, light, rcond=None)[0], dtype=np.float32)


def _build_triangle_sums(triangles: IndexArray, vertices: int) -> sparse.csr_array:
    """Return the matrix that sums values of triangles over those around each vertex."""
    members = np.repeat(np.arange(len(triangles)), 3)
    ones = np.ones(triangles.size, dtype=np.float32)
    return sparse.csr_array((ones, (triangles.ravel(), members)), shape=(vertices, len(triangles)))


def _read_materials(mesh: Mesh, sums: sparse.csr_array) -> tuple[Single, Single, Single]:
    """Return colours ``(vertices, 3)``, strength and sharpness of highlights ``(vertices,)``."""
    count = len(mesh.vertices)
    colours = np.empty((count, 3), dtype=np.float32)
    specular = np.empty(count, dtype=np.float32)
    power = np.empty(count, dtype=np.float32)
    for part in mesh.parts:
        members = slice(part.vertices.start, part.vertices.stop)
        colours[members] = part.material.colour
        specular[members] = part.material.specular
        power[members] = max(part.material.specular_power, 1.0)
    if mesh.colours is not None:
        colours[:] = mesh.colours
    # Nose and forehead shine; where they end, the shine fades.
    for name, gloss in _SHINY.items():
        if name in mesh.regions:
            specular[mesh.get_region(name)] = gloss
    skin = _find_skin(mesh)
    around = (sums @ sums.T).astype(np.float32)
    for _ in range(_FADING):
        specular[skin] = (around @ specular / np.maximum(around.sum(axis=1), 1))[skin]
    # What is dark, as nostrils are, lies too deep to shine.
    specular[skin] *= np.clip(colours[skin].mean(axis=1) / 0.6, 0.0, 1.0) ** 2
    # Lips are moist, and wet inside.
    for name, strength, sharpness in (
        ("upper_lip", 0.22, 24.0),
        ("lower_lip", 0.22, 24.0),
        ("wet_lip", 0.5, 45.0),
    ):
        if name in mesh.regions:
            specular[mesh.get_region(name)] = strength
            power[mesh.get_region(name)] = sharpness
    return colours, specular, power


def _find_skin(mesh: Mesh) -> NDArray[np.bool_]:
    """Return whether each vertex belongs to skin, ``(vertices,)``."""
    skin = np.zeros(len(mesh.vertices), dtype=bool)
    for part in mesh.parts:
        if part.name == "skin":
            skin[part.vertices.start : part.vertices.stop] = True
    return skin
