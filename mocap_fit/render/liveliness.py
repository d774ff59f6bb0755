"""Blinks, and the small motion of a head that is alive.

Neither is measured or predicted: they are drawn from a seed, and only where they are asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial.transform import Rotation

from mocap_fit.errors import ConfigurationError
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.tracks import FloatArray

# Seconds: lids fall, stay, rise.
_FALL, _STAY, _RISE = 0.09, 0.03, 0.16
# Seconds between two blinks: the least, and the mean of what comes on top.
_LEAST_BETWEEN, _MORE_BETWEEN = 1.3, 2.4
# Hertz, and standard deviations: degrees about x (nod), y (turn), z (tilt); millimetres.
_SWAY = (0.12, 0.21, 0.34, 0.55, 0.83)
_TURNS = (1.1, 1.5, 0.7)
_SHIFTS = (0.6, 0.5, 0.8)
# The lids of one eye: middle of the upper and of the lower lid, outer and inner corner, the fold
# above the upper lid, the pupil; the regions that follow the upper lid; the ball.
_EYES = (
    (
        ("3.1", "3.3", "3.7", "3.11", "3.13", "3.5"),
        ("eyelids_left", "lashes_left"),
        "eye_left",
    ),
    (
        ("3.2", "3.4", "3.12", "3.8", "3.14", "3.6"),
        ("eyelids_right", "lashes_right"),
        "eye_right",
    ),
)
# How far behind the pupil the eye turns, and how far a lowered lid lies before the ball, mm.
_EYE_RADIUS = 12.3
_LID_THICKNESS = 1.4
# A closing lid is coarser than what it covers: the ball draws back from it, unseen, mm.
_DRAWN_BACK = 2.6
# How far under the chin the head's motion has died away, mm.
_NECK = 75.0


@dataclass(frozen=True, eq=False)
class Liveliness:
    """How a head blinks and moves during a movie.

    Parameters
    ----------
    blinks
        `(frames,)`, 0 open to 1 closed.
    turns
        `(frames, 3)`, rotation vectors, radians.
    shifts
        `(frames, 3)`, millimetres.
    """

    blinks: FloatArray
    turns: FloatArray
    shifts: FloatArray


def liveliness(
    times: FloatArray, *, blinks: bool = True, head_motion: bool = True, seed: int = 0
) -> Liveliness:
    """Draw blinks and head motion for the frames of a movie.

    Parameters
    ----------
    times
        `(frames,)`, seconds. The same seed gives the same blinks at any frame rate.
    blinks, head_motion
        Which of the two.
    seed
        What they are drawn from.
    """
    chance_of_blinks, chance_of_motion = np.random.default_rng(seed).spawn(2)
    closed = np.zeros(len(times))
    turns, shifts = np.zeros((len(times), 3)), np.zeros((len(times), 3))
    if blinks and len(times):
        closed = _blinks(times, chance_of_blinks)
    if head_motion and len(times):
        turns = np.radians(_sway(times, chance_of_motion, _TURNS))
        shifts = _sway(times, chance_of_motion, _SHIFTS)
    return Liveliness(closed, turns, shifts)


def _blinks(times: FloatArray, chance: np.random.Generator) -> FloatArray:
    closed = np.zeros(len(times))
    begin = float(times[0]) + chance.uniform(0.4, 1.6)
    while begin < times[-1]:
        since = times - begin
        falling = np.clip(since / _FALL, 0.0, 1.0)
        rising = np.clip((since - _FALL - _STAY) / _RISE, 0.0, 1.0)
        closed = np.maximum(closed, _eased(falling) - _eased(rising))
        begin += _LEAST_BETWEEN + chance.exponential(_MORE_BETWEEN)
    return np.asarray(closed)


def _eased(share: FloatArray) -> FloatArray:
    return np.asarray(share * share * (3.0 - 2.0 * share))


def _sway(
    times: FloatArray, chance: np.random.Generator, sizes: tuple[float, float, float]
) -> FloatArray:
    """Slow sums of sines, `(frames, 3)`; slow ones are larger."""
    rates = np.array(_SWAY)
    shares = 1.0 / np.sqrt(rates)
    shares /= np.sqrt(0.5 * np.sum(shares**2))
    phases = chance.uniform(0, 2 * np.pi, (3, len(rates)))
    angles = 2 * np.pi * rates * times[:, None, None] + phases
    return np.asarray((shares * np.sin(angles)).sum(axis=2) * np.array(sizes))


class LivelyFace:
    """Moves the lids and the head of a mesh.

    Parameters
    ----------
    mesh
        The face at rest.
    blinks
        Whether its lids will be closed.

    Raises
    ------
    ConfigurationError
        If lids are to be closed and the mesh does not name what it takes.
    """

    def __init__(self, mesh: Mesh, *, blinks: bool = True) -> None:
        self._lids = [_Lid(mesh, *eye) for eye in _EYES] if blinks else []
        low = float(mesh.vertices[:, 1].min())
        chin = mesh.feature_points.get("2.1")
        self._chin = low if chin is None else float(mesh.vertices[chin, 1])
        # A face without a neck moves as a whole.
        self._foot = self._chin - _NECK if self._chin - low > 0.3 * _NECK else -np.inf
        ears = [
            mesh.feature_points[name] for name in ("10.7", "10.8") if name in mesh.feature_points
        ]
        middle = mesh.vertices[ears].mean(axis=0) if ears else mesh.vertices.mean(axis=0)
        self._joint = np.array([0.0, self._chin, float(middle[2])])

    def moved(
        self, vertices: FloatArray, blink: float, turn: FloatArray, shift: FloatArray
    ) -> FloatArray:
        """The face with its lids partly closed and its head turned.

        Parameters
        ----------
        vertices
            `(vertices, 3)`, mm, of this mesh.
        blink
            0 open to 1 closed.
        turn, shift
            `(3,)`: a rotation vector (radians), and mm.
        """
        if blink > 0.0 and self._lids:
            vertices = vertices.copy()
            for lid in self._lids:
                lid.close(vertices, blink)
        return self.carried(vertices, turn, shift)

    def carried(self, points: FloatArray, turn: FloatArray, shift: FloatArray) -> FloatArray:
        """Points that go with the head, `(points, 3)`, mm, such as markers."""
        if not (np.any(turn) or np.any(shift)):
            return points
        moved = Rotation.from_rotvec(turn).apply(points - self._joint) + self._joint + shift
        if not np.isfinite(self._foot):
            return np.asarray(moved)
        share = _eased(np.clip((points[:, 1] - self._foot) / (self._chin - self._foot), 0.0, 1.0))
        return np.asarray(points + share[:, None] * (moved - points))


class _Lid:
    """The upper lid of one eye, which slides over the ball down to the lower one."""

    def __init__(
        self, mesh: Mesh, points: tuple[str, ...], regions: tuple[str, str], ball: str
    ) -> None:
        missing = [name for name in points if name not in mesh.feature_points]
        if missing or not mesh.has_region(regions[0]):
            raise ConfigurationError(
                "this face cannot blink: its mesh does not name what it takes",
                found=f"no {', '.join(missing) or regions[0]}",
                expected=f"the feature points {', '.join(points)}, the region '{regions[0]}'",
                advice="Leave the blinks out, or name them in the rig file.",
            )
        places = [mesh.vertices[mesh.get_feature_point(name)] for name in points]
        upper, lower, outer, inner, fold, pupil = places
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
        share = 1.0 - _eased(np.clip(above, 0.0, 1.0))
        # What lies under the middle line of the eye is the lower lid, which stays.
        share *= _eased(np.clip((rest[:, 1] - level) / 0.6, 0.0, 1.0)) * (bulge > 0)
        chosen = share > 1e-3
        self._ids = ids[chosen]
        self._fall = (share * (target - margin))[chosen]
        self._centre = pupil - np.array([0.0, 0.0, _EYE_RADIUS])
        self._ball: LinearNDInterpolator | None = None
        self._ball_ids: IndexArray = np.zeros(0, dtype=np.int64)
        if mesh.has_region(ball):
            self._ball_ids = mesh.get_region(ball)
            surface = mesh.vertices[self._ball_ids]
            self._ball = LinearNDInterpolator(surface[:, :2], surface[:, 2], fill_value=-np.inf)

    def close(self, vertices: FloatArray, amount: float) -> None:
        """Lower the lid, in place."""
        places = vertices[self._ids]
        height = places[:, 1] - self._centre[1]
        depth = places[:, 2] - self._centre[2]
        lowered = height + amount * self._fall
        # It stays as far from the eye's axis as it is, or it would cut through the ball.
        depth = np.sqrt(np.maximum(height**2 + depth**2 - lowered**2, 1.0))
        places[:, 1] = self._centre[1] + lowered
        places[:, 2] = np.maximum(self._centre[2] + depth, places[:, 2])
        if self._ball is not None:
            vertices[self._ball_ids, 2] -= _DRAWN_BACK * min(1.0, 2.0 * amount)
            thickness = _LID_THICKNESS * min(1.0, 4.0 * amount)
            places[:, 2] = np.maximum(places[:, 2], self._ball(places[:, :2]) + thickness)
        vertices[self._ids] = places
