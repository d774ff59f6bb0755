"""Contact: what is in each other is moved apart, and nothing else."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mocap_fit.control.rule_based import RuleBased
from mocap_fit.control.tongue import compute_tongue
from mocap_fit.evaluation.depths import Depths
from mocap_fit.face import Rig, load_face, to_parameters
from mocap_fit.face.builtin import load_built_in_head, reshape_head
from mocap_fit.face.contact import list_touching, resolve_contact
from mocap_fit.face.lips import find_lip_line
from mocap_fit.phones import PhoneSegment, PhoneSequence

ROOT = Path(__file__).parents[2]
SHALLOW = 0.5


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_face(tongue=True)


@pytest.fixture(scope="module")
def depths(rig: Rig) -> Depths:
    return Depths(rig.mesh)


def pose(rig: Rig, **values: float) -> np.ndarray:
    return rig.deform(to_parameters(values, rig.parameter_names))


PRESSED = {"jaw_rotation": 0.12, "upper_lip_raise": -0.3, "lower_lip_depression": -0.5}
LABIODENTAL = {
    "jaw_rotation": 0.11,
    "upper_lip_raise": 0.2,
    "lower_lip_depression": -0.2,
    "lower_lip_retraction": 0.62,
    "jaw_thrust": -0.3,
}


def test_at_rest_nothing_touches_and_nothing_is_moved(rig: Rig) -> None:
    np.testing.assert_allclose(
        resolve_contact(rig.mesh.vertices, rig.mesh), rig.mesh.vertices, atol=1e-9
    )


def test_an_open_mouth_is_not_moved_before_the_back_of_the_mouth(rig: Rig) -> None:
    opened = pose(rig, jaw_rotation=0.5, lower_lip_depression=0.3)
    lips = np.concatenate([rig.mesh.get_region(f"{side}_lip") for side in ("upper", "lower")])
    tongue = rig.mesh.get_region("tongue")
    front = tongue[rig.mesh.vertices[tongue, 2] > 60]
    # At the corners the lips are on the teeth.
    middle = lips[np.abs(rig.mesh.vertices[lips, 0]) < 15]
    changed = resolve_contact(opened, rig.mesh) - opened
    assert np.abs(changed[np.concatenate([middle, front])]).max() < 0.2


@pytest.mark.parametrize(
    ("values", "pair"),
    [
        (PRESSED, "lip in lip"),
        (LABIODENTAL, "lips in teeth_upper"),
        (LABIODENTAL, "teeth_upper in lips"),
        ({"jaw_rotation": 0.2, "tongue_body_raise": 1.3}, "tongue in gums_upper"),
        ({"tongue_tip_raise": 1.4}, "tongue in gums_upper"),
        ({"jaw_rotation": -0.2}, "teeth_lower in teeth_upper"),
    ],
)
def test_what_is_in_each_other_is_moved_apart(depths: Depths, rig: Rig, values, pair: str) -> None:
    vertices = pose(rig, **values)
    assert depths.measure(vertices)[pair] > SHALLOW
    assert depths.measure(resolve_contact(vertices, rig.mesh))[pair] < SHALLOW


def test_pressed_lips_bulge_and_stay_sealed(rig: Rig) -> None:
    values = {"jaw_rotation": 0.12, "upper_lip_raise": -0.19, "lower_lip_depression": -0.38}
    before = pose(rig, **values)
    after = resolve_contact(before, rig.mesh)
    line = find_lip_line(rig.mesh)
    pressed, sealed = (line.measure(shape[None, line.vertices])[0] for shape in (before, after))
    assert pressed.min() < -0.5
    assert sealed.max() < 0.5
    assert sealed.min() > 0.5 * pressed.min()
    lips = np.concatenate([rig.mesh.get_region(f"{side}_lip") for side in ("upper", "lower")])
    front = lips[before[lips, 2] > np.percentile(before[lips, 2], 80)]
    assert (after[front, 2] - before[front, 2]).mean() > 0.05


def test_skin_moves_with_a_lip_that_stops_at_the_teeth(rig: Rig) -> None:
    """Else the front of the lip would go through its back."""
    changed = pose(rig, upper_lip_retraction=1.0)
    moved = resolve_contact(changed, rig.mesh) - changed
    point = rig.mesh.get_feature_point("8.1")
    assert moved[point, 2] > 0.5
    far = np.linalg.norm(rig.mesh.vertices - rig.mesh.vertices[point], axis=1) > 60
    assert not moved[far].any()


def test_left_and_right_are_alike(rig: Rig) -> None:
    for values in (PRESSED, LABIODENTAL, {"tongue_body_raise": 1.2, "tongue_tip_raise": 1.2}):
        moved = resolve_contact(pose(rig, **values), rig.mesh) - pose(rig, **values)
        rest = rig.mesh.vertices
        _, twin = cKDTree(rest).query(rest * [-1, 1, 1])
        skin = np.arange(rig.mesh.get_part("skin").vertices.stop)
        np.testing.assert_allclose(moved[skin], moved[twin[skin]] * [-1, 1, 1], atol=0.12)


def test_nothing_pops(rig: Rig) -> None:
    """A small step of a movement moves no vertex much farther than the movement does."""
    start, end = (
        to_parameters(values, rig.parameter_names)
        for values in ({"jaw_rotation": 0.2}, {**PRESSED, "tongue_tip_raise": 1.2})
    )
    shares = np.linspace(0, 1, 61)[:, None]
    shapes = [
        resolve_contact(rig.deform(values), rig.mesh)
        for values in (1 - shares) * start + shares * end
    ]
    steps = np.linalg.norm(np.diff(shapes, axis=0), axis=2).max(axis=1)
    assert steps.max() < 1.2


def test_resolving_twice_changes_little(rig: Rig) -> None:
    once = resolve_contact(pose(rig, **PRESSED), rig.mesh)
    twice = resolve_contact(once, rig.mesh)
    assert np.abs(twice - once).max() < 0.5


def test_it_goes_with_the_head(rig: Rig) -> None:
    """The result does not depend on where a turned head is, but for the lips' forward bulge."""
    vertices = pose(rig, tongue_body_raise=1.3, jaw_rotation=0.2)
    shift = np.array([3.0, -20.0, 5.0])
    np.testing.assert_allclose(
        resolve_contact(vertices + shift, rig.mesh) - shift,
        resolve_contact(vertices, rig.mesh),
        atol=1e-6,
    )


