"""The typical shape of the markers of a recording, and the layout that its names belong to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mocap_fit.fitting import Layout, load_layout
from mocap_fit.fitting.layout import list_layouts
from mocap_fit.io.names import split_subject
from mocap_fit.tracks import FloatArray, MarkerTracks, estimate_rigid_transforms
from mocap_fit.tracks.rigid import apply_inverse_transforms, project_to_rotations
from mocap_fit.tracks.rigid_sets import compute_median, compute_typical_shape
from mocap_fit.tracks.robust import estimate_robust_transforms

# A shipped layout is taken where a recording has as many of its markers.
_KNOWN_SHARE = 0.8


@dataclass(frozen=True, eq=False)
class Stilled:
    """A recording without the head's motion.

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
        return np.asarray(self.shape @ self.mean_rotation.T + self.mean_translation)


def remove_motion(recording: MarkerTracks, head: Sequence[int]) -> Stilled | None:
    """Take the head's motion out of a recording, by its head markers or, without, by all.

    Parameters
    ----------
    recording
        Markers in any coordinates.
    head
        Which of them are rigid with the head; four or more of them are believed.

    Returns
    -------
    Stilled or None
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
    return Stilled(
        still,
        compute_median(still),
        residuals,
        project_to_rotations(rotations[known].sum(axis=0)),
        np.median(translations[known], axis=0),
    )


def guess_layout(names: Sequence[str]) -> Layout | None:
    """Guess the shipped layout from the markers' names.

    Parameters
    ----------
    names
        Names of the markers.

    Returns
    -------
    Layout or None
        The layout that most of the names belong to; None where none does.
    """
    best, best_layout = _KNOWN_SHARE, None
    known = {split_subject(name)[1] for name in names}
    for name in list_layouts():
        layout = load_layout(name)
        wanted = [marker.name for marker in layout.markers]
        share = sum(marker in known for marker in wanted) / len(wanted)
        if share > best:
            best, best_layout = share, layout
    return best_layout
