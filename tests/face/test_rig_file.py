"""Rig files: what can be written, and what is wrong is named with its place."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from mocap_fit.errors import ConfigurationError, FileFormatError
from mocap_fit.face import Mesh, load_face
from mocap_fit.face import rig_file as rig_file_module
from mocap_fit.face.builtin import load_built_in_head
from mocap_fit.face.parke import ParkeRig
from mocap_fit.face.rig_file import RigFile, list_shipped_rigs, read_rig_file
from mocap_fit.face.rig_tables import (
    Constraint,
    Point,
    Region,
    Weight,
    compute_surface_distance,
)

FACES = Path(__file__).parents[2] / "fixtures" / "faces"

PLANE = """
mesh = "mask.obj"
scale = 1000
axes = "x z -y"
[parts]
skin = "Mask"
[feature_points]
8.3 = 56
8.4 = 70
[parameters]
open = [-1, 2]
[weights.all]
centre = "8.3"
radii = [50, 50, 50]
[weights.field]
values = [{ value = 1, feature_points = "8.3" }, { value = 0, feature_points = "8.4" }]
multiply = "1 - all"
parts = { LowerTeeth = 0.5 }
[[transforms]]
parameter = "open"
kind = "rotation"
weight = "field"
axis = [1, 0, 0]
degrees = 10
centre = [0, 10, 20]
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    shutil.copy(FACES / "mask.obj", folder / "mask.obj")
    return path


