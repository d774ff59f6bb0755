"""Utterances of which there is next to nothing: something is said, and nothing breaks."""

import numpy as np
import pytest

from corpus_tools.validation import (
    Context,
    Report,
    Severity,
    Subject,
    check_subject,
    load_thresholds,
)
from mocap_fit.face import load_face
from mocap_fit.fitting import load_layout
from mocap_fit.labels import Label, Tier
from mocap_fit.phones import load_phone_set
from mocap_fit.sound import Sound
from mocap_fit.tracks import MarkerTracks, ParameterTracks

FACE, LAYOUT = load_face(), load_layout("face30-head5")
FULL = Context(load_thresholds(), LAYOUT, FACE, load_phone_set("sv-sta"), 60.0)
NAMES = tuple(marker.name for marker in LAYOUT.markers)


def found(**parts: object) -> set[str]:
    files = dict.fromkeys(parts, "a")
    findings, summary = check_subject(Subject("a", files=files, on_one_clock=True, **parts), FULL)
    assert summary.name == "a"
    return {finding.code for finding in findings}


def parameters(frames: int, value: float = 0.0) -> ParameterTracks:
    return ParameterTracks(FACE.parameter_names, 60.0, np.full((frames, 10), value))


@pytest.mark.parametrize("frames", [0, 1, 2])
def test_few_frames(frames):
    positions = np.zeros((frames, len(NAMES), 3)) + np.arange(len(NAMES))[:, None]
    load_codes = found(markers=MarkerTracks(NAMES, 60.0, positions), parameters=parameters(frames))
    assert ("MF305" in load_codes) == (frames == 0)
    # Markers on a line tell no pose.
    assert "MF126" in load_codes or frames == 0


def test_nothing_but_gaps():
    load_codes = found(
        markers=MarkerTracks(NAMES, 60.0, np.full((90, len(NAMES), 3), np.nan)),
        parameters=parameters(90, np.nan),
    )
    assert {"MF103", "MF109", "MF305"} <= load_codes


def test_short_and_empty_sounds():
    assert found(sound=Sound(np.zeros(1), 16000.0)) == {"MF402"}
    assert found(sound=Sound(np.zeros((100, 2)), 100.0)) == {"MF402"}


def test_labels_without_anything_else():
    assert found(tier=Tier("phones", ())) == {"MF210"}
    assert found(tier=Tier("phones", (Label(0.0, 0.0, "A:"),))) == {"MF203"}
    assert found(tier=Tier("phones", (Label(1.0, 0.5, "A:"), Label(0.1, 0.2, "?")))) == {
        "MF203",
        "MF202",
        "MF207",
    }


def test_labels_that_are_all_silence_have_nothing_to_say_of_loudness():
    rng = np.random.default_rng(0)
    sound = Sound(rng.normal(0, 0.1, 16000) * np.repeat([0.001, 1.0], 8000), 16000.0)
    assert found(tier=Tier("phones", (Label(0.0, 1.0, "sil"),)), sound=sound) == set()


def test_another_face_has_no_bounds():
    tracks = ParameterTracks(("smile",), 60.0, np.linspace(0, 9, 120)[:, None])
    assert found(parameters=tracks) == set()


def test_a_residual_far_over_the_limit_is_an_error_that_a_report_can_count():
    tracks = parameters(60).replace(residuals=np.full(60, 7.6))
    findings, _ = check_subject(Subject("a", parameters=tracks, files={"parameters": "a"}), FULL)
    report = Report(FULL.limits)
    report.add(findings)
    report.finish()
    assert [f.severity for f in report.findings if f.code == "MF301"] == [Severity.ERROR]
    assert report.counts["error"] == 1
    assert report.to_record()["findings"][0]["severity"] == "error"
