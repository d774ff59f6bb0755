"""MPEG-4 feature points of the built-in head.

Numbers are those of ISO/IEC 14496-2, Annex C (facial definition parameters). Left is the
speaker's. In most groups odd numbers are left and even ones right; these are the exceptions and
the ones that are easily confused:

- 3.7 and 3.11 are the outer and the inner corner of the left eye ("left" and "right" corner);
  3.12 and 3.8 are the outer and the inner corner of the right eye.
- 4.1 is the inner end of the left brow, 4.2 of the right one.
- 9.4 and 9.5 are the right and the left bottom edge of the nose, 9.6 and 9.7 the right and the
  left upper edge of the nose bone; but 9.1, 9.2 and 9.13, 9.14 are left, right.
- 11.2 and 11.3 are the right and the left border between hair and forehead.
- 8.9 and 8.10, the high points of Cupid's bow: the standard's table names the right one first.
  Here 8.9 is the left one, like every other odd number of the group, because the shipped marker
  tables count so.

Left out: 7.1 (the top of the spine) and 11.5 (the thickness of the hair), which are not points of
a face's surface.
"""

from __future__ import annotations

import numpy as np

from mocap_fit.face.builtin import eyes
from mocap_fit.face.builtin.skin import Skin
from mocap_fit.face.builtin.surfaces import MIRROR, Mask, Piece
from mocap_fit.face.builtin.tongue import TONGUE_COLUMNS, TONGUE_ROWS
from mocap_fit.tracks import FloatArray

# Left point, right point, position along a half ring of the mouth (0 below, 10 corner, 20 above).
_CONTACT_POINTS = [("2.4", "2.5", 10), ("2.6", "2.7", 16), ("2.8", "2.9", 4)]
_BORDER_POINTS = [("8.3", "8.4", 10), ("8.5", "8.6", 16), ("8.7", "8.8", 4), ("8.9", "8.10", 18)]
# Left point, right point, vertex of a lid ring (0 outer corner, 7 above, 14 inner corner, 21
# below), ring.
_LID_POINTS = [
    ("3.1", "3.2", 7, 2),
    ("3.3", "3.4", 21, 2),
    ("3.7", "3.12", 0, 2),
    ("3.11", "3.8", 14, 2),
    ("3.9", "3.10", 21, 5),
    ("3.13", "3.14", 7, 5),
]
# Left point, right point, where it is seen from the front.
_FRONT_POINTS = [
    ("2.11", "2.12", (15.0, -38.0)),
    ("4.1", "4.2", (13.0, 79.5)),
    ("4.3", "4.4", (33.0, 83.5)),
    ("4.5", "4.6", (48.5, 78.5)),
    ("5.1", "5.2", (43.0, 12.0)),
    ("5.3", "5.4", (46.0, 40.0)),
    ("9.1", "9.2", (16.5, 27.0)),
    ("9.5", "9.4", (11.5, 21.5)),
    ("9.7", "9.6", (8.0, 68.0)),
    ("9.13", "9.14", (10.0, 51.0)),
    ("11.3", "11.2", (52.0, 113.0)),
]
_MIDDLE_POINTS = [("9.12", 51.5), ("11.1", 124.0)]
# Left point, right point, position in space.
_SPACE_POINTS = [("2.13", "2.14", (54.0, -6.0, 22.0))]