def refused(folder: Path, text: str) -> str:
    """The message a rig file is refused with; it is one line and names the file."""
    path = written(folder, text)
    with pytest.raises(ConfigurationError) as caught:
        load_face(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    return message


VALUES = '[{ value = 1, feature_points = "8.3" }, { value = 0, feature_points = "8.4" }]'
ODD_VALUES = (
    "0", "-1", "2", "1e300", "nan", "1" + 400 * "0", "true", '""', '"x\\ny"', '"8.1"', "[]", "{}",
    "[1, 2, 3]", '["8.1"]', "{ at = [] }", "[[]]", "2020-01-01", "{ a = { b = 1 } }",
)  # fmt: skip
MASK = (FACES / "mask.toml").read_text(encoding="utf-8")


# What is replaced by what, the place that the message names, and what it says.
WRONG_MASKS = {
    "not TOML": ("extends =", "extends", "", "not TOML"),
    "key twice": ("scale = 1000", "scale = 1000\nscale = 1", "", "not TOML"),
    "unknown key": ("scale = 1000", "scael = 1000", "scael", "no such setting"),
    "unknown table": ("[points]", "[pionts]", "pionts", "no such setting"),
    "wrong type": ("scale = 1000", 'scale = "big"', "scale", "number"),
    "number as text": ("scale = 1000", 'scale = "1000"', "scale", "number"),
    "scale nil": ("scale = 1000", "scale = 0", "scale", "greater than 0"),
    "scale NaN": ("scale = 1000", "scale = nan", "scale", "finite|greater"),
    "extends unknown": (
        'extends = "parke"',
        'extends = "park"',
        "extends",
        "expected one of parke",
    ),
    "extends a number": ('extends = "parke"', "extends = 1", "extends", "string"),
    "mesh missing": ('"mask.obj"', '"msak.obj"', "mesh, 'msak.obj'", "no such file"),
    "mesh in metres": ("scale = 1000\n", "", "mesh, 'mask.obj'", "size of a head .*scale=1000"),
    "axes unknown": ('"x z -y"', '"x z w"', "mesh, 'mask.obj'", "x, y and z"),
    "part unknown": ('skin = "Mask"', 'skin = "Face"', "parts.skin", "one of Mask, LowerTeeth"),
    "no skin": ('skin = "Mask"\n', "", "", r"lacks .*part skin \(for weights\.below\.on\)"),
    "point is text": ("8.1 = 147", '8.1 = "lip"', "feature_points.8.1", "vertex number, or"),
    "point is true": ("8.1 = 147", "8.1 = true", "feature_points.8.1", "vertex number, or"),
    "point is flat": ("8.1 = 147", "8.1 = [1, 2]", "feature_points.8.1", "vertex number, or"),
    "point is NaN": ("8.1 = 147", "8.1 = [nan, 0, 0]", r"feature_points.8.1", "finite"),
    "point negative": ("8.1 = 147", "8.1 = -1", "feature_points.8.1", "vertex number, or"),
    "point too high": (
        "8.1 = 147",
        "8.1 = 466",
        "feature_points.8.1",
        "found 466, expected 0 to 465",
    ),
    "point off the mesh": (
        "[-24, 0, 83]",
        "[-24, 0, 830]",
        "feature_points.8.4",
        "not on the mesh",
    ),
    "point missing": ("8.2 = 189\n", "", "", r"lacks .*feature point 8\.2 \(for weights\.below"),
    "lips sewn up": ("2.3 = 77", "2.3 = 63", "", "2.2 and 2.3 are one vertex"),
    "corners coincide": ("[-24, 0, 83]", "56", "", "mouth's width apart .*found 0 mm"),
    "corners swapped": ("8.3 = 56\n8.4 = [-24, 0, 83]", "8.3 = 70\n8.4 = 56", "", "to the left"),
    "no joint": (
        "jaw_joint = [0, 30, 0]\n",
        "",
        "",
        r"feature points 10\.7 \(for points\.jaw_joint\), 10\.8",
    ),
    "joint flat": ("[0, 30, 0]", "[0, 30]", "points.jaw_joint.2", "missing"),
    "joint nowhere": (
        "[0, 30, 0]",
        "{}",
        "points.jaw_joint",
        "feature points it is at, or a position",
    ),
    "region missing": (
        "upper_lip =",
        "uper_lip =",
        "",
        r"lacks .*region upper_lip \(for weights\.below\.values\.1\)",
    ),
    "region nothing": ('{ near = "2.1", within = 15 }', "{}", "regions.chin", "give vertices"),
    "region too small": ("within = 15", "within = 0", "regions.chin.within", "greater than 0"),
    "region without extent": (", within = 15", "", "regions.chin", "near and within"),
    "region near nothing": (
        'near = "2.1"',
        'near = "2.99"',
        "regions.chin",
        "no feature point 2.99",
    ),
    "region of no part": (
        '{ near = "2.1", within = 15 }',
        '{ part = "Chin" }',
        "regions.chin",
        "no part 'Chin'",
    ),
    "region beyond": ("[57, 69]", "[57, 6900000000]", "regions.upper_lip", "found 6900000000"),
    "region backwards": (
        "[57, 69]",
        "[69, 57]",
        "regions.upper_lip.vertices.0",
        "pair .first, last.",
    ),
    "region of three": (
        "[57, 69]",
        "[57, 69, 70]",
        "regions.upper_lip.vertices.0",
        "pair .first, last.",
    ),
    "region empty": (
        "{ vertices = [[57, 69], [85, 97], [113, 125], [141, 153]] }",
        "{ vertices = [] }",
        "regions.upper_lip",
        "holds no vertex",
    ),
    "regions a list": ("[regions]", "[[regions]]", "regions", "dictionary"),
}

WRONG_PLANES = {
    "no parameters": (
        "[parameters]\nopen = [-1, 2]",
        "",
        "transforms.0.parameter",
        "no parameter 'open'",
    ),
    "bounds without 0": ("[-1, 2]", "[0.5, 2]", "parameters.open", "hold 0"),
    "bounds upside down": ("[-1, 2]", "[2, -1]", "parameters.open", "hold 0"),
    "bounds without room": ("[-1, 2]", "[-1, 0]", "parameters.open", "upper one above"),
    "one bound": ("[-1, 2]", "[2]", "parameters.open.1", "missing"),
    "bound infinite": ("[-1, 2]", "[-1, inf]", "parameters.open.1", "finite"),
    "bound as text": ("[-1, 2]", '[-1, "2"]', "parameters.open.1", "number"),
    "unmoved parameter": (
        "open = [-1, 2]",
        "open = [-1, 2]\nshut = [0, 1]",
        "parameters.shut",
        "no transform",
    ),
    "unknown parameter": (
        'parameter = "open"',
        'parameter = "opne"',
        "transforms.0.parameter",
        "no parameter 'opne'; there are open",
    ),
    "unknown weight": (
        'weight = "field"',
        'weight = "feild"',
        "transforms.0.weight",
        "no weight 'feild'; there are all, field",
    ),
    "weight below": (
        '"1 - all"',
        '"1 - field"',
        "weights.field.multiply",
        "no weight 'field' above this one; those above are all",
    ),
    "multiply misspelt": ('"1 - all"', '"1-all"', "weights.field.multiply", "no weight '1-all'"),
    "value above 1": (
        "value = 1,",
        "value = 1.5,",
        "weights.field.values.0.value",
        "less than or equal to 1",
    ),
    "value NaN": (
        "value = 1,",
        "value = nan,",
        "weights.field.values.0.value",
        "finite|less|greater",
    ),
    "value missing": ("value = 1, ", "", "weights.field.values.0.value", "missing"),
    "value nowhere": (
        'value = 1, feature_points = "8.3"',
        "value = 1",
        "weights.field.values.0",
        "name regions",
    ),
    "unknown point": (
        'value = 1, feature_points = "8.3"',
        'value = 1, feature_points = "8.9"',
        "",
        r"lacks .*8\.9 \(for weights\.field\.values\.0\)",
    ),
    "unknown region": (
        'value = 1, feature_points = "8.3"',
        'value = 1, regions = "lip"',
        "",
        r"lacks .*region lip \(for weights\.field\.values\.0\)",
    ),
    "value on another part": (
        VALUES,
        '[{ value = 1, regions = "LowerTeeth" }]',
        "weights.field",
        "no vertex of the part 'skin' has a value",
    ),
    "part share": (
        "LowerTeeth = 0.5",
        "LowerTeeth = 5",
        "weights.field.parts.LowerTeeth",
        "less than or equal to 1",
    ),
    "both kinds": (
        "radii = [50, 50, 50]",
        "radii = [50, 50, 50]\nvalues = [{ value = 1, feature_points = '8.3' }]",
        "weights.all",
        "either centre and radii, or values",
    ),
    "no radii": ("radii = [50, 50, 50]\n", "", "weights.all", "either centre and radii"),
    "radius nil": ("[50, 50, 50]", "[50, 0, 50]", "weights.all", "above 0"),
    "two radii": ("[50, 50, 50]", "[50, 50]", "weights.all.radii.2", "missing"),
    "plateau whole": ("radii =", "plateau = 1\nradii =", "weights.all.plateau", "less than 1"),
    "on no part": (
        "[weights.all]",
        '[weights.all]\non = "hide"',
        "",
        r"lacks .*part hide \(for weights\.all\.on\)",
    ),
    "centre unknown": (
        'centre = "8.3"',
        'centre = "3.8"',
        "",
        r"lacks .*3\.8 \(for weights\.all\.centre\)",
    ),
    "kind unknown": ('kind = "rotation"', 'kind = "twist"', "transforms.0.kind", "rotation"),
    "axis nil": ("axis = [1, 0, 0]", "axis = [0, 0, 0]", "transforms.0", "no direction"),
    "centre missing": ("centre = [0, 10, 20]\n", "", "transforms.0", "a rotation needs centre"),
    "degrees missing": ("degrees = 10\n", "", "transforms.0", "a rotation needs degrees"),
    "another kind's amount": (
        "degrees = 10\n",
        "degrees = 10\nby = [1, 2, 3]\n",
        "transforms.0",
        "a rotation has no by",
    ),
    "moves nothing": ("degrees = 10", "degrees = 0", "transforms.0", "moves nothing"),
    "weight of nothing": ('weight = "field"', 'weight = "all"', "transforms.0", "moves nothing"),
    "rig kind unknown": (
        'mesh = "mask.obj"',
        'mesh = "mask.obj"\nkind = "spring"',
        "kind",
        "no rig 'spring' .*parke",
    ),
    "axes turned": ('"x z -y"', '"-x z y"', "", "8.3 is not to the left of 8.4"),
    "follows nothing": (
        "[parameters]",
        '[follow]\nLowerTeeth = "gum"\n[parameters]',
        "",
        r"lacks .*region gum \(for follow\.LowerTeeth\)",
    ),
}


class TestRefusals:
    @pytest.mark.parametrize("case", WRONG_MASKS)
    def test_a_face_of_ones_own(self, case: str, tmp_path: Path) -> None:
        old, new, place, says = WRONG_MASKS[case]
        self.check(MASK, old, new, place, says, tmp_path)

    @pytest.mark.parametrize("case", WRONG_PLANES)
    def test_a_rig_of_ones_own(self, case: str, tmp_path: Path) -> None:
        old, new, place, says = WRONG_PLANES[case]
        text = PLANE
        if case == "weight of nothing":
            text = text.replace('centre = "8.3"\n', "centre = [0, 900, 0]\n")
        self.check(text, old, new, place, says, tmp_path)

    def check(self, text: str, old: str, new: str, place: str, says: str, folder: Path) -> None:
        assert text.count(old) == 1, "the case no longer changes the file"
        message = refused(folder, text.replace(old, new))
        if place:
            assert f"wrong at {place}: " in message or f"wrong: {place}: " in message
        assert re.search(says, message)

    def test_the_files_are_right_before_they_are_made_wrong(self, tmp_path: Path) -> None:
        assert load_face(written(tmp_path, PLANE)).parameter_names == ("open",)
        assert len(load_face(written(tmp_path, MASK)).parameter_names) == 10

    @pytest.mark.parametrize("text", [MASK, PLANE], ids=["mask", "plane"])
    def test_any_line_may_hold_anything(self, text: str, tmp_path: Path) -> None:
        lines = text.splitlines()
        taken, messages = 0, []
        for i, line in enumerate(lines):
            key, equals, _ = line.partition(" = ")
            for value in ODD_VALUES if equals else []:
                changed = [*lines[:i], f"{key} = {value}", *lines[i + 1 :]]
                path = written(tmp_path, "\n".join(changed))
                try:
                    load_face(path)
                    taken += 1
                except (ConfigurationError, FileFormatError) as error:
                    messages.append(str(error))
        assert [m for m in messages if "\n" in m or not m.startswith(str(path))] == []
        assert len(messages) > 5 * taken > 0

    @pytest.mark.parametrize(
        ("content", "says"),
        [
            (b"", "no parameters or no transforms"),
            (b"[parameters]\nopen = [0, 1]", "no parameters or no transforms"),
            (b"\xff\xfe\x00", "cannot be read"),
            (b"a = " + b"[" * 5000, "not TOML"),
            (b"extends = 'parke'\nmesh = ''", "mesh"),
        ],
    )
    def test_files_that_are_nothing_of_the_kind(
        self, content: bytes, says: str, tmp_path: Path
    ) -> None:
        path = tmp_path / "rig.toml"
        path.write_bytes(content)
        with pytest.raises((ConfigurationError, FileFormatError), match=says) as caught:
            load_face(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_no_file_and_a_folder(self, tmp_path: Path) -> None:
        for path in (tmp_path / "none.toml", tmp_path):
            with pytest.raises(FileFormatError, match=r"(cannot be read|no such) .*parke"):
                load_face(path)

    def test_everything_that_is_missing_is_named_at_once(self, tmp_path: Path) -> None:
        message = refused(
            tmp_path, 'extends = "parke"\nmesh = "mask.obj"\nscale = 1000\naxes = "x z -y"'
        )
        for name in ("8.1", "8.2", "8.3", "8.4", "2.1", "2.2", "2.3", "10.7", "10.10"):
            assert f" {name} (for " in message
        for name in ("upper_lip", "lower_lip", "skin"):
            assert f" {name} (for " in message
        assert "[regions]" in message


class TestWhatIsTaken:
    def test_the_shipped_rig_is_there(self) -> None:
        assert list_shipped_rigs() == ("parke",)
        assert len(read_rig_file("parke").parameters) == 10

    def test_dotted_and_quoted_names_are_the_same(self, tmp_path: Path) -> None:
        plain = written(tmp_path, "[feature_points]\n8.1 = 3\n8.10 = 4\n2.1 = [1, 2, 3]")
        one = read_rig_file(plain).feature_points
        quoted = written(tmp_path, '[feature_points]\n"8.1" = 3\n"8.10" = 4\n"2.1" = [1, 2, 3]')
        assert one == read_rig_file(quoted).feature_points
        assert one == {"8.1": 3, "8.10": 4, "2.1": (1, 2, 3)}

    def test_the_example_of_the_docstring_is_a_rig_file(self, tmp_path: Path) -> None:
        lines = (rig_file_module.__doc__ or "").splitlines()
        example = "\n".join(line[4:] for line in lines if line.startswith("    "))
        rig_file = read_rig_file(written(tmp_path, example))
        assert rig_file.feature_points["8.3"] == (25, 0, 90)
        assert rig_file.regions["lower_lip"].vertices == (1187, 1188, (1190, 1215))
        mask = load_face(FACES / "mask.toml").mesh
        needed = {name for kind, name in rig_file._list_needs(mask) if kind != "part"}
        assert needed == {*rig_file.feature_points, *rig_file.regions}

    def test_one_entry_can_be_changed_and_the_others_stay(self, tmp_path: Path) -> None:
        path = written(
            tmp_path,
            'extends = "parke"\n[parameters]\njaw_shift = [-3, 3]\n'
            "[weights.left_corner]\ncentre = '8.3'\nradii = [9, 9, 9]\n",
        )
        changed, shipped = read_rig_file(path), read_rig_file("parke")
        assert changed.parameters == {**shipped.parameters, "jaw_shift": (-3, 3)}
        assert list(changed.weights) == list(shipped.weights)
        assert changed.weights["left_corner"].radii == (9, 9, 9)
        assert changed.weights["jaw"] == shipped.weights["jaw"]
        assert changed.transforms == shipped.transforms

    def test_transforms_of_ones_own_bring_their_parameters(self, tmp_path: Path) -> None:
        path = written(
            tmp_path,
            'extends = "parke"\n[parameters]\npout = [0, 1]\n[[transforms]]\n'
            'parameter = "pout"\nkind = "translation"\nweight = "lips"\nby = [0, 0, 5]\n',
        )
        assert list(read_rig_file(path).parameters) == ["pout"]
        rig = load_face(path)
        assert rig.deform([1.0]).shape == rig.mesh.vertices.shape

    @pytest.mark.parametrize("axis", ["[1, 0, 0]", "[0.5, 0, 0]"])
    def test_a_rig_of_ones_own_does_what_it_says(self, axis: str, tmp_path: Path) -> None:
        rig = load_face(written(tmp_path, PLANE.replace("[1, 0, 0]", axis)))
        assert isinstance(rig, ParkeRig)
        assert rig.bounds.tolist() == [[-1, 2]]
        mesh = rig.mesh
        moved = rig.deform([1.0]) - mesh.vertices
        # The right corner has no share, the left one loses its own to `1 - all`.
        assert np.abs(moved[[56, 70]]).max() == 0
        tooth = mesh.get_region("LowerTeeth")[0]
        arm = mesh.vertices[tooth] - [0, 10, 20]
        angle = np.radians(5)
        turned = [
            arm[0],
            np.cos(angle) * arm[1] - np.sin(angle) * arm[2],
            np.sin(angle) * arm[1] + np.cos(angle) * arm[2],
        ]
        np.testing.assert_allclose(moved[tooth], turned - arm, atol=1e-12)

    def test_a_field_may_be_on_any_part(self, tmp_path: Path) -> None:
        """On the strip of teeth, which comes after the skin: from one end to the other."""
        teeth = load_face(FACES / "mask.toml").mesh.get_region("teeth_lower")
        first, last = teeth[0], teeth[len(teeth) // 2 - 1]
        values = "[{ value = 0, regions = 'one' }, { value = 1, regions = 'other' }]"
        text = PLANE.replace(
            f"[weights.field]\nvalues = {VALUES}",
            f"[weights.field]\non = 'LowerTeeth'\nvalues = {values}",
        )
        text = text.replace('multiply = "1 - all"\nparts = { LowerTeeth = 0.5 }\n', "")
        text += f"[regions]\none = {{ vertices = [{first}] }}\nother = {{ vertices = [{last}] }}\n"
        rig = load_face(written(tmp_path, text))
        assert isinstance(rig, ParkeRig)
        weights = rig.compiled.weights[0]
        assert weights[: teeth[0]].max() == 0
        # The lower row of the strip, end to end.
        row = weights[first : last + 1]
        assert row[[0, -1]].tolist() == [0, 1]
        assert (np.diff(row) > 0).all()

    def test_lengths_are_scaled_to_the_mouth(self, tmp_path: Path) -> None:
        mesh = load_face(FACES / "mask.toml").mesh
        rig_file = read_rig_file("parke")
        width = np.linalg.norm(mesh.vertices[56] - mesh.vertices[70])
        np.testing.assert_allclose(rig_file.compute_scales(mesh), width / 50)
        shapes = [
            load_face("parke", mesh=other).deform(np.full(10, 0.5))
            for other in (named(mesh), named(mesh.replace_vertices(1.5 * mesh.vertices)))
        ]
        np.testing.assert_allclose(shapes[1], 1.5 * shapes[0], atol=1e-6)

    def test_each_axis_has_its_scale_where_the_base_of_the_nose_is_known(self) -> None:
        rig_file, mesh = read_rig_file("parke"), load_built_in_head()
        own = rig_file.compute_scales(mesh)
        np.testing.assert_allclose(own, own[0], rtol=2e-4)
        long = mesh.replace_vertices(mesh.vertices * [0.9, 1.2, 1.0])
        np.testing.assert_allclose(rig_file.compute_scales(long) / own, [0.9, 1.2, 1.05], rtol=1e-4)
        noseless = {k: v for k, v in mesh.feature_points.items() if k != "9.15"}
        without = replace(long, feature_points=noseless)
        np.testing.assert_allclose(rig_file.compute_scales(without), 0.9 * own[0])
        one_length = rig_file.model_copy(update={"lower_face_height": None})
        np.testing.assert_allclose(one_length.compute_scales(long), 0.9 * own[0])

    def test_a_chin_above_the_nose_is_refused(self) -> None:
        mesh = load_built_in_head()
        points = {**mesh.feature_points, "9.15": mesh.get_feature_point("8.2")}
        with pytest.raises(
            ConfigurationError, match=r"2\.1, is not well below .* 9\.15.*leave 9\.15"
        ):
            load_face(mesh=replace(mesh, feature_points={**points, "2.1": points["11.4"]}))

    def test_an_only_part_is_the_skin(self, tmp_path: Path) -> None:
        lines = (FACES / "mask.obj").read_text().split("o LowerTeeth")[0]
        text = MASK.replace('[parts]\nskin = "Mask"\nteeth_lower = "LowerTeeth"\n', "")
        path = written(tmp_path, text)
        (tmp_path / "mask.obj").write_text(lines)
        assert [part.name for part in load_face(path).mesh.parts] == ["skin"]

    def test_two_parts_keep_their_names_and_an_only_one_may_be_another(self) -> None:
        mesh = load_face(FACES / "mask.toml").mesh
        one = Mesh(mesh.vertices, mesh.triangles)
        for face, settings, names in (
            (mesh, {}, ["skin", "teeth_lower"]),
            (mesh, {"teeth_lower": "skin", "skin": "teeth_lower"}, ["teeth_lower", "skin"]),
            (one, {}, ["skin"]),
            (one, {"tongue": "skin"}, ["tongue"]),
        ):
            labelled = RigFile(parts=settings).label_mesh(face)
            assert [part.name for part in labelled.parts] == names
        other = replace(mesh, parts=tuple(replace(p, name=p.name[::-1]) for p in mesh.parts))
        assert [part.name for part in RigFile().label_mesh(other).parts] == ["niks", "rewol_hteet"]

    def test_points_and_places(self) -> None:
        mesh = load_face(FACES / "mask.toml").mesh
        middle = Point(at=("8.3", "8.4"), offset=(0, 0, 10)).locate(mesh, 0.5, {})
        expected = mesh.vertices[[56, 70]].mean(axis=0) + np.array([0, 0, 5])
        np.testing.assert_allclose(middle, expected)
        fixed = Point(position=(1, 2, 3))
        assert fixed.locate(mesh, 0.5, {}).tolist() == [1, 2, 3]
        assert Point(at=("here",)).locate(mesh, 1.0, {"here": np.arange(3.0)}).tolist() == [0, 1, 2]

    def test_what_lies_below_above_or_behind(self, tmp_path: Path) -> None:
        text = PLANE.replace(
            '{ value = 1, feature_points = "8.3" }', "{ value = 1, below = '8.3' }"
        )
        text = text.replace('{ value = 0, feature_points = "8.4" }', "{ value = 0, above = '8.3' }")
        rig = load_face(written(tmp_path, text.replace('multiply = "1 - all"\n', "")))
        slopes = np.linalg.norm(rig.jacobian([0.0])[:, :, 0], axis=1)
        skin, height = rig.mesh.get_region("skin"), rig.mesh.vertices[:, 1]
        above = skin[height[skin] > height[56]]
        below = skin[height[skin] < height[56]]
        assert slopes[above].max() == 0
        assert slopes[below].min() > 0

    @pytest.mark.parametrize(("share", "accepted"), [(0.098, True), (0.102, False)])
    def test_a_position_may_be_a_tenth_of_the_mesh_off_it(
        self, share: float, accepted: bool, tmp_path: Path
    ) -> None:
        mesh = load_face(FACES / "mask.toml").mesh
        front = int(mesh.vertices[:, 2].argmax())
        z = mesh.vertices[front, 2] + share * np.ptp(mesh.vertices, axis=0).max()
        text = MASK.replace("[-24, 0, 83]", "70") + ""
        text = text.replace("2.1 = 385", f"2.1 = 385\n9.3 = [0, {mesh.vertices[front, 1]}, {z}]")
        path = written(tmp_path, text)
        if accepted:
            assert load_face(path).mesh.get_feature_point("9.3") == front
        else:
            with pytest.raises(ConfigurationError, match="not on the mesh"):
                load_face(path)

    @pytest.mark.parametrize(("factor", "accepted"), [(0.26, True), (0.24, False)])
    def test_the_flattest_lower_face_is_a_quarter_as_high(
        self, factor: float, accepted: bool
    ) -> None:
        mesh, rig_file = load_built_in_head(), read_rig_file("parke")
        # The head's proportions are the rig file's.
        flat = mesh.replace_vertices(mesh.vertices * [1.0, factor, 1.0])
        if accepted:
            assert rig_file.compute_scales(flat)[1] == pytest.approx(factor, rel=0.01)
        else:
            with pytest.raises(ConfigurationError, match=r"2\.1, is not well below"):
                rig_file.compute_scales(flat)

    @pytest.mark.parametrize(
        ("left", "right", "says"),
        [
            ([0.4, 0, 0], [-0.4, 0, 0], "not a mouth's width apart .*found 0.8 mm"),
            ([0.6, 0, 0], [-0.6, 0, 0], None),
            ([499.0, 0, 0], [-499, 0, 0], None),
            ([501.0, 0, 0], [-501, 0, 0], "not a mouth's width apart"),
            # 46 degrees and 44 degrees from the x axis; 0.7 is the cosine of 45.6.
            ([18.0, 18.2, 0], [-18, -18.2, 0], None),
            ([17.0, 18.2, 0], [-17, -18.2, 0], "8.3 is not to the left of 8.4"),
            ([-24.0, 0, 0], [24, 0, 0], "8.3 is not to the left of 8.4"),
        ],
    )
    def test_the_corners_of_a_mouth(
        self, left: list[float], right: list[float], says: str | None
    ) -> None:
        mesh = Mesh(
            np.array([left, right, [0.0, 9, 0]]),
            np.array([[0, 1, 2]]),
            feature_points={"8.3": 0, "8.4": 1},
        )
        rig_file = read_rig_file("parke")
        if says is None:
            width = np.linalg.norm(np.subtract(left, right))
            np.testing.assert_allclose(rig_file.compute_scales(mesh), width / 50)
        else:
            with pytest.raises(ConfigurationError, match=says):
                rig_file.compute_scales(mesh)

    def test_behind_is_what_has_a_lower_z(self) -> None:
        mesh = load_face(FACES / "mask.toml").mesh
        for axis, name, sign in ((2, "behind", -1), (1, "below", -1), (1, "above", 1)):
            constraint = Constraint.model_validate({"value": 1, name: "8.3"})
            members = constraint.find_vertices(mesh, 1.0, {})
            expected = np.flatnonzero(sign * (mesh.vertices[:, axis] - mesh.vertices[56, axis]) > 0)
            np.testing.assert_array_equal(members, expected)
            assert 56 not in members

    def test_points_that_refer_to_points_are_refused(self, tmp_path: Path) -> None:
        text = (
            PLANE.replace("centre = [0, 10, 20]", 'centre = "a"') + '\n[points]\na = "b"\nb = "a"\n'
        )
        with pytest.raises(ConfigurationError, match=r"lacks .*feature point b \(for points\.a\)"):
            load_face(written(tmp_path, text))

    def test_a_rig_file_prints_in_a_line(self) -> None:
        assert repr(read_rig_file("parke")) == (
            "RigFile(kind='parke', mesh=None, 10 parameters, 8 weights, 11 transforms)"
        )

    def test_a_vertex_in_two_constraints_takes_the_mean(self, tmp_path: Path) -> None:
        text = PLANE.replace(
            VALUES, VALUES[:-1] + ', { value = 0.5, feature_points = ["8.3", "8.4"] }]'
        ).replace('multiply = "1 - all"\n', "")
        rig = load_face(written(tmp_path, text))
        assert isinstance(rig, ParkeRig)
        assert rig.compiled.weights[0, [56, 70]].tolist() == [0.75, 0.25]


def named(mesh: Mesh) -> Mesh:
    """The mask's mesh with the ears that the shipped rig looks for, on its edge."""
    return Mesh(
        mesh.vertices,
        mesh.triangles,
        mesh.parts,
        mesh.regions,
        {**mesh.feature_points, "10.7": 420, "10.8": 434, "10.9": 421, "10.10": 433},
    )


def grid() -> Mesh:
    """Four by three vertices, squares of 2 mm that are cut along one diagonal."""
    x, y = np.meshgrid(np.arange(4.0), np.arange(3.0))
    vertices = np.stack([2 * x, 2 * y, 0 * x], axis=2).reshape(-1, 3)
    squares = [4 * row + column for row in range(2) for column in range(3)]
    triangles = [t for a in squares for t in ([a, a + 1, a + 5], [a, a + 5, a + 4])]
    return Mesh(vertices, np.array(triangles), feature_points={"2.1": 0, "2.2": 11})


def test_a_region_is_all_that_it_names() -> None:
    mesh = grid()
    for region, members in (
        ({"near": "2.1", "within": 2}, [0, 1, 4]),
        ({"near": ["2.1", "2.2"], "within": 2.0}, [0, 1, 4, 7, 10, 11]),
        ({"vertices": [3, [5, 7], 3]}, [3, 5, 6, 7]),
        ({"vertices": [2], "near": "2.1", "within": 1.9}, [0, 2]),
        ({"part": "skin"}, list(range(12))),
    ):
        vertices = Region.model_validate(region).find_vertices(mesh)
        assert vertices.tolist() == members
    with pytest.raises(ConfigurationError, match="found 12, expected 0 to 11"):
        Region.model_validate({"vertices": [[11, 12]]}).find_vertices(mesh)


@pytest.mark.parametrize(
    ("model", "settings", "accepted"),
    [
        (Point, {"position": [1e6, -1e6, 0]}, True),
        (Point, {"position": [1000000.5, 0, 0]}, False),
        (Point, {"position": [0, 0, -1000000.5]}, False),
        (RigFile, {"mouth_width": 1}, True),
        (RigFile, {"mouth_width": 0.9}, False),
        (RigFile, {"lower_face_height": 1000}, True),
        (RigFile, {"lower_face_height": 1001}, False),
        (RigFile, {"feature_points": {"2.1": [1e6, 0, -1e6]}}, True),
        (RigFile, {"feature_points": {"2.1": [1000000.5, 0, 0]}}, False),
        (RigFile, {"feature_points": {"2.1": 0}}, True),
        (Constraint, {"value": 0, "regions": "a"}, True),
        (Constraint, {"value": 1, "regions": "a"}, True),
        (Constraint, {"value": -0.01, "regions": "a"}, False),
        (Constraint, {"value": 1.01, "regions": "a"}, False),
        (Region, {"vertices": [[0, 0]]}, True),
        (Weight, {"centre": "8.1", "radii": [1, 1, 1], "plateau": 0.99}, True),
        (Weight, {"centre": "8.1", "radii": [1, 1, 1], "plateau": -0.01}, False),
        (Weight, {"centre": "8.1", "radii": [0.001, 1, 1]}, True),
        (Weight, {"centre": "8.1", "radii": [1, 1, 0]}, False),
    ],
)
def test_limits_hold_on_both_sides(model: type, settings: dict, accepted: bool) -> None:
    if accepted:
        model.model_validate(settings)
    else:
        with pytest.raises(ValidationError):
            model.model_validate(settings)


def test_distance_along_a_grid_is_that_of_its_edges() -> None:
    """A vertex one across and one up is reached by a diagonal of √8 mm."""
    distance = compute_surface_distance(grid(), 0)
    root = 8**0.5
    expected = [[0, 2, 4, 6], [2, root, 2 + root, 4 + root], [4, 2 + root, 2 * root, 2 + 2 * root]]
    np.testing.assert_allclose(distance.reshape(3, 4), expected)


def test_distance_along_the_surface_goes_round_the_mouth() -> None:
    mesh = load_face(FACES / "mask.toml").mesh
    upper, lower = mesh.get_feature_point("2.2"), mesh.get_feature_point("2.3")
    assert np.linalg.norm(mesh.vertices[upper] - mesh.vertices[lower]) < 1e-3
    distance = compute_surface_distance(mesh, upper)
    assert distance[upper] == 0
    # Round the corner, or through the back of the mouth.
    assert distance[lower] > 20
    assert np.isinf(distance[mesh.get_region("teeth_lower")]).all()
    several = compute_surface_distance(mesh, [upper, lower])
    np.testing.assert_allclose(
        several, np.minimum(distance, compute_surface_distance(mesh, lower)), atol=1e-12
    )
