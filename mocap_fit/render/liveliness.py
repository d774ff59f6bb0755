"""Blinks, and the motion of a living head.

Both are drawn at random from a seed, which is to be the same for all conditions of an experiment;
or the head moves as it was measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial.transform import Rotation

from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.tracks import FloatArray, PoseTracks

# Seconds in which lids fall, stay closed, and rise.
_FALL, _STAY, _RISE = 0.09, 0.03, 0.16
# Seconds between two blinks: the minimum, and the mean of the rest.
_MIN_PAUSE, _MEAN_MORE = 1.3, 2.4
# Hertz, and standard deviations: degrees about x (nod), y (turn), z (tilt); millimetres.
_SWAY = (0.12, 0.21, 0.34, 0.55, 0.83)
_TURNS = (1.1, 1.5, 0.7)
_SHIFTS = (0.6, 0.5, 0.8)
# The lids of one eye: middle of the upper and of the lower lid, outer and inner corner, the fold
# above the upper lid, the pupil; the regions that follow the upper lid; the ball.
_EYES = (
    (("3.1", "3.3", "3.7", "3.11", "3.13", "3.5"), ("eyelids_left", "lashes_left"), "eye_left"),
    (("3.2", "3.4", "3.12", "3.8", "3.14", "3.6"), ("eyelids_right", "lashes_right"), "eye_right"),
)
# Millimetres: from the pupil back to the centre of rotation, and from the ball to a lowered lid.
_EYE_RADIUS = 12.3
_LID_THICKNESS = 1.4
# Millimetres: a closing lid is coarser than what it covers, so the ball retracts behind it.
_RETRACTION = 2.0
# Millimetres below the chin at which the motion of the head ends.
_NECK = 75.0


@dataclass(frozen=True, eq=False)
class Liveliness:
    """The blinks and the motion of a head during a movie.

    Parameters
    ----------
    blinks
        Closure of the lids, ``(frames,)``, 0 to 1 (closed).
    turns
        Rotation vectors of the head, ``(frames, 3)``, radians.
    shifts
        Translations of the head, ``(frames, 3)``, millimetres.
    """

    blinks: FloatArray
    turns: FloatArray
    shifts: FloatArray


def draw_liveliness(
    times: FloatArray, *, blinks: bool = True, head_motion: bool = True, seed: int = 0
) -> Liveliness:
    """Draw blinks and head motion for the frames of a movie.

    Parameters
    ----------
    times
        Times of the frames, ``(frames,)``, seconds.
    blinks
        Whether there are blinks.
    head_motion
        Whether the head moves.
    seed
        Another seed draws others; the same seed gives the same at any frame rate.

    Returns
    -------
    Liveliness
        Blinks and head motion of every frame.
    """
    blink_rng, motion_rng = np.random.default_rng(seed).spawn(2)
    closed = np.zeros(len(times))
    turns, shifts = np.zeros((len(times), 3)), np.zeros((len(times), 3))
    if blinks and len(times):
        closed = _draw_blinks(times, blink_rng)
    if head_motion and len(times):
        turns = np.radians(_draw_sway(times, motion_rng, _TURNS))
        shifts = _draw_sway(times, motion_rng, _SHIFTS)
    return Liveliness(closed, turns, shifts)


def plan_liveliness(
    times: FloatArray, mesh: Mesh, *, blinks: bool, head_motion: bool | PoseTracks, seed: int
) -> Liveliness:
    """Draw blinks and head motion, or let the head move as it was measured.

    Parameters
    ----------
    times
        Times of the frames, ``(frames,)``, seconds.
    mesh
        The face.
    blinks
        Whether there are blinks.
    head_motion
        Whether the head moves at random; or its measured pose in the axes of the face.
    seed
        Another seed draws others.

    Returns
    -------
    Liveliness
        Blinks and head motion of every frame.

    Raises
    ------
    DataError
        If the pose is known in no frame.
    """
    life = draw_liveliness(times, blinks=blinks, head_motion=head_motion is True, seed=seed)
    if isinstance(head_motion, PoseTracks):
        return follow_pose(life, head_motion, times, mesh)
    return life


def follow_pose(life: Liveliness, pose: PoseTracks, times: FloatArray, mesh: Mesh) -> Liveliness:
    """Move the head as it was measured, about its mean pose.

    Parameters
    ----------
    life
        Blinks; the motion of the head is replaced.
    pose
        Pose of the head in the axes of the face, such as a corpus has it; the first body is used.
    times
        Times of the frames, ``(frames,)``, seconds. Gaps are bridged, and the first and the last
        pose hold before and after.
    mesh
        The face.

    Returns
    -------
    Liveliness
        With the measured motion.

    Raises
    ------
    DataError
        If the pose is known in no frame.
    """
    known = np.isfinite(pose.translations[:, 0]).all(axis=1)
    known &= np.isfinite(pose.rotations[:, 0]).all(axis=(1, 2))
    if not known.any():
        raise DataError("the pose of the head is known in no frame", found=pose.name or None)
    rotations = Rotation.from_matrix(pose.rotations[known, 0])
    mean = rotations.mean().inv()
    turns = mean * rotations
    shifts = mean.apply(pose.translations[known, 0])
    # The same motion, as a rotation about the neck's joint and a translation.
    joint = _find_joint(mesh)
    shifts += turns.apply(joint)
    motion = np.hstack([turns.as_rotvec(), shifts - shifts.mean(axis=0)])
    between = [np.interp(times, pose.times[known], column) for column in motion.T]
    return replace(life, turns=np.stack(between[:3], axis=1), shifts=np.stack(between[3:], axis=1))


def _find_joint(mesh: Mesh) -> FloatArray:
    """Return the point about which the head turns, ``(3,)``: below the ears, as low as the chin."""
    points = mesh.feature_points
    ears = [points[name] for name in ("10.7", "10.8") if name in points]
    middle = mesh.vertices[ears].mean(axis=0) if ears else mesh.vertices.mean(axis=0)
    low = mesh.vertices[points["2.1"], 1] if "2.1" in points else mesh.vertices[:, 1].min()
    return np.array([0.0, low, middle[2]])


def _draw_blinks(times: FloatArray, rng: np.random.Generator) -> FloatArray:
    closed = np.zeros(len(times))
    begin = float(times[0]) + rng.uniform(0.4, 1.6)
    while begin < times[-1]:
        since = times - begin
        falling = np.clip(since / _FALL, 0.0, 1.0)
        rising = np.clip((since - _FALL - _STAY) / _RISE, 0.0, 1.0)
        closed = np.maximum(closed, _ease(falling) - _ease(rising))
        begin += _MIN_PAUSE + rng.exponential(_MEAN_MORE)
    return np.asarray(closed)


def _ease(share: FloatArray) -> FloatArray:
    """Return the cubic from 0 to 1 whose slope is 0 at both ends."""
    return np.asarray(share * share * (3.0 - 2.0 * share))


def _draw_sway(
    times: FloatArray, rng: np.random.Generator, sizes: tuple[float, float, float]
) -> FloatArray:
    """Return sums of slow sines, ``(frames, 3)``; the slowest are the largest."""
    rates = np.array(_SWAY)
    shares = 1.0 / np.sqrt(rates)
    shares /= np.sqrt(0.5 * np.sum(shares**2))
    phases = rng.uniform(0, 2 * np.pi, (3, len(rates)))
    angles = 2 * np.pi * rates * times[:, None, None] + phases
    return np.asarray((shares * np.sin(angles)).sum(axis=2) * np.array(sizes))


class LivelyFace:
    """A mesh whose lids close and whose head moves.

    Parameters
    ----------
    mesh
        The face at rest.
    blinks
        Whether its lids will close.

    Raises
    ------
    ConfigurationError
        If the lids will close and the mesh lacks the feature points or regions of the eyes.
    """

    def __init__(self, mesh: Mesh, *, blinks: bool = True) -> None:
        self._lids = [_Lid(mesh, *eye) for eye in _EYES] if blinks else []
        low = float(mesh.vertices[:, 1].min())
        self._joint = _find_joint(mesh)
        self._chin = float(self._joint[1])
        # A face without a neck moves as a whole.
        self._foot = self._chin - _NECK if self._chin - low > 0.3 * _NECK else -np.inf

    def describe(self) -> dict[str, Any]:
        """Return how the head moves on its neck, for programs that do it themselves.

        Returns
        -------
        dict[str, Any]
            ``joint``: the point of rotation; ``chin`` and ``foot``: heights at which the rotation
            is full and at which it ends, None where all of the face moves; millimetres.
        """
        foot = self._foot if np.isfinite(self._foot) else None
        return {"joint": self._joint.tolist(), "chin": self._chin, "foot": foot}

    def move(
        self, vertices: FloatArray, blink: float, turn: FloatArray, shift: FloatArray
    ) -> FloatArray:
        """Close the lids partly and move the head.

        Parameters
        ----------
        vertices
            Vertices of this mesh, ``(vertices, 3)``, millimetres.
        blink
            Closure of the lids, 0 to 1 (closed).
        turn
            Rotation vector of the head, ``(3,)``, radians.
        shift
            Translation of the head, ``(3,)``, millimetres.

        Returns
        -------
        ndarray
            The moved vertices, ``(vertices, 3)``, millimetres.
        """
        if blink > 0.0 and self._lids:
            vertices = vertices.copy()
            for lid in self._lids:
                lid.close(vertices, blink)
        return self.carry(vertices, turn, shift)

    def carry(self, points: FloatArray, turn: FloatArray, shift: FloatArray) -> FloatArray:
        """Move points with the head, such as markers; what is below the neck only shifts.

        Parameters
        ----------
        points
            Points in the head frame, ``(points, 3)``, millimetres.
        turn
            Rotation vector of the head, ``(3,)``, radians.
        shift
            Translation of the head, ``(3,)``, millimetres.

        Returns
        -------
        ndarray
            The moved points, ``(points, 3)``, millimetres.
        """
        if not (np.any(turn) or np.any(shift)):
            return points
        moved = Rotation.from_rotvec(turn).apply(points - self._joint) + self._joint
        if np.isfinite(self._foot):
            height = (points[:, 1] - self._foot) / (self._chin - self._foot)
            moved = points + _ease(np.clip(height, 0.0, 1.0))[:, None] * (moved - points)
        return np.asarray(moved + shift)


class _Lid:
    """The upper lid of one eye, which slides over the ball down to the lower one."""

    def __init__(
        self, mesh: Mesh, points: tuple[str, ...], regions: tuple[str, str], ball: str
    ) -> None:
        missing = [name for name in points if name not in mesh.feature_points]
        if missing or not mesh.has_region(regions[0]):
            raise ConfigurationError(
                "this face cannot blink: its mesh lacks points or regions of the eyes",
                found=f"no {', '.join(missing) or regions[0]}",
                expected=f"the feature points {', '.join(points)}, the region '{regions[0]}'",
                advice="Leave the blinks out, or name them in the rig file.",
            )
        positions = [mesh.vertices[mesh.get_feature_point(name)] for name in points]
        upper, lower, outer, inner, fold, pupil = positions
        members = [mesh.get_region(name) for name in regions if mesh.has_region(name)]
        ids: IndexArray = np.unique(np.concatenate(members))
        rest = mesh.vertices[ids]
        # Across the eye: -1 at one corner, 1 at the other; lids meet there.
        middle, half = 0.5 * (outer + inner), 0.5 * abs(outer[0] - inner[0])
        across = np.clip((rest[:, 0] - middle[0]) / half, -1.0, 1.0)
        slope = (outer[1] - inner[1]) / (outer[0] - inner[0])
        level = middle[1] + slope * (rest[:, 0] - middle[0])
        bulge = 1.0 - across**2
        margin = level + bulge * (upper[1] - middle[1])
        target = level + bulge * (lower[1] - middle[1] + 0.3)
        above = (rest[:, 1] - margin) / max(fold[1] - upper[1], 1e-6)
        share = 1.0 - _ease(np.clip(above, 0.0, 1.0))
        # Below the middle line of the eye is the lower lid, which does not move.
        share *= _ease(np.clip((rest[:, 1] - level) / 0.6, 0.0, 1.0)) * (bulge > 0)
        chosen = share > 1e-3
        self._ids = ids[chosen]
        self._fall = (share * (target - margin))[chosen]
        self._thickness = (_LID_THICKNESS * np.clip(5.0 * bulge, 0.0, 1.0))[chosen]
        self._centre = pupil - np.array([0.0, 0.0, _EYE_RADIUS])
        self._ball: LinearNDInterpolator | None = None
        self._ball_ids: IndexArray = np.zeros(0, dtype=np.int64)
        if mesh.has_region(ball):
            self._ball_ids = mesh.get_region(ball)
            surface = mesh.vertices[self._ball_ids]
            self._ball = LinearNDInterpolator(surface[:, :2], surface[:, 2], fill_value=-np.inf)
            # What lies behind the ball stays there, and closes the gap between lid and ball.
            behind = rest[chosen, 2] < self._ball(rest[chosen, :2])
            self._thickness[behind] = -np.inf
            # At the corners the lids hardly move, and the ball must not leave them.
            aside = np.clip((surface[:, 0] - middle[0]) / half, -1.0, 1.0)
            self._sink = _RETRACTION * np.minimum(4.0 * (1.0 - aside**2), 1.0)

    def close(self, vertices: FloatArray, amount: float) -> None:
        """Lower the lid, in place."""
        positions = vertices[self._ids]
        height = positions[:, 1] - self._centre[1]
        depth = positions[:, 2] - self._centre[2]
        lowered = height + amount * self._fall
        # Its distance from the axis of the eye is constant, or it would cut through the ball.
        depth = np.sqrt(np.maximum(height**2 + depth**2 - lowered**2, 1.0))
        positions[:, 1] = self._centre[1] + lowered
        positions[:, 2] = np.maximum(self._centre[2] + depth, positions[:, 2])
        if self._ball is not None:
            vertices[self._ball_ids, 2] -= self._sink * min(1.0, 2.0 * amount)
            thickness = self._thickness * min(1.0, 4.0 * amount)
            positions[:, 2] = np.maximum(positions[:, 2], self._ball(positions[:, :2]) + thickness)
        vertices[self._ids] = positions
