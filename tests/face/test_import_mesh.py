"""Foreign meshes: read as they are, checked, refused with a reason."""

import json
import struct
import warnings

import numpy as np
import pytest

from mocap_fit import size_limit
from mocap_fit.errors import (
    ConfigurationError,
    DataError,
    FileFormatError,
    MocapFitError,
    MocapFitWarning,
)
from mocap_fit.face.import_mesh import read_mesh
from mocap_fit.face.mesh_pieces import _make_unique

# Numbers that are no vertices, and sizes that are no sizes.
BAD_POLYGONS = [
    "3 0 1 99999999999999999999999",
    "3 0 1 -1",
    "3 0 1 1e400",
    "3 0 1 nan",
    "3 0 1 1.5",
    "-1 0 1 2",
    "inf 0 1 2",
    "3000000000 0 1 2",
    "3 0 0 0 0",
    "3 0 1 0x2 0",
    "3 0 1",
    f"3 0 1 {'9' * 5000} 0",
]


def egg(rows: int = 9, columns: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """A closed egg the size of a head: vertices (mm) and outward triangles."""
    polar = np.linspace(0, np.pi, rows + 2)[1:-1, None]
    around = 2 * np.pi * np.arange(columns) / columns
    rings = np.stack(
        np.broadcast_arrays(
            70 * np.sin(polar) * np.cos(around),
            110 * np.cos(polar),
            -90 * np.sin(polar) * np.sin(around),
        ),
        axis=2,
    ).reshape(-1, 3)
    vertices = np.concatenate([rings, [[0, 110, 0], [0, -110, 0]]])
    index = np.arange(rows * columns).reshape(rows, columns)
    after = np.roll(index, -1, axis=1)
    triangles = [
        np.stack([index[:-1], index[1:], after[1:]], axis=2).reshape(-1, 3),
        np.stack([index[:-1], after[1:], after[:-1]], axis=2).reshape(-1, 3),
        np.stack([np.full(columns, rows * columns), index[0], after[0]], axis=1),
        np.stack([np.full(columns, rows * columns + 1), after[-1], index[-1]], axis=1),
    ]
    return vertices, np.concatenate(triangles)


def volume(mesh) -> float:
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def write_obj(path, vertices, polygons, header=""):
    lines = [header, *(f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices)]
    lines += ["f " + " ".join(str(i + 1) for i in polygon) for polygon in polygons]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_with(library, path, vertices, triangles):
    if library == "pyvista":
        import pyvista

        pyvista.PolyData.from_regular_faces(vertices, triangles).save(path)
    else:
        import trimesh

        trimesh.Trimesh(vertices, triangles, process=False).export(path)
    return path


def quiet(path, **arguments):
    """Read with every warning an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", MocapFitWarning)
        return read_mesh(path, **arguments)


@pytest.mark.parametrize(
    ("library", "ending"),
    [("pyvista", e) for e in (".ply", ".stl")] + [("trimesh", e) for e in (".glb", ".off", ".ply")],
)
def test_every_format_gives_the_same_egg(tmp_path, library, ending):
    vertices, triangles = egg()
    mesh = quiet(write_with(library, tmp_path / f"egg{ending}", vertices, triangles))
    assert mesh.vertices.shape == vertices.shape
    assert mesh.triangles.shape == triangles.shape
    assert [part.name for part in mesh.parts] == ["egg"] or ending == ".glb"
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi * 70 * 110 * 90, rel=0.15)
    if ending != ".stl":  # which stores no vertex numbers
        np.testing.assert_allclose(mesh.vertices, vertices, atol=1e-4)
        np.testing.assert_array_equal(mesh.triangles, triangles)


def test_obj_keeps_vertex_numbers_and_cuts_polygons(tmp_path):
    vertices, triangles = egg()
    vertices = np.concatenate([vertices, vertices[:1], [[0, 0, 0]]])  # a double, and one unused
    quad = [0, 12, 13, 1]
    polygons = [t for t in triangles.tolist() if not set(t) <= set(quad)] + [quad]
    assert len(polygons) == len(triangles) - 1
    mesh = quiet(write_obj(tmp_path / "a.obj", vertices, polygons))
    np.testing.assert_allclose(mesh.vertices, vertices, atol=1e-6)
    assert len(mesh.triangles) == len(triangles)
    assert mesh.triangles[-2:].tolist() == [[0, 12, 13], [0, 13, 1]]


def test_obj_writes_corners_in_many_ways(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text(
        "# é\nmtllib a.mtl\nv 0 0 0 1.0\nv 100 0 0\r\nv 0 100 0\nvt 0 0\nvn 0 0 1\n"
        "v 0 0 100\nusemtl x\ns 1\nf 1/1/1 2/1/1 3/1/1\nf 1//1 3//1 4//1\nf -4 -1 -3\nf 2 4 3\n",
        encoding="latin-1",
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        mesh = read_mesh(path)
    assert len(mesh.triangles) == 4
    assert {frozenset(t) for t in mesh.triangles.tolist()} == {
        frozenset(t) for t in ([0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2])
    }
    assert volume(mesh) > 0


def test_obj_objects_become_parts_and_groups_that_share_vertices_regions(tmp_path):
    vertices, triangles = egg()
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += ["o shell", "g upper"]
    faces = ["f {} {} {}".format(*(t + 1)) for t in triangles]
    lines += [*faces[:100], "g lower", *faces[100:]]
    lines += [f"v {x} {y} {z}" for x, y, z in 0.5 * vertices]
    lines += ["o core"]
    lines += ["f {} {} {}".format(*(t + 1 + len(vertices))) for t in triangles]
    path = tmp_path / "a.obj"
    path.write_text("\n".join(lines))
    mesh = quiet(path)
    assert [part.name for part in mesh.parts] == ["upper", "core"]
    assert {"upper", "lower", "core"} <= set(mesh.regions)
    np.testing.assert_allclose(mesh.vertices[mesh.get_region("core")], 0.5 * vertices, atol=1e-6)
    both = np.union1d(mesh.get_region("upper"), mesh.get_region("lower"))
    np.testing.assert_array_equal(both, np.arange(len(vertices)))


def test_glb_objects_become_parts_where_they_stand(tmp_path):
    import trimesh

    vertices, triangles = egg()
    scene = trimesh.Scene()
    for name, shift in (("face", 0.0), ("tongue", 0.02)):
        scene.add_geometry(
            trimesh.Trimesh(vertices / 1000, triangles, process=False),
            node_name=name,
            geom_name=name,
            transform=trimesh.transformations.translation_matrix([0, shift, 0]),
        )
    scene.export(tmp_path / "two.glb")
    mesh = quiet(tmp_path / "two.glb", scale=1000)
    assert [part.name for part in mesh.parts] == ["face", "tongue"]
    np.testing.assert_allclose(
        mesh.vertices[mesh.get_region("tongue")], vertices + np.array([0, 20, 0]), atol=1e-3
    )


def test_axes_and_scale_bring_a_mesh_upright(tmp_path):
    vertices, triangles = egg()
    # A z-up program that looks along -y, in metres: its (x, y, z) is our (x, -z, y).
    theirs = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1) / 1000
    path = write_obj(tmp_path / "a.obj", theirs, triangles.tolist())
    mesh = quiet(path, scale=1000, axes="x z -y")
    np.testing.assert_allclose(mesh.vertices, vertices, atol=1e-4)
    assert volume(mesh) > 0


def test_left_handed_axes_keep_the_outside_outside(tmp_path):
    vertices, triangles = egg()
    path = write_obj(tmp_path / "a.obj", vertices * [1, 1, -1], triangles[:, ::-1].tolist())
    mesh = quiet(path, axes="x,y,-z")
    np.testing.assert_allclose(mesh.vertices, vertices, atol=1e-6)
    assert volume(mesh) > 0


def test_triangles_that_face_inwards_are_turned_with_a_warning(tmp_path):
    vertices, triangles = egg()
    path = write_obj(tmp_path / "a.obj", vertices, triangles[:, ::-1].tolist())
    with pytest.warns(MocapFitWarning, match="of 1 objects faced inwards") as caught:
        mesh = read_mesh(path)
    assert volume(mesh) > 0
    # The warning points at the caller.
    assert caught[0].filename == __file__


@pytest.mark.parametrize("depth", [-300.0, 0, 300])
def test_an_open_mask_is_seen_from_its_bulging_side_wherever_it_is(tmp_path, depth):
    vertices, triangles = egg()
    moved = vertices + np.array([0, 0, depth])
    front = triangles[vertices[triangles, 2].mean(axis=1) > 10]
    path = write_obj(tmp_path / "a.obj", moved, front.tolist())
    assert quiet(path).compute_normals()[vertices[:, 2].argmax(), 2] > 0.5
    path = write_obj(tmp_path / "a.obj", moved, front[:, ::-1].tolist())
    with pytest.warns(MocapFitWarning, match="inwards"):
        assert read_mesh(path).compute_normals()[vertices[:, 2].argmax(), 2] > 0.5


def test_a_flat_sheet_faces_where_it_faced(tmp_path):
    square = [[0, 0, 0], [100, 0, 0], [100, 100, 0], [0, 100, 0]]
    for polygon, normal in (([0, 1, 2, 3], 1), ([3, 2, 1, 0], -1)):
        mesh = quiet(write_obj(tmp_path / "a.obj", square, [polygon]))
        np.testing.assert_allclose(mesh.compute_normals(), [[0, 0, normal]] * 4)


def test_triangles_without_area_are_left_out_with_a_warning(tmp_path):
    vertices, triangles = egg()
    path = write_obj(
        tmp_path / "a.obj", vertices, [*triangles.tolist(), [0, 0, 1], [5, 7, 5], [3, 3, 3]]
    )
    with pytest.warns(MocapFitWarning, match="3 triangles without area"):
        mesh = read_mesh(path)
    assert len(mesh.triangles) == len(triangles)


def thin_triangle(area: float) -> list[list[float]]:
    """Corners of a triangle on a base of 1 mm."""
    return [[0.0, 0, 0], [1, 0, 0], [0, 2 * area, 0]]


@pytest.mark.parametrize(("area", "count"), [(1.01e-10, 1), (0.99e-10, 0)])
def test_a_triangle_of_1e_10_square_millimetres_has_no_area(tmp_path, area, count):
    vertices, triangles = egg()
    path = tmp_path / "a.obj"
    corners = [*vertices.tolist(), *thin_triangle(area)]
    thin = [len(vertices) + i for i in range(3)]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in corners]
    lines += ["f {} {} {}".format(*(np.add(t, 1))) for t in [*triangles.tolist(), thin]]
    path.write_text("\n".join(lines))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        assert len(read_mesh(path).triangles) == len(triangles) + count


def test_three_vertices_on_a_line_have_no_area_whatever_rounding_does(tmp_path):
    generator = np.random.default_rng(2)
    vertices, triangles = egg()
    starts, ends = generator.uniform(-100, 100, (2, 50, 3))
    middles = starts + generator.uniform(0, 1, (50, 1)) * (ends - starts)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    flat = np.stack([starts, middles, ends], axis=1).reshape(-1, 3)
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in flat.tolist()]
    lines += ["f {} {} {}".format(*(t + 1)) for t in triangles]
    first = len(vertices) + 1
    lines += [f"f {i} {i + 1} {i + 2}" for i in range(first, first + 150, 3)]
    path = tmp_path / "a.obj"
    path.write_text("\n".join(lines))
    with pytest.warns(MocapFitWarning, match="50 triangles without area"):
        assert len(read_mesh(path).triangles) == len(triangles)


@pytest.mark.parametrize(
    ("across", "fits"), [(79.9, False), (80, True), (600, True), (600.1, False)]
)
def test_heads_are_8_to_60_centimetres_across(tmp_path, across, fits):
    vertices, triangles = egg()
    path = write_obj(tmp_path / "a.obj", vertices * across / np.ptp(vertices[:, 1]), triangles)
    if fits:
        assert np.ptp(quiet(path).vertices[:, 1]) == pytest.approx(across, abs=1e-3)
    else:
        with pytest.raises(DataError, match=r"size of a head .*expected 80 to 600 mm"):
            read_mesh(path)


def test_edges_of_three_triangles_are_reported(tmp_path):
    vertices, triangles = egg()
    vertices = np.concatenate([vertices, [[200.0, 0, 0]]])
    fin = [*triangles[0, :2].tolist(), len(vertices) - 1]
    path = write_obj(tmp_path / "a.obj", vertices, [*triangles.tolist(), fin])
    with pytest.warns(MocapFitWarning, match="1 edges belong to more than two"):
        read_mesh(path)


def ply_header(kind, vertices, faces):
    return (
        f"ply\nformat {kind} 1.0\ncomment made by hand\nelement vertex {vertices}\n"
        "property float x\nproperty float y\nproperty double z\nproperty uchar red\n"
        f"element face {faces}\nproperty list uchar int vertex_index\nproperty short flag\n"
        "end_header\n"
    )


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_with_polygons_of_different_lengths(tmp_path, kind):
    vertices, triangles = egg()
    quad = [0, 12, 13, 1]
    polygons = [*(t for t in triangles.tolist() if not set(t) <= set(quad)), quad]
    data = ply_header(kind, len(vertices), len(polygons)).encode()
    if kind == "ascii":
        rows = [f"{x} {y} {z} 200" for x, y, z in vertices]
        rows += [f"{len(p)} {' '.join(map(str, p))} -3" for p in polygons]
        data += "\n".join(rows).encode()
    else:
        order = "<" if "little" in kind else ">"
        data += b"".join(struct.pack(f"{order}ffdB", *v, 200) for v in vertices)
        data += b"".join(struct.pack(f"{order}B{len(p)}ih", len(p), *p, -3) for p in polygons)
    path = tmp_path / "a.ply"
    path.write_bytes(data)
    mesh = quiet(path)
    np.testing.assert_allclose(mesh.vertices, vertices, atol=1e-4)
    assert len(mesh.triangles) == len(triangles)
    assert mesh.triangles[-2:].tolist() == [[0, 12, 13], [0, 13, 1]]


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("char", "b"),
        ("uchar", "B"),
        ("short", "h"),
        ("ushort", "H"),
        ("int", "i"),
        ("uint", "I"),
        ("int8", "b"),
        ("uint8", "B"),
        ("int16", "h"),
        ("uint16", "H"),
        ("int32", "i"),
        ("uint32", "I"),
    ],
)
def test_ply_takes_every_type_of_whole_number(tmp_path, name, code, ending):
    vertices, triangles = egg(4, 6)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property float32 x\nproperty float64 y\nproperty double z\n"
        f"element extra 3\nproperty {name} odd\n"
        f"element face {len(triangles)}\nproperty list {name} {name} vertex_indices\nend_header\n"
    )
    data = header.replace("\n", ending).encode()
    data += b"".join(struct.pack("<fdd", *v) for v in vertices) + struct.pack(f"<3{code}", 1, 2, 3)
    data += b"".join(struct.pack(f"<4{code}", 3, *t) for t in triangles.tolist())
    path = tmp_path / "a.ply"
    path.write_bytes(data)
    mesh = quiet(path)
    np.testing.assert_allclose(mesh.vertices, vertices, atol=1e-5)
    np.testing.assert_array_equal(mesh.triangles, triangles)


def test_names_that_come_again_are_numbered(tmp_path):
    vertices, triangles = egg()
    lines = []
    for i in range(3):
        lines += [f"o {'eye' if i else 'head'}", f"g {'eye' if i else 'head'}"]
        lines += [f"v {x} {y} {z}" for x, y, z in (1 - 0.2 * i) * vertices]
        lines += ["f {} {} {}".format(*(t + 1 + i * len(vertices))) for t in triangles]
        lines += ["g", *([] if i else ["f 1 2 14"])]
    path = tmp_path / "a.obj"
    path.write_text("\n".join(lines))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        mesh = read_mesh(path)
    # The two eyes are one name and so one object; the nameless triangle is on the head.
    assert [part.name for part in mesh.parts] == ["head", "eye"]
    assert _make_unique(["eye", "eye", "head", "eye"]) == ["eye", "eye_2", "head", "eye_3"]


V, T = egg()
NAN_ROW = np.where(np.arange(len(V))[:, None] == 5, np.nan, V)


def obj_text(*lines):
    return lambda path: path.write_text("\n".join(lines))


def binary(path):
    path.write_bytes(bytes(range(256)) * 40)


def cut(library):
    def write(path):
        write_with(library, path, V, T)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    return write


def points_ply(path):
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n0 0 0\n100 0 0\n0 100 0\n"
    )


BAD = {
    "no such file": ("a.obj", None, FileFormatError, "no such file"),
    "a folder": ("a.obj", lambda p: p.mkdir(), FileFormatError, "a folder"),
    "empty file": ("a.obj", lambda p: p.touch(), FileFormatError, "empty"),
    "empty ply": ("a.ply", lambda p: p.touch(), FileFormatError, "empty"),
    "unknown format": ("a.max", lambda p: p.write_text("x"), FileFormatError, "not a mesh format"),
    "no ending": ("head", lambda p: p.write_text("x"), FileFormatError, "not a mesh format"),
    "obj without faces": (
        "a.obj",
        obj_text("v 0 0 0", "v 1 0 0", "v 0 1 0"),
        DataError,
        "no triangles",
    ),
    "obj of comments": ("a.obj", obj_text("# nothing"), DataError, "no triangles"),
    "text for a number": ("a.obj", obj_text("v 0 zero 0"), FileFormatError, "line 1"),
    "two coordinates": ("a.obj", obj_text("", "v 0 0"), FileFormatError, "line 2"),
    "face with two corners": (
        "a.obj",
        obj_text("v 0 0 0", "v 1 0 0", "f 1 2"),
        FileFormatError,
        "line 3",
    ),
    "vertex not there": (
        "a.obj",
        obj_text("v 0 0 0", "v 1 0 0", "v 0 1 0", "f 1 2 9"),
        FileFormatError,
        "vertex 9",
    ),
    "vertex zero": (
        "a.obj",
        obj_text("v 0 0 0", "v 1 0 0", "v 0 1 0", "f 0 1 2"),
        FileFormatError,
        "vertex 0",
    ),
    "not a number": ("a.obj", lambda p: write_obj(p, NAN_ROW, T), DataError, "not finite"),
    "infinite": (
        "a.obj",
        obj_text("v 0 0 0", "v inf 0 0", "v 0 1 0", "f 1 2 3"),
        DataError,
        "not finite",
    ),
    "in metres": ("a.obj", lambda p: write_obj(p, V / 1000, T), DataError, "scale=1000"),
    "in centimetres": ("a.obj", lambda p: write_obj(p, V / 10, T), DataError, "scale=10"),
    "huge": ("a.obj", lambda p: write_obj(p, V * 10, T), DataError, "scale=0.1"),
    "all at one place": ("a.obj", lambda p: write_obj(p, V * 0, T), DataError, "one position"),
    "a line": (
        "a.obj",
        lambda p: write_obj(p, [[0, 0, 0], [0, 100, 0], [0, 200, 0]], [[0, 1, 2]]),
        DataError,
        "has an area",
    ),
    "binary obj": ("a.obj", binary, MocapFitError, "a.obj"),
    "binary ply": ("a.ply", binary, MocapFitError, "a.ply"),
    "binary stl": ("a.stl", binary, MocapFitError, "a.stl"),
    "binary glb": ("a.glb", binary, MocapFitError, "a.glb"),
    "binary off": ("a.off", binary, MocapFitError, "a.off"),
    "broken gltf": ("a.gltf", lambda p: p.write_text("{"), MocapFitError, "a.gltf"),
    "ply cut off": ("a.ply", cut("pyvista"), FileFormatError, "cut off"),
    "stl cut off": ("a.stl", cut("pyvista"), MocapFitError, "a.stl"),
    "glb cut off": ("a.glb", cut("trimesh"), MocapFitError, "a.glb"),
    "ply of unknown numbers": (
        "a.ply",
        obj_text("ply", "format ascii 1.0", "element vertex 1", "property quad x", "end_header"),
        FileFormatError,
        "line 4",
    ),
    "ply text cut off": (
        "a.ply",
        lambda p: p.write_text(
            ply_header("ascii", 3, 2) + "0 0 0 9\n100 0 0 9\n0 100 0 9\n3 0 1 2 0\n"
        ),
        FileFormatError,
        "ends too soon.*expected 3 vertex, 2 face",
    ),
    "relative vertex before the first": (
        "a.obj",
        obj_text("v 0 0 0", "v 1 0 0", "v 0 1 0", "f -1 -2 -4"),
        FileFormatError,
        "vertex -4",
    ),
    "ply with text for a number": (
        "a.ply",
        lambda p: p.write_text(ply_header("ascii", 1, 0) + "0 zero 0 0"),
        FileFormatError,
        "zero",
    ),
    "ply without vertices": (
        "a.ply",
        obj_text("ply", "format ascii 1.0", "end_header"),
        FileFormatError,
        "no vertices",
    ),
    "ply that names a vertex too many": (
        "a.ply",
        lambda p: p.write_text(
            ply_header("ascii", 3, 1) + "0 0 0 9\n100 0 0 9\n0 100 0 9\n3 0 1 3 0"
        ),
        DataError,
        "not there .*found 3, expected 0 to 2",
    ),
    "ply that names a vertex below 0": (
        "a.ply",
        lambda p: p.write_text(
            ply_header("ascii", 3, 1) + "0 0 0 9\n100 0 0 9\n0 100 0 9\n3 0 1 -1 0"
        ),
        DataError,
        "not there .*found -1, expected 0 to 2",
    ),
    "ply of points": ("a.ply", points_ply, DataError, "no triangles"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_meshes_are_refused_with_a_reason(tmp_path, kind, capfd):
    name, write, error, message = BAD[kind]
    path = tmp_path / name
    if write is not None:
        write(path)
    with pytest.raises(error, match=message) as caught:
        read_mesh(path)
    text = str(caught.value)
    assert str(path) in text
    assert "\n" not in text
    shown = capfd.readouterr()
    assert shown.out + shown.err == ""


@pytest.mark.parametrize("axes", ["x y", "x y y", "x y q", "--x y z", "x y z w", "1 2 3", " "])
def test_impossible_axes_are_refused(tmp_path, axes):
    path = write_obj(tmp_path / "a.obj", V, T)
    if not axes.strip():
        assert len(read_mesh(path, axes=None).vertices) == len(V)
    with pytest.raises(ConfigurationError, match="axes"):
        read_mesh(path, axes=axes)


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf])
def test_impossible_scales_are_refused(tmp_path, scale):
    path = write_obj(tmp_path / "a.obj", V, T)
    with pytest.raises(ConfigurationError, match="scale"):
        read_mesh(path, scale=scale)


def test_a_scale_may_shrink(tmp_path):
    path = write_obj(tmp_path / "a.obj", 10 * V, T)
    np.testing.assert_allclose(quiet(path, scale=0.1).vertices, V, atol=1e-6)


@pytest.mark.parametrize("ending", [".vtk", ".vtp", ".vtu", ".vtm", ".wrl", ".VTK"])
def test_formats_whose_readers_end_the_process_are_refused_in_words(tmp_path, ending):
    path = tmp_path / f"head{ending}"
    path.write_text("# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 9 float\n")
    with pytest.raises(FileFormatError, match=r"not a mesh format.*\.stl.*Save it in one of these"):
        read_mesh(path)


PLY = ply_header("ascii", 3, 1) + "0 0 0 9\n100 0 0 9\n0 100 0 9\n"
OFF = "OFF\n3 1 0\n0 0 0\n100 0 0\n0 100 0\n"


@pytest.mark.parametrize(
    ("name", "text"),
    [(f"a{i}.ply", f"{PLY}{line}") for i, line in enumerate(BAD_POLYGONS)]
    + [(f"a{i}.off", f"{OFF}{line}") for i, line in enumerate(BAD_POLYGONS)]
    + [
        (f"b{i}.ply", f"{PLY.replace(*change)}3 0 1 2 0\n")
        for i, change in enumerate(
            [
                ("vertex 3", "vertex 3000000000"),
                ("vertex 3", "vertex -3"),
                ("vertex 3", f"vertex {'9' * 5000}"),
                ("face 1", "face 99999999999999999999"),
                ("face 1", "face -1"),
                ("property float y", "property list uchar float y"),
            ]
        )
    ]
    + [
        (f"b{i}.off", f"{OFF.replace('3 1 0', counts)}3 0 1 2\n")
        for i, counts in enumerate(
            ["3000000000 1 0", "3 3000000000 0", "-3 1 0", "3 -1 0", "3 2 0", "4 1 0", "3", "x y"]
        )
    ],
)
def test_impossible_counts_and_numbers_are_refused(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(MocapFitError, match=name):
        read_mesh(path)


def test_a_text_that_is_cut_off_is_no_smaller_mesh(tmp_path):
    for ending in (".off", ".stl"):
        path = write_with("trimesh", tmp_path / f"a{ending}", V, T)
        content = path.read_bytes()
        path.write_bytes(content[: len(content) // 2])
        with pytest.raises(FileFormatError, match=r"cut off"):
            read_mesh(path)


@pytest.mark.parametrize("count", [0, 1, 215, 217, 2**31, 2**32 - 1])
def test_an_stl_file_is_as_long_as_it_says(tmp_path, count):
    path = write_with("pyvista", tmp_path / "a.stl", V, T)
    content = bytearray(path.read_bytes())
    struct.pack_into("<I", content, 80, count)
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match=r"not as long as it says.*cut off"):
        read_mesh(path)


def change_glb(path, change):
    """Write the egg as GLB with another description."""
    data = write_with("trimesh", path, V, T).read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    content = json.loads(data[20 : 20 + length])
    change(content)
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    size = 20 + len(text) + len(rest)
    path.write_bytes(b"glTF" + struct.pack("<III", 2, size, len(text)) + b"JSON" + text + rest)


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c["accessors"][0].update(count=3_000_000_000),
        lambda c: (c["accessors"][0].pop("bufferView"), c["accessors"][0].update(count=10**9)),
        lambda c: c["accessors"][0].update(count=-1),
        lambda c: c["accessors"][0].update(count="many"),
        lambda c: c["accessors"][1].update(byteOffset=10**12),
        lambda c: c.update(buffers=[{"uri": "/dev/zero", "byteLength": 10}]),
        lambda c: c.update(buffers=[{"uri": "../../etc/passwd", "byteLength": 10}]),
        lambda c: c["nodes"][0].update(matrix=[1e300] * 16),
        lambda c: c["nodes"][0].update(matrix=[float("nan")] * 16),
        lambda c: c["nodes"][0].update(name="\ud800"),
        lambda c: c.update(accessors={}),
    ],
)
def test_glb_that_claims_too_much_or_nonsense_is_refused(tmp_path, change):
    path = tmp_path / "a.glb"
    change_glb(path, change)
    with pytest.raises(MocapFitError, match=r"a\.glb"):
        read_mesh(path)


def test_an_element_of_a_scene_counts_as_the_largest_that_there_is(tmp_path, monkeypatch):
    path = tmp_path / "a.glb"
    count = 0

    def add(content):
        nonlocal count
        count = sum(accessor["count"] for accessor in content["accessors"])

    change_glb(path, add)
    monkeypatch.setenv(size_limit.VARIABLE, str(64 * count))
    assert len(read_mesh(path).vertices) == len(V)
    monkeypatch.setenv(size_limit.VARIABLE, str(64 * count - 1))
    with pytest.raises(FileFormatError, match="the scene claims"):
        read_mesh(path)


def test_a_mesh_that_a_scene_repeats_counts_each_time(tmp_path, monkeypatch):
    path = tmp_path / "a.glb"
    change_glb(
        path,
        lambda c: (
            c["nodes"].extend([{"mesh": 0}] * 200),
            c["scenes"][0].update(nodes=list(range(len(c["nodes"])))),
        ),
    )
    monkeypatch.setenv(size_limit.VARIABLE, "500kB")
    with pytest.raises(FileFormatError, match="the scene claims"):
        read_mesh(path)


def test_thousands_of_objects_take_little_time_and_memory(tmp_path):
    """A relation of each object to each of the others would be 3 GB here."""
    lines = ["v 0 0 0", "v 200 0 0", "v 0 200 0"]
    lines += [f"g part_{i}\nf 1 2 3" for i in range(20_000)]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    with pytest.warns(MocapFitWarning):
        mesh = read_mesh(tmp_path / "a.obj")
    assert len(mesh.parts) == 1
    assert len(mesh.regions) == 20_000


def test_the_suggested_scale_works(tmp_path):
    path = write_obj(tmp_path / "a.obj", V / 25.4, T)  # inches
    with pytest.raises(DataError, match=r"scale=(\S+)\.$|scale=(\S+)") as caught:
        read_mesh(path)
    suggested = float(str(caught.value).split("scale=")[1].rstrip("."))
    assert len(read_mesh(path, scale=suggested).vertices) == len(V)
