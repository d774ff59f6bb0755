"""The built-in head: symmetry, closedness, regions, feature points, cache."""

import importlib.util
import json
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mocap_fit.errors import ConfigurationError
from mocap_fit.face.builtin import eyes, load_built_in_head, reshape_head
from mocap_fit.face.builtin.cache import (
    get_cache_folder,
    hash_sources,
    load_mesh,
    save_mesh,
)
from mocap_fit.face.mesh import Material, Mesh, Part

FACES = Path(__file__).parents[2] / "fixtures" / "faces"
PARTS = (
    "skin",
    "teeth_upper",
    "teeth_lower",
    "gums_upper",
    "gums_lower",
    "tongue",
    "eye_left",
    "eye_right",
    "brow_left",
    "brow_right",
    "lashes_left",
    "lashes_right",
    "hair",
    "shirt",
)
MIDDLE_REGIONS = {
    "upper_lip",
    "lower_lip",
    "upper_lip_skin",
    "lower_lip_skin",
    "mouth_bag_upper",
    "mouth_bag_lower",
    "mouth_roof",
    "mouth_floor",
    "chin",
    "nose",
    "forehead",
    "scalp",
    "under_hair",
    "neck",
    "wet_lip",
    "inner_lip_contour",
    "outer_lip_contour",
}
SIDED_REGIONS = {"jaw_{}", "cheek_{}", "brow_{}_skin", "eyelids_{}", "ear_{}"}


@pytest.fixture(scope="module")
def head() -> Mesh:
    return load_built_in_head(use_cache=False)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("MOCAP_FIT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def part_surface(head: Mesh, name: str) -> tuple[np.ndarray, np.ndarray]:
    part = head.get_part(name)
    return (
        head.vertices[part.vertices.start : part.vertices.stop],
        head.triangles[part.triangles.start : part.triangles.stop] - part.vertices.start,
    )


def directed_edges(triangles: np.ndarray) -> np.ndarray:
    return np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])


def border_loops(triangles: np.ndarray) -> list[set[int]]:
    """Loops of edges that only one triangle uses."""
    edges = {tuple(edge) for edge in directed_edges(triangles).tolist()}
    following = {a: b for a, b in edges if (b, a) not in edges}
    loops = []
    while following:
        first = next(iter(following))
        loop = [first]
        while (after := following.pop(loop[-1])) != first:
            loop.append(after)
        loops.append(set(loop))
    return loops


def mirror_of(vertices: np.ndarray) -> np.ndarray:
    """Index of each vertex's mirror image; fails unless there is exactly one."""
    position = {tuple(vertex): i for i, vertex in enumerate(vertices.tolist())}
    assert len(position) == len(vertices), "two vertices at one place"
    mirrored = vertices * [-1, 1, 1] + 0.0
    return np.array([position[tuple(vertex)] for vertex in mirrored.tolist()])


