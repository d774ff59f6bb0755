"""Checks of the shape of face and head: sizes, axes, left and right, rigid head markers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np

from corpus_tools.validation.findings import Finding, Location, locate
from corpus_tools.validation.markers import collect_evidence
from corpus_tools.validation.slips import find_slips
from corpus_tools.validation.thresholds import Thresholds
from mocap_fit.fitting import Layout
from mocap_fit.fitting.coordinates import locate_expected
from mocap_fit.head.aligned_frames import AlignedFrames
from mocap_fit.head.alignment import (
    Alignment,
    align_shapes,
    compute_angle,
    describe_axes,
    describe_directions,
    describe_reflection,
    guess_unit,
)
from mocap_fit.tracks import FloatArray, MarkerTracks, compute_spread, estimate_rigid_transforms
from mocap_fit.tracks.interpolation import find_runs
from mocap_fit.tracks.rigid_sets import compute_median, compute_typical_shape

# Recordings that tell what is usual in a session.
_FEWEST = 3


@dataclass(frozen=True, eq=False)
class Shape:
    """The shape of the markers of a recording, to compare it with the others of its session.

    Parameters
    ----------
    location
        The file and the utterance.
    names
        Names of all markers.
    head
        Names of the head markers.
    placed
        The typical shape at the middle pose, ``(markers, 3)``, millimetres in the recording's
        coordinates.
    against_layout
        The layout's face aligned with it; None where no layout tells.
    varies
        Whether the layout says that sizes vary.
    """

    location: Location
    names: tuple[str, ...]
    head: tuple[str, ...]
    placed: FloatArray
    against_layout: Alignment | None
    varies: bool


def summarise(
    recording: MarkerTracks,
    still: AlignedFrames,
    layout: Layout | None,
    location: Location,
    limits: Thresholds,
) -> Shape:
    """Summarise the shape of a recording: unit, axes and positions of markers.

    Parameters
    ----------
    recording
        The recording.
    still
        The recording without head motion.
    layout
        The marker layout; None where it is not known.
    location
        The file and the utterance.
    limits
        What counts as wrong.

    Returns
    -------
    Shape
        The shape.
    """
    fitted = None
    head: tuple[str, ...] = ()
    if layout is not None:
        expected = locate_expected(layout, recording.names)
        fitted = align_shapes(expected, still.placed, limits.shape.mirror_gain)
        head = tuple(m.name for m in layout.head_markers if m.name in recording.names)
    varies = layout is not None and layout.size_varies
    return Shape(location, recording.names, head, still.placed, fitted, varies)


def check_layout(recording: MarkerTracks, layout: Layout, location: Location) -> Iterator[Finding]:
    """Find markers of the layout that are missing, and others that it does not know.

    Parameters
    ----------
    recording
        The recording.
    layout
        The marker layout.
    location
        The file and the utterance.

    Yields
    ------
    Finding
        What is wrong.
    """
    wanted = [marker.name for marker in layout.markers]
    lacking = [name for name in wanted if name not in recording.names]
    if lacking:
        where = location.at(", ".join(lacking))
        text = f"{len(lacking)} of {len(wanted)} are not there"
        yield Finding("MF111", where, text, f"the markers of the layout '{layout.name}'")
    others = [name for name in recording.names if name not in wanted]
    if others:
        expected = f"the markers of the layout '{layout.name}'"
        yield Finding("MF112", location.at(", ".join(others)), f"{len(others)} markers", expected)


def check_head(
    recording: MarkerTracks,
    still: AlignedFrames,
    head: Sequence[int],
    location: Location,
    limits: Thresholds,
    varies: bool = False,
) -> Iterator[Finding]:
    """Find head markers that do not keep their distances, and one that has slipped.

    Parameters
    ----------
    recording
        The recording.
    still
        The recording without head motion.
    head
        Indices of the head markers.
    location
        The file and the utterance.
    limits
        What counts as wrong.
    varies
        Whether sizes vary, as those of landmarks of a video do; these are not glued on,
        wander, and cannot slip.

    Yields
    ------
    Finding
        What is wrong.
    """
    rigid = limits.shape
    if len(head) < 3:
        return
    positions = recording.positions[:, list(head)]
    residuals = still.residuals
    if len(head) == 3:
        # The pose rests on all markers there; of these three the residual is their own.
        shape = compute_typical_shape(positions)
        residuals = estimate_rigid_transforms(shape, positions)[2]
    some = recording.visible.any(axis=1)
    unknown = np.isnan(residuals) & some
    if some.any() and unknown.sum() > rigid.pose_unknown * some.sum():
        where = locate(location, recording, "head", find_runs(unknown)[0])
        text = f"in {unknown.sum() / some.sum():.0%} of the frames"
        yield Finding("MF126", where, text, f"at most {rigid.pose_unknown:.0%}")
    known = ~np.isnan(residuals)
    if known.any() and np.median(residuals[known]) > rigid.rigid_residual:
        text = f"{np.median(residuals[known]):.2f} mm from their mean shape (median)"
        yield Finding("MF124", location.at("head"), text, f"at most {rigid.rigid_residual} mm")
    if varies:
        return
    for column, run, off in find_slips(positions, recording.rate, limits.shape):
        names, marker = recording.names, head[column]
        where = locate(location, recording, names[marker], run)
        text = f"{off:.1f} mm from where the others have it"
        picture = collect_evidence(recording, names, still.positions, [marker], run)
        expected = f"less than {rigid.slip_distance} mm"
        yield Finding("MF125", where, text, expected, evidence=picture)


def check_sessions(members: Sequence[Shape], limits: Thresholds) -> Iterator[Finding]:
    """Find recordings whose unit, axes or positions of markers are wrong.

    Parameters
    ----------
    members
        The recordings of one speaker and session.
    limits
        What counts as wrong.

    Yields
    ------
    Finding
        What is wrong.
    """
    upright = [m for m in members if not (m.against_layout and m.against_layout.mirrored)]
    middle = _estimate_session_shape(upright, limits)
    for member in members:
        yield from _check_size(member, middle, limits)
        yield from _check_axes(member, middle, limits)
        if middle is not None and not (member.against_layout and member.against_layout.mirrored):
            yield from _check_positions(member, middle, limits)


@dataclass(frozen=True, eq=False)
class _Session:
    """The usual shape of a session, at its usual pose."""

    names: tuple[str, ...]
    shape: FloatArray
    differences: FloatArray


def _order_points(member: Shape, names: Sequence[str]) -> FloatArray:
    rows = dict(zip(member.names, member.placed, strict=True))
    return np.array([rows.get(name, np.full(3, np.nan)) for name in names])


def _estimate_session_shape(members: Sequence[Shape], limits: Thresholds) -> _Session | None:
    if len(members) < _FEWEST:
        return None
    names = tuple(dict.fromkeys(chain.from_iterable(member.names for member in members)))
    placed = np.array([_order_points(member, names) for member in members])
    # The pose that is nearest to all others; single recordings turned otherwise do not count.
    base = placed[int(np.argmax((~np.isnan(placed[:, :, 0])).sum(axis=1)))]
    aligned = placed
    rotations = []
    for _ in range(2):
        fits = [align_shapes(one, base, limits.shape.mirror_gain) for one in placed]
        rotations = [None if f is None or f.mirrored else f.matrix for f in fits]
        aligned = np.full(placed.shape, np.nan)
        for row, (one, fit) in enumerate(zip(placed, fits, strict=True)):
            if fit is not None and not fit.mirrored:
                aligned[row] = _align(one, fit, base)
        base = compute_median(aligned)
    usable = [r for r in rotations if r is not None]
    if len(usable) < _FEWEST:
        return None
    angles = [sum(compute_angle(one @ other.T) for other in usable) for one in usable]
    usual = usable[int(np.argmin(angles))]
    sizes = np.array([_compute_size(one) for one in placed])
    # `base` has the size of the recording that came first: give it the session's.
    centre = compute_median(np.array([compute_median(one) for one in placed]))
    shape = (base - compute_median(base)) @ usual
    shape = shape * float(np.nanmedian(sizes) / _compute_size(shape)) + centre
    differences = np.linalg.norm(aligned - base, axis=2)
    return _Session(names, shape, compute_median(differences))


def _compute_size(points: FloatArray) -> float:
    return float(np.sqrt((compute_spread(points) ** 2).sum()))


def _align(points: FloatArray, fit: Alignment, target: FloatArray) -> FloatArray:
    """Points laid on the target as the fit says, by the points whose distances are small."""
    turned = fit.scale * points @ fit.matrix.T
    usual = max(1.5 * float(np.nanmedian(fit.distances)), 1e-9)
    weights = np.nan_to_num(1.0 / (1.0 + (fit.distances / usual) ** 2))
    both = weights > 0
    shift = weights[both] @ (target[both] - turned[both]) / weights[both].sum()
    return np.asarray(turned + shift)


def _name_unit(ratio: float) -> str:
    """Return a guessed unit as the end of a sentence."""
    words = guess_unit(ratio)
    return f"; {words}" if words else ""


def _check_size(member: Shape, middle: _Session | None, limits: Thresholds) -> Iterator[Finding]:
    rules = limits.shape
    extent = np.ptp(member.placed[~np.isnan(member.placed[:, 0])], axis=0)
    height = float(extent.max())
    if member.against_layout is not None:
        ratio = member.against_layout.scale
        if not rules.smallest_face <= ratio <= rules.largest_face:
            text = f"markers reach over {height / 1000:.3g} m, {ratio:.3g} times the layout's face"
            expected = f"{rules.smallest_face:g} to {rules.largest_face:g} times"
            yield Finding("MF121", member.location, text + _name_unit(ratio), expected)
            return
    elif not rules.smallest_extent <= height <= rules.largest_extent:
        expected = f"{rules.smallest_extent:g} to {rules.largest_extent:g} mm"
        yield Finding("MF121", member.location, f"markers reach over {height:.4g} mm", expected)
        return
    if middle is None:
        return
    ratio = _compute_size(_order_points(member, middle.names)) / _compute_size(middle.shape)
    complete = np.isnan(_order_points(member, middle.names)[:, 0]).sum() <= 0.2 * len(middle.names)
    allowed = rules.size_in_session_video if member.varies else rules.size_in_session
    if complete and abs(ratio - 1) > allowed:
        text = f"{ratio:.3g} times the size of the session's other recordings{_name_unit(ratio)}"
        yield Finding("MF121", member.location, text, f"within {allowed:.0%} of it")


def _check_axes(member: Shape, middle: _Session | None, limits: Thresholds) -> Iterator[Finding]:
    against = member.against_layout
    if middle is None:
        if against is not None and against.mirrored:
            advice = (
                "Turn an axis round, exchange two axes, or exchange the names of left and right: "
                "the recording alone does not tell which."
            )
            yield _describe_mirrored(member, against).replace(advice=advice)
        return
    here = _order_points(member, middle.names)
    fit = align_shapes(middle.shape, here, limits.shape.mirror_gain)
    if fit is None:
        return
    if fit.mirrored:
        kind, words = describe_reflection(fit, middle.shape, here)
        code = "MF122" if kind in ("same", "reversed") else "MF123"
        text = f"against the session's other recordings, {words}"
        yield Finding(code, member.location, text, "the same axes and names")
    elif (angle := compute_angle(fit.matrix)) > limits.shape.turned:
        _, words = describe_axes(fit.matrix)
        text = (
            f"the head is turned by {angle:.0f} degrees against the session's other recordings "
            f"({words})"
        )
        yield Finding("MF123", member.location, text, f"at most {limits.shape.turned:g} degrees")
    elif against is not None and against.mirrored:
        yield _describe_mirrored(member, against)


def _describe_mirrored(member: Shape, against: Alignment) -> Finding:
    text = f"a face's mirror image ({describe_directions(against.matrix)})"
    expected = "axes of a right hand, and the speaker's own left and right"
    return Finding("MF122", member.location, text, expected)


def _check_positions(member: Shape, middle: _Session, limits: Thresholds) -> Iterator[Finding]:
    rules = limits.shape
    here = _order_points(member, middle.names)
    head = [k for k, name in enumerate(middle.names) if name in member.head]
    slipped: set[int] = set()
    if len(head) >= 4 and not member.varies:
        odd = _find_odd_one(middle.shape[head], here[head], rules.slip_in_session)
        if odd is not None:
            slipped.add(head[odd[0]])
            text = f"{odd[1]:.1f} mm from where the session's other recordings have it"
            expected = f"at most {rules.slip_in_session} mm"
            yield Finding("MF125", member.location.at(middle.names[head[odd[0]]]), text, expected)
    fit = align_shapes(here, middle.shape, rules.mirror_gain)
    if fit is None or fit.mirrored:
        return
    moved = _align(here, fit, middle.shape)
    off = np.linalg.norm(moved - middle.shape, axis=1)
    limit = np.maximum(rules.moved_in_session, rules.moved_factor * middle.differences)
    # Two that have each other's places need not be far apart.
    near = np.maximum(limits.markers.swap_distance, 3 * middle.differences)
    with np.errstate(invalid="ignore"):
        suspects = [int(k) for k in np.flatnonzero(off > near) if k not in slipped]
    exchanged: set[int] = set()
    for k, other in combinations(suspects, 2):
        crossed = max(
            float(np.linalg.norm(moved[k] - middle.shape[other])),
            float(np.linalg.norm(moved[other] - middle.shape[k])),
        )
        if crossed < limits.markers.swap_gain * min(off[k], off[other]):
            exchanged |= {k, other}
            names = f"{middle.names[k]} and {middle.names[other]}"
            text = "each is where the session's other recordings have the other one, throughout"
            yield Finding("MF106", member.location.at(names), text, "each its own")
    for k in suspects:
        if k in exchanged or not off[k] > limit[k]:
            continue
        text = f"{off[k]:.1f} mm from where the session's other recordings have it"
        expected = f"at most {limit[k]:.1f} mm"
        yield Finding("MF127", member.location.at(middle.names[k]), text, expected)


def _find_odd_one(usual: FloatArray, here: FloatArray, limit: float) -> tuple[int, float] | None:
    """Return the point that has moved against the others, and how far."""
    there = np.flatnonzero(~(np.isnan(usual[:, 0]) | np.isnan(here[:, 0])))
    if len(there) < 4:
        return None
    best: tuple[float, int, float] | None = None
    for k in there:
        others = there[there != k]
        rest = here[None, others]
        rotations, translations, residuals = estimate_rigid_transforms(usual[others], rest)
        if np.isnan(residuals[0]):
            continue
        off = float(np.linalg.norm(here[k] - rotations[0] @ usual[k] - translations[0]))
        if best is None or residuals[0] < best[0]:
            best = (float(residuals[0]), int(k), off)
    if best is None or best[2] < limit or best[0] > 0.4 * best[2]:
        return None
    return best[1], best[2]
