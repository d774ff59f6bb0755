"""The head's motion in a recording that is too long to be held: stretch by stretch, in two passes.

The answers are those of `remove_head_motion` on the whole: the first pass learns what the poses
depend on of the whole recording, and the second sees enough frames beyond each stretch's ends.
"""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.head.reference import Findings, Survey, chosen_reference, median_pose, weights_of
from mocap_fit.tracks import FloatArray, MarkerTracks, Origin
from mocap_fit.tracks.robust import REACH, RigidFit, robust_rigid_transforms


class HeadInStretches:
    """Removes the head's motion from the stretches of one recording.

    Parameters
    ----------
    reference
        The reference pose, whose coordinates are head coordinates (the median over its frames).
    names, weights
        The reference markers, and their weights, as for `mocap_fit.head.estimate_head_motion`.
    """

    def __init__(
        self,
        reference: MarkerTracks,
        names: Sequence[str],
        weights: Mapping[str, float] | None = None,
    ) -> None:
        self._reference, self._names, self._weights = reference, tuple(names), dict(weights or {})
        pose = median_pose(reference)
        self._pose = np.array([pose.get(name, np.full(3, np.nan)) for name in self._names])
        base = np.array([self._weights.get(name, 1.0) for name in self._names])
        self._survey = Survey(self._names, self._pose, base)
        self._seen_once: MarkerTracks | None = None
        self._lost, self._first_lost, self._frames = 0, 0, 0

    def look_at(self, part: MarkerTracks) -> None:
        """Take the next stretch in the first pass."""
        self._survey.add(_of(part, self._names))
        if self._seen_once is None:
            self._seen_once = part.replace(positions=part.positions[:1], origin=part.origin[:1])
        unseen = ~self._seen_once.visible[0]
        where = np.flatnonzero(unseen & part.visible.any(axis=0))
        if where.size:
            positions, origin = self._seen_once.positions.copy(), self._seen_once.origin.copy()
            first = part.visible[:, where].argmax(axis=0)
            positions[0, where], origin[0, where] = (
                part.positions[first, where],
                part.origin[first, where],
            )
            self._seen_once = self._seen_once.replace(positions=positions, origin=origin)

    def remove(self, parts: Iterable[MarkerTracks]) -> Iterator[MarkerTracks]:
        """Give the stretches in head coordinates, in a second pass over all of them.

        Parameters
        ----------
        parts
            The stretches again.

        Yields
        ------
        MarkerTracks
            A stretch; its markers are missing in the frames whose pose is not known.

        Raises
        ------
        DataError
            As `mocap_fit.head.remove_head_motion`.
        """
        if self._seen_once is None:
            raise DataError("the recording has no frames", expected="one or more")
        chosen, shape = chosen_reference(self._seen_once, self._reference, self._names)
        base = weights_of(chosen, shape, self._weights, {*self._seen_once.names, *self._names})
        noise = self._survey.noise()
        self._findings = Findings(chosen, shape)
        arguments: dict[str, object] = {"reference_markers": list(chosen)}
        if self._weights:
            arguments["weights"] = dict(zip(chosen, base.tolist(), strict=True))
        for part, before, positions, after in _with_neighbours(parts, chosen):
            window = np.concatenate([before, positions, after])
            fit = robust_rigid_transforms(shape, window, base, noise)
            fit = _cut(fit, slice(len(before), len(before) + len(positions)))
            self._findings.add(positions, fit)
            yield self._moved(part, fit).with_step("remove_head_motion", arguments)

    def _moved(self, part: MarkerTracks, fit: RigidFit) -> MarkerTracks:
        shifted = part.positions - fit.translations[:, None, :]
        positions = np.einsum("fji,fpj->fpi", fit.rotations, shifted)
        known = ~np.isnan(fit.residuals)
        lost = ~known & part.visible.any(axis=1)
        if lost.any():
            if not self._lost:
                self._first_lost = self._frames + int(np.argmax(lost))
            self._lost += int(lost.sum())
        self._frames += part.frames
        origin = np.where(known[:, None], part.origin, Origin.MISSING).astype(np.uint8)
        return part.replace(positions=positions, origin=origin)

    def tell(self) -> float:
        """After the second pass: the median residual of the reference markers, millimetres.

        Raises
        ------
        DataError
            If no frame has a pose.

        Warns
        -----
        MocapFitWarning
            Of markers that do not fit, and frames that are lost.
        """
        residual = self._findings.tell()
        if self._lost:
            warnings.warn(
                f"the head's pose is not known in {self._lost} of {self._frames} frames "
                f"(first {self._first_lost}): their markers count as missing",
                MocapFitWarning,
                stacklevel=2,
            )
        return residual


def _of(part: MarkerTracks, names: Sequence[str]) -> FloatArray:
    """Markers of a stretch, `(frames, markers, 3)`; NaN for those that it has not."""
    positions = np.full((part.frames, len(names), 3), np.nan)
    for place, name in enumerate(names):
        if name in part.names:
            positions[:, place] = part.positions[:, part.index(name)]
    return positions


def _with_neighbours(
    parts: Iterable[MarkerTracks], names: Sequence[str]
) -> Iterator[tuple[MarkerTracks, FloatArray, FloatArray, FloatArray]]:
    """Each stretch, its markers of these names, and those of the frames before and after."""
    before = np.zeros((0, len(names), 3))
    waiting: deque[tuple[MarkerTracks, FloatArray]] = deque()

    def next_one() -> tuple[MarkerTracks, FloatArray, FloatArray, FloatArray]:
        part, positions = waiting.popleft()
        after = np.concatenate([before[:0], *(follows for _, follows in waiting)])[:REACH]
        return part, before, positions, after

    for part in parts:
        waiting.append((part, _of(part, names)))
        while sum(len(positions) for _, positions in waiting) - len(waiting[0][1]) >= REACH:
            one = next_one()
            yield one
            before = np.concatenate([before, one[2]])[-REACH:]
    while waiting:
        one = next_one()
        yield one
        before = np.concatenate([before, one[2]])[-REACH:]


def _cut(fit: RigidFit, frames: slice) -> RigidFit:
    return RigidFit(
        fit.rotations[frames],
        fit.translations[frames],
        fit.residuals[frames],
        fit.weights[frames],
        fit.rejected[frames],
        fit.noise,
    )
