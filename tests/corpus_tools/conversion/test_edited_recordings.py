"""Edit lists are honoured by every command that reads recordings, and noticed when they change."""

import hashlib
import json
import shutil

import numpy as np
import pytest

import corpus_tools
from corpus_tools.cli import app as cli
from corpus_tools.conversion.entries import list_entries
from corpus_tools.conversion.manifest import load_manifest
from corpus_tools.conversion.plan import find_files
from mocap_fit.corpus import open_corpus
from mocap_fit.edits import (
    DropSpan,
    EditList,
    Mirror,
    Relabel,
    Rename,
    Swap,
    start_edits,
    write_edits,
)
from mocap_fit.io import read_tracks, write_tracks
from mocap_fit.labels import read_phones
from mocap_fit.tracks import read_parquet


@pytest.fixture
def takes(session, tmp_path):
    """A folder with the first recording of the session, and a place for its list."""
    folder = tmp_path / "takes"
    folder.mkdir()
    shutil.copy(session.recordings[0], folder / "take.tsv")
    return folder


def write(recording, *edits, path=None):
    path = path or recording.with_name(f"{recording.name}.edits.toml")
    write_edits(start_edits(recording).add(*edits), path)
    return path


def fit(session, takes, out, **options):
    report = corpus_tools.fit(
        takes, reference=session.reference, layout=session.layout, out=out, **options
    )
    assert report.errors == {}
    return report, read_parquet(out / "take.parquet")


