"""The head for other programs: blended shapes, glTF, facial animation parameters."""

import builtins

import numpy as np
import pytest

from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, MissingExtraError
from mocap_fit.face import load_face
from mocap_fit.face.contact import list_touching, resolve_contact
from mocap_fit.face.fap import FAPS
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.render.fap import measure_faps, write_fap
from mocap_fit.render.gltf import write_gltf
from mocap_fit.render.shapes import compute_blend_shapes
from mocap_fit.tracks import ParameterTracks


@pytest.fixture(scope="module")
def rig():
    return load_face()


@pytest.fixture(scope="module")
def tracks(rig) -> ParameterTracks:
    times = np.arange(30) / 25
    values = np.zeros((30, len(rig.parameter_names)))
    values[:, rig.parameter_names.index("jaw_rotation")] = 0.5 - 0.5 * np.cos(5 * times)
    values[:, rig.parameter_names.index("lip_rounding")] = 0.4 - 0.4 * np.cos(4 * times)
    values[:, rig.parameter_names.index("left_corner_stretch")] = 0.3 * np.sin(3 * times)
    return ParameterTracks(rig.parameter_names, 25, values, name="a talk")


def draw_frame(rig, tracks, frame: int) -> np.ndarray:
    return resolve_contact(rig.deform(tracks.values[frame]), rig.mesh)


def test_compute_blend_shapes_come_near_what_is_drawn(rig, tracks):
    blended = compute_blend_shapes(tracks, rig)
    assert blended.largest_error < 0.2
    assert blended.names[:10] == rig.parameter_names
    rest = rig.deform(np.zeros(10))
    frame = 11
    shown = rest + np.tensordot(blended.weights[frame], blended.shapes, 1)
    apart = np.abs(shown - draw_frame(rig, tracks, frame)).max()
    assert apart <= blended.largest_error
    # Without the corrections it would not.
    plain = rest + np.tensordot(blended.weights[frame, :10], blended.shapes[:10], 1)
    assert np.abs(plain - draw_frame(rig, tracks, frame)).max() > 5 * blended.largest_error
    # Contact is a part of it.
    assert "contact_1" in blended.names
    contact = blended.shapes[[name.startswith("contact") for name in blended.names]]
    untouched = np.setdiff1d(np.arange(len(rest)), list_touching(rig.mesh))
    assert not contact[:, untouched].any()


def test_a_tongue_is_in_the_shapes_by_its_phones(tracks):
    face = load_face(tongue=True)
    phones = PhoneSequence((PhoneSegment(0, 0.6, "L"), PhoneSegment(0.6, 1.2, "TH")))
    phones = phones.replace(phone_set="en-arpabet")
    moved = compute_blend_shapes(tracks, face, phones=phones)
    index = moved.names.index("tongue_tip_advance")
    assert moved.weights[-5, index] > moved.weights[5, index] + 0.5
    rested = compute_blend_shapes(tracks, face)
    assert not rested.weights[:, index].any()


def test_the_rate_can_be_chosen(rig, tracks):
    blended = compute_blend_shapes(tracks, rig, 50)
    np.testing.assert_allclose(np.diff(blended.times), 0.02)
    assert len(blended.times) == 59
    np.testing.assert_allclose(blended.weights[::2, :10], tracks.values, atol=1e-12)


@pytest.fixture(scope="module")
def file(rig, tracks, tmp_path_factory):
    path = tmp_path_factory.mktemp("gltf") / "head.glb"
    write_gltf(tracks, path, rig)
    return path


@pytest.fixture(scope="module")
def read(file):
    pygltflib = pytest.importorskip("pygltflib")
    return pygltflib.GLTF2().load(str(file))


