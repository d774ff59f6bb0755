"""Checks of single markers: gaps, spikes, jumps, stuck and exchanged markers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from corpus_tools.validation.exchanges import Exchange, find_exchanges, find_previous
from corpus_tools.validation.findings import Evidence, Finding, Location, locate
from corpus_tools.validation.thresholds import Thresholds
from mocap_fit.tracks import FloatArray, MarkerTracks, Origin, count_gaps
from mocap_fit.tracks.interpolation import find_runs

# Frames on each side of a place that its picture shows.
_MARGIN = 25


def check_markers(
    recording: MarkerTracks, still: FloatArray | None, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    """Find what is wrong with single markers of a recording.

    Parameters
    ----------
    recording
        The recording, in any coordinates.
    still
        Positions without head motion, ``(frames, markers, 3)``, millimetres; None where no
        pose is known.
    location
        The file and the utterance.
    limits
        What counts as wrong.

    Yields
    ------
    Finding
        What is wrong.
    """
    yield from _check_gaps(recording, location, limits)
    stuck = np.zeros(recording.visible.shape, dtype=bool)
    yield from _check_stuck(recording, location, limits, stuck)
    yield from _check_coincident(recording, location, limits)
    if still is not None:
        # Where a marker is stuck, it jumps back at the end: that is said already.
        moving = np.where(stuck[:, :, None], np.nan, still)
        yield from _check_movement(recording, moving, location, limits)


def mend_head(
    recording: MarkerTracks, head: Sequence[int], location: Location, limits: Thresholds
) -> tuple[MarkerTracks, list[Finding]]:
    """Find head markers that have exchanged their names, before a pose is estimated from them.

    Parameters
    ----------
    recording
        The recording.
    head
        Indices of the head markers.
    location
        The file and the utterance.
    limits
        What counts as wrong.

    Returns
    -------
    MarkerTracks
        The recording with these names exchanged back.
    list of Finding
        The exchanges.
    """
    if len(head) < 2:
        return recording, []
    positions = recording.positions[:, list(head)]
    exchanges, mended = find_exchanges(positions, recording.rate, limits.markers)
    if not exchanges:
        return recording, []
    corrected = recording.positions.copy()
    corrected[:, list(head)] = mended
    origin = np.where(np.isnan(corrected[:, :, 0]), Origin.MISSING, Origin.MEASURED)
    names = [recording.names[k] for k in head]
    findings = list(_describe_exchanges(recording, names, positions, exchanges, location))
    return recording.replace(positions=corrected, origin=origin.astype(np.uint8)), findings


def _describe_exchanges(
    recording: MarkerTracks,
    names: Sequence[str],
    positions: FloatArray,
    exchanges: Sequence[Exchange],
    location: Location,
) -> Iterator[Finding]:
    for exchange in exchanges:
        run = slice(exchange.first, exchange.last + 1)
        where = locate(location, recording, " and ".join(names[k] for k in exchange.markers), run)
        text = f"they continue each other's tracks for {run.stop - run.start} frames"
        picture = collect_evidence(recording, names, positions, exchange.markers, run)
        yield Finding("MF106", where, text, "each its own", evidence=picture)


def collect_evidence(
    recording: MarkerTracks,
    names: Sequence[str],
    positions: FloatArray,
    members: Sequence[int],
    run: slice,
) -> Evidence:
    """Collect the coordinates of some markers about a run of frames.

    Parameters
    ----------
    recording
        The recording.
    names
        Names of the markers.
    positions
        Positions, ``(frames, markers, 3)``, millimetres.
    members
        Indices of the markers that are shown.
    run
        The frames.

    Returns
    -------
    Evidence
        Curves with some frames on each side.
    """
    part = slice(max(0, run.start - _MARGIN), min(len(positions), run.stop + _MARGIN))
    times = recording.times[part]
    single = len(members) == 1
    curves = {}
    for member in members:
        track = positions[part, member]
        axes = range(3) if single else [_choose_axis(positions[part][:, list(members)])]
        for axis in axes:
            curves[f"{names[member]} {'xyz'[axis]}"] = track[:, axis]
    return Evidence(times, curves, "mm")


def _choose_axis(positions: FloatArray) -> int:
    """Return the coordinate in which the markers are farthest apart."""
    filled = np.where(np.isnan(positions), 0.0, positions)
    return int(np.argmax(np.ptp(filled, axis=1).mean(axis=0)))


def _check_gaps(
    recording: MarkerTracks, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    empty = np.asarray(~recording.visible.any(axis=1))
    for run in find_runs(empty):
        if run.stop - run.start >= limits.markers.empty_frames:
            where = locate(location, recording, "", run)
            yield Finding("MF109", where, f"{run.stop - run.start} frames")
    seen = recording.replace(positions=recording.positions[~empty], origin=recording.origin[~empty])
    if not seen.frames:
        yield Finding("MF103", location.at("all"), "no sample of any marker")
        return
    for marker in count_gaps(seen).markers:
        where = location.at(marker.name)
        if marker.missing == seen.frames:
            yield Finding("MF103", where, "no sample")
            continue
        if marker.share > limits.markers.gap_share:
            text = f"missing in {marker.share:.0%} of the frames, in {marker.gaps} gaps"
            yield Finding("MF101", where, text, f"at most {limits.markers.gap_share:.0%}")
        if marker.longest_seconds > limits.markers.longest_gap:
            hidden = ~recording.visible[:, recording.index(marker.name)]
            run = max(find_runs(hidden), key=lambda run: run.stop - run.start)
            where = locate(location, recording, marker.name, run)
            text = f"missing for {marker.longest_seconds:.2f} s"
            yield Finding("MF102", where, text, f"at most {limits.markers.longest_gap} s")


def _check_stuck(
    recording: MarkerTracks, location: Location, limits: Thresholds, mask: NDArray[np.bool_]
) -> Iterator[Finding]:
    """Markers that are stuck; the mask `(frames, markers)` is set where they are."""
    positions = recording.positions
    if len(positions) < 2:
        return
    both = recording.visible[1:] & recording.visible[:-1]
    same = both & (positions[1:] == positions[:-1]).all(axis=2)
    # A frame in which nothing moves is a copy, or all are at rest; no marker is stuck in it.
    moving = (both & ~same).sum(axis=1) > same.sum(axis=1)
    copies = ~moving & same.any(axis=1)
    alive = (both & ~same).any()
    if alive and copies.mean() > limits.markers.repeated_share:
        first = int(np.argmax(copies)) + 1
        where = locate(location, recording, "", slice(first, first + 1))
        text = f"{int(copies.sum())} of {recording.frames} frames are copies of the one before"
        yield Finding("MF110", where, text, f"at most {limits.markers.repeated_share:.0%}")
    shortest = max(limits.markers.stuck_frames, round(limits.markers.stuck_time * recording.rate))
    for marker, name in enumerate(recording.names):
        for run in find_runs(same[:, marker] & (moving | copies)):
            stuck = slice(run.start, run.stop + 1)
            inside = moving[run]
            if stuck.stop - stuck.start >= shortest and inside.mean() > 0.5:
                mask[stuck, marker] = True
                where = locate(location, recording, name, stuck)
                text = f"exactly one place for {stuck.stop - stuck.start} frames"
                expected = "a marker that moves with the others"
                picture = collect_evidence(recording, recording.names, positions, [marker], stuck)
                yield Finding("MF105", where, text, expected, evidence=picture)


def _check_coincident(
    recording: MarkerTracks, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    step = max(1, recording.frames // 200)
    sample = recording.positions[::step]
    for marker in range(len(recording.names) - 1):
        apart = np.linalg.norm(sample[:, marker + 1 :] - sample[:, marker : marker + 1], axis=2)
        with np.errstate(invalid="ignore"):
            near = apart < limits.markers.same_place
        together = (~np.isnan(apart)).sum(axis=0)
        for other in np.flatnonzero((near.sum(axis=0) > 0.5 * together) & (together >= 5)):
            names = f"{recording.names[marker]} and {recording.names[marker + 1 + other]}"
            distance = float(np.nanmedian(apart[:, other]))
            expected = f"more than {limits.markers.same_place} mm"
            yield Finding("MF108", location.at(names), f"{distance:.2g} mm apart", expected)


def _check_movement(
    recording: MarkerTracks, still: FloatArray, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    exchanges, mended = find_exchanges(still, recording.rate, limits.markers)
    yield from _describe_exchanges(recording, recording.names, still, exchanges, location)
    spikes = np.zeros(mended.shape[:2], dtype=bool)
    for marker, name in enumerate(recording.names):
        for run, height in _find_spikes(mended[:, marker], recording.rate, limits):
            spikes[run, marker] = True
            where = locate(location, recording, name, run)
            text = f"{height:.1f} mm out and back"
            expected = f"less than {limits.markers.spike_size} mm, or slower"
            picture = collect_evidence(recording, recording.names, mended, [marker], run)
            yield Finding("MF104", where, text, expected, evidence=picture)
    calm = np.where(spikes[:, :, None], np.nan, mended)
    yield from _check_jumps(recording, calm, location, limits)


def _find_spikes(
    track: FloatArray, rate: float, limits: Thresholds
) -> Iterator[tuple[slice, float]]:
    """Yield runs of frames in which a marker is off its track, and how far in millimetres."""
    marker = limits.markers
    seen = np.flatnonzero(~np.isnan(track[:, 0]))
    if len(seen) < 5:
        return
    points, bridge = track[seen], max(1, round(marker.gap_bridged * rate))
    wrong = np.zeros(len(seen), dtype=bool)
    heights = np.zeros(len(seen))
    usual = 0.0
    for length in range(1, marker.spike_frames + 1):
        if len(seen) < length + 2:
            break
        before, after = points[: -length - 1], points[length + 1 :]
        first, last = seen[: -length - 1], seen[length + 1 :]
        inside = np.stack([seen[1 + k : len(seen) - length + k] for k in range(length)])
        middle = np.stack([points[1 + k : len(seen) - length + k] for k in range(length)])
        share = ((inside - first) / (last - first))[:, :, None]
        out = np.linalg.norm(middle - (before + share * (after - before)), axis=2)
        height = out.min(axis=0)
        if length == 1:
            usual = float(np.median(height))
        limit = np.maximum(marker.spike_size, marker.spike_factor * usual)
        enter = np.linalg.norm(middle[0] - before, axis=1) * rate / (inside[0] - first)
        leave = np.linalg.norm(after - middle[-1], axis=1) * rate / (last - inside[-1])
        is_spike = (
            (height > limit)
            & (np.minimum(enter, leave) > marker.spike_speed)
            & (np.linalg.norm(after - before, axis=1) < 0.5 * height)
            & (last - first <= length + 2 * bridge)
        )
        for index in np.flatnonzero(is_spike & ~wrong[1 : len(is_spike) + 1]):
            part = slice(index + 1, index + 1 + length)
            if not wrong[part].any():
                wrong[part] = True
                heights[part] = out[:, index]
    frames = np.zeros(len(track), dtype=bool)
    frames[seen[wrong]] = True
    size = np.zeros(len(track))
    size[seen] = heights
    for run in find_runs(frames):
        yield run, float(size[run].max())


def _check_jumps(
    recording: MarkerTracks, positions: FloatArray, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    marker = limits.markers
    before, ago = find_previous(positions, max(1, round(marker.gap_bridged * recording.rate)))
    steps = np.linalg.norm(positions - before, axis=2)
    for index, name in enumerate(recording.names):
        column: FloatArray = steps[:, index]
        there = ~np.isnan(column)
        if not there.any():
            continue
        usual = float(np.median(column[there]))
        limit = max(marker.jump_size, marker.jump_factor * usual)
        with np.errstate(invalid="ignore"):
            fast: NDArray[np.bool_] = column * recording.rate / ago[:, index] > marker.jump_speed
            far = fast & (column > limit)
        for frame in np.flatnonzero(far):
            run = slice(int(frame), int(frame) + 1)
            where = locate(location, recording, name, run)
            text = f"{column[frame]:.1f} mm from one frame to the next"
            picture = collect_evidence(recording, recording.names, positions, [index], run)
            yield Finding("MF107", where, text, f"less than {limit:.1f} mm", evidence=picture)
