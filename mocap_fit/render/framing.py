"""Framing: where the camera stands, and what it looks at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.face.mesh import Mesh
from mocap_fit.tracks import FloatArray

View = Literal["front", "three-quarter", "side"]

# Direction from the face to the camera.
DIRECTIONS: dict[str, tuple[float, float, float]] = {
    "front": (0.0, 0.02, 1.0),
    "three-quarter": (0.68, 0.04, 0.8),
    "side": (1.0, 0.02, 0.05),
}
VIEW_ANGLE = 18.0
"""Degrees, from the lower to the upper edge of a picture."""
# Height of the picture over that of the head, from chin to crown; and the share of it above the
# crown, which a moving head may use.
_PICTURE_OVER_HEAD = 1.29
_PICTURE_OVER_MESH = 1.12
_ABOVE_CROWN = 0.045
# The mouth is this many powers of the zoom nearer to the middle: twice as close, a quarter as far.
_APPROACH = 3


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera that looks at a face, upright.

    Parameters
    ----------
    position
        Where it stands, ``(3,)``, millimetres.
    target
        What is in the middle of its picture, ``(3,)``, millimetres.
    """

    position: FloatArray
    target: FloatArray


def frame_face(
    mesh: Mesh, view: View = "front", zoom: float = 1.0, centre: ArrayLike | None = None
) -> Camera:
    """Find the camera that shows a face from one side.

    Parameters
    ----------
    mesh
        The face.
    view
        ``front``, ``three-quarter`` or ``side`` (the speaker's left).
    zoom
        Magnification, no unit: 1 shows the head from above its crown to below its chin; the closer,
        the nearer the mouth is to the middle.
    centre
        The point in the middle instead, ``(3,)``, millimetres.

    Returns
    -------
    Camera
        Its position and target.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    height = _PICTURE_OVER_MESH * (high[1] - low[1])
    target = 0.5 * (low + high)
    if "2.1" in mesh.feature_points:
        chin = mesh.vertices[mesh.get_feature_point("2.1"), 1]
        # The lower face at most hides a chin without a neck; shoulders are not the head.
        head = mesh.vertices[mesh.vertices[:, 1] >= chin]
        height = _PICTURE_OVER_HEAD * (high[1] - chin)
        target = 0.5 * (head.min(axis=0) + head.max(axis=0))
        target[1] = high[1] - (0.5 - _ABOVE_CROWN) * height
    if centre is not None:
        target = np.asarray(centre, dtype=np.float64)
    elif zoom > 1 and "2.2" in mesh.feature_points:
        mouth = mesh.vertices[mesh.get_feature_point("2.2")]
        target = mouth + (target - mouth) / zoom**_APPROACH
    direction = np.array(DIRECTIONS[view])
    distance = 0.5 * height / np.tan(np.radians(VIEW_ANGLE) / 2) / zoom
    return Camera(target + direction / np.linalg.norm(direction) * distance, target)