def signed_volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.fixture(scope="module")
def make_head():
    specification = importlib.util.spec_from_file_location("make_head", FACES / "make_head.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def test_the_head_is_the_published_one(head, make_head):
    """Rig files, layouts and fitted corpora count on its vertices: it must not move."""
    with np.load(FACES / "head.npz") as published:
        assert make_head.describe(head) == json.loads(str(published["about"]))
        np.testing.assert_allclose(head.vertices, published["vertices"] / 100, atol=0.0051)
        np.testing.assert_allclose(head.colours, published["colours"] / 255, atol=0.00197)


def test_parts_are_the_agreed_ones_in_order(head):
    assert tuple(part.name for part in head.parts) == PARTS
    assert head.colours is not None
    assert head.colours.min() >= 0
    assert head.colours.max() <= 1


def test_skin_is_exactly_mirror_symmetric(head):
    vertices, triangles = part_surface(head, "skin")
    mirror = mirror_of(vertices + 0.0)
    assert (mirror[mirror] == np.arange(len(vertices))).all()
    turned = np.sort(mirror[triangles][:, ::-1], axis=1)
    assert {tuple(t) for t in turned.tolist()} == {
        tuple(t) for t in np.sort(triangles, axis=1).tolist()
    }


@pytest.mark.parametrize("name", ["eye", "brow", "lashes"])
def test_paired_parts_mirror_each_other(head, name):
    left, _ = part_surface(head, f"{name}_left")
    right, _ = part_surface(head, f"{name}_right")
    apart = np.abs(left * [-1, 1, 1] - right).max(axis=1) > 0
    # Only the light in the eye is on the same side of both.
    assert apart.mean() < (0.2 if name == "eye" else 1e-12)


def test_skin_is_a_manifold_open_only_at_the_eyes_and_the_neck(head):
    vertices, triangles = part_surface(head, "skin")
    edges = directed_edges(triangles)
    assert len(np.unique(edges, axis=0)) == len(edges), "an edge is used twice in one direction"
    _, uses = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    assert set(uses.tolist()) == {1, 2}
    middles = sorted(
        vertices[list(loop)].mean(axis=0).round().tolist() for loop in border_loops(triangles)
    )
    assert len(middles) == 3
    right_eye, neck, left_eye = middles
    assert neck[1] < -90
    for eye in (left_eye, right_eye):
        assert abs(abs(eye[0]) - 31) < 2
        assert 55 < eye[1] < 70
    # A sphere with three holes.
    assert len(vertices) - len(uses) + len(triangles) == 2 - 3
    assert (np.unique(triangles) == np.arange(len(vertices))).all(), "a vertex is unused"


@pytest.mark.parametrize(
    "name", ["teeth_upper", "teeth_lower", "gums_upper", "gums_lower", "tongue"]
)
def test_what_is_in_the_mouth_is_closed_and_face_outwards(head, name):
    vertices, triangles = part_surface(head, name)
    edges = directed_edges(triangles)
    assert {tuple(e) for e in edges.tolist()} == {tuple(e) for e in edges[:, ::-1].tolist()}
    assert signed_volume(vertices - vertices.mean(axis=0), triangles) > 100


def test_triangles_face_outwards_and_have_area(head):
    vertices, triangles = part_surface(head, "skin")
    # The skin without its three openings encloses about four litres.
    assert 2.5e6 < signed_volume(vertices, triangles) < 5e6
    corners = head.vertices[head.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert 0.5 * np.linalg.norm(across, axis=1).min() > 1e-3


def test_no_triangle_of_the_face_is_flipped(head):
    """Away from what folds by nature, neighbours never face opposite ways."""
    vertices, triangles = part_surface(head, "skin")
    folding = np.zeros(len(vertices), dtype=bool)
    for name in ("upper_lip", "lower_lip", "mouth_bag_upper", "mouth_bag_lower"):
        folding[head.get_region(name)] = True
    for side in ("left", "right"):
        folding[head.get_region(f"ear_{side}")] = folding[head.get_region(f"eyelids_{side}")] = True
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edges = np.sort(directed_edges(triangles), axis=1)
    owner = np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort(edges.T)
    same = np.flatnonzero((edges[order][1:] == edges[order][:-1]).all(axis=1))
    first, second = owner[order[same]], owner[order[same + 1]]
    smooth = ~(folding[triangles[first]].any(axis=1) | folding[triangles[second]].any(axis=1))
    agreement = (normals[first] * normals[second]).sum(axis=1)[smooth]
    assert agreement.min() > -0.3
    assert np.quantile(agreement, 0.01) > 0.7


def test_eyes_face_forwards(head):
    for name in ("eye_left", "eye_right", "brow_left", "brow_right"):
        vertices, triangles = part_surface(head, name)
        a, b, c = (vertices[triangles[:, i]] for i in range(3))
        assert np.cross(b - a, c - a)[:, 2].min() > -1e-9, name


def test_the_iris_is_round_and_lids_cover_its_top_and_bottom_a_little(head):
    for side, pupil, upper, lower in (
        ("left", "3.5", "3.1", "3.3"),
        ("right", "3.6", "3.2", "3.4"),
    ):
        eye, _ = part_surface(head, f"eye_{side}")
        pupil, upper, lower = (
            head.vertices[head.get_feature_point(name)] for name in (pupil, upper, lower)
        )
        away = np.hypot(*(eye - pupil)[:, :2].T)
        edge = eye[np.abs(away - eyes.IRIS_RADIUS) < 1e-6]
        assert len(edge) >= 32
        turns = np.sort(np.arctan2(*(edge - pupil)[:, :2].T))
        assert np.diff(turns).max() < 0.2
        # Seen from the front: covered by about a millimetre, above rather than below.
        above, below = edge[:, 1].max() - upper[1], lower[1] - edge[:, 1].min()
        assert 0.3 < below < above < 2.0
        assert lower[1] < pupil[1] - 3 < pupil[1] + 3 < upper[1]


def test_lids_lie_before_the_ball_and_nothing_of_it_comes_through(head):
    """Seen from in front, what is outside the opening of the lids is behind skin."""
    ball, _ = part_surface(head, "eye_left")
    skin = head.vertices[head.get_region("eyelids_left")]
    rings = [skin[np.argsort(np.hypot(*(skin - vertex)[:, :2].T))[:4], 2] for vertex in ball]
    margin = head.vertices[[head.get_feature_point(name) for name in ("3.1", "3.3")], 1]
    hidden = (ball[:, 1] > margin[0] + 0.5) | (ball[:, 1] < margin[1] - 0.5)
    assert hidden.sum() > 5
    before = np.max(rings, axis=1)
    assert (ball[hidden, 2] < before[hidden]).all()


def test_hair_lies_on_the_scalp_and_hides_what_is_said_to_be_under_it(head):
    hair, triangles = part_surface(head, "hair")
    scalp = head.vertices[head.get_region("under_hair")]
    assert len(scalp) > 300
    centre = np.array([0.0, 55.0, -8.0])
    a, b, c = (hair[triangles[:, i]] for i in range(3))
    assert (np.sum(np.cross(b - a, c - a) * (a - centre), axis=1) > 0).mean() > 0.99
    crown = triangles == hair[:, 1].argmax()
    assert (np.cross(b - a, c - a)[crown.any(axis=1), 1] > 0).all()
    distance, nearest = cKDTree(hair).query(scalp)
    assert distance.max() < 14
    lifted = np.linalg.norm(hair[nearest] - centre, axis=1) - np.linalg.norm(scalp - centre, axis=1)
    assert np.quantile(lifted, 0.02) > 0
    for name in ("8.3", "9.3", "4.1", "3.7"):
        marker = head.vertices[head.get_feature_point(name)]
        assert np.linalg.norm(hair - marker, axis=1).min() > 15


def test_the_shirt_hides_the_edge_of_the_neck(head):
    shirt, _ = part_surface(head, "shirt")
    skin, triangles = part_surface(head, "skin")
    (rim,) = (loop for loop in map(sorted, border_loops(triangles)) if skin[loop, 1].max() < -60)
    for vertex in skin[rim]:
        near = shirt[np.abs(shirt[:, 1] - vertex[1]) < 14]
        aligned = np.sum(near[:, [0, 2]] * (vertex[[0, 2]] + [0, 16]), axis=1)
        assert np.hypot(near[:, 0], near[:, 2] + 16)[aligned.argmax()] > np.hypot(
            vertex[0], vertex[2] + 16
        )


def test_eyes_brows_and_lashes_mirror_each_other(head):
    for name in ("eye", "brow", "lashes"):
        left, _ = part_surface(head, f"{name}_left")
        right, _ = part_surface(head, f"{name}_right")
        np.testing.assert_array_equal(left * [-1, 1, 1], right)


def test_lips_meet_at_rest(head):
    upper, lower = (head.vertices[head.get_feature_point(name)] for name in ("2.2", "2.3"))
    assert np.linalg.norm(upper - lower) < 0.3
    contour = head.vertices[head.get_region("inner_lip_contour")]
    above = contour[contour[:, 1] >= np.median(contour[:, 1])]
    for vertex in above:
        nearest = np.sort(np.linalg.norm(contour - vertex, axis=1))[1]
        assert nearest < 2.5


def test_teeth_and_tongue_are_inside_the_lips(head):
    lips = head.vertices[head.get_region("inner_lip_contour")]
    for name in ("teeth_upper", "teeth_lower", "gums_upper", "gums_lower", "tongue"):
        vertices, _ = part_surface(head, name)
        assert vertices[:, 2].max() < lips[:, 2].max() - 4, name


def test_tongue_rests_behind_the_lower_teeth(head):
    tongue, _ = part_surface(head, "tongue")
    teeth, _ = part_surface(head, "teeth_lower")
    front_teeth = teeth[np.abs(teeth[:, 0]) < 4]
    assert tongue[:, 2].max() < front_teeth[:, 2].min() + 0.5


def test_regions_cover_the_skin(head):
    names = set(head.regions)
    sided = {name.format(side) for name in SIDED_REGIONS for side in ("left", "right")}
    assert names == MIDDLE_REGIONS | sided
    covered = np.zeros(len(head.get_part("skin").vertices), dtype=bool)
    for name in names:
        members = head.get_region(name)
        assert len(members) > 5, name
        covered[members] = True
    assert covered.all()


def test_regions_are_on_their_side(head):
    for name in SIDED_REGIONS:
        left = head.vertices[head.get_region(name.format("left"))]
        right = head.vertices[head.get_region(name.format("right"))]
        assert left[:, 0].min() > 0
        assert right[:, 0].max() < 0
        assert len(left) == len(right)


def test_lip_regions_share_only_their_corners(head):
    shared = np.intersect1d(head.get_region("upper_lip"), head.get_region("lower_lip"))
    assert {head.get_feature_point(name) for name in ("2.4", "2.5", "8.3", "8.4")} <= set(
        shared.tolist()
    )
    assert np.abs(head.vertices[shared, 0]).min() > 20
    bag = np.intersect1d(head.get_region("mouth_bag_upper"), head.get_region("mouth_bag_lower"))
    deepest = head.get_region("mouth_bag_lower")
    deepest = deepest[head.vertices[deepest, 2].argmin()]
    assert deepest in bag
    assert head.vertices[deepest, 0] == 0


def test_regions_lie_where_their_names_say(head):
    def middle(name):
        return head.vertices[head.get_region(name)].mean(axis=0)

    down = ["forehead", "brow_left_skin", "eyelids_left", "nose", "upper_lip_skin", "upper_lip"]
    down += ["lower_lip", "lower_lip_skin", "chin", "neck"]
    heights = [middle(name)[1] for name in down]
    assert heights == sorted(heights, reverse=True)
    assert middle("scalp")[2] < middle("ear_left")[2] < middle("cheek_left")[2]
    assert middle("jaw_left")[1] < middle("cheek_left")[1]


LEFT_RIGHT = [
    ("2.4", "2.5"),
    ("2.6", "2.7"),
    ("2.8", "2.9"),
    ("2.11", "2.12"),
    ("2.13", "2.14"),
    ("3.1", "3.2"),
    ("3.3", "3.4"),
    ("3.5", "3.6"),
    ("3.7", "3.12"),
    ("3.9", "3.10"),
    ("3.11", "3.8"),
    ("3.13", "3.14"),
    ("4.1", "4.2"),
    ("4.3", "4.4"),
    ("4.5", "4.6"),
    ("5.1", "5.2"),
    ("5.3", "5.4"),
    ("6.3", "6.4"),
    ("8.3", "8.4"),
    ("8.5", "8.6"),
    ("8.7", "8.8"),
    ("8.9", "8.10"),
    ("9.1", "9.2"),
    ("9.5", "9.4"),
    ("9.7", "9.6"),
    ("9.13", "9.14"),
    ("10.1", "10.2"),
    ("10.3", "10.4"),
    ("10.5", "10.6"),
    ("10.7", "10.8"),
    ("10.9", "10.10"),
    ("11.3", "11.2"),
]
IN_THE_MIDDLE = ["2.1", "2.2", "2.3", "2.10", "6.1", "6.2", "8.1", "8.2"]
IN_THE_MIDDLE += ["9.3", "9.12", "9.15", "11.1", "11.4", "11.6"]


@pytest.mark.parametrize(("left", "right"), LEFT_RIGHT)
def test_left_and_right_feature_points_mirror_each_other(head, left, right):
    left_place, right_place = (
        head.vertices[head.get_feature_point(name)] for name in (left, right)
    )
    assert left_place[0] > 1
    np.testing.assert_allclose(left_place * [-1, 1, 1], right_place, atol=1e-9)


@pytest.mark.parametrize("name", IN_THE_MIDDLE)
def test_middle_feature_points_are_in_the_middle(head, name):
    assert abs(head.vertices[head.get_feature_point(name), 0]) < 1e-9


@pytest.mark.parametrize(
    ("name", "region"),
    [
        ("2.1", "chin"),
        ("2.2", "upper_lip"),
        ("2.2", "inner_lip_contour"),
        ("2.3", "lower_lip"),
        ("2.6", "upper_lip"),
        ("2.8", "lower_lip"),
        ("2.10", "chin"),
        ("2.11", "chin"),
        ("2.13", "jaw_left"),
        ("3.1", "eyelids_left"),
        ("3.12", "eyelids_right"),
        ("4.3", "brow_left_skin"),
        ("4.2", "brow_right_skin"),
        ("5.1", "cheek_left"),
        ("5.4", "cheek_right"),
        ("6.1", "tongue"),
        ("8.1", "outer_lip_contour"),
        ("8.1", "upper_lip"),
        ("8.2", "lower_lip"),
        ("8.9", "upper_lip"),
        ("9.3", "nose"),
        ("9.1", "nose"),
        ("9.8", "teeth_upper"),
        ("9.11", "teeth_lower"),
        ("10.1", "ear_left"),
        ("10.6", "ear_right"),
        ("11.4", "scalp"),
    ],
)
def test_feature_points_are_in_their_regions(head, name, region):
    assert head.get_feature_point(name) in head.get_region(region)


def test_dimensions_are_an_adults(head):
    """Means of adults, men and women together, within a fifth (Farkas, Anthropometry, 1994)."""

    def position(name):
        return head.vertices[head.get_feature_point(name)]

    between = {
        ("8.3", "8.4", 0): 52,  # width of the mouth
        ("3.7", "3.12", 0): 90,  # outer corners of the eyes
        ("3.11", "3.8", 0): 32,  # inner corners of the eyes
        ("9.1", "9.2", 0): 34,  # wings of the nose
        ("9.7", "2.1", 1): 118,  # root of the nose to the chin
        ("9.7", "9.15", 1): 52,  # height of the nose
        ("9.15", "2.1", 1): 68,  # lower face
        ("10.1", "10.5", 1): 61,  # height of the ear
        ("11.4", "2.1", 1): 225,  # height of the head
        ("9.3", "11.6", 2): 205,  # length of the head with the nose
    }
    for (first, second, axis), expected in between.items():
        length = position(first)[axis] - position(second)[axis]
        assert length == pytest.approx(expected, rel=0.2), (first, second)


def test_proportions_are_human(head):
    def height(name):
        return head.vertices[head.get_feature_point(name), 1]

    chin, crown = height("2.1"), height("11.4")
    eyes, nose, mouth, brows = (height(n) for n in ("3.5", "9.15", "2.2", "4.3"))
    assert eyes == pytest.approx((chin + crown) / 2, abs=5)
    assert nose == pytest.approx((chin + brows) / 2, abs=6)
    assert (nose - mouth) / (nose - chin) == pytest.approx(1 / 3, abs=0.08)
    between_pupils = 2 * head.vertices[head.get_feature_point("3.5"), 0]
    assert (eyes - mouth) / between_pupils < 1.1


def test_followers_are_near_their_skin(head):
    """The rig gives them the weights of the nearest skin, which must be the skin they lie on."""
    on_skin = head.vertices[head.get_region("skin")]
    for name in ("brow_left", "brow_right", "lashes_left", "lashes_right"):
        followers = head.vertices[head.get_region(name)]
        distance = np.linalg.norm(followers[:, None] - on_skin, axis=2).min(axis=1)
        assert len(distance) > 0
        assert distance.max() < 6


def assert_same(one: Mesh, other: Mesh) -> None:
    assert one.vertices.tobytes() == other.vertices.tobytes()
    assert one.triangles.tobytes() == other.triangles.tobytes()
    assert one.colours.tobytes() == other.colours.tobytes()
    assert one.parts == other.parts
    assert dict(one.feature_points) == dict(other.feature_points)
    assert list(one.regions) == list(other.regions)
    for name in one.regions:
        np.testing.assert_array_equal(one.regions[name], other.regions[name])


@pytest.fixture(scope="module")
def cached(tmp_path_factory) -> Path:
    """The one file that the first use of the head leaves in the cache."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("MOCAP_FIT_CACHE", str(folder))
        load_built_in_head()
    (path,) = folder.iterdir()
    return path


@pytest.fixture
def in_cache(cached, cache) -> Path:
    cache.mkdir()
    return Path(shutil.copy(cached, cache))


def test_cached_head_is_the_built_head(head, in_cache):
    before = in_cache.stat()
    assert in_cache.suffix == ".npz"
    assert_same(load_built_in_head(), head)
    assert in_cache.stat().st_mtime_ns == before.st_mtime_ns


def test_the_cache_is_really_read(head, in_cache):
    marked = head.replace_vertices(head.vertices + 1.0)
    assert save_mesh(marked, in_cache)
    assert load_built_in_head().vertices.tobytes() == marked.vertices.tobytes()
    assert load_built_in_head(use_cache=False).vertices.tobytes() == head.vertices.tobytes()


def test_a_mesh_without_colours_is_cached_too(tmp_path):
    material = Material((0.1, 0.2, 0.3), 0.4, 5.0)
    parts = (Part("skin", range(3), range(1), material), Part("eye", range(3, 4), range(1, 1)))
    mesh = Mesh(np.eye(4, 3), np.array([[0, 1, 2]]), parts, {"lip": np.array([1])}, {"8.1": 2})
    assert save_mesh(mesh, tmp_path / "new" / "mesh.npz")
    other = load_mesh(tmp_path / "new" / "mesh.npz")
    assert other.parts == parts
    assert other.colours is None
    assert dict(other.feature_points) == {"8.1": 2}
    assert other.get_region("lip").tolist() == [1]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["mesh.npz"]


def test_loading_from_the_cache_imports_no_scipy(cache):
    code = (
        "import sys; from mocap_fit.face.builtin import load_built_in_head; load_built_in_head();"
        "print('scipy.spatial' in sys.modules)"
    )
    answers = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert [answer.stdout.strip() for answer in answers] == ["True", "False"]


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: b"not an archive",
        lambda data: data[: len(data) // 2],
        lambda data: data[:3000] + b"\xff" * 500 + data[3500:],
    ],
    ids=["empty", "text", "cut off", "overwritten"],
)
def test_a_damaged_cache_is_not_used(in_cache, damage):
    in_cache.write_bytes(damage(in_cache.read_bytes()))
    assert load_mesh(in_cache) is None


def test_a_damaged_cache_is_rebuilt(head, in_cache):
    good = in_cache.read_bytes()
    in_cache.write_bytes(good[: len(good) // 2])
    assert_same(load_built_in_head(), head)
    assert in_cache.read_bytes() == good


@pytest.mark.skipif(os.name == "nt", reason="permissions work otherwise on Windows")
def test_a_folder_that_cannot_be_written_is_no_obstacle(head, tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("a file where the folder should be")
    blocked.chmod(stat.S_IRUSR)
    monkeypatch.setenv("MOCAP_FIT_CACHE", str(blocked))
    assert_same(load_built_in_head(), head)
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_cache_folder_follows_the_platform(monkeypatch):
    monkeypatch.delenv("MOCAP_FIT_CACHE", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert get_cache_folder().as_posix() == "/somewhere/mocap-fit"
    monkeypatch.setattr(sys, "platform", "darwin")
    assert get_cache_folder().as_posix().endswith("Library/Caches/mocap-fit")
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setenv("LOCALAPPDATA", "/local")
    assert get_cache_folder().as_posix() == "/local/mocap-fit/Cache"


def test_the_key_of_the_cache_changes_with_sources_and_versions(tmp_path, monkeypatch):
    one, other = tmp_path / "a.py", tmp_path / "b.py"
    one.write_text("1")
    other.write_text("2")
    key = hash_sources(one, other)
    assert len(key) == 16
    assert hash_sources(other, one) == key
    keys = {key, hash_sources(one)}
    one.write_text("3")
    keys.add(hash_sources(one, other))
    one.write_text("1")
    one.rename(tmp_path / "c.py")
    keys.add(hash_sources(tmp_path / "c.py", other))
    monkeypatch.setattr(np, "__version__", "0")
    keys.add(hash_sources(tmp_path / "c.py", other))
    assert len(keys) == 5


class TestReshape:
    def test_nothing_changes_by_default(self, head):
        np.testing.assert_allclose(reshape_head(head).vertices, head.vertices, atol=1e-12)

    def test_size_scales_everything(self, head):
        np.testing.assert_allclose(
            reshape_head(head, size=0.9).vertices, 0.9 * head.vertices, atol=1e-12
        )

    def test_width_height_depth_scale_one_axis_each(self, head):
        reshaped = reshape_head(head, width=1.1, height=0.9, depth=1.2)
        np.testing.assert_allclose(reshaped.vertices, head.vertices * [1.1, 0.9, 1.2], atol=1e-12)

    def test_lower_face_moves_only_what_is_below_the_nose(self, head):
        longer = reshape_head(head, lower_face=1.2)
        moved = longer.vertices - head.vertices
        base = head.vertices[head.get_feature_point("9.15"), 1]
        above = head.vertices[:, 1] >= base
        assert (moved[above] == 0).all()
        assert (moved[:, [0, 2]] == 0).all()
        assert (moved[~above, 1] < 0).all()
        chin, nose = (head.get_feature_point(name) for name in ("2.1", "9.15"))

        def length(mesh):
            return mesh.vertices[nose, 1] - mesh.vertices[chin, 1]

        assert 1.1 < length(longer) / length(head) < 1.2

    def test_the_lower_face_sets_in_over_15_mm(self):
        """Below the nose by d: d²/30 more for d up to 15 mm, d - 7.5 beyond, times the factor."""
        heights = [20.0, 25.0, 14.0, 5.0, -10.0, -40.0]
        vertices = np.array([[0.0, y, 90] for y in heights])
        points = {"9.15": 0, "8.3": 4, "8.4": 4}
        longer = reshape_head(
            Mesh(vertices, np.array([[0, 1, 2]]), feature_points=points), lower_face=1.5
        )
        moved = heights - longer.vertices[:, 1]
        np.testing.assert_allclose(moved, 0.5 * np.array([0, 0, 36 / 30, 7.5, 22.5, 52.5]))

    def test_the_widening_of_the_mouth_fades_as_a_gaussian(self):
        """Of 48 mm across, 30 up and down, 45 forwards and back, about between the corners."""
        vertices = np.array([[24.0, 2, 80], [-24, 2, 80], [48, 2, 80], [10, 32, 80], [10, 2, 35.0]])
        points = {"9.15": 3, "8.3": 0, "8.4": 1}
        wider = reshape_head(
            Mesh(vertices, np.array([[0, 1, 2]]), feature_points=points), mouth_width=1.5
        )
        growth = wider.vertices[:, 0] / vertices[:, 0] - 1
        away = np.array([0.25, 0.25, 1, (10 / 48) ** 2 + 1, (10 / 48) ** 2 + 1])
        np.testing.assert_allclose(growth, 0.5 * np.exp(-away))

    @pytest.mark.parametrize("factor", [0.5, 2.0])
    def test_the_largest_factors_are_accepted(self, head, factor):
        np.testing.assert_allclose(
            reshape_head(head, size=factor).vertices, factor * head.vertices, atol=1e-12
        )

    def test_mouth_width_widens_the_mouth(self, head):
        wider = reshape_head(head, mouth_width=1.2)
        corner, ear = head.get_feature_point("8.3"), head.get_feature_point("10.3")
        growth = wider.vertices[corner, 0] / head.vertices[corner, 0]
        assert 1.12 < growth < 1.2
        assert wider.vertices[ear, 0] / head.vertices[ear, 0] < 1.005
        assert (wider.vertices[:, 1:] == head.vertices[:, 1:]).all()

    def test_lips_stay_closed_and_the_skin_symmetric_and_unfolded(self, head):
        other = reshape_head(
            head, width=1.05, height=0.95, depth=1.03, lower_face=1.15, mouth_width=0.85, size=1.05
        )
        upper, lower = (other.vertices[other.get_feature_point(name)] for name in ("2.2", "2.3"))
        assert np.linalg.norm(upper - lower) < 0.3
        vertices, triangles = part_surface(other, "skin")
        mirror_of(vertices + 0.0)
        before, _ = part_surface(head, "skin")

        def normals(points):
            a, b, c = (points[triangles[:, i]] for i in range(3))
            across = np.cross(b - a, c - a)
            return across / np.linalg.norm(across, axis=1, keepdims=True)

        assert (normals(vertices) * normals(before)).sum(axis=1).min() > 0.5
        assert other.parts == head.parts
        assert other.feature_points == head.feature_points

    @pytest.mark.parametrize("factor", [0, -1, 0.49, 2.01, np.nan, np.inf])
    @pytest.mark.parametrize("name", ["width", "lower_face", "mouth_width", "size"])
    def test_impossible_factors_are_refused(self, head, name, factor):
        with pytest.raises(ConfigurationError, match=name):
            reshape_head(head, **{name: factor})

    def test_a_mesh_without_feature_points_is_refused(self):
        bare = Mesh(np.eye(3), np.array([[0, 1, 2]]))
        with pytest.raises(ConfigurationError, match=r"8\.3"):
            reshape_head(bare)
