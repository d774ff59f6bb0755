"""The frames of a recording laid on each other, where no reference pose is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mocap_fit.tracks import FloatArray, MarkerTracks, estimate_rigid_transforms
from mocap_fit.tracks.rigid import apply_inverse_transforms, project_to_rotations
from mocap_fit.tracks.rigid_sets import compute_median, compute_typical_shape
from mocap_fit.tracks.robust import estimate_robust_transforms


@dataclass(frozen=True, eq=False)
class AlignedFrames:
    """The frames of a recording, laid on each other by the markers that are rigid with the head.

    Parameters
    ----------
    positions
        `(frames, markers, 3)`, millimetres, in the coordinates of the typical shape; NaN where a
        marker or the pose is missing.
    shape
        `(markers, 3)`: the median over the frames; NaN for markers that are never seen.
    residuals
        `(frames,)`, millimetres: of the markers that the pose rests on.
    mean_rotation, mean_translation
        `(3, 3)` and `(3,)`: the middle pose, from these coordinates to the recording's.
    """

    positions: FloatArray
    shape: FloatArray
    residuals: FloatArray
    mean_rotation: FloatArray
    mean_translation: FloatArray

    @property
    def placed(self) -> FloatArray:
        """The shape at the middle pose in the recording's coordinates, `(markers, 3)`."""
        return self.place(self.shape)

    def place(self, points: FloatArray) -> FloatArray:
        """Bring points to the middle pose in the recording's coordinates.

        Parameters
        ----------
        points
            ``(..., 3)``, millimetres, in the coordinates of the typical shape.

        Returns
        -------
        ndarray
            ``(..., 3)``, millimetres.
        """
        return np.asarray(points @ self.mean_rotation.T + self.mean_translation)


def align_frames(recording: MarkerTracks, head: Sequence[int]) -> AlignedFrames | None:
    """Lay the frames of a recording on each other, by its head markers or, without, by all.

    Parameters
    ----------
    recording
        Markers in any coordinates.
    head
        Which of them are rigid with the head; four or more of them are believed.

    Returns
    -------
    AlignedFrames or None
        None where no frame shows three markers that are not on a line.
    """
    positions = recording.positions
    if not len(positions):
        return None
    chosen = np.array(head if len(head) >= 4 else range(positions.shape[1]), dtype=np.intp)
    shape = compute_typical_shape(positions[:, chosen])
    if (~np.isnan(shape[:, 0])).sum() < 3:
        return None
    if len(head) >= 4:
        fit = estimate_robust_transforms(shape, positions[:, chosen])
        rotations, translations, residuals = fit.rotations, fit.translations, fit.residuals
    else:
        rotations, translations, residuals = estimate_rigid_transforms(shape, positions[:, chosen])
    known = ~np.isnan(residuals)
    if not known.any():
        return None
    still = apply_inverse_transforms(positions, rotations, translations)
    # About the set's middle: far from it, a noisy rotation moves points far.
    centre = np.nanmean(shape, axis=0)
    middle = np.median(rotations[known] @ centre + translations[known], axis=0)
    rotation = project_to_rotations(rotations[known].sum(axis=0))
    return AlignedFrames(
        still, compute_median(still), residuals, rotation, middle - rotation @ centre
    )
