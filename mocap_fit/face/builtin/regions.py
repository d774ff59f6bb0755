"""Regions of the skin, and its colours."""

from __future__ import annotations

import numpy as np

from mocap_fit.face.builtin import brows, hair, mouth, skull
from mocap_fit.face.builtin.skin import Skin
from mocap_fit.face.builtin.surfaces import (
    Colour,
    Mask,
    compute_bump,
    compute_hill,
    measure_path_distance,
    smoothstep,
)
from mocap_fit.face.mesh import IndexArray
from mocap_fit.tracks import FloatArray

# The side of the mouth's bag, between its floor and its roof: points of a ring from the corner.
_BAG_SIDE = 5
SIDED = ("jaw", "cheek", "brow_skin", "eyelids", "ear")
_JAW_LINE = [(21.0, -30.0), (40.0, -18.0), (56.0, 2.0), (66.0, 22.0)]

# Tints of the face: share, middle and widths (mm; both sides), colour.
_TINTS: tuple[tuple[float, tuple[float, float], tuple[float, float], Colour], ...] = (
    (0.30, (0, 104), (44, 22), (0.945, 0.79, 0.66)),  # forehead
    (0.24, (37, 28), (14, 13), (0.92, 0.55, 0.49)),  # cheek
    (0.20, (54, 22), (13, 16), (0.90, 0.58, 0.51)),  # farther out
    (0.34, (0, 28), (11, 7), (0.90, 0.54, 0.48)),  # tip of the nose
    (0.20, (13, 25), (5, 5), (0.84, 0.48, 0.43)),  # its wings
    (0.30, (30, 66), (14, 8), (0.78, 0.53, 0.47)),  # eye socket
    (0.32, (17, 63), (6, 8), (0.72, 0.47, 0.43)),  # its inner corner
    (0.22, (29, 53.5), (9, 3.0), (0.74, 0.53, 0.51)),  # below the eye
    (0.16, (0, -33), (13, 9), (0.90, 0.57, 0.51)),  # chin
    (0.22, (0, -15), (15, 4.5), (0.80, 0.53, 0.46)),  # below the lower lip
    (0.20, (27.5, -1), (4, 5), (0.74, 0.47, 0.42)),  # corners of the mouth
)
_BEARD = 0.13
_SKIN: Colour = (0.93, 0.76, 0.665)
_LIP: Colour = (0.80, 0.50, 0.47)
# The wet inner rim of the lips, where they meet and behind.
_WET_LIP: Colour = (0.70, 0.34, 0.33)
_INNER_LIP: Colour = (0.64, 0.27, 0.27)
_CHEEK: Colour = (0.66, 0.29, 0.28)
_THROAT: Colour = (0.14, 0.04, 0.04)
_NOSTRIL: Colour = (0.27, 0.12, 0.10)


def find_skin_regions(skin: Skin) -> dict[str, IndexArray]:
    """Find named vertex sets that cover the skin; left and right are the speaker's.

    Parameters
    ----------
    skin
        The skin of the built-in head.

    Returns
    -------
    dict
        Region → vertex indices.
    """
    left = skin.vertices[:, 0] >= 0
    regions = _find_mouth_regions(skin)
    for name, mask in _find_outer_regions(skin).items():
        if name in SIDED:
            stem, _, rest = name.partition("_")
            for side, on_side in (("left", left), ("right", ~left)):
                sided = f"{stem}_{side}" + (f"_{rest}" if rest else "")
                regions[sided] = np.flatnonzero(mask & on_side)
        else:
            regions[name] = np.flatnonzero(mask)
    azimuths, levels = np.nan_to_num(skin.azimuths), np.nan_to_num(skin.levels)
    hidden = np.isfinite(skin.azimuths) & hair.is_under_hair(azimuths, levels)
    regions["under_hair"] = np.flatnonzero(hidden)
    return regions


def _add_mirrored(skin: Skin, half: IndexArray) -> IndexArray:
    """Add the mirror images of vertices of the left half."""
    return np.unique(np.concatenate([half, skin.mirror[half]]))


