"""Contact: lips, teeth, tongue and palate touch, and do not pass through each other.

A rig moves each part by itself, so lips that are pressed would go through each other, and a tongue
through the palate. `resolve_contact` is the last step of drawing and of export; a rig's `deform`
and what is fitted with it stay as they are. Both rows of teeth with their gums are rigid: they have
fields of distances, made once. Lips that are drawn onto the teeth stop there, and the skin before
them moves along; pressed lips meet in a surface between them and bulge; the tongue is flattened by
what it meets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from mocap_fit.face.contact_surface import Surface
from mocap_fit.face.distance_field import DistanceField, compute_fields
from mocap_fit.face.mesh import IndexArray, Mesh, compute_normals, list_edges
from mocap_fit.tracks import FloatArray

# Rotation and shift from rest.
Pose = tuple[FloatArray, FloatArray]
_SPACING = 0.8
# Millimetres between surfaces that touch, of teeth to the upper and to the lower row; what is
# nearer at rest may be as near. The edges of lower incisors are thinner than the grid.
_LIPS_TO_TEETH, _TONGUE_TO_TEETH = (0.3, 0.3), (0.4, 0.6)
_LIP_TO_LIP, _TONGUE_TO_LIP = 0.04, 0.3
# How far lips and tongue are carried along with what is pushed: standard deviations, and the end.
_LIP_SPREAD, _TONGUE_SPREAD, _END = 4.5, 6.0, 15.0
# Millimetres: so deep lips are in each other may be left to exact distances.
_SHALLOW = 0.45
# Millimetres: longer edges are tested at more than their middles.
_LONG = 3.0
# Pressed lips come forwards by this share of what is pressed.
_BULGE = 0.5
_SMOOTH_ROUNDS, _ROUNDS, _TONGUE_ROUNDS = 2, 4, 8
_SMALL, _SMALLEST = 0.02, 0.01


@dataclass(frozen=True, eq=False)
class _Jaw:
    """A row of teeth and its gum: rigid, wherever the jaw has brought it.

    Parameters
    ----------
    vertices
        Vertices that show where it is, ``(vertices,)``.
    rest
        Their positions at rest, ``(vertices, 3)``, millimetres.
    for_lips, for_tongue
        Distances from it, at rest: the lips stay before it, the tongue inside.
    """

    vertices: IndexArray
    rest: FloatArray
    for_lips: DistanceField
    for_tongue: DistanceField

    def locate(self, vertices: FloatArray) -> Pose:
        """Return rotation and shift from rest to where it is, ``(3, 3)`` and ``(3,)``."""
        moved = vertices[self.vertices]
        middle, rest = moved.mean(axis=0), self.rest.mean(axis=0)
        left, _, right = np.linalg.svd((moved - middle).T @ (self.rest - rest))
        rotation = left @ right
        return rotation, middle - rotation @ rest


@dataclass(frozen=True, eq=False)
class _Soft:
    """Vertices that give way, and what they carry along.

    Parameters
    ----------
    vertices
        Vertices that touch the teeth, ``(vertices,)``.
    carried
        Vertices that are carried along, ``(carried,)``, themselves among them.
    shares
        How near each of the carried is to each that touches, ``(carried, vertices)``.
    fading
        How much of the movement is left, ``(carried,)``, 1 next to those that touch.
    samples
        What is tested, positions in `vertices`, ``(samples, 2)``: each vertex, twice, and the ends
        of edges, for points between them.
    parts
        Share of the second of the two, ``(samples,)``.
    clearance
        How near each sample may come to the upper and the lower row, ``(2, samples)``, millimetres.
    """

    vertices: IndexArray
    carried: IndexArray
    shares: sparse.csr_array
    fading: FloatArray
    samples: IndexArray
    parts: FloatArray
    clearance: FloatArray

    def push_off(
        self, points: FloatArray, poses: list[Pose], fields: list[DistanceField]
    ) -> FloatArray:
        """Return what brings the vertices, at `points`, out of both rows, ``(vertices, 3)``.

        For each the mean of the pushes of its samples, in which large ones count more.
        """
        sums, totals = np.zeros_like(points), np.full(len(points), _SMALLEST)
        for pose, field, least in zip(poses, fields, self.clearance, strict=True):
            field.add_pushes(points, self.samples, self.parts, least, pose, sums, totals)
        return np.asarray(sums / totals[:, None])

    def spread(self, pushes: FloatArray) -> FloatArray:
        """Spread pushes over what is carried along, ``(carried, 3)``; smooth, and 0 for none."""
        sizes = np.minimum(np.linalg.norm(pushes, axis=1) / 0.5, 1.0)
        near = self.shares @ sizes + 0.3
        return np.asarray((self.shares @ pushes) * (self.fading / near)[:, None])


@dataclass(frozen=True, eq=False)
class Contact:
    """What may touch in a face, made once for a mesh.

    Parameters
    ----------
    jaws
        The upper and the lower row of teeth.
    lips
        The lips, the skin behind them, and what they carry.
    tongue
        The tongue; None where there is none.
    red
        The vertices of the lips by themselves: the upper lip first, ``(red,)``.
    upper
        How many of them are of the upper lip.
    surfaces
        Of the upper lip, of the lower lip, and of both.
    lip_clearance
        How near each may come to the other lip, ``(red,)``, millimetres.
    tip
        Positions in the tongue of what may meet the lips, ``(tip,)``.
    lower_parts
        Vertices that go with the lower row where a bite is held open, ``(vertices,)``: its teeth
        first.
    lower_teeth
        How many of them are teeth.
    """

    jaws: tuple[_Jaw, _Jaw]
    lips: _Soft
    tongue: _Soft | None
    red: IndexArray
    upper: int
    surfaces: tuple[Surface, Surface, Surface]
    lip_clearance: FloatArray
    tip: IndexArray
    lower_parts: IndexArray
    lower_teeth: int

    @cached_property
    def _in_lips(self) -> IndexArray:
        """Positions of the red among the carried."""
        return np.searchsorted(self.lips.carried, self.red)

    def resolve(self, vertices: FloatArray) -> FloatArray:
        """Move apart what is in each other.

        Parameters
        ----------
        vertices
            Vertices of the mesh, ``(vertices, 3)``, millimetres.

        Returns
        -------
        ndarray
            ``(vertices, 3)``, millimetres; the same where nothing touches.
        """
        result = vertices.copy()
        self._hold_bite(result)
        poses = [jaw.locate(result) for jaw in self.jaws]
        self._resolve_lips(result, poses)
        if self.tongue is not None:
            self._resolve_tongue(result, poses)
        return result

    def _hold_bite(self, result: FloatArray) -> None:
        """Lower the lower row where it has come into the upper one, in place."""
        upper = self.jaws[0]
        rotation, shift = upper.locate(result)
        for _ in range(_ROUNDS):
            teeth = (result[self.lower_parts[: self.lower_teeth]] - shift) @ rotation
            depth = float(-upper.for_tongue.sample(teeth)[0].min(initial=0.0))
            if depth < _SMALL:
                break
            result[self.lower_parts] -= depth * rotation[:, 1]

    def _press_lips(self, points: FloatArray, *, smooth: bool) -> FloatArray:
        """Return what brings lips out of each other, half of it for each, ``(red, 3)``."""
        normals = compute_normals(points, self.surfaces[2].triangles)
        gaps, ways = self.measure_lips(points, normals, smooth=smooth)
        least = -_SHALLOW if smooth else self.lip_clearance
        return np.asarray(0.5 * np.maximum(least - gaps, 0.0)[:, None] * ways)

    def measure_lips(
        self, points: FloatArray, normals: FloatArray, *, smooth: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Measure how far each of the red is from the other lip.

        Parameters
        ----------
        points
            Positions of the red, ``(red, 3)``, millimetres.
        normals
            Their normals, ``(red, 3)``.
        smooth
            Whether the lips are taken as smooth surfaces (`Surface.measure`).

        Returns
        -------
        gaps
            Signed distances, ``(red,)``, millimetres; infinite out of reach.
        ways
            Directions out of the other lip, ``(red, 3)``.
        """
        k = self.upper
        upper = self.surfaces[1].measure(points[:k], points[k:], normals[k:], smooth=smooth)
        lower = self.surfaces[0].measure(points[k:], points[:k], normals[:k], smooth=smooth)
        return np.concatenate([upper[0], lower[0]]), np.concatenate([upper[1], lower[1]])

    def _resolve_lips(self, result: FloatArray, poses: list[Pose]) -> None:
        lips, fields = self.lips, [jaw.for_lips for jaw in self.jaws]
        pushes = lips.push_off(result[lips.vertices], poses, fields)
        if pushes.any():
            result[lips.carried] += lips.spread(pushes)
        pressed = np.zeros(len(self.red))
        for number in range(_SMOOTH_ROUNDS + _ROUNDS):
            smooth = number < _SMOOTH_ROUNDS
            if number == _SMOOTH_ROUNDS and pressed.any():
                self._move_forwards(result, pressed)
            apart = self._press_lips(result[self.red], smooth=smooth)
            result[self.red] += apart
            pressed += np.linalg.norm(apart, axis=1)
            pushes = lips.push_off(result[lips.vertices], poses, fields)
            result[lips.vertices] += pushes
            if not smooth and max(np.abs(apart).max(), np.abs(pushes).max()) < _SMALL:
                break

    def _move_forwards(self, result: FloatArray, pressed: FloatArray) -> None:
        """Bring the front of pressed lips forwards, in place: flesh goes where it can."""
        amounts = np.zeros((len(self.lips.vertices), 3))
        amounts[np.searchsorted(self.lips.vertices, self.red), 2] = pressed
        forwards = self.lips.spread(amounts)[self._in_lips, 2]
        normals = compute_normals(result[self.red], self.surfaces[2].triangles)
        result[self.red] += (_BULGE * forwards * np.maximum(normals[:, 2], 0.0))[:, None] * normals

    def _resolve_tongue(self, result: FloatArray, poses: list[Pose]) -> None:
        tongue = self.tongue
        assert tongue is not None
        fields = [jaw.for_tongue for jaw in self.jaws]
        normals = compute_normals(result[self.red], self.surfaces[2].triangles)
        points = result[tongue.vertices]
        for number in range(_TONGUE_ROUNDS):
            pushes = tongue.push_off(points, poses, fields)
            gaps, ways = self.surfaces[2].measure(points[self.tip], result[self.red], normals)
            pushes[self.tip] += np.maximum(_TONGUE_TO_LIP - gaps, 0.0)[:, None] * ways
            if np.abs(pushes).max() < _SMALL:
                break
            points = points + (tongue.spread(pushes) if number == 0 else pushes)
        result[tongue.vertices] = points


