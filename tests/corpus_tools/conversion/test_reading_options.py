"""Recordings that say something wrongly: with the option that mends it, results are the same."""

import re
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest

import corpus_tools
from corpus_tools.cli import app as cli
from mocap_fit.errors import ConfigurationError, MocapFitError, MocapFitWarning
from mocap_fit.io import read_tracks, write_qualisys_tsv
from mocap_fit.io.names import rename_tracks
from mocap_fit.tracks import MarkerTracks, read_parquet

# Metres come back as millimetres to the last digit but one; of a reference pose, the solver of the
# orientation fit makes a millionth of a millimetre of that, and those of some frames this.
TOLERANCE = 2e-3
SWAP = np.eye(3)[[0, 2, 1]]
OLD, NEW = "Lip Upper", "lip_upper_mid"


def add_twin(tracks: MarkerTracks) -> MarkerTracks:
    """Add a second person whose markers have the same names."""
    names = [f"{who}:{name}" for who in ("Ann", "Bo") for name in tracks.names]
    positions = np.concatenate([tracks.positions, tracks.positions[:, ::-1] + 500.0], axis=1)
    return tracks.replace(names=tuple(names), positions=positions, origin=None)


SPOILT = {
    "unit": (lambda t: t.replace(positions=t.positions / 1000), {"unit": "m"}),
    "name": (lambda t: rename_tracks(t, {NEW: OLD}), {"rename": {OLD: NEW}}),
    "subject": (add_twin, {"subject": "Ann"}),
    "rate": (lambda t: t.replace(rate=t.rate / 2), {"rate": 60.0}),
    "axes": (lambda t: t.replace(positions=t.positions @ SWAP.T), {"allow_mirrored": True}),
}


def spoil(source: Path, target: Path, change) -> None:
    target.parent.mkdir(exist_ok=True)
    write_qualisys_tsv(change(read_tracks(source)), target, decimals=9)


@pytest.fixture(scope="module")
def plain(session, tmp_path_factory):
    """The parameters of the recording as it is."""
    folder = tmp_path_factory.mktemp("plain")
    spoil(session.recordings[0], folder / "a.tsv", lambda tracks: tracks)
    corpus_tools.fit(
        folder / "a.tsv", reference=session.reference, layout=session.layout, out=folder / "out"
    )
    return read_parquet(folder / "out" / "a.parquet")


