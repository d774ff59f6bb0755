"""The mouth of the built-in head: what a dentist measures, and what closed lips hide."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mocap_fit.control.rule_table import load_rules
from mocap_fit.face import Mesh, load_face
from mocap_fit.face.lips import compute_lip_openings
from mocap_fit.face.rig import Rig, to_parameters
from mocap_fit.phones import load_phone_set
from mocap_fit.synthesis.closures import Interval, close_lips

TEETH, GUMS = ("teeth_upper", "teeth_lower"), ("gums_upper", "gums_lower")
CROWNS = 14


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_face()


@pytest.fixture(scope="module")
def head(rig) -> Mesh:
    return rig.mesh


@pytest.fixture(scope="module")
def bilabial(rig) -> np.ndarray:
    """The vertices of an m as it is spoken: the table's targets, with lips that close."""
    phones = load_phone_set("en-arpabet")
    (part,) = load_rules(phones).get_parts(phones.get_phone("M"))
    values = to_parameters(dict(part.targets), rig.parameter_names)
    return close_lips(values[None], np.zeros(1), (Interval(-1.0, 1.0),), rig)[0]


def surface(head: Mesh, name: str) -> tuple[np.ndarray, np.ndarray]:
    part = head.get_part(name)
    triangles = head.triangles[part.triangles.start : part.triangles.stop] - part.vertices.start
    return head.vertices[part.vertices.start : part.vertices.stop], triangles


def crowns(head: Mesh, name: str) -> np.ndarray:
    """``(crowns, vertices, 3)``: left and right in turn, from the middle outwards."""
    return surface(head, name)[0].reshape(CROWNS, -1, 3)


