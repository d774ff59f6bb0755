"""Mirrored, turned and scaled reference poses and recordings: refused, mended, or named."""

import warnings

import numpy as np
import pytest

import mocap_fit as mf
from corpus_tools.simulation import OTHER_SPEAKER, Conditions, Session
from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.face import load_face
from mocap_fit.face.builtin import load_built_in_head, reshape_head
from mocap_fit.fitting import Layout, Speaker, fit_speaker, load_layout
from mocap_fit.fitting.coordinates import check_recording, check_reference
from mocap_fit.tracks import MarkerTracks

LAYOUT = load_layout("face30-head5")
MIRRORS = {
    "x": np.diag([-1.0, 1, 1]),
    "z": np.diag([1.0, 1, -1]),
    "all": -np.eye(3),
    "y and z": np.eye(3)[[0, 2, 1]],
    "x and y": np.eye(3)[[1, 0, 2]],
}
every_mirror = pytest.mark.parametrize("matrix", MIRRORS.values(), ids=MIRRORS)


@pytest.fixture(scope="module")
def rest() -> MarkerTracks:
    return mf.read_tracks(mf.load_sample("rest"))


@pytest.fixture(scope="module")
def take() -> MarkerTracks:
    return mf.read_tracks(mf.load_sample("take_01"))


@pytest.fixture(scope="module")
def speaker(rest: MarkerTracks) -> Speaker:
    return fit_speaker("built-in", LAYOUT, rest)


def turn(tracks: MarkerTracks, matrix: np.ndarray, scale: float = 1.0) -> MarkerTracks:
    return tracks.replace(positions=scale * tracks.positions @ matrix.T)


@every_mirror
def test_a_mirrored_recording(matrix, rest, take) -> None:
    with pytest.raises(DataError, match=r"is a mirror image of the reference.*--allow-mirrored"):
        check_recording(LAYOUT, rest, turn(take, matrix))
    with pytest.warns(MocapFitWarning, match="and is mirrored back"):
        mended = check_recording(LAYOUT, rest, turn(take, matrix), allow_mirrored=True)
    # The head hardly turns in the sample: these are the axes again, to the last digit.
    np.testing.assert_array_equal(mended.positions, take.positions)
    assert mended.provenance[-1].name == "mirror"
    assert check_recording(LAYOUT, rest, take, allow_mirrored=True) is take


