"""The built-in head, put together."""

from __future__ import annotations

from mocap_fit.face.builtin import brows, eyes, landmarks
from mocap_fit.face.builtin import teeth_and_tongue as inside_mouth
from mocap_fit.face.builtin.regions import skin_colours, skin_regions
from mocap_fit.face.builtin.skin import build_skin
from mocap_fit.face.builtin.surfaces import Piece, joined
from mocap_fit.face.mesh import Material, Mesh, Part

MATERIALS = {
    "skin": Material((0.93, 0.76, 0.665), specular=0.12, specular_power=12),
    "teeth": Material((0.93, 0.91, 0.85), specular=0.4, specular_power=40),
    "gums": Material((0.72, 0.38, 0.38), specular=0.25, specular_power=25),
    "tongue": Material((0.74, 0.38, 0.38), specular=0.2, specular_power=20),
    "eye": Material((0.93, 0.92, 0.90), specular=0.8, specular_power=90),
    "brow": Material((0.25, 0.17, 0.12), specular=0.0, specular_power=1),
    "lashes": Material((0.10, 0.07, 0.06), specular=0.0, specular_power=1),
}


def build_head() -> Mesh:
    """Make the built-in head, without the cache."""
    skin = build_skin()
    brow, eye, lashes = brows.brow(), eyes.eyeball(), eyes.lashes()
    pieces = {
        "skin": Piece(skin.vertices, skin.triangles, skin_colours(skin)),
        "teeth_upper": inside_mouth.teeth(upper=True),
        "teeth_lower": inside_mouth.teeth(upper=False),
        "gums_upper": inside_mouth.gums(upper=True),
        "gums_lower": inside_mouth.gums(upper=False),
        "tongue": inside_mouth.tongue(),
        "eye_left": eye,
        "eye_right": eye.mirrored(),
        "brow_left": brow,
        "brow_right": brow.mirrored(),
        "lashes_left": lashes,
        "lashes_right": lashes.mirrored(),
    }
    whole = joined(list(pieces.values()))
    parts = _parts(pieces)
    points = landmarks.feature_points(skin)
    start = {part.name: part.vertices.start for part in parts}
    on_parts = {
        "tongue": landmarks.tongue_points(pieces["tongue"]),
        "teeth_upper": landmarks.teeth_points(pieces["teeth_upper"], upper=True),
        "teeth_lower": landmarks.teeth_points(pieces["teeth_lower"], upper=False),
        "eye_left": {"3.5": landmarks.pupil_point(pieces["eye_left"])},
        "eye_right": {"3.6": landmarks.pupil_point(pieces["eye_right"])},
    }
    for name, found in on_parts.items():
        points.update({number: start[name] + vertex for number, vertex in found.items()})
    ordered = sorted(points, key=lambda number: [int(digits) for digits in number.split(".")])
    return Mesh(
        whole.vertices,
        whole.triangles,
        parts,
        skin_regions(skin),
        {number: points[number] for number in ordered},
        whole.colours,
    )


def _parts(pieces: dict[str, Piece]) -> tuple[Part, ...]:
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
