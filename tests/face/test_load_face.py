"""Faces as users load them: the built-in one, and a mesh of one's own from file to fit."""

import importlib.util
import os
import re
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from mocap_fit.errors import ConfigurationError
from mocap_fit.face import CompiledRig, Rig, load_face, to_parameters
from mocap_fit.face.builtin import load_built_in_head, reshape_head
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.face.parke import ParkeRig
from mocap_fit.face.rig import Kind, check_parameters, evaluate, evaluate_jacobian
from mocap_fit.fitting import (
    Binding,
    Layout,
    LayoutMarker,
    Orientation,
    bind_markers,
    fit_orientation,
    fit_shape,
)
from mocap_fit.tracks import MarkerTracks

FACES = Path(__file__).parents[2] / "fixtures" / "faces"
MASK = FACES / "mask.toml"
AROUND = 28


@pytest.fixture(scope="module")
def mask() -> Rig:
    return load_face(MASK)


class TestBuiltIn:
    def test_it_is_the_default(self) -> None:
        rig = load_face()
        assert isinstance(rig, ParkeRig)
        np.testing.assert_array_equal(rig.mesh.vertices, load_built_in_head().vertices)
        values = np.linspace(-0.2, 0.8, 10)
        np.testing.assert_array_equal(rig.deform(values), load_face("built-in").deform(values))

    def test_it_loads_at_once_and_keeps_nothing_but_the_head(self, tmp_path: Path) -> None:
        """In a process of its own; the weights are solved for anew each time."""
        program = (
            "import time; from mocap_fit.face import load_face; load_face()\n"
            "took = []\n"
            "for _ in range(3):\n"
            "    start = time.process_time(); load_face()\n"
            "    took.append(time.process_time() - start)\n"
            "print(min(took))"
        )
        environment = {**os.environ, "MOCAP_FIT_CACHE": str(tmp_path)}
        answer = subprocess.run(
            [sys.executable, "-c", program],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        assert float(answer.stdout) < 0.3
        assert len(list(tmp_path.iterdir())) == 1

    def test_it_is_the_same_in_every_process(self) -> None:
        program = (
            "import hashlib; from mocap_fit.face import load_face\n"
            "print(hashlib.sha256(load_face().deform([0.3] * 10).tobytes()).hexdigest())"
        )
        answers = {
            subprocess.run(
                [sys.executable, "-c", program],
                env={**os.environ, "PYTHONHASHSEED": seed},
                capture_output=True,
                text=True,
                check=True,
            ).stdout
            for seed in ("1", "2")
        }
        assert len(answers) == 1

    def test_on_another_head(self) -> None:
        head = reshape_head(load_built_in_head(), width=1.2)
        np.testing.assert_array_equal(load_face(mesh=head).deform(np.zeros(10)), head.vertices)

    def test_a_mesh_without_a_mouth_is_refused_with_all_that_it_lacks(self) -> None:
        bare = Mesh(100 * np.eye(3), np.array([[0, 1, 2]]))
        with pytest.raises(ConfigurationError, match=r"lacks .*8\.3.*; regions lower_lip"):
            load_face(mesh=bare)


class TestForeignMesh:
    def test_what_a_file_must_give_is_nearly_enough(self) -> None:
        """The few points and regions of the rig file's docstring, on the built-in head."""
        whole = load_face()
        head = whole.mesh
        kept = ("8.1", "8.2", "8.3", "8.4", "2.1", "2.2", "2.3", "10.7", "10.8", "10.9", "10.10")
        bare = Mesh(
            head.vertices,
            head.triangles,
            head.parts,
            {name: head.get_region(name) for name in ("upper_lip", "lower_lip")},
            {name: head.get_feature_point(name) for name in kept},
        )
        little = load_face(mesh=bare)
        middle = (np.abs(head.vertices[:, 0]) < 30) & (head.vertices[:, 2] > 60)
        for gesture in np.eye(10):
            apart = np.linalg.norm(whole.deform(gesture) - little.deform(gesture), axis=1)
            size = np.linalg.norm(whole.deform(gesture) - head.vertices, axis=1).max()
            assert apart[middle].mean() < 0.02 * size

    def test_the_script_makes_the_same_file(self, tmp_path: Path) -> None:
        spec = importlib.util.spec_from_file_location("make_mask", FACES / "make_mask.py")
        assert spec is not None
        assert spec.loader is not None
        script = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(script)
        script.make(tmp_path)
        assert (tmp_path / "mask.obj").read_bytes() == (FACES / "mask.obj").read_bytes()

    def test_it_loads_without_a_warning_in_the_head_frame(self) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            mesh = load_face(MASK).mesh
        assert [part.name for part in mesh.parts] == ["skin", "teeth_lower"]
        assert 400 < len(mesh.vertices) < 600
        corner = mesh.vertices[mesh.get_feature_point("8.3")]
        np.testing.assert_allclose(corner, [24, 0, 83], atol=0.1)
        # Counted round the mouth: 8.4 is given by its place, and found.
        assert mesh.get_feature_point("8.4") == 56 + AROUND // 2
        nose = mesh.vertices[:, 2].argmax()
        assert mesh.compute_normals()[nose, 2] > 0.5

    def test_the_jaw_opens_with_its_teeth(self, mask: Rig) -> None:
        change = mask.deform(to_parameters({"jaw_rotation": 1}, mask.parameter_names))
        change = change - mask.mesh.vertices
        upper, lower, chin, corner = (
            change[mask.mesh.get_feature_point(p)] for p in ("2.2", "2.3", "2.1", "8.3")
        )
        assert lower[1] < -12
        assert chin[1] < -8
        assert np.abs(upper).max() < 1e-9
        assert lower[1] < corner[1] < -3
        teeth = change[mask.mesh.get_region("teeth_lower")]
        assert teeth[:, 1].max() < -8
        forehead = mask.mesh.vertices[:, 1] > 70
        assert np.abs(change[forehead]).max() < 1e-9

    @pytest.mark.parametrize(
        ("name", "point", "axis", "least", "still"),
        [
            ("lip_rounding", "8.1", 2, 3, "2.1"),
            ("upper_lip_raise", "2.2", 1, 3, "2.3"),
            ("upper_lip_retraction", "8.1", 2, -3, "8.2"),
            ("lower_lip_depression", "2.3", 1, -3, "2.2"),
            ("lower_lip_retraction", "8.2", 2, -3, "8.1"),
            ("left_corner_stretch", "8.3", 0, 4, "8.4"),
            ("right_corner_stretch", "8.4", 0, -4, "8.3"),
            ("jaw_thrust", "2.1", 2, 4, "2.2"),
            ("jaw_shift", "2.1", 0, 4, "2.2"),
        ],
    )
    def test_gestures_move_what_they_should(
        self, mask: Rig, name: str, point: str, axis: int, least: float, still: str
    ) -> None:
        shape = mask.deform(to_parameters({name: 1}, mask.parameter_names))
        change = shape - mask.mesh.vertices
        assert change[mask.mesh.get_feature_point(point), axis] * np.sign(least) > abs(least)
        assert np.abs(change[mask.mesh.get_feature_point(still)]).max() < 1e-9


# ---- from markers on a foreign mesh back to its parameters ---------------------------------------


class Callback:
    """A rig that does what another does, but cannot be compiled."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self.mesh, self.bounds = rig.mesh, rig.bounds
        self.parameter_names = rig.parameter_names

    def deform(self, parameters: np.ndarray) -> np.ndarray:
        return self._rig.deform(parameters)

    def jacobian(self, parameters: np.ndarray) -> np.ndarray:
        return self._rig.jacobian(parameters)

    def compile(self, vertex_ids: IndexArray) -> None:
        return None


class Blendshapes:
    """Four gestures of another rig as displacements that add up."""

    parameter_names = ("open", "round", "stretch", "raise")
    bounds = np.array([[0.0, 1.0]] * 4)

    def __init__(self, rig: Rig) -> None:
        self.mesh = rig.mesh
        rest, gestures = rig.mesh.vertices, np.eye(10)[[0, 1, 6, 3]]
        fields = np.array([rig.deform(gesture) - rest for gesture in gestures])
        nothing = np.zeros((4, 3))
        self._compiled = CompiledRig(
            np.arange(len(rest)),
            rest,
            np.full(4, Kind.FIELD, dtype=np.int64),
            np.arange(4),
            np.zeros((4, len(rest))),
            nothing,
            nothing,
            fields,
            4,
        )

    def deform(self, parameters: np.ndarray) -> np.ndarray:
        return evaluate(self._compiled, check_parameters(parameters, self.parameter_names))

    def jacobian(self, parameters: np.ndarray) -> np.ndarray:
        values = check_parameters(parameters, self.parameter_names)
        return evaluate_jacobian(self._compiled, values)[1]

    def compile(self, vertex_ids: IndexArray) -> CompiledRig:
        return self._compiled.take(vertex_ids)


def layout_on(mesh: Mesh) -> tuple[Layout, dict[str, np.ndarray]]:
    """Markers on the mask, 2 mm above it, and where they are at rest."""
    strategic = ("8.3", "8.4", "8.1", "2.1")
    markers = [
        LayoutMarker(name=f"point {p}", feature_point=p, orientation=True) for p in strategic
    ]
    vertices = [mesh.get_feature_point(p) for p in strategic]
    # Rings 5, 7 and 9 of the mesh are the lips' border, the skin round it, and the cheeks.
    for ring, angles in ((5, range(1, 28, 3)), (7, range(0, 28, 4)), (10, range(2, 28, 4))):
        for i in angles:
            lip = "upper_lip" if i < AROUND / 2 else "lower_lip"
            region = (lip,) if ring == 5 else ("skin",)
            markers.append(LayoutMarker(name=f"ring {ring} at {i}", region=region))
            vertices.append(ring * AROUND + i)
    places = mesh.vertices[vertices] + 2.0 * mesh.compute_normals()[vertices]
    layout = Layout(name="mask", marker_offset=2.0, markers=tuple(markers))
    return layout, {m.name: p for m, p in zip(markers, places, strict=True)}


SPEAKER = Orientation(
    1.15, np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.array([5.0, -20.0, 12.0])
)


def tied(rig: Rig) -> Binding:
    """Markers of a speaker of another size and place, tied to the face."""
    layout, places = layout_on(rig.mesh)
    pose = SPEAKER.undo(np.array(list(places.values())))
    reference = MarkerTracks(tuple(places), 100.0, pose[None])
    return bind_markers(rig, layout, reference, fit_orientation(rig, layout, reference))


def recording(binding: Binding, truth: np.ndarray) -> MarkerTracks:
    markers = np.array([binding.evaluate(values)[0] for values in truth])
    return MarkerTracks(binding.names, 100.0, binding.orientation.undo(markers))


def smooth_truth(rig: Rig, frames: int = 12) -> np.ndarray:
    times = np.arange(frames)[:, None] / frames
    phases = np.arange(len(rig.parameter_names))
    return np.asarray(0.3 + 0.3 * np.sin(2 * np.pi * times + phases))


class TestFitOnForeignMesh:
    def test_the_orientation_is_the_speakers(self, mask: Rig) -> None:
        found = tied(mask).orientation
        assert found.scale == pytest.approx(SPEAKER.scale, rel=0.02)
        np.testing.assert_allclose(found.rotation, SPEAKER.rotation, atol=0.03)

    @pytest.mark.parametrize("objective", ["squares", "distances"])
    def test_the_fit_recovers_the_parameters(self, mask: Rig, objective: str) -> None:
        binding, truth = tied(mask), smooth_truth(mask)
        fit = fit_shape(binding, recording(binding, truth), objective=objective)  # type: ignore[arg-type]
        np.testing.assert_allclose(fit.parameters.values, truth, atol=2e-4)
        assert fit.parameters.names == mask.parameter_names
        assert fit.parameters.residuals.max() < 1e-3

    def test_blendshapes_are_fitted_like_any_rig(self, mask: Rig) -> None:
        rig = Blendshapes(mask)
        binding, truth = tied(rig), smooth_truth(rig)
        fit = fit_shape(binding, recording(binding, truth), objective="squares")
        np.testing.assert_allclose(fit.parameters.values, truth, atol=2e-4)
        assert fit.parameters.names == rig.parameter_names

    def test_a_rig_that_is_called_back_gives_the_same_answers(self, mask: Rig) -> None:
        compiled, called = tied(mask), tied(Callback(mask))
        assert called.compiled is None
        values = np.linspace(-0.3, 0.9, 10)
        for one, other in zip(compiled.evaluate(values), called.evaluate(values), strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-10)
        tracks = recording(compiled, smooth_truth(mask, 6))
        fits = [fit_shape(b, tracks, objective="squares") for b in (compiled, called)]
        np.testing.assert_allclose(
            fits[0].parameters.values, fits[1].parameters.values, rtol=0, atol=1e-6
        )


TOY_RIG = """
import numpy as np
from mocap_fit.face.rig import check_parameters

class ToyRig:
    parameter_names = ("nod",)
    bounds = np.array([[-1.0, 1.0]])

    def __init__(self, mesh, reach):
        self.mesh, self.reach = mesh, reach

    @classmethod
    def from_file(cls, rig_file, mesh):
        return cls(mesh, rig_file.settings["reach"])

    def deform(self, parameters):
        nod = check_parameters(parameters, self.parameter_names)[0]
        return self.mesh.vertices - [0.0, self.reach * nod, 0.0]

    def jacobian(self, parameters):
        return np.tile([[0.0], [-self.reach], [0.0]], (len(self.mesh.vertices), 1, 1))

    def compile(self, vertex_ids):
        return None
"""


def test_a_rig_of_another_distribution_is_named_by_the_rig_file(tmp_path: Path) -> None:
    (tmp_path / "toy_rig.py").write_text(TOY_RIG, encoding="utf-8")
    about = tmp_path / "toy_rig-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Name: toy-rig\nVersion: 1.0\n", encoding="utf-8")
    (about / "entry_points.txt").write_text("[mocap_fit.rigs]\ntoy = toy_rig:ToyRig\n")
    rig_file = tmp_path / "rig.toml"
    mesh = (FACES / "mask.obj").as_posix()
    rig_file.write_text(
        f"kind = 'toy'\nmesh = '{mesh}'\nscale = 1000\naxes = 'x z -y'\n"
        "[parts]\nskin = 'Mask'\n[settings]\nreach = 3.5\n",
        encoding="utf-8",
    )
    without_reach = tmp_path / "bad.toml"
    without_reach.write_text(rig_file.read_text().replace("reach", "rich"), encoding="utf-8")
    program = (
        "import sys; from mocap_fit.face import load_face; rig = load_face(sys.argv[1])\n"
        "print(type(rig).__name__, (rig.deform([1.0]) - rig.mesh.vertices)[7].tolist())\n"
        "try: load_face(sys.argv[2])\n"
        "except Exception as error: print(type(error).__name__, error)"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program, str(rig_file), str(without_reach)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
        capture_output=True,
        text=True,
        check=True,
    )
    good, bad = answer.stdout.splitlines()
    assert good == "ToyRig [0.0, -3.5, 0.0]"
    # The plug-in's mistake is named with its distribution.
    assert re.match(r"RegistryError .*bad\.toml: the rig 'toy' of toy-rig failed .*KeyError", bad)


def test_loading_a_foreign_mesh_is_quick() -> None:
    start = time.process_time()
    load_face(MASK)
    assert time.process_time() - start < 2.0