@every_mirror
def test_a_mirrored_reference_pose_and_both(matrix, rest, take) -> None:
    with pytest.raises(DataError, match="the reference pose is a face's mirror image"):
        check_reference(LAYOUT, turn(rest, matrix))
    with pytest.warns(MocapFitWarning, match="and is mirrored back"):
        mended = check_reference(LAYOUT, turn(rest, matrix), allow_mirrored=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error", MocapFitWarning)
        check_reference(LAYOUT, mended)
    # Both are mirrored: then the recording is, too, seen from the mended pose.
    with pytest.raises(DataError, match="mirror image"):
        check_recording(LAYOUT, mended, turn(take, matrix))
    with pytest.warns(MocapFitWarning, match="mirrored back"):
        both = check_recording(LAYOUT, mended, turn(take, matrix), allow_mirrored=True)
    one = check_reference(LAYOUT, rest)
    np.testing.assert_array_equal(check_recording(LAYOUT, one, take).positions, take.positions)
    flipped = np.diag([-1.0, 1, 1]) @ matrix
    np.testing.assert_array_equal(both.positions, turn(take, flipped).positions)


def test_exchanged_names_are_a_mirror_image_too(rest, take) -> None:
    swapped = {"left": "right", "right": "left"}
    names = ["_".join(swapped.get(part, part) for part in name.split("_")) for name in take.names]
    away = (rest.replace(positions=rest.positions + 500), take.positions + 500)
    exchanged = take.replace(names=tuple(names), positions=away[1])
    with pytest.raises(DataError, match=r"mirror image .*names of left and right are exchanged,"):
        check_recording(LAYOUT, away[0], exchanged)
    with pytest.raises(DataError, match=r"mirror image .*found x is reversed,"):
        check_recording(LAYOUT, away[0], turn(take.replace(positions=away[1]), MIRRORS["x"]))


def test_the_fit_of_a_mended_recording_is_that_of_the_recording(speaker, take) -> None:
    part = take.between(0, 0.2)
    with pytest.raises(DataError, match="mirror image"):
        speaker.fit(turn(part, MIRRORS["y and z"]))
    with pytest.warns(MocapFitWarning, match="mirrored back"):
        mended = speaker.fit(turn(part, MIRRORS["y and z"]), allow_mirrored=True)
    expected = speaker.fit(part).parameters.values
    np.testing.assert_allclose(mended.parameters.values, expected, atol=1e-9)


def test_a_mirrored_reference_gives_a_speaker_only_where_that_is_allowed(rest, speaker) -> None:
    mirrored = turn(rest, MIRRORS["x"])
    with pytest.raises(DataError, match="rest: the reference pose is a face's mirror image"):
        fit_speaker("built-in", LAYOUT, mirrored)
    with pytest.warns(MocapFitWarning, match="mirrored back"):
        mended = fit_speaker("built-in", LAYOUT, mirrored, allow_mirrored=True)
    np.testing.assert_array_equal(mended.binding.coordinates, speaker.binding.coordinates)


def test_flat_markers_say_nothing_and_that_is_said(rest, take) -> None:
    pose = np.nanmedian(rest.positions, axis=0)
    centred = pose - pose.mean(axis=0)
    axes = np.linalg.svd(centred)[2]
    flat = rest.replace(
        positions=(centred @ axes.T * [1, 1, 0.05] @ axes + pose.mean(axis=0))[None], origin=None
    )
    for matrix in (np.eye(3), MIRRORS["x"]):
        with pytest.warns(MocapFitWarning, match="cannot be tested.*nearly in one plane"):
            assert check_reference(LAYOUT, turn(flat, matrix)).names == rest.names
    assert check_recording(LAYOUT, flat, turn(take, MIRRORS["x"])).names == take.names


@pytest.mark.parametrize(
    ("scale", "unit"),
    [(0.001, "in metres"), (0.1, "in centimetres"), (1 / 25.4, "in inches"), (1000, "read as met")],
)
def test_another_unit_is_named(scale, unit, rest, speaker, take) -> None:
    with pytest.raises(DataError, match=rf"reference pose differs.*{unit}.*--unit"):
        check_reference(LAYOUT, turn(rest, np.eye(3), scale))
    with pytest.raises(DataError, match=r"differ in size|reference markers"):
        speaker.fit(turn(take, np.eye(3), scale))


def test_sizes_and_axes_that_a_fit_can_bear_are_named(rest, take) -> None:
    with pytest.warns(MocapFitWarning, match=r"unusual size: 2.* times the layout's face"):
        check_reference(LAYOUT, turn(rest, np.eye(3), 2.2))
    with pytest.warns(MocapFitWarning, match=r"recording is 1\.2 times as large"):
        check_recording(LAYOUT, rest, turn(take, np.eye(3), 1.2))
    z_up = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    with pytest.warns(MocapFitWarning, match=r"turned by .* \(.*y is -z.*axes may be exchanged"):
        check_recording(LAYOUT, rest, turn(take, z_up))
    with warnings.catch_warnings():
        warnings.simplefilter("error", MocapFitWarning)
        check_reference(LAYOUT, rest)
        check_recording(LAYOUT, rest, turn(take, np.eye(3), 1.05))


def test_few_markers_in_common(rest, take) -> None:
    few = take.select(take.names[:3])
    assert check_recording(LAYOUT, rest, few) is few
    empty = take.replace(positions=take.positions[:0], origin=None)
    assert check_recording(LAYOUT, rest, empty) is empty
    unplaced = Layout.model_validate(
        {
            "name": "own",
            "markers": [
                {"name": n, "feature_point": f"99.{k}", "orientation": True}
                for k, n in enumerate(rest.names[:6])
            ],
        }
    )
    with pytest.warns(MocapFitWarning, match="cannot be tested"):
        assert check_reference(unplaced, rest) is rest


@pytest.mark.parametrize("head", [None, OTHER_SPEAKER], ids=["the head itself", "another"])
def test_no_good_take_is_refused_and_no_mirrored_one_passes(head, face, layout) -> None:
    conditions = Conditions(noise=0.5, drop_outs=0.3, duration=1.0, head_rotation=0.5)
    if head is not None:
        face = load_face(mesh=reshape_head(load_built_in_head(), **head))
    session = Session(layout, face, conditions)
    first, *others = np.random.default_rng(1).spawn(5)
    reference = session.record_reference(first)
    with warnings.catch_warnings():
        warnings.simplefilter("error", MocapFitWarning)
        assert check_reference(layout, reference) is reference
        for rng in others:
            take = session.record(rng, "take").recording
            assert check_recording(layout, reference, take) is take
            with pytest.raises(DataError, match="mirror image"):
                check_recording(layout, reference, turn(take, MIRRORS["all"]))
    with pytest.raises(DataError, match="mirror image"):
        check_reference(layout, turn(reference, MIRRORS["z"]))


@pytest.mark.slow
@pytest.mark.real_data
def test_real_takes(data_folder) -> None:
    folder = data_folder / "grid_s1"
    layout = load_layout("grid_s1")
    reference = mf.read_tracks(folder / "reference.tsv")
    with warnings.catch_warnings():
        warnings.simplefilter("error", MocapFitWarning)
        assert check_reference(layout, reference) is reference
        for path in sorted((folder / "tsv").iterdir()):
            take = mf.read_tracks(path)
            assert check_recording(layout, reference, take) is take
            with pytest.raises(DataError, match="mirror image"):
                check_recording(layout, reference, turn(take, MIRRORS["y and z"]))
    body = mf.read_tracks(data_folder / "c3d" / "qtm2017_body_with_head_markers.c3d")
    all_of_it = Layout.model_validate(
        {
            "name": "body",
            "markers": [
                {"name": name, "feature_point": "2.1", "orientation": True} for name in body.names
            ],
        }
    )
    start = body.between(body.start_time, body.start_time + 0.1)
    for pose in (start, body):
        assert check_recording(all_of_it, pose, body) is body