@pytest.mark.parametrize("kind", SPOILT)
def test_fit(kind, session, plain, tmp_path):
    change, options = SPOILT[kind]
    spoil(session.recordings[0], tmp_path / "a.tsv", change)
    # Unit and subject hold for the reference pose too; it has the right names and axes.
    reference = tmp_path / "reference.tsv"
    both = kind in ("unit", "subject")
    spoil(session.reference, reference, change if both else lambda tracks: tracks)
    where = {"reference": reference, "layout": session.layout, "out": tmp_path / "out"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        if both:
            with pytest.raises(MocapFitError, match=re.escape(str(reference))):
                corpus_tools.fit(tmp_path / "a.tsv", **where)
        elif kind != "rate":
            assert list(corpus_tools.fit(tmp_path / "a.tsv", **where).errors) == ["a"]
        report = corpus_tools.fit(tmp_path / "a.tsv", **where, **options)
    assert not report.errors
    mended = read_parquet(tmp_path / "out" / "a.parquet")
    assert mended.rate == 60.0
    np.testing.assert_allclose(mended.values, plain.values, atol=TOLERANCE if both else 1e-9)
    np.testing.assert_allclose(mended.times - mended.start_time, plain.times - plain.start_time)
    again = corpus_tools.fit(tmp_path / "a.tsv", **where, **options)
    assert [row["kept"] for row in again.recordings] == [True]


def exchange(tracks: MarkerTracks) -> MarkerTracks:
    """Exchange the names of left and right."""
    other = {"left": "right", "right": "left"}
    names = ["_".join(other.get(part, part) for part in name.split("_")) for name in tracks.names]
    return tracks.replace(names=tuple(names))


def test_what_is_wrong_in_the_recordings_alone(session, plain, tmp_path):
    spoil(session.recordings[0], tmp_path / "a.tsv", lambda t: SPOILT["unit"][0](exchange(t)))
    spoil(session.reference, tmp_path / "rest.tsv", lambda tracks: tracks)
    names = read_tracks(tmp_path / "rest.tsv").names
    pairs = zip(names, exchange(read_tracks(tmp_path / "rest.tsv")).names, strict=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        report = corpus_tools.fit(
            tmp_path / "a.tsv",
            reference=tmp_path / "rest.tsv",
            layout=session.layout,
            out=tmp_path / "out",
            unit="m",
            rename={old: new for old, new in pairs if old != new},
            reference_as_is=True,
        )
    assert not report.errors
    mended = read_parquet(tmp_path / "out" / "a.parquet")
    np.testing.assert_allclose(mended.values, plain.values, atol=1e-6)


def test_all_on_the_command_line(session, plain, tmp_path, capsys):
    spoil(
        session.recordings[0],
        tmp_path / "a.tsv",
        lambda t: SPOILT["subject"][0](SPOILT["name"][0](SPOILT["axes"][0](t))),
    )
    spoil(session.reference, tmp_path / "rest.tsv", lambda tracks: tracks)
    command = ["fit", str(tmp_path / "a.tsv"), "--reference", str(tmp_path / "rest.tsv")]
    command += ["--layout", session.layout, "--out", str(tmp_path / "out")]
    assert cli.main(command) == 1
    assert "--subject Bo" in capsys.readouterr().err
    command += ["--subject", "Ann"]
    assert cli.main(command) == 1
    message = capsys.readouterr().err
    assert "lacks 1 of the 35 markers" in message
    assert f"--rename '{OLD}={NEW}'" in message
    command += ["--rename", f"{OLD}={NEW}"]
    assert cli.main(command) == 1
    assert "is a mirror image of the reference pose" in capsys.readouterr().err
    assert cli.main([*command, "--allow-mirrored"]) == 0
    assert "mirrored back" in capsys.readouterr().err
    mended = read_parquet(tmp_path / "out" / "a.parquet")
    np.testing.assert_allclose(mended.values, plain.values, atol=1e-9)


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--rate", "0"], "--rate"),
        (["--rate", "nan"], "--rate"),
        (["--unit", "ft"], "mm, cm, m"),
        (["--rename", "chin"], "OLD=NEW"),
        (["--rename", "a=b", "--rename", "a=c"], "twice"),
    ],
)
@pytest.mark.parametrize("command", ["info", "validate"])
def test_wrong_calls(command, words, problem, session, capsys):
    assert cli.main([command, str(session.reference), *words]) == 2
    assert problem in capsys.readouterr().err


def test_info_and_validate(session, tmp_path, capsys):
    path = tmp_path / "a.tsv"
    spoil(session.recordings[0], path, lambda t: SPOILT["unit"][0](SPOILT["name"][0](t)))
    options = {"unit": "m", "rename": {OLD: NEW}, "rate": 30.0}
    (content,) = corpus_tools.info(path, **options).contents
    assert content["rate"] == 30.0
    assert NEW in [marker["name"] for marker in content["markers"]]
    codes = {f.code for f in corpus_tools.validate([path]).findings}
    assert {"MF111", "MF121"} <= codes
    mended = corpus_tools.validate([path], unit="m", rename={OLD: NEW})
    assert not {"MF111", "MF112", "MF121"} & {f.code for f in mended.findings}
    words = ["--unit", "m", "--rename", f"{OLD}={NEW}"]
    assert cli.main(["info", str(path), *words]) == 0
    assert NEW in capsys.readouterr().out
    assert cli.main(["info", str(path), "--rename", "none=nothing"]) == 1
    assert "there is no marker 'none' to rename" in capsys.readouterr().err


def test_validate_sees_through_the_prefix_of_a_subject(session, tmp_path):
    def add_wand(tracks):
        names = (*(f"Ann:{name}" for name in tracks.names), "Wand:tip")
        tip = 3000.0 + tracks.positions[:, :1]
        positions = np.concatenate([tracks.positions, tip], axis=1)
        return tracks.replace(names=names, positions=positions, origin=None)

    spoil(session.recordings[0], tmp_path / "a.tsv", add_wand)
    findings = corpus_tools.validate([tmp_path / "a.tsv"]).findings
    assert [f.location.item for f in findings if f.code in ("MF111", "MF112")] == ["Wand:tip"]


