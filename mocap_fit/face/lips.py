"""How far the lips are apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.errors import DataError
from mocap_fit.face.mesh import IndexArray
from mocap_fit.face.rig import Rig, deform_points
from mocap_fit.tracks import FloatArray

# The middle of the inner upper lip and of the inner lower lip (MPEG-4).
UPPER_LIP, LOWER_LIP = "2.2", "2.3"


def compute_lip_gap(rig: Rig, values: ArrayLike) -> FloatArray:
    """Compute how far the inner lips are apart in the middle, frame by frame.

    Parameters
    ----------
    rig
        A face whose mesh has the feature points 2.2 and 2.3.
    values
        Values of the parameters, ``(frames, parameters)``, in the order of the rig, full gestures.

    Returns
    -------
    ndarray
        ``(frames,)``, millimetres along the head's y axis; negative where the lips are pressed into
        each other, NaN where a parameter is.

    Raises
    ------
    DataError
        If the shape is wrong, or the mesh lacks the points.
    """
    frames = np.asarray(values, dtype=np.float64)
    names = rig.parameter_names
    if frames.ndim != 2 or frames.shape[1] != len(names):
        raise DataError(
            "the parameters have the wrong shape",
            found=frames.shape,
            expected=f"(frames, {len(names)}): {', '.join(names)}",
        )
    lips: IndexArray = np.array([rig.mesh.get_feature_point(p) for p in (UPPER_LIP, LOWER_LIP)])
    heights = deform_points(rig, lips, frames)[:, :, 1]
    return np.asarray(heights[:, 0] - heights[:, 1])