class TestGltf:
    def array(self, read, number: int) -> np.ndarray:
        accessor = read.accessors[number]
        view = read.bufferViews[accessor.bufferView]
        kind = {5126: "<f4", 5125: "<u4", 5121: "u1"}[accessor.componentType]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
        raw = read.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
        return np.frombuffer(raw, dtype=kind).reshape(accessor.count, width)

    def test_it_has_all_parts_and_named_targets(self, read, rig):
        mesh = read.meshes[0]
        assert [read.materials[p.material].name for p in mesh.primitives] == [
            part.name for part in rig.mesh.parts
        ]
        names = mesh.extras["targetNames"]
        assert names[:10] == list(rig.parameter_names)
        assert {len(p.targets) for p in mesh.primitives} == {len(names)} == {len(mesh.weights)}

    def test_what_is_played_is_the_movement(self, read, rig, tracks):
        animation = read.animations[0]
        sampler = animation.samplers[0]
        times = self.array(read, sampler.input)[:, 0]
        weights = self.array(read, sampler.output).reshape(len(times), -1)
        np.testing.assert_allclose(times, tracks.times - tracks.start_time, atol=1e-6)
        skin = read.meshes[0].primitives[0]
        shown = self.array(read, skin.attributes.POSITION).astype(float)
        for target, weight in zip(skin.targets, weights[17], strict=True):
            shown = shown + weight * self.array(read, target["POSITION"])
        part = rig.mesh.parts[0].vertices
        wanted = draw_frame(rig, tracks, 17)[part.start : part.stop]
        assert np.abs(1000 * shown - wanted).max() < 0.2
        triangles = self.array(read, skin.indices)
        assert triangles.max() == len(part) - 1

    def test_another_program_reads_it(self, file, rig):
        trimesh = pytest.importorskip("trimesh")
        scene = trimesh.load(file)
        assert len(scene.geometry) == len(rig.mesh.parts)
        height = np.ptp(rig.mesh.vertices[:, 1]) / 1000
        assert scene.extents[1] == pytest.approx(height, abs=1e-4)

    def test_the_same_movement_gives_the_same_bytes(self, file, rig, tracks, tmp_path):
        write_gltf(tracks, tmp_path / "again.glb", rig)
        assert (tmp_path / "again.glb").read_bytes() == file.read_bytes()

    def test_bad_names_and_missing_libraries_are_errors(self, rig, tracks, tmp_path, monkeypatch):
        with pytest.raises(FileFormatError, match=r"\.glb"):
            write_gltf(tracks, tmp_path / "a.obj", rig)
        with pytest.raises(FileFormatError, match="cannot be written"):
            write_gltf(tracks, tmp_path / "nowhere" / "a.glb", rig)
        real = builtins.__import__

        def without(name, *rest, **options):
            if name == "pygltflib":
                raise ImportError(name)
            return real(name, *rest, **options)

        monkeypatch.setattr(builtins, "__import__", without)
        with pytest.raises(MissingExtraError, match=r"mocap-fit\[mesh\]"):
            write_gltf(tracks, tmp_path / "a.glb", rig)
        assert not list(tmp_path.iterdir())


class TestFap:
    def test_numbers_are_those_of_the_standard(self):
        numbers = [fap.number for fap in FAPS]
        assert numbers == [*range(3, 19), *range(51, 61)]
        assert len({fap.name for fap in FAPS}) == len(FAPS)

    def test_directions_are_those_of_the_standard(self, rig):
        names = rig.parameter_names

        def moved(**values: float) -> dict[str, int]:
            row = np.array([[values.get(name, 0.0) for name in names]])
            faps, numbers = measure_faps(ParameterTracks(names, 25, row), rig)
            return {f.name: int(n) for f, n in zip(faps, numbers[0], strict=True)}

        opened = moved(jaw_rotation=1.0)
        assert opened["open_jaw"] > 500
        assert opened["raise_b_midlip"] < -500
        assert opened["lower_t_midlip"] == 0
        assert moved(jaw_thrust=1.0)["thrust_jaw"] > 100
        # The parameter is positive to the speaker's left, the standard's to the right.
        assert moved(jaw_shift=1.0)["shift_jaw"] < -50
        assert moved(upper_lip_raise=1.0)["lower_t_midlip"] < -100
        wide = moved(left_corner_stretch=1.0)
        assert wide["stretch_l_cornerlip_o"] > 50
        assert wide["stretch_r_cornerlip_o"] == 0
        assert not any(moved().values())

    def test_units_are_distances_of_the_face(self, rig):
        """The mouth as wide again as it was: each corner out by half, 512 of 1024."""
        mesh = rig.mesh
        width = mesh.vertices[mesh.get_feature_point("8.3"), 0] * 2
        row = np.zeros((1, 10))
        row[0, rig.parameter_names.index("left_corner_stretch")] = 0.8
        left = mesh.get_feature_point("8.3")
        out = rig.deform(row[0])[left, 0] - mesh.vertices[left, 0]
        faps, values = measure_faps(ParameterTracks(rig.parameter_names, 25, row), rig)
        column = [fap.name for fap in faps].index("stretch_l_cornerlip_o")
        assert values[0, column] == round(1024 * out / width)

    def test_the_file_says_what_follows(self, rig, tracks, tmp_path):
        assert write_fap(tracks, tmp_path / "a.fap", rig) == 30
        lines = (tmp_path / "a.fap").read_text().splitlines()
        assert lines[0] == "2.1 a_talk 25 30"
        assert len(lines) == 1 + 2 * 30
        mask = lines[1].split()
        assert len(mask) == 68
        assert {int(i) + 1 for i, one in enumerate(mask) if one == "1"} == {f.number for f in FAPS}
        for frame, line in enumerate(lines[2::2]):
            number, *values = map(int, line.split())
            assert number == frame
            assert len(values) == len(FAPS)

    def test_a_face_without_its_points_is_refused(self, rig, tracks):
        import dataclasses

        points = {k: v for k, v in rig.mesh.feature_points.items() if k != "9.15"}
        bare = dataclasses.replace(
            load_face(), mesh=dataclasses.replace(rig.mesh, feature_points=points)
        )
        with pytest.raises(ConfigurationError, match=r"no 9\.15"):
            measure_faps(tracks, bare)

    def test_tracks_of_another_face_are_refused(self, rig):
        with pytest.raises(DataError, match="no parameter nose"):
            measure_faps(ParameterTracks(("nose",), 25, np.zeros((3, 1))), rig)