def test_one_warning_of_many_files_is_one_line_of_validate(session, tmp_path):
    for name in "abc":
        spoil(session.recordings[0], tmp_path / f"{name}.tsv", lambda t: t.replace(rate=30.0))
    with pytest.warns(MocapFitWarning) as caught:
        corpus_tools.validate([tmp_path], rate=60.0)
    (message,) = [str(w.message) for w in caught]
    assert "a.tsv: the file says 30 Hz; 60 Hz is used" in message
    assert message.endswith("(and the same of 2 more)")


def test_a_manifest(lab, lab_corpus, tmp_path):
    folder = tmp_path / "lab"
    shutil.copytree(lab, folder)

    def change(tracks):
        return add_twin(rename_tracks(SPOILT["unit"][0](tracks), {NEW: OLD}))

    for path in [*(folder / "recordings").iterdir(), folder / "reference.tsv"]:
        spoil(path, path, change)
    manifest = folder / "manifest.toml"
    text = manifest.read_text()
    assert "rate = 30" in text
    manifest.write_text(f'unit = "m"\nsubject = "Bo"\nrename = {{ "{OLD}" = "{NEW}" }}\n' + text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        # What the caller says wins.
        report = corpus_tools.convert(folder, out=tmp_path / "out", subject="Ann")
    assert not report.errors
    for path in sorted((lab_corpus / "tracks").iterdir()):
        mended = read_parquet(tmp_path / "out" / "tracks" / path.name)
        np.testing.assert_allclose(mended.values, read_parquet(path).values, atol=TOLERANCE)
        markers = read_tracks(tmp_path / "out" / "markers" / path.name)
        expected = read_tracks(lab_corpus / "markers" / path.name)
        assert markers.names == expected.names
        np.testing.assert_allclose(markers.positions, expected.positions, atol=1e-6)


@pytest.mark.slow
def test_mirrored_recordings_are_one_line_and_mended_ones_are_written(lab, lab_corpus, tmp_path):
    folder = tmp_path / "lab"
    shutil.copytree(lab, folder)
    for path in (folder / "recordings").iterdir():
        spoil(path, path, SPOILT["axes"][0])
    report = corpus_tools.convert(folder, out=tmp_path / "out")
    assert len(report.errors) == 3
    (line,) = [line for line in report.messages if line.startswith("error")]
    assert line.startswith("error: 3 utterances (sim001, sim002, sim003): the recording is a mirr")
    report = corpus_tools.convert(folder, out=tmp_path / "out", allow_mirrored=True)
    assert not report.errors
    (line,) = [line for line in report.messages if "mirrored back" in line]
    assert line.startswith("warning: 3 utterances")
    for path in sorted((lab_corpus / "markers").iterdir()):
        mended = read_tracks(tmp_path / "out" / "markers" / path.name)
        np.testing.assert_allclose(mended.positions, read_tracks(path).positions, atol=1e-6)


@pytest.mark.slow
def test_the_rate_of_the_manifest_wins_and_both_are_said(lab, lab_corpus, tmp_path):
    folder = tmp_path / "lab"
    shutil.copytree(lab, folder)
    for path in (folder / "recordings").iterdir():
        spoil(path, path, lambda tracks: tracks.replace(rate=60.0))
    report = corpus_tools.convert(folder, out=tmp_path / "out")
    assert not report.errors
    (line,) = [line for line in report.messages if "60 Hz" in line]
    assert "3 utterances" in line
    assert "the file says 60 Hz; 30 Hz is used, as given" in line
    for path in sorted((lab_corpus / "tracks").iterdir()):
        mended = read_parquet(tmp_path / "out" / "tracks" / path.name)
        np.testing.assert_allclose(mended.values, read_parquet(path).values, atol=1e-6)


def test_a_manifest_with_an_impossible_unit(lab, tmp_path):
    path = tmp_path / "manifest.toml"
    path.write_text('phone_set = "en-arpabet"\nunit = "ell"\n')
    with pytest.raises(ConfigurationError, match="unit"):
        corpus_tools.convert(path, out=tmp_path / "out", root=lab)