_PREPARED: WeakKeyDictionary[Mesh, Contact | None] = WeakKeyDictionary()


def resolve_contact(vertices: FloatArray, mesh: Mesh) -> FloatArray:
    """Move apart what is in each other: lips, teeth, tongue and palate.

    Parameters
    ----------
    vertices
        Vertices of the mesh as a rig has moved them, ``(vertices, 3)``, millimetres.
    mesh
        The face at rest. One without the regions ``upper_lip`` and ``lower_lip`` and closed parts
        ``teeth_upper``, ``gums_upper``, ``teeth_lower`` and ``gums_lower`` stays as it is.

    Returns
    -------
    ndarray
        ``(vertices, 3)``, millimetres; the same where nothing touches.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> from mocap_fit.face import to_parameters
    >>> face = mf.load_face()
    >>> pressed = face.deform(to_parameters({"jaw_rotation": -0.1}, face.parameter_names))
    >>> resolve_contact(pressed, face.mesh).shape == pressed.shape
    True
    """
    contact = _get_contact(mesh)
    return vertices if contact is None else contact.resolve(vertices)


def list_touching(mesh: Mesh) -> IndexArray:
    """List the vertices that `resolve_contact` may move.

    Parameters
    ----------
    mesh
        The face at rest.

    Returns
    -------
    ndarray
        Vertex indices, ``(vertices,)``, increasing.
    """
    contact = _get_contact(mesh)
    if contact is None:
        return np.zeros(0, dtype=np.int64)
    return np.union1d(contact.lips.carried, contact.lower_parts)


