"""Layouts are found by the names of markers, and confirmed by their shape."""

import numpy as np
import pytest
import tomli_w

import mocap_fit as mf
from mocap_fit.errors import ConfigurationError, MocapFitWarning
from mocap_fit.fitting import find_layout, fit_speaker, load_layout, rank_layouts


@pytest.fixture(scope="module")
def take():
    return mf.read_tracks(mf.load_sample("take_01"))


def write_layout(path, rename, **changes):
    content = load_layout("face30-head5").model_dump(mode="json", exclude_none=True)
    for marker in content["markers"]:
        marker["name"] = rename(marker["name"])
    path.write_text(tomli_w.dumps({**content, **changes}), encoding="utf-8")


def test_the_shipped_one_is_found(take):
    match = find_layout(take)
    assert (match.source, match.lacking) == ("face30-head5", ())
    assert match.misfit < 0.1


@pytest.mark.parametrize("change", ["mirrored", "metres", "turned", "prefixed"])
def test_what_is_mended_elsewhere_does_not_hide_it(take, change):
    positions, names = take.positions, take.names
    if change == "mirrored":
        positions = positions * [-1, 1, 1]
    elif change == "metres":
        positions = positions / 1000
    elif change == "turned":
        positions = positions[:, :, [1, 2, 0]]
    else:
        names = tuple(f"Ann:{name}" for name in names)
    assert find_layout(take.replace(positions=positions, names=names)).source == "face30-head5"


def test_one_beside_the_file_is_found_by_its_names(take, tmp_path):
    write_layout(tmp_path / "mine.toml", lambda name: f"M_{name}", name="")
    (tmp_path / "other.toml").write_text("colour = 1")
    (tmp_path / "broken.toml").write_text("= 1")
    mine = take.replace(names=tuple(f"M_{name}" for name in take.names))
    match = find_layout(mine, [tmp_path])
    assert match.source == str(tmp_path / "mine.toml")
    assert match.layout.name == "mine"


def test_of_two_with_the_same_names_the_shape_decides(take, tmp_path):
    order = np.random.default_rng(0).permutation(len(take.names))
    names = np.array(take.names)
    exchanged = dict(zip(names, names[order], strict=True))
    write_layout(tmp_path / "aaa.toml", lambda name: exchanged[name])
    assert find_layout(take, [tmp_path]).source == "face30-head5"
    assert len(rank_layouts(take, [tmp_path])) == 3
    again = take.replace(names=tuple(names[order]))
    assert find_layout(again, [tmp_path]).source == str(tmp_path / "aaa.toml")


def test_names_without_the_shape_are_refused(take):
    names = tuple(np.random.default_rng(1).permutation(take.names))
    with pytest.raises(ConfigurationError, match="are not where it has them"):
        find_layout(take.replace(names=names))


def test_a_near_miss_says_what_lacks(take):
    some = take.select(take.names[:20])
    with pytest.raises(ConfigurationError, match="nearest is 'face30-head5'") as caught:
        find_layout(some)
    assert "cheek_left" in str(caught.value)
    # Nearer, it is taken, and whoever uses it says what lacks.
    lacking = take.select(take.names[:4] + take.names[5:])
    assert find_layout(lacking).lacking == (take.names[4],)
    with pytest.raises(Exception, match=take.names[4]):
        fit_speaker("built-in", None, lacking)


def test_names_of_no_layout_are_refused(take):
    with pytest.raises(ConfigurationError, match="no marker of any layout"):
        find_layout(take.replace(names=tuple(f"p{k}" for k in range(35))))


def test_a_layout_that_contradicts_itself_is_named(take, tmp_path):
    (tmp_path / "bad.toml").write_text('[[markers]]\nname = "a"\n')
    with pytest.warns(MocapFitWarning, match=r"bad\.toml"):
        assert find_layout(take, [tmp_path]).source == "face30-head5"


def test_a_speaker_finds_it_beside_the_reference_pose(tmp_path):
    rest = mf.read_tracks(mf.load_sample("rest"))
    mine = rest.replace(names=tuple(f"M_{name}" for name in rest.names))
    mf.write_tracks(mine, tmp_path / "rest.tsv")
    write_layout(tmp_path / "mine.toml", lambda name: f"M_{name}")
    speaker = fit_speaker("built-in", None, f"{tmp_path / 'rest.tsv'}@0-0.3")
    assert speaker.binding.names[0].startswith("M_")