def _find_mouth_regions(skin: Skin) -> dict[str, IndexArray]:
    """Find the lips, the bag behind them and the two contours; corners are upper and lower."""
    groups: dict[str, list[IndexArray]] = {}
    *rings, deepest = skin.mouth
    kinds = [str(skin.kinds[ring[0]]) for ring in rings]
    for number, (kind, ring) in enumerate(zip(kinds, rings, strict=True)):
        stem = {"bag": "mouth_bag_{}", "skin": "{}_lip_skin"}.get(kind, "{}_lip")
        groups.setdefault(stem.format("lower"), []).append(ring[: mouth.CORNER + 1])
        groups.setdefault(stem.format("upper"), []).append(ring[mouth.CORNER :])
        # The fold behind the lips follows what is around it.
        if kinds[number : number + 2] == ["bag", "bag"]:
            groups.setdefault("mouth_floor", []).append(ring[: mouth.CORNER - _BAG_SIDE])
            groups.setdefault("mouth_roof", []).append(ring[mouth.CORNER + _BAG_SIDE + 1 :])
        if kind in ("inner_lip", "contact"):
            groups.setdefault("wet_lip", []).append(ring)
        if kind == "contact":
            groups["wet_lip"] += rings[number + 1 : number + 3]
            groups["inner_lip_contour"] = [ring]
        if kind == "border":
            groups["outer_lip_contour"] = [ring]
    for name in ("mouth_bag_upper", "mouth_bag_lower"):
        groups[name].append(deepest)
    return {name: _add_mirrored(skin, np.concatenate(rings)) for name, rings in groups.items()}


def _find_outer_regions(skin: Skin) -> dict[str, Mask]:
    """Find the skin outside the mouth, each vertex in one region, sides together."""
    x, y, z = np.abs(skin.vertices[:, 0]), skin.vertices[:, 1], skin.vertices[:, 2]
    azimuth = np.abs(skin.azimuths)
    brow_path = [tuple(point) for point in brows.trace_brow(np.linspace(0, 1, 12)).tolist()]
    jaw_height = np.interp(x, *np.transpose(_JAW_LINE))
    jaw_edge = skull.get_section_level(4)
    nose_width = np.interp(y, [15, 22, 30, 45, 66, 82], [10, 15, 17, 16, 11, 10])
    in_front = z > 60
    # The first that holds counts.
    rules: dict[str, Mask] = {
        "ear": skin.kinds == "ear",
        "eyelids": skin.kinds == "eyelid",
        "nose": (skin.kinds == "nostril") | (in_front & (y > 19) & (y < 76) & (x < nose_width)),
        "brow_skin": in_front & (measure_path_distance(x, y, brow_path)[0] < 6.5),
        "neck": (skin.levels < jaw_edge - 9) | ((skin.levels < jaw_edge + 25) & (azimuth > 2.0)),
        "forehead": (y > 74) & (azimuth < 1.15) & (y < 124 - 20 * azimuth**2),
        "scalp": (y > 70) | (azimuth > 1.75),
        "upper_lip_skin": (y > 0) & (y < 22) & (x < 29) & in_front,
        "lower_lip_skin": (y <= 0) & (y > -21) & (x < 27) & in_front,
        "chin": (y <= -21) & (x < 21),
        "jaw": y < jaw_height,
        "cheek": np.ones(len(x), dtype=bool),
    }
    taken = np.isin(skin.kinds, ["bag", "inner_lip", "contact", "vermilion", "border"])
    regions = {}
    for name, rule in rules.items():
        regions[name] = rule & ~taken
        taken = taken | rule
    return regions