def _get_contact(mesh: Mesh) -> Contact | None:
    if mesh not in _PREPARED:
        _PREPARED[mesh] = _prepare_contact(mesh)
    return _PREPARED[mesh]


def _prepare_contact(mesh: Mesh) -> Contact | None:
    rows = [("teeth_upper", "gums_upper"), ("teeth_lower", "gums_lower")]
    names = {part.name for part in mesh.parts}
    needed = {name for row in rows for name in row}
    if not needed <= names or not {"upper_lip", "lower_lip"} <= mesh.regions.keys():
        return None
    jaws = (_prepare_jaw(mesh, rows[0], upper=True), _prepare_jaw(mesh, rows[1], upper=False))
    upper, lower = mesh.get_region("upper_lip"), mesh.get_region("lower_lip")
    # Vertices of both lips, at the corners, have no side.
    corners = np.intersect1d(upper, lower)
    upper, lower = np.setdiff1d(upper, corners), np.setdiff1d(lower, corners)
    red = np.concatenate([upper, lower])
    bag = [mesh.get_region(n) for n in ("mouth_bag_upper", "mouth_bag_lower") if mesh.has_region(n)]
    touching = np.unique(np.concatenate([red, corners, *bag]))
    front = mesh.vertices[red, 2].max()
    touching = touching[mesh.vertices[touching, 2] > front - 35.0]
    # Skin that is behind a row's front at rest, as the throat's, is not before it.
    before = [jaw.for_lips.sample(mesh.vertices[touching])[0] > -1.0 for jaw in jaws]
    touching = np.union1d(touching[np.all(before, axis=0)], red)
    skin = np.arange(mesh.get_part("skin").vertices.start, mesh.get_part("skin").vertices.stop)
    lips = _prepare_soft(
        mesh, touching, skin, _LIP_SPREAD, [jaw.for_lips for jaw in jaws], _LIPS_TO_TEETH
    )
    tongue = None
    tip = np.zeros(0, dtype=np.int64)
    lower_parts = [mesh.get_region(name) for name in rows[1]]
    if mesh.has_region("tongue"):
        ids = mesh.get_region("tongue")
        fields = [jaw.for_tongue for jaw in jaws]
        tongue = _prepare_soft(mesh, ids, ids, _TONGUE_SPREAD, fields, _TONGUE_TO_TEETH, apart=True)
        depths = mesh.vertices[ids, 2]
        tip = np.flatnonzero(depths > depths.max() - 25.0)
        lower_parts.append(ids)
    local = np.full(len(mesh.vertices), -1)
    local[red] = np.arange(len(red))
    triangles = local[mesh.triangles]
    triangles = triangles[(triangles >= 0).all(axis=1)]
    k = len(upper)
    of_upper = triangles[(triangles < k).all(axis=1)]
    of_lower = triangles[(triangles >= k).all(axis=1)] - k
    surfaces = (
        Surface.from_triangles(of_upper, k),
        Surface.from_triangles(of_lower, len(lower)),
        Surface.from_triangles(triangles, len(red)),
    )
    clearance = np.full(len(red), _LIP_TO_LIP)
    contact = Contact(
        jaws,
        lips,
        tongue,
        red,
        k,
        surfaces,
        clearance,
        tip,
        np.concatenate(lower_parts),
        len(lower_parts[0]),
    )
    rest = mesh.vertices[red]
    gaps, _ = contact.measure_lips(rest, compute_normals(rest, triangles))
    return replace(contact, lip_clearance=np.minimum(gaps, clearance))


