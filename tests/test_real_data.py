"""Real recordings through the real commands; the numbers are printed with ``pytest -s``."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from corpus_tools.cli import app as cli
from mocap_fit import load_face, read_tracks
from mocap_fit.tracks import read_parquet

pytestmark = [pytest.mark.real_data, pytest.mark.slow]

# The labels are of the sound; the centre of the first video frame is 20 ms into it.
FIRST_FRAME = 0.02
CLOSED, OPEN = {"B", "M", "P"}, {"AA", "AE", "AY"}


def phone_centres(path: Path) -> list[tuple[str, float]]:
    text = path.read_text("utf-8")
    text = text[text.index('name = "phones"') :]
    found = re.findall(r'xmin = ([\d.]+)\s+xmax = ([\d.]+)\s+text = "(.*?)"', text)
    return [(phone, (float(start) + float(end)) / 2) for start, end, phone in found]


@pytest.fixture(scope="module")
def fitted(data_folder: Path, tmp_path_factory, request) -> dict:
    """All 287 recordings fitted in one command."""
    folder = data_folder / "grid_s1"
    out = tmp_path_factory.mktemp("grid") / "fits"
    capture = request.config.pluginmanager.getplugin("capturemanager")
    report = out.parent / "report.json"
    with capture.global_and_fixture_disabled(), report.open("w") as stream:
        import contextlib

        with contextlib.redirect_stdout(stream):
            status = cli.main(
                [
                    "fit",
                    str(folder / "tsv"),
                    "--reference",
                    str(folder / "reference.tsv"),
                    "--layout",
                    "grid_s1",
                    "--out",
                    str(out),
                    "--json",
                ]
            )
    return {"status": status, "report": json.loads(report.read_text()), "out": out}


def test_all_recordings_are_fitted(fitted: dict) -> None:
    assert fitted["status"] == 0
    rows = fitted["report"]["recordings"]
    assert len(rows) == 287
    assert not [row for row in rows if "error" in row]
    # What is not fitted is what the video does not show: frames with no landmark at all.
    assert sum(row["frames"] - row["fitted"] for row in rows) == 45
    assert np.median([row["residual_mm"] for row in rows]) < 1.5


def test_lips_close_and_follow(fitted: dict, data_folder: Path) -> None:
    folder = data_folder / "grid_s1"
    face = load_face()
    scale = fitted["report"]["scale"]
    lips = [face.mesh.get_feature_point("2.2"), face.mesh.get_feature_point("2.3")]
    compiled = face.compile(np.array(lips))
    from mocap_fit.face.rig import evaluate

    gaps: dict[str, dict[str, list[float]]] = {
        "fit": {"closed": [], "open": []},
        "landmarks": {"closed": [], "open": []},
    }
    all_fit, all_measured = [], []
    for path in sorted(fitted["out"].glob("*.parquet")):
        tracks, recording = read_parquet(path), read_tracks(folder / "tsv" / f"{path.stem}.tsv")
        points = [evaluate(compiled, v) for v in np.nan_to_num(tracks.values)]
        known = np.isfinite(tracks.values[:, 0])
        fit = np.array([np.linalg.norm(p[0] - p[1]) for p in points]) / scale
        measured = np.linalg.norm(
            recording["lip_inner_mid_upper"] - recording["lip_inner_mid_lower"],
            axis=1,
        )
        all_fit.append(fit[known])
        all_measured.append(measured[known])
        for phone, centre in phone_centres(folder / "labels" / f"{path.stem}.TextGrid"):
            kind = "closed" if phone in CLOSED else "open" if phone in OPEN else None
            frame = int(np.argmin(np.abs(tracks.times + FIRST_FRAME - centre)))
            if kind is not None and known[frame]:
                gaps["fit"][kind].append(fit[frame])
                gaps["landmarks"][kind].append(measured[frame])
    ratio = {w: np.median(g["closed"]) / np.median(g["open"]) for w, g in gaps.items()}
    r = np.corrcoef(np.concatenate(all_fit), np.concatenate(all_measured))[0, 1]
    print(
        f"\nlip gap on B, M, P over that on AA, AE, AY: {ratio['fit']:.3f} on the fitted face, "
        f"{ratio['landmarks']:.3f} on the landmarks ({len(gaps['fit']['closed'])} and "
        f"{len(gaps['fit']['open'])} phones); lip opening r = {r:.4f}"
    )
    assert ratio["landmarks"] < 0.05
    assert ratio["fit"] < 0.15
    assert r > 0.95
