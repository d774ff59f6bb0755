"""Long recordings, stretch by stretch: the bytes of the fit in one piece."""

import json

import numpy as np
import pytest

from corpus_tools.cli import app as cli
from corpus_tools.conversion import long_recording
from mocap_fit import read_tracks
from mocap_fit.tracks import MarkerTracks, parquet_file, read_parquet


@pytest.fixture(scope="module")
def long_session(simulate, tmp_path_factory):
    """A recording of 1,320 frames with gaps, as TSV and as CSV."""
    folder = simulate(
        tmp_path_factory.mktemp("long") / "session", "--utterances", 1, "--duration", 22
    )
    recording = read_tracks(folder.recordings[0])
    assert recording.frames == 1320
    assert not recording.visible.all()
    write_csv(recording, folder.path / "as_csv.csv")
    return folder


def write_csv(recording: MarkerTracks, path) -> None:
    titles = [f"{name}_{axis}" for name in recording.names for axis in "xyz"]
    rows = np.concatenate(
        [recording.times[:, None], recording.positions.reshape(recording.frames, -1)], axis=1
    )
    text = [",".join(f"{v:.6f}" if np.isfinite(v) else "" for v in row) for row in rows]
    path.write_text("\n".join([",".join(["time", *titles]), *text]) + "\n")


def fitted(session, file, out, *options: object) -> bytes:
    status = cli.main(
        [
            *("fit", str(file), "--reference", str(session.reference)),
            *("--layout", session.layout, "--out", str(out), *map(str, options)),
        ]
    )
    assert status == 0
    (result,) = out.iterdir()
    return result.read_bytes()


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("tsv", ()),
        ("csv", ()),
        ("tsv", ("--solver", "newton", "--objective", "huber")),
    ],
)
def test_the_bytes_of_one_piece(long_session, tmp_path, monkeypatch, capsys, kind, options):
    file = long_session.recordings[0] if kind == "tsv" else long_session.path / "as_csv.csv"
    monkeypatch.setattr(parquet_file, "ROW_GROUP", 600)
    monkeypatch.setattr(long_recording, "ROW_GROUP", 600)
    whole = fitted(long_session, file, tmp_path / "whole", *options, "--json")
    told = json.loads(capsys.readouterr().out)["recordings"][0]
    monkeypatch.setattr(long_recording, "LONG", 0)
    monkeypatch.setattr(long_recording, "STRETCH", 512)
    seen = []
    fit = long_recording.fit

    def watched(*arguments):
        seen.append(arguments[2])
        return fit(*arguments)

    monkeypatch.setattr(long_recording, "fit", watched)
    assert fitted(long_session, file, tmp_path / "parts", *options, "--json") == whole
    assert seen == [file]
    again = json.loads(capsys.readouterr().out)["recordings"][0]
    assert again | {"output": ""} == told | {"output": ""}
    assert read_parquet(next((tmp_path / "parts").iterdir())).frames == 1320


def test_a_long_recording_is_kept(long_session, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(long_recording, "LONG", 0)
    file = long_session.recordings[0]
    first = fitted(long_session, file, tmp_path, "--solver", "newton")
    capsys.readouterr()
    assert fitted(long_session, file, tmp_path, "--solver", "newton", "--json") == first
    assert json.loads(capsys.readouterr().out)["recordings"][0]["kept"] is True
    # One byte of the result is wrong: it is made anew.
    (result,) = tmp_path.iterdir()
    damaged = bytearray(first)
    damaged[len(damaged) // 3] ^= 0xFF
    result.write_bytes(damaged)
    assert fitted(long_session, file, tmp_path, "--solver", "newton") == first


def test_a_fault_far_into_the_file_leaves_nothing(long_session, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(long_recording, "LONG", 0)
    monkeypatch.setattr(long_recording, "STRETCH", 512)
    lines = long_session.recordings[0].read_text().splitlines(keepends=True)
    file = tmp_path / "broken.tsv"
    file.write_text("".join([*lines[:-10], lines[-10].replace(".", "x", 4), *lines[-9:]]))
    out = tmp_path / "out"
    status = cli.main(
        [
            *("fit", str(file), "--reference", str(long_session.reference)),
            *("--layout", long_session.layout, "--out", str(out)),
        ]
    )
    assert status == 1
    assert f"line {len(lines) - 9}" in capsys.readouterr().err
    assert list(out.iterdir()) == []


def test_what_needs_the_whole_is_fitted_whole(long_session, monkeypatch):
    from corpus_tools.conversion.speaker import Options, Speaker

    file = long_session.recordings[0]
    speaker = Speaker.load(long_session.reference, long_session.layout, "built-in")
    assert not long_recording.is_one(speaker, Options(), file)
    monkeypatch.setattr(long_recording, "LONG", 0)
    assert long_recording.is_one(speaker, Options(), file)
    assert not long_recording.is_one(speaker, Options(smooth=True), file)
