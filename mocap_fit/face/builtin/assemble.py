"""The built-in head, put together."""

from __future__ import annotations

from mocap_fit.face.builtin import brows, eyes, hair, landmarks, shirt, teeth
from mocap_fit.face.builtin.gums import build_gums
from mocap_fit.face.builtin.regions import find_skin_regions, paint_skin
from mocap_fit.face.builtin.skin import build_skin
from mocap_fit.face.builtin.surfaces import Piece, join_pieces
from mocap_fit.face.builtin.tongue import build_tongue
from mocap_fit.face.mesh import Material, Mesh, Part

MATERIALS = {
    "skin": Material((0.93, 0.76, 0.665), specular=0.12, specular_power=12),
    "teeth": Material((0.93, 0.91, 0.85), specular=0.4, specular_power=40),
    "gums": Material((0.72, 0.38, 0.38), specular=0.25, specular_power=25),
    "tongue": Material((0.74, 0.38, 0.38), specular=0.2, specular_power=20),
    "eye": Material((0.84, 0.815, 0.79), specular=1.0, specular_power=240),
    "brow": Material(brows.BROW, specular=0.0, specular_power=1),
    "lashes": Material((0.10, 0.07, 0.055), specular=0.0, specular_power=1),
    "hair": Material(hair.HAIR, specular=0.16, specular_power=18),
    "shirt": Material(shirt.SHIRT, specular=0.0, specular_power=1),
}


def build_head() -> Mesh:
    """Build the built-in head, without the cache.

    Returns
    -------
    Mesh
        The head, millimetres in the head frame.
    """
    skin = build_skin()
    brow, eye, lashes = brows.build_brow(), eyes.build_eyeball(), eyes.build_lashes()
    pieces = {
        "skin": Piece(skin.vertices, skin.triangles, paint_skin(skin)),
        "teeth_upper": teeth.build_teeth(upper=True),
        "teeth_lower": teeth.build_teeth(upper=False),
        "gums_upper": build_gums(upper=True),
        "gums_lower": build_gums(upper=False),
        "tongue": build_tongue(),
        "eye_left": eye,
        "eye_right": eye.mirror(),
        "brow_left": brow,
        "brow_right": brow.mirror(),
        "lashes_left": lashes,
        "lashes_right": lashes.mirror(),
        "hair": hair.build_hair(),
        "shirt": shirt.build_shirt(),
    }
    head = join_pieces(list(pieces.values()))
    parts = _make_parts(pieces)
    points = landmarks.find_feature_points(skin)
    start = {part.name: part.vertices.start for part in parts}
    on_parts = {
        "tongue": landmarks.find_tongue_points(pieces["tongue"]),
        "teeth_upper": landmarks.find_teeth_points(pieces["teeth_upper"], upper=True),
        "teeth_lower": landmarks.find_teeth_points(pieces["teeth_lower"], upper=False),
        "eye_left": {"3.5": landmarks.find_pupil(pieces["eye_left"])},
        "eye_right": {"3.6": landmarks.find_pupil(pieces["eye_right"])},
    }
    for name, local_points in on_parts.items():
        points.update({number: start[name] + vertex for number, vertex in local_points.items()})
    ordered = sorted(points, key=lambda number: [int(digits) for digits in number.split(".")])
    return Mesh(
        head.vertices,
        head.triangles,
        parts,
        find_skin_regions(skin),
        {number: points[number] for number in ordered},
        head.colours,
    )


def _make_parts(pieces: dict[str, Piece]) -> tuple[Part, ...]:
    parts = []
    vertex = triangle = 0
    for name, piece in pieces.items():
        next_vertex, next_triangle = vertex + len(piece.vertices), triangle + len(piece.triangles)
        parts.append(
            Part(
                name,
                range(vertex, next_vertex),
                range(triangle, next_triangle),
                MATERIALS[name.partition("_")[0]],
            )
        )
        vertex, triangle = next_vertex, next_triangle
    return tuple(parts)