class TestFit:
    def test_a_list_beside_the_recording_is_applied_and_noticed(self, session, takes, tmp_path):
        recording, out = takes / "take.tsv", tmp_path / "fits"
        before = hashlib.sha256(recording.read_bytes()).hexdigest()
        _, plain = fit(session, takes, out)
        swap = Swap(markers=("lip_upper_mid", "chin_mid"), start=0.1, end=0.3)
        spoilt = swap.apply(read_tracks(recording))
        write(recording, DropSpan(start=0.1, end=0.2))
        report, edited = fit(session, takes, out)
        assert not report.recordings[0]["kept"]
        assert np.isnan(edited.residuals[6:12]).all()
        np.testing.assert_allclose(edited.values[20:], plain.values[20:], atol=1e-6)
        steps = {step.name: step.arguments for step in edited.provenance}
        assert steps["edit"]["edits"][0]["edit"] == "drop_span"
        assert fit(session, takes, out)[0].recordings[0]["kept"]
        assert hashlib.sha256(recording.read_bytes()).hexdigest() == before
        # A list mends what is wrong in another file.
        write_tracks(spoilt, recording)
        write(recording, swap)
        _, mended = fit(session, takes, out)
        np.testing.assert_allclose(mended.values, plain.values, atol=1e-3)

    def test_a_list_may_be_elsewhere(self, session, takes, tmp_path):
        recording = takes / "take.tsv"
        path = write(recording, DropSpan(start=0.1, end=0.2), path=tmp_path / "my.toml")
        _, edited = fit(session, takes, tmp_path / "fits", edits=path)
        assert np.isnan(edited.residuals[6:12]).all()

    @pytest.mark.parametrize("what", ["another recording", "no such marker", "not TOML"])
    def test_a_bad_list_refuses_its_recording_alone(self, session, takes, tmp_path, what, capsys):
        shutil.copy(session.recordings[1], takes / "good.tsv")
        path = write(takes / "take.tsv", Rename(old="nobody", new="somebody"))
        if what == "another recording":
            write_edits(EditList(sha256="0" * 64), path)
        elif what == "not TOML":
            path.write_text("= 1")
        call = ["fit", str(takes), "--reference", str(session.reference)]
        assert cli.main([*call, "--out", str(tmp_path / "fits"), "-q"]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert "take.tsv" in line
        assert {"no such marker": "edit 1 of the edit list"}.get(what, what) in line
        assert [path.stem for path in (tmp_path / "fits").iterdir()] == ["good"]


class TestConvert:
    def test_recordings_and_labels_are_edited_before_they_are_checked(self, lab, tmp_path):
        folder, out = tmp_path / "lab", tmp_path / "corpus"
        shutil.copytree(lab, folder)
        recording, *_ = sorted((folder / "recordings").iterdir())
        name = recording.stem
        (labels,) = (folder / "labels").glob(f"{name}.*")
        phones = read_phones(labels, phone_set="sv-sta")
        spoken = next(segment for segment in phones if segment.phone != "sil")
        write_tracks(Mirror().apply(read_tracks(recording)), recording)
        first = corpus_tools.convert(folder, out=out)
        assert "mirror image" in first.errors[name]
        other = "L" if spoken.phone != "L" else "M"
        write(recording, Mirror(), Relabel(time=spoken.centre, phone=other))
        second = corpus_tools.convert(folder, out=out)
        assert second.errors == {}
        utterance = next(u for u in open_corpus(out) if u.id == name)
        converted = utterance.read_phones()
        assert other == next(s.phone for s in converted if abs(s.centre - spoken.centre) < 0.01)
        steps = [step.name for step in utterance.read_tracks().provenance]
        assert "edit" in steps
        assert "edit" in [step.name for step in converted.provenance]
        # The others are as they were.
        assert [row.name for row in second.results.values() if not row.cached] == [name]

    def test_the_manifest_says_where_lists_are(self, lab, tmp_path):
        folder = tmp_path / "lab"
        shutil.copytree(lab, folder)
        manifest = load_manifest(folder / "manifest.toml")
        manifest = manifest.model_copy(update={"edits": "edits/{id}.toml"})
        entries = list_entries(manifest, folder)
        first, second, third = sorted((folder / "recordings").iterdir())
        (folder / "edits").mkdir()
        write(first, Mirror(), path=folder / "edits" / f"{first.stem}.toml")
        write(first, Rename(old="a", new="b"))
        write(second, Mirror(axis="z"))
        write(second, Mirror(), path=folder / "edits" / f"{third.stem}.toml")
        items, refused = find_files(manifest, entries, folder)
        edits = {item.name: item.edits for item in items}
        assert edits[first.stem].edits == (Mirror(),)
        assert edits[second.stem].edits == (Mirror(axis="z"),)
        assert set(refused) == {third.stem}
        assert "another recording" in refused[third.stem]

    @pytest.mark.slow
    def test_a_phone_that_is_not_in_the_set_is_refused(self, lab, tmp_path):
        folder = tmp_path / "lab"
        shutil.copytree(lab, folder)
        recording, *_ = sorted((folder / "recordings").iterdir())
        write(recording, Relabel(time=0.001, phone="foo"))
        report = corpus_tools.convert(folder, out=tmp_path / "corpus")
        assert "'foo' is not in the phone set" in report.errors[recording.stem]


class TestValidate:
    def test_what_is_mended_is_not_wrong_any_more(self, lab, tmp_path):
        folder = tmp_path / "lab"
        shutil.copytree(lab, folder)
        recording, *_ = sorted((folder / "recordings").iterdir())
        swap = Swap(markers=("lip_upper_mid", "chin_mid"), start=0.4, end=1.4)
        write_tracks(swap.apply(read_tracks(recording)), recording)

        def find_codes(**options):
            report = corpus_tools.validate([recording], **options)
            return {finding.code for finding in report.findings}

        assert "MF106" in find_codes()
        path = write(recording, swap, path=tmp_path / "my.toml")
        assert "MF106" not in find_codes(edits=path)
        shutil.copy(path, recording.with_name(f"{recording.name}.edits.toml"))
        assert "MF106" not in find_codes()
        write_edits(EditList(sha256="0" * 64), path)
        assert {"MF004", "MF106"} <= find_codes(edits=path)


def test_info_says_that_there_is_a_list(takes):
    write(takes / "take.tsv", Mirror(), Rename(old="chin_mid", new="chin"))
    (content,) = (c for c in corpus_tools.info(takes / "take.tsv").contents)
    assert content["edits"] == "take.tsv.edits.toml: mirror: x; rename: chin_mid, chin"
    assert json.dumps(content)
