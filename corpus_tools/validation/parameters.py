"""Checks of face parameters: the fit's residual, bounds, gaps, jumps, closed lips."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from corpus_tools.validation.findings import Evidence, Finding, Location, Severity, locate
from corpus_tools.validation.thresholds import Thresholds
from mocap_fit.face import Rig
from mocap_fit.labels import Label
from mocap_fit.phones import PhoneSet
from mocap_fit.tracks import FloatArray, ParameterTracks
from mocap_fit.tracks.interpolation import find_runs

_MARGIN = 25


def check_parameters(
    tracks: ParameterTracks, rig: Rig | None, varies: bool, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    """Find what is wrong with the parameters of an utterance.

    Parameters
    ----------
    tracks
        As fitted.
    rig
        The face that they are of; None where it is not known.
    varies
        Whether the markers are landmarks whose size varies.
    location
        The file and the utterance.
    limits
        What counts as wrong.

    Yields
    ------
    Finding
        What is wrong.
    """
    known = np.asarray(np.isfinite(tracks.values).all(axis=1))
    if not known.any():
        yield Finding("MF305", location, f"{tracks.frames} frames, none fitted", "parameters")
        return
    yield from _check_missing(tracks, known, location, limits)
    yield from _residuals(tracks, varies, location, limits)
    bounds = np.full((len(tracks.names), 2), np.nan)
    if rig is not None and tuple(rig.parameter_names) == tracks.names:
        bounds = rig.bounds
        yield from _check_bounds(tracks, bounds, location, limits)
    yield from _check_movement(tracks, bounds, location, limits)


def _collect_evidence(
    tracks: ParameterTracks,
    name: str,
    curve: FloatArray,
    run: slice,
    unit: str = "of the full gesture",
) -> Evidence:
    part = slice(max(0, run.start - _MARGIN), run.stop + _MARGIN)
    return Evidence(tracks.times[part], {name: curve[part]}, unit)


def _measure(run: slice, tracks: ParameterTracks) -> float:
    """Return the duration of a run of frames, seconds."""
    return float((run.stop - run.start) / tracks.rate)


def _check_missing(
    tracks: ParameterTracks, known: NDArray[np.bool_], location: Location, limits: Thresholds
) -> Iterator[Finding]:
    rules = limits.parameters
    missing = find_runs(~known)
    for run in missing:
        if _measure(run, tracks) > rules.missing_time:
            where = locate(location, tracks, "", run)
            text = f"{run.stop - run.start} frames ({_measure(run, tracks):.2f} s)"
            yield Finding("MF304", where, text, f"at most {rules.missing_time} s")
    if (~known).mean() > rules.missing_share:
        where = locate(location, tracks, "", missing[0])
        text = f"in all {(~known).mean():.0%} of the frames"
        yield Finding("MF304", where, text, f"at most {rules.missing_share:.0%}")
    for column, name in enumerate(tracks.names):
        share = float(tracks.uncertain[:, column].mean())
        if share > rules.undetermined_share:
            expected = f"at most {rules.undetermined_share:.0%}"
            yield Finding("MF306", location.at(name), f"in {share:.0%} of the frames", expected)


def _residuals(
    tracks: ParameterTracks, varies: bool, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    rules = limits.parameters
    there = np.isfinite(tracks.residuals)
    if not there.any():
        return
    median = float(np.median(tracks.residuals[there]))
    allowed = rules.residual_video if varies else rules.residual
    if median > allowed:
        text = f"{median:.2f} mm (median over the utterance)"
        finding = Finding("MF301", location, text, f"at most {allowed} mm")
        grave = median > rules.residual_error * allowed
        yield finding.replace(severity=Severity.ERROR) if grave else finding
        return
    limit = max(rules.bad_frames_residual, rules.bad_frames_factor * median)
    with np.errstate(invalid="ignore"):
        bad = find_runs(tracks.residuals > limit)
    for run in bad:
        if _measure(run, tracks) >= rules.bad_frames_time:
            where = locate(location, tracks, "", run)
            text = f"up to {np.max(tracks.residuals[run]):.1f} mm"
            picture = _collect_evidence(tracks, "residual", tracks.residuals, run, "mm")
            yield Finding("MF302", where, text, f"at most {limit:.1f} mm", evidence=picture)


def _check_bounds(
    tracks: ParameterTracks, bounds: FloatArray, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    rules = limits.parameters
    for column, name in enumerate(tracks.names):
        values = tracks.values[:, column]
        there = np.isfinite(values)
        for bound, which, sign in zip(bounds[column], ("lower", "upper"), (-1, 1), strict=True):
            with np.errstate(invalid="ignore"):
                beyond = sign * (values - bound) > rules.bound_distance
                reached = (np.abs(values - bound) <= rules.bound_distance) & there
            if beyond.any():
                run = find_runs(beyond)[0]
                extreme = float(np.nanmax(sign * values) * sign)
                where = locate(location, tracks, name, run)
                text = f"{extreme:.3g} in {int(beyond.sum())} frames"
                expected = f"{bounds[column, 0]:g} to {bounds[column, 1]:g}"
                picture = _collect_evidence(tracks, name, values, run)
                yield Finding("MF310", where, text, expected, evidence=picture)
            stretches = find_runs(reached)
            longest = max(stretches, key=lambda run: run.stop - run.start, default=slice(0, 0))
            duration = _measure(longest, tracks)
            share = reached.sum() / max(1, there.sum())
            if duration >= rules.bound_time or share > rules.bound_share:
                where = locate(location, tracks, name, longest)
                text = f"at the {which} bound {bound:g} in {share:.0%} of the frames, "
                text += f"{duration:.2f} s at a stretch"
                expected = f"at most {rules.bound_share:.0%}, and less than {rules.bound_time} s"
                picture = _collect_evidence(tracks, name, values, longest)
                yield Finding("MF303", where, text, expected, evidence=picture)


def _check_movement(
    tracks: ParameterTracks, bounds: FloatArray, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    rules = limits.parameters
    steps = np.abs(np.diff(tracks.values, axis=0))
    # A value that the markers hardly determine may be anywhere: that it jumps is no news.
    doubt = np.nan_to_num(tracks.standard_deviations, nan=0.0, posinf=np.inf)
    doubt = rules.jump_deviations * np.hypot(doubt[1:], doubt[:-1])
    with np.errstate(invalid="ignore"):
        fast = (steps * tracks.rate > rules.jump_speed) & (steps > rules.jump_size)
        fast &= steps > doubt
        still = steps <= rules.still
    moving = (~still & np.isfinite(steps)).sum(axis=1) > 0.5 * steps.shape[1]
    for column, name in enumerate(tracks.names):
        values = tracks.values[:, column]
        for frame in np.flatnonzero(fast[:, column]):
            run = slice(int(frame), int(frame) + 2)
            where = locate(location, tracks, name, run)
            text = f"{steps[frame, column]:.2f} full gestures from one frame to the next"
            expected = f"at most {max(rules.jump_size, rules.jump_speed / tracks.rate):.2f}"
            picture = _collect_evidence(tracks, name, values, run)
            yield Finding("MF307", where, text, expected, evidence=picture)
        for stretch in find_runs(still[:, column] & moving):
            run = slice(stretch.start, stretch.stop + 1)
            if (np.abs(values[run.start] - bounds[column]) <= rules.bound_distance).any():
                continue
            if _measure(run, tracks) >= rules.still_time:
                at_rest = "" if values[run.start] else " (at rest)"
                where = locate(location, tracks, name, run)
                text = f"{values[run.start]:.3g}{at_rest} for {_measure(run, tracks):.2f} s"
                yield Finding("MF308", where, text, "a track that moves with the others")


@dataclass(frozen=True, eq=False)
class Closure:
    """How far the lips close in a bilabial.

    Parameters
    ----------
    location
        The file, the utterance and the time.
    phone
        Its symbol.
    gap
        The smallest gap of the lips in it, millimetres of the face.
    evidence
        The gap about it.
    """

    location: Location
    phone: str
    gap: float
    evidence: Evidence


def measure_closures(
    tracks: ParameterTracks,
    gaps: FloatArray,
    phones: list[Label],
    phone_set: PhoneSet,
    location: Location,
    limits: Thresholds,
) -> list[Closure]:
    """Measure the smallest gap of the lips in every bilabial closure, one a phone.

    Parameters
    ----------
    tracks
        For the times of the frames.
    gaps
        `(frames,)`: of the lips, millimetres; NaN is missing.
    phones
        The labels.
    phone_set
        Theirs.
    location
        The file and the utterance.
    limits
        What counts as wrong.

    Returns
    -------
    list of Closure
        The closures, in the order of time.
    """
    there = np.isfinite(gaps)
    times, margin = tracks.times, limits.parameters.lips_time
    closures = []
    for label in phones:
        parsed = phone_set.parse(label.text)
        if parsed is None or "bilabial_stop" not in phone_set.get_phone(parsed[0]).get_classes():
            continue
        inside = (times >= label.start - margin) & (times < label.end + margin) & there
        if not inside.any():
            continue
        around = (times >= label.start - 0.15) & (times < label.end + 0.15)
        where = location.at(label.text, seconds=(label.start, label.end))
        picture = Evidence(times[around], {"gap of the lips": gaps[around]}, "mm")
        closures.append(Closure(where, parsed[0], float(gaps[inside].min()), picture))
    return closures


def check_closures(
    closures: list[Closure], spans: FloatArray, limits: Thresholds
) -> Iterator[Finding]:
    """Find bilabials in which the lips stay open.

    Parameters
    ----------
    closures
        The closures of all utterances.
    spans
        `(utterances, 2)`: the gap when closed and when wide open.
    limits
        What counts as wrong.

    Yields
    ------
    Finding
        What is wrong.
    """
    if not len(spans):
        return
    rules = limits.parameters
    closed = float(np.median(spans[:, 0]))
    opened = float(np.quantile(spans[:, 1], 0.75))
    limit = max(rules.lips_open, closed + rules.lips_open_share * (opened - closed))
    for closure in closures:
        if closure.gap > limit:
            text = f"the lips stay {closure.gap:.1f} mm apart in '{closure.phone}'"
            expected = f"at most {limit:.1f} mm"
            yield Finding("MF309", closure.location, text, expected, evidence=closure.evidence)