def find_feature_points(skin: Skin) -> dict[str, int]:
    """Find the feature points that lie on the skin.

    Parameters
    ----------
    skin
        The skin of the built-in head.

    Returns
    -------
    dict
        Feature point → vertex index.
    """
    points: dict[str, int] = {}

    def add_pair(left: str, right: str, vertex: int) -> None:
        points[left] = int(vertex)
        points[right] = int(skin.mirror[vertex])

    rings = {str(skin.kinds[ring[0]]): ring for ring in skin.mouth if len(ring) > 1}
    contact, border = rings["contact"], rings["border"]
    points["2.2"], points["2.3"] = int(contact[-1]), int(contact[0])
    points["8.1"], points["8.2"] = int(border[-1]), int(border[0])
    for ring, table in ((contact, _CONTACT_POINTS), (border, _BORDER_POINTS)):
        for left, right, position in table:
            add_pair(left, right, ring[position])
    for left, right, vertex, ring_number in _LID_POINTS:
        add_pair(left, right, skin.eye[ring_number][vertex])
    for left, right, seen in _FRONT_POINTS:
        add_pair(
            left, right, _find_nearest(skin, np.array([*seen, 0.0]), np.array([1.0, 1.0, 0.0]))
        )
    for left, right, location in _SPACE_POINTS:
        add_pair(left, right, _find_nearest(skin, np.array(location), np.ones(3)))
    points.update(_find_middle_points(skin))
    ear = skin.ear[4]
    add_pair("10.1", "10.2", ear[skin.vertices[ear, 1].argmax()])
    add_pair("10.3", "10.4", ear[skin.vertices[ear, 2].argmin()])
    add_pair("10.5", "10.6", ear[skin.vertices[ear, 1].argmin()])
    base = skin.ear[0]
    add_pair("10.7", "10.8", base[22])
    add_pair("10.9", "10.10", base[11])
    return points


def _find_middle_points(skin: Skin) -> dict[str, int]:
    """Find the points in the middle of the face."""
    middle = np.flatnonzero((skin.vertices[:, 0] == 0) & (skin.kinds == "fill"))
    y, z = skin.vertices[middle, 1], skin.vertices[middle, 2]

    def find_extreme(score: FloatArray, where: Mask) -> int:
        return int(middle[np.where(where, score, -np.inf).argmax()])

    front = z > 40
    chin = front & (y < -20) & (y > -60)
    points = {
        "2.1": find_extreme(z - 1.6 * y, chin),  # where the chin turns under
        "2.10": find_extreme(z, chin),
        "9.3": find_extreme(z, front & (y > 15) & (y < 50)),
        "9.15": find_extreme(-z, front & (y > 16) & (y < 24)),
        "11.4": find_extreme(y, y > 0),
        "11.6": find_extreme(-z, y > 0),
    }
    for name, height in _MIDDLE_POINTS:
        points[name] = find_extreme(-np.abs(y - height), front)
    return points


def _find_nearest(skin: Skin, position: FloatArray, axes: FloatArray) -> int:
    distance = (skin.vertices - position) ** 2 @ axes
    left_fill = (skin.kinds == "fill") & (skin.vertices[:, 0] >= 0) & (skin.vertices[:, 2] > 0)
    return int(np.where(left_fill, distance, np.inf).argmin())


def find_tongue_points(piece: Piece) -> dict[str, int]:
    """Find the feature points of the tongue.

    Parameters
    ----------
    piece
        The tongue.

    Returns
    -------
    dict
        Feature point → vertex index within the piece.
    """
    columns = np.arange(TONGUE_COLUMNS)
    tip = TONGUE_ROWS * TONGUE_COLUMNS
    row = 3 * TONGUE_ROWS // 5
    body = row * TONGUE_COLUMNS + columns
    top = body[TONGUE_COLUMNS // 4]
    border = 2 * TONGUE_COLUMNS + columns
    return {
        "6.1": tip,
        "6.2": int(top),
        "6.3": int(border[piece.vertices[border, 0].argmax()]),
        "6.4": int(border[piece.vertices[border, 0].argmin()]),
    }


def find_teeth_points(piece: Piece, *, upper: bool) -> dict[str, int]:
    """Find the edge and the neck of the front teeth.

    Parameters
    ----------
    piece
        A row of teeth.
    upper
        Whether it is the upper row.

    Returns
    -------
    dict
        Feature point → vertex index within the piece.
    """
    front = np.flatnonzero(np.abs(piece.vertices[:, 0]) < 6)
    y = piece.vertices[front, 1]
    highest, lowest = int(front[y.argmax()]), int(front[y.argmin()])
    if upper:
        return {"9.8": highest, "9.10": lowest}
    return {"9.9": lowest, "9.11": highest}


def find_pupil(piece: Piece) -> int:
    """Find the centre of a pupil.

    Parameters
    ----------
    piece
        The left or the right eye.

    Returns
    -------
    int
        Vertex index within the piece.
    """
    centre = eyes.CENTRE if piece.vertices[:, 0].mean() > 0 else eyes.CENTRE * MIRROR
    aside = np.hypot(*(piece.vertices[:, :2] - centre[:2]).T)
    return int(aside.argmin())