def _prepare_jaw(mesh: Mesh, row: tuple[str, str], *, upper: bool) -> _Jaw:
    parts = [mesh.get_part(name) for name in row]
    triangles = np.concatenate(
        [mesh.triangles[p.triangles.start : p.triangles.stop] for p in parts]
    )
    ids = np.unique(triangles)
    points = mesh.vertices[ids]
    low, high = points.min(axis=0) - 3.0, points.max(axis=0) + 3.0
    # Between two nodes the middle of the face sees both sides alike.
    side = _SPACING * (math.ceil(max(-low[0], high[0]) / _SPACING) + 0.5)
    # Palate and floor go on behind, or the tongue would go round their ends.
    low[2] -= 10.0
    low[0], high[0] = -side, side
    behind_lips, behind_tongue = (2, -1), (1, 1 if upper else -1)
    for_lips, for_tongue = compute_fields(
        mesh.vertices,
        triangles,
        (low, high),
        _SPACING,
        [behind_lips, behind_tongue],
        extend=points[:, 2].min() + 0.8,
    )
    # A part of the teeth is enough to see where they are.
    teeth = mesh.get_region(row[0])[::8]
    return _Jaw(teeth, mesh.vertices[teeth], for_lips, for_tongue)


def _prepare_soft(
    mesh: Mesh,
    touching: IndexArray,
    others: IndexArray,
    spread: float,
    fields: list[DistanceField],
    clearance: tuple[float, float],
    *,
    apart: bool = False,
) -> _Soft:
    """Prepare what gives way; `apart`, if its sides may be pushed towards each other."""
    points = mesh.vertices[touching]
    tree = cKDTree(points)
    nearest, _ = tree.query(mesh.vertices[others], distance_upper_bound=_END)
    carried = np.union1d(others[np.isfinite(nearest)], touching)
    near, _ = tree.query(mesh.vertices[carried])
    pairs = cKDTree(mesh.vertices[carried]).sparse_distance_matrix(
        tree, 2.5 * spread, output_type="coo_matrix"
    )
    weights = np.exp(-0.5 * (pairs.data / spread) ** 2)
    if apart:
        normals = mesh.compute_normals()
        alike = (normals[carried[pairs.row]] * normals[touching[pairs.col]]).sum(axis=1)
        weights *= 0.65 + 0.35 * alike
    shares = sparse.csr_array((weights, (pairs.row, pairs.col)), shape=pairs.shape)
    left = np.clip(1.0 - near / _END, 0.0, 1.0)
    fading = left * left * (3.0 - 2.0 * left)
    samples, parts = _list_samples(mesh, touching)
    tested = points[samples[:, 0]] + parts[:, None] * (
        points[samples[:, 1]] - points[samples[:, 0]]
    )
    gaps = np.array([field.sample(tested)[0] for field in fields])
    return _Soft(
        touching,
        carried,
        shares,
        fading,
        samples,
        parts,
        np.minimum(gaps, np.array(clearance)[:, None]),
    )


def _list_samples(mesh: Mesh, vertices: IndexArray) -> tuple[IndexArray, FloatArray]:
    """Return pairs of positions in `vertices` and the share of the second: see `_Soft`."""
    edges = list_edges(mesh.triangles)
    edges = edges[np.isin(edges, vertices).all(axis=1)]
    lengths = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    each = np.arange(len(vertices))
    pairs, shares = [np.stack([each, each], axis=1)], [np.zeros(len(each))]
    for share, chosen in ((0.5, lengths > 0.0), (0.25, lengths > _LONG), (0.75, lengths > _LONG)):
        pairs.append(np.searchsorted(vertices, edges[chosen]))
        shares.append(np.full(int(chosen.sum()), share))
    return np.concatenate(pairs), np.concatenate(shares)