def winding(points: np.ndarray, vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """1 inside a closed surface, 0 outside (Van Oosterom and Strackee 1983)."""
    a, b, c = (vertices[triangles[:, i]] - points[:, None] for i in range(3))
    x, y, z = (np.linalg.norm(side, axis=2) for side in (a, b, c))
    volume = np.einsum("ijk,ijk->ij", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ijk,ijk->ij", p, q) for p, q in ((a, b), (b, c), (c, a)))
    return np.arctan2(volume, x * y * z + ab * z + bc * x + ca * y).sum(axis=1) / (2 * np.pi)


def measure_travel(rig: Rig, jaw: float) -> np.ndarray:
    """How far each lower tooth is below the upper ones, the least of its surface, mm."""
    vertices = rig.deform(to_parameters({"jaw_rotation": jaw}, rig.parameter_names))
    n = 7
    shares = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    sampled = []
    for name in TEETH:
        part = rig.mesh.get_part(name)
        triangles = rig.mesh.triangles[part.triangles.start : part.triangles.stop]
        sampled.append(np.swapaxes(shares @ vertices[triangles], 0, 1).reshape(-1, 3))
    upper, lower = sampled
    tooth = np.arange(len(lower)) * CROWNS // len(lower) // 2
    _, nearest = cKDTree(upper[:, [0, 2]]).query(lower[:, [0, 2]], k=6, distance_upper_bound=0.3)
    height = np.append(upper[:, 1], np.inf)[nearest].min(axis=1) - lower[:, 1]
    return np.array([height[tooth == number].min() for number in range(CROWNS // 2)])


def test_the_arches_have_an_adults_width(head):
    for name, width in zip(TEETH, (55.0, 51.0), strict=True):
        first_molars = crowns(head, name)[10:12]
        assert np.ptp(first_molars[..., 0]) == pytest.approx(width, abs=2.0)


def test_left_and_right_mirror_each_other(head):
    for name in TEETH:
        rows = crowns(head, name)
        np.testing.assert_array_equal(rows[::2] * [-1, 1, 1], rows[1::2])
    for name in GUMS:
        vertices, _ = surface(head, name)
        distance, _ = cKDTree(vertices).query(vertices * [-1, 1, 1])
        assert distance.max() == 0.0


def test_incisors_stand_two_millimetres_behind_the_lips(head):
    lips = head.vertices[np.concatenate([head.get_region(f"{s}_lip") for s in ("upper", "lower")])]
    inside = lips[np.abs(lips[:, 0]) < 6, 2].min()
    assert inside - crowns(head, "teeth_upper")[:2, :, 2].max() == pytest.approx(2.0, abs=0.3)


def test_arches_are_apart_at_rest_and_meet_with_an_overbite(rig):
    """2 to 3 mm between premolars and molars at rest; together, incisors overlap as much."""
    names = rig.parameter_names
    assert measure_travel(rig, 0.0)[3:].min() == pytest.approx(2.3, abs=0.5)
    assert measure_travel(rig, 0.0)[3:].max() < 3.0
    together = measure_travel(rig, -0.12)
    assert together.min() > 0.0
    assert together[3:].max() < 0.5
    closed = rig.deform(to_parameters({"jaw_rotation": -0.12}, names))
    upper, lower = (closed[rig.mesh.get_feature_point(name)] for name in ("9.10", "9.11"))
    assert 2.0 < lower[1] - upper[1] < 3.0
    assert 1.5 < upper[2] - lower[2] < 3.0


def test_crowns_have_the_shapes_of_their_kinds(head):
    for name, up in zip(TEETH, (-1.0, 1.0), strict=True):
        rows = crowns(head, name)[::2]
        top = up * rows[..., 1]
        for tooth in (0, 1):  # the edge of an incisor is long and thin
            edge = rows[tooth][top[tooth] > top[tooth].max() - 1.0]
            _, (length, thickness), _ = np.linalg.svd(
                edge[:, ::2] - edge[:, ::2].mean(axis=0), full_matrices=False
            )
            assert length > 3 * thickness
        point = rows[2][top[2] > top[2].max() - 0.6]
        assert np.ptp(point[:, 0]) < 4.0
        for tooth in (5, 6):  # the middle of a molar is lower than its cusps
            middle = rows[tooth][-2]
            assert 1.0 < top[tooth].max() - up * middle[1] < 2.5


@pytest.mark.parametrize(("name", "gum"), [*zip(TEETH, GUMS, strict=True)])
def test_every_tooth_stands_in_its_gum(head, name, gum):
    rows = crowns(head, name)
    necks, tops = rows[:, -1], rows[:, -2]
    around = winding(np.concatenate([necks, tops]), *surface(head, gum))
    np.testing.assert_allclose(around, np.repeat([1.0, 0.0], CROWNS), atol=1e-6)
    # Between two teeth the gum reaches farther along the crown than before the tooth.
    vertices, _ = surface(head, gum)
    front = vertices[(vertices[:, 2] > vertices[:, 2].max() - 4) & (np.abs(vertices[:, 0]) < 6)]
    between, before = (front[np.abs(np.abs(front[:, 0]) - x) < 0.7, 1] for x in (0.0, 4.3))
    reach = before.min() - between.min() if gum == "gums_upper" else between.max() - before.max()
    assert 1.5 < reach < 5.0


def test_teeth_are_in_the_mouth_and_not_in_its_walls(head):
    skin = surface(head, "skin")
    points = np.concatenate([surface(head, name)[0][::37] for name in TEETH])
    assert np.abs(winding(points, *skin)).max() < 0.3


def test_the_palate_is_above_the_tongue(head):
    palate, _ = surface(head, "gums_upper")
    tongue, _ = surface(head, "tongue")
    inside = palate[(np.abs(palate[:, 0]) < 20) & (palate[:, 1] < 20)]
    tongue = tongue[tongue[:, 2] > inside[:, 2].min()]
    away, nearest = cKDTree(inside[:, [0, 2]]).query(tongue[:, [0, 2]])
    near = away < 3.0
    assert near.mean() > 0.8
    assert (inside[nearest[near], 1] - tongue[near, 1]).min() > 2.0
    # Its vault is higher than its borders.
    middle = np.abs(inside[:, 0]) < 3
    assert inside[middle, 1].max() > 14


def test_lips_seal_along_their_line(rig, bilabial):
    openings = compute_lip_openings(rig, bilabial[None])
    assert -1.2 < openings.min() < openings.max() <= 0.5


@pytest.mark.parametrize("pose", ["rest", "m"])
def test_no_tooth_is_seen_when_the_lips_are_closed(rig, bilabial, pose):
    """Every line from a tooth to a camera in front, aside or above meets the skin."""
    vertices = rig.deform(bilabial) if pose == "m" else rig.mesh.vertices
    skin = rig.mesh.get_part("skin").triangles
    triangles = rig.mesh.triangles[skin.start : skin.stop]
    middle = vertices[triangles].mean(axis=1)
    near = (middle[:, 2] > 70) & (np.abs(middle[:, 1]) < 30) & (np.abs(middle[:, 0]) < 50)
    a, b, c = (vertices[triangles[near, i]] for i in range(3))
    teeth = np.concatenate([vertices[rig.mesh.get_region(name)] for name in TEETH])
    teeth = teeth[(np.abs(teeth[:, 1]) < 4) & (teeth[:, 2] > 65)][::2]
    for direction in ([0, 0, 1.0], [0.7, 0, 0.7], [-0.7, 0, 0.7], [0, 0.25, 1], [0, -0.25, 1]):
        assert_hidden(teeth, np.array(direction), a, b, c)


def assert_hidden(points, direction, a, b, c):
    """By sides of triangles as seen along the direction."""
    right = np.cross([0.0, 1.0, 0.0], direction)
    axes = np.stack([right / np.linalg.norm(right), np.cross(direction, right)])
    flat = [corner @ axes.T for corner in (a, b, c)]
    seen = points @ axes.T

    def side(start, end):
        across = end - start
        away = seen[:, None] - start
        return across[:, 0] * away[..., 1] - across[:, 1] * away[..., 0]

    sides = [side(flat[i], flat[(i + 1) % 3]) for i in range(3)]
    within = np.all([s >= 0 for s in sides], axis=0) | np.all([s <= 0 for s in sides], axis=0)
    before = (a @ direction)[None] > (points @ direction)[:, None]
    hidden = (within & before).any(axis=1)
    assert hidden.all(), points[~hidden]