@pytest.mark.parametrize("seed", range(3))
def test_any_pose_stays_finite_and_near(rig: Rig, seed: int) -> None:
    low, high = rig.bounds.T
    vertices = rig.deform(np.random.default_rng(seed).uniform(low, high))
    moved = resolve_contact(vertices, rig.mesh)
    assert np.isfinite(moved).all()
    changed = np.linalg.norm(moved - vertices, axis=1)
    assert not changed[np.setdiff1d(np.arange(len(vertices)), list_touching(rig.mesh))].any()


def test_faces_without_teeth_stay_as_they_are(rig: Rig) -> None:
    mask = load_face(ROOT / "fixtures" / "faces" / "mask.toml")
    vertices = mask.mesh.vertices.copy()
    vertices[:, 1] *= 0.1
    assert resolve_contact(vertices, mask.mesh) is vertices
    assert not list_touching(mask.mesh).size


def test_a_reshaped_head_has_contact_too() -> None:
    head = reshape_head(load_built_in_head(), width=1.1, mouth_width=0.9, size=0.95)
    rig = load_face(mesh=head)
    vertices = rig.deform(to_parameters(PRESSED, rig.parameter_names))
    measured = Depths(rig.mesh)
    assert measured.measure(resolve_contact(vertices, rig.mesh))["lip in lip"] < SHALLOW


@pytest.mark.parametrize("phone", ["TH", "L", "T", "N", "K"])
def test_sounds_of_the_tongue_are_where_they_belong(depths: Depths, rig: Rig, phone: str) -> None:
    segments = [
        PhoneSegment(0.12 * i, 0.12 * (i + 1), s) for i, s in enumerate(["AA", phone, "AA"])
    ]
    phones = PhoneSequence(tuple(segments), phone_set="en-arpabet")
    values = np.zeros(15)
    values[:10] = RuleBased().prepare("en-arpabet").predict_at(phones, np.array([0.18]))[0]
    values[10:] = compute_tongue(phones, [0.18], jaw=values[:1])[0]
    vertices = resolve_contact(rig.deform(values), rig.mesh)
    assert max(depths.measure(vertices).values()) < SHALLOW
    mesh = rig.mesh
    tongue, palate = vertices[mesh.get_region("tongue")], vertices[mesh.get_region("gums_upper")]
    teeth = vertices[mesh.get_feature_point("9.10")]
    if phone == "TH":
        # Between the teeth: before the upper ones, below their edge.
        foremost = tongue[tongue[:, 2].argmax()]
        assert foremost[2] > teeth[2] - 1.0
        assert foremost[1] < teeth[1]
        return
    near, _ = cKDTree(palate).query(tongue)
    touching = tongue[near < 1.5]
    assert len(touching)
    # The tip behind the teeth, or the body far back.
    behind = teeth[2] - touching[:, 2].max()
    assert (behind > 25) if phone == "K" else (3 < behind < 16)