def paint_skin(skin: Skin) -> FloatArray:
    """Choose the colours of the skin.

    Parameters
    ----------
    skin
        The skin of the built-in head.

    Returns
    -------
    ndarray
        Red, green and blue, ``(vertices, 3)``, 0 to 1.
    """
    x, y, z = np.abs(skin.vertices[:, 0]), skin.vertices[:, 1], skin.vertices[:, 2]
    front = (z > 20).astype(np.float64)
    colours = np.tile(np.array(_SKIN), (len(x), 1))

    def blend_colour(share: FloatArray, colour: Colour) -> None:
        colours[:] += np.clip(share, 0, 1)[:, None] * (np.array(colour) - colours)

    for share, centre, widths, colour in _TINTS:
        blend_colour(share * compute_bump(x, y, centre, widths) * front, colour)
    blend_colour(_BEARD * _compute_beard(x, y) * front, (0.66, 0.575, 0.53))
    blend_colour(0.35 * (skin.kinds == "ear"), (0.88, 0.54, 0.47))
    for ring, dark in zip(skin.ear[-6:], np.linspace(0.08, 0.55, 6), strict=True):
        colours[_add_mirrored(skin, ring)] *= 1 - dark
    brow_path = [tuple(point) for point in brows.trace_brow(np.linspace(0, 1, 12)).tolist()]
    near_brow = compute_hill(measure_path_distance(x, y, brow_path)[0], 0.0, 2.0) * front
    blend_colour(0.5 * near_brow, brows.BROW)
    blend_colour(_compute_hair(skin), hair.HAIR)
    colours *= 1 + 0.022 * _compute_mottle(skin.vertices)[:, None] * [0.6, 1.0, 1.0]
    by_kind = {
        "inner_lip": _INNER_LIP,
        "contact": _INNER_LIP,
        "vermilion": _LIP,
        "border": tuple(0.25 * np.array(_LIP) + 0.75 * np.array(_SKIN)),
    }
    for kind, colour in by_kind.items():
        colours[skin.kinds == kind] = colour
    _colour_lips(skin, colours)
    _colour_bag(skin, colours)
    colours[_add_mirrored(skin, skin.nostril[0])] *= 0.75
    for depth, ring in enumerate(skin.nostril[1:]):
        colours[_add_mirrored(skin, ring)] = np.array(_NOSTRIL) * (0.8, 0.45, 0.25)[depth]
    _colour_lids(skin, colours)
    return np.asarray(np.clip(colours, 0, 1))


def _colour_lips(skin: Skin, colours: FloatArray) -> None:
    """Colour the red of the lips: dry outside, wetter and darker towards where they meet."""
    red = [ring for ring in skin.mouth if skin.kinds[ring[0]] == "vermilion"]
    for ring, wet in zip(red, (1.0, 0.45, 0.12, 0.0), strict=True):
        shade = np.array(_LIP) * (1 - wet) + np.array(_WET_LIP) * wet
        colours[_add_mirrored(skin, ring)] = shade


def _compute_beard(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return where a shaven beard would show, 0 to 1."""
    moustache = compute_bump(x, y, (9, 14), (12, 4.5))
    chin = compute_bump(x, y, (0, -34), (26, 13))
    jaw = compute_bump(x, y, (52, -8), (14, 20))
    return np.asarray(np.clip(moustache + chin + jaw, 0, 1))


def _compute_mottle(vertices: FloatArray) -> FloatArray:
    """Return the unevenness of skin, about -1 to 1: a few waves of 10 to 30 mm that cross."""
    waves = np.array(
        [[0.21, 0.13, 0.09], [-0.17, 0.27, 0.11], [0.33, -0.29, 0.2], [0.45, 0.38, -0.31]]
    )
    folded = np.abs(vertices * [1, 0, 0]) + vertices * [0, 1, 1]
    return np.asarray(np.sin(folded @ waves.T + [0.4, 1.9, 3.1, 4.6]).mean(axis=1) * 2)


def _colour_bag(skin: Skin, colours: FloatArray) -> None:
    """Colour the mouth's bag: cheeks in front, darker towards the throat."""
    bag = np.flatnonzero(skin.kinds == "bag")
    z = skin.vertices[bag, 2]
    throat = smoothstep((z.min() + 36.0 - z) / 30.0)[:, None]
    cheek = np.array(_CHEEK) * mouth.compute_shade(z)
    colours[bag] = cheek * (1 - throat) + np.array(_THROAT) * throat


def _compute_hair(skin: Skin) -> FloatArray:
    """Return where hair would grow, 0 to 1: a close-cropped head."""
    depth = hair.measure_hair_depth(np.nan_to_num(skin.azimuths), np.nan_to_num(skin.levels))
    return np.where(np.isfinite(skin.azimuths), smoothstep((depth + 5) / 9), 0.0)


def _colour_lids(skin: Skin, colours: FloatArray) -> None:
    for depth, ring in enumerate(skin.eye[:4]):
        upper = np.arange(len(ring)) <= len(ring) // 2
        dark, pink = np.array([0.29, 0.19, 0.16]), np.array([0.81, 0.58, 0.51])
        if depth < 3:
            shade = np.where(upper[:, None], dark, pink)
            colours[ring] = shade
            colours[skin.mirror[ring]] = shade
        else:
            lid = ring[1 : len(ring) // 2]
            colours[lid] = colours[skin.mirror[lid]] = [0.69, 0.49, 0.41]
