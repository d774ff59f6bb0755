"""Names of recordings against those of the layout: subjects, doubled and lacking markers."""

import numpy as np
import pytest

import mocap_fit as mf
from mocap_fit.errors import DataError
from mocap_fit.fitting import load_layout
from mocap_fit.fitting.marker_names import match_names
from mocap_fit.io.names import rename_tracks
from mocap_fit.tracks import MarkerTracks

LAYOUT = load_layout("face30-head5")
NAMES = tuple(marker.name for marker in LAYOUT.markers)


def tracks_of(*names: str) -> MarkerTracks:
    return MarkerTracks(names, 50, np.arange(3.0 * len(names)).reshape(1, -1, 3))


def test_the_prefix_of_one_subject_is_no_difference() -> None:
    tracks = match_names(LAYOUT, tracks_of(*(f"Ann:{name}" for name in NAMES), "centre"))
    assert tracks.names == (*NAMES, "centre")
    assert tracks.provenance[-1].name == "rename"
    other = LAYOUT.model_copy(
        update={
            "markers": tuple(m.model_copy(update={"name": f"Bo:{m.name}"}) for m in LAYOUT.markers)
        }
    )
    assert match_names(other, tracks_of(*NAMES)).names == tuple(f"Bo:{name}" for name in NAMES)
    assert match_names(other, tracks_of(*(f"Ann:{n}" for n in NAMES))).names[0] == f"Bo:{NAMES[0]}"
    assert match_names(LAYOUT, tracks) is tracks


def test_two_subjects_are_not_one_face() -> None:
    names = [f"{'Ann' if k % 2 else 'Bo'}:{name}" for k, name in enumerate(NAMES)]
    with pytest.raises(DataError, match="the recording lacks 35 of the 35 markers"):
        match_names(LAYOUT, tracks_of(*names))


def test_head_markers_may_be_missing_but_from_the_reference_pose() -> None:
    head = {marker.name for marker in LAYOUT.head_markers}
    face = tracks_of(*(name for name in NAMES if name not in head))
    assert match_names(LAYOUT, face) is face
    with pytest.raises(DataError, match="the reference pose lacks 5 of the 35 markers"):
        match_names(LAYOUT, face, complete=True)


def test_both_lists_and_the_options_are_in_the_message() -> None:
    names = list(NAMES)
    names[0], names[1], names[2] = names[0].replace("_", " ").title(), f"X{'y' * 300}", "Chin!"
    with pytest.raises(DataError) as caught:
        match_names(LAYOUT, tracks_of(*names))
    message = str(caught.value)
    assert "lacks 3 of the 35 markers of the layout 'face30-head5'" in message
    assert f"expected {', '.join(NAMES[:3])}" in message
    assert f"found {names[0]}, X{'y' * 38}…, Chin!" in message
    assert f"--rename '{names[0]}={NAMES[0]}'" in message
    assert len(message) < 600
    with pytest.raises(DataError, match=r"Choose the layout.*--rename OLD=NEW"):
        match_names(LAYOUT, tracks_of("qqq", "www"))


def test_a_doubled_name_is_refused_only_where_the_layout_needs_it() -> None:
    def read_with(name: str) -> MarkerTracks:
        return tracks_of(*NAMES, f"{name}_2", "other").add_step(
            "read", {"renamed": {f"{name}_2": name}}
        )

    assert match_names(LAYOUT, read_with("other")).frames == 1
    chin = NAMES[3]
    with pytest.raises(DataError, match=rf"'{chin}' of the layout more than once.*--rename"):
        match_names(LAYOUT, read_with(chin))
    settled = rename_tracks(read_with(chin), {f"{chin}_2": "ghost"})
    assert match_names(LAYOUT, settled).names[-2] == "ghost"


def test_the_reader_and_the_fit_together(tmp_path) -> None:
    take = mf.read_tracks(mf.load_sample("take_01")).between(0, 0.1)
    mf.write_tracks(
        rename_tracks(take, {name: f"Ann:{name}" for name in take.names}), tmp_path / "a.tsv"
    )
    speaker = mf.fit_speaker("built-in", LAYOUT, mf.load_sample("rest"))
    mf.write_tracks(take, tmp_path / "b.tsv")
    one, other = (speaker.fit(mf.read_tracks(tmp_path / f"{k}.tsv")) for k in "ab")
    np.testing.assert_array_equal(one.parameters.values, other.parameters.values)
