"""glTF: the head with its movement, for Blender, game engines and web pages.

One file (``.glb``, or ``.gltf`` with its data inside): the mesh in metres, a colour at every
vertex, morph targets with the names of the parameters, and one animation of their weights.
"""

from __future__ import annotations

import base64
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import FileFormatError, MissingExtraError
from mocap_fit.face.mesh import Mesh, Part
from mocap_fit.face.rig import Rig
from mocap_fit.phones import PhoneSequence
from mocap_fit.render.shapes import BlendShapes, compute_blend_shapes
from mocap_fit.tracks import ParameterTracks

_METRES = 0.001
_FLOAT, _UNSIGNED, _BYTE = 5126, 5125, 5121
_VERTICES, _INDICES = 34962, 34963


def write_gltf(
    tracks: ParameterTracks,
    path: str | os.PathLike[str],
    rig: Rig,
    *,
    rate: float | None = None,
    phones: PhoneSequence | None = None,
) -> BlendShapes:
    """Write a talking head as glTF, in one file.

    Parameters
    ----------
    tracks
        Face parameters over time.
    path
        The file, with a name in ``.glb`` (binary) or ``.gltf`` (JSON, a third larger); an
        existing one is replaced.
    rig
        The face.
    rate
        Frame rate of the animation, hertz; that of the tracks if None.
    phones
        The phones of the utterance, by which a tongue moves that is not in the tracks.

    Returns
    -------
    BlendShapes
        The shapes that were written, and how near they are to the rig.

    Raises
    ------
    MissingExtraError
        If the extra ``mesh`` is not installed.
    FileFormatError
        If the name ends otherwise, or the file cannot be written.
    DataError
        If the tracks have a parameter that the face lacks, or no frame.
    """
    try:
        import pygltflib
    except ImportError:
        raise MissingExtraError(
            "glTF needs the extra 'mesh', which is not installed",
            advice='pip install "mocap-fit[mesh]"',
        ) from None
    target = Path(path)
    ending = target.suffix.lower()
    if ending not in (".glb", ".gltf"):
        raise FileFormatError(
            "glTF is written as one file", path=path, expected="a name in .glb or .gltf"
        )
    blended = compute_blend_shapes(tracks, rig, rate, phones)
    document = _Document(pygltflib, rig.mesh, blended)
    content = document.assemble(tracks.name or "talk")
    if ending == ".gltf":
        content = _convert_to_text(content)
    with write_atomically(path) as partial:
        partial.write_bytes(content)
    return blended


def _convert_to_text(binary: bytes) -> bytes:
    """Return binary glTF as JSON that holds its buffer."""
    length = int.from_bytes(binary[12:16], "little")
    content = json.loads(binary[20 : 20 + length])
    data = base64.b64encode(binary[28 + length :]).decode()
    content["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{data}"
    return json.dumps(content).encode()


class _Document:
    """A file that is being assembled."""

    def __init__(self, library: Any, mesh: Mesh, blended: BlendShapes) -> None:
        self._lib = library
        self._mesh, self._blended = mesh, blended
        self._file = library.GLTF2(asset=library.Asset(version="2.0", generator="mocap-fit"))
        self._bytes = bytearray()

    def assemble(self, name: str) -> bytes:
        """Return the content of the file."""
        lib, file, blended = self._lib, self._file, self._blended
        rest = self._mesh.compute_normals()
        moved = [
            self._mesh.compute_normals(self._mesh.vertices + shape) - rest
            for shape in blended.shapes
        ]
        primitives = [self._add_primitive(part, rest, moved) for part in self._mesh.parts]
        file.meshes.append(
            lib.Mesh(
                name="head",
                primitives=primitives,
                weights=[0.0] * len(blended.names),
                extras={"targetNames": list(blended.names)},
            )
        )
        file.nodes.append(lib.Node(name="head", mesh=0))
        file.scenes.append(lib.Scene(nodes=[0]))
        file.scene = 0
        times = (blended.times - blended.times[0]).astype(np.float32)
        at = self._add_accessor(times, "SCALAR", limits=True)
        weights = self._add_accessor(blended.weights.astype(np.float32).ravel(), "SCALAR")
        file.animations.append(
            lib.Animation(
                name=name,
                samplers=[lib.AnimationSampler(input=at, output=weights, interpolation="LINEAR")],
                channels=[
                    lib.AnimationChannel(
                        sampler=0, target=lib.AnimationChannelTarget(node=0, path="weights")
                    )
                ],
            )
        )
        file.buffers.append(lib.Buffer(byteLength=len(self._bytes)))
        file.set_binary_blob(bytes(self._bytes))
        return b"".join(file.save_to_bytes())

    def _add_primitive(self, part: Part, rest: Any, moved: list[Any]) -> Any:
        lib = self._lib
        members = slice(part.vertices.start, part.vertices.stop)
        triangles = self._mesh.triangles[part.triangles.start : part.triangles.stop]
        attributes = lib.Attributes(
            POSITION=self._add_vectors(self._mesh.vertices[members] * _METRES),
            NORMAL=self._add_vectors(rest[members]),
        )
        coloured = self._mesh.colours is not None
        if self._mesh.colours is not None:
            # Colours here are encoded for screens (gamma 2.2); those of glTF are linear.
            linear = np.clip(self._mesh.colours[members], 0, 1) ** 2.2
            four = np.concatenate([linear, np.ones((len(linear), 1))], axis=1)
            attributes.COLOR_0 = self._add_accessor(
                np.rint(255 * four).astype(np.uint8), "VEC4", normalized=True
            )
        targets = [
            lib.Attributes(
                POSITION=self._add_vectors(shape[members] * _METRES),
                NORMAL=self._add_vectors(normals[members]),
            )
            for shape, normals in zip(self._blended.shapes, moved, strict=True)
        ]
        return lib.Primitive(
            attributes=attributes,
            indices=self._add_accessor(
                (triangles - part.vertices.start).astype(np.uint32).ravel(), "SCALAR", _INDICES
            ),
            material=self._add_material(part, coloured),
            targets=[json.loads(target.to_json()) for target in targets],
        )

    def _add_material(self, part: Part, coloured: bool) -> int:
        lib = self._lib
        colour = [1.0] * 3 if coloured else [c**2.2 for c in part.material.colour]
        self._file.materials.append(
            lib.Material(
                name=part.name,
                # Lashes are seen from both sides.
                doubleSided=part.name.startswith("lashes"),
                pbrMetallicRoughness=lib.PbrMetallicRoughness(
                    baseColorFactor=[*colour, 1.0],
                    metallicFactor=0.0,
                    roughnessFactor=round(1.0 - 0.75 * min(part.material.specular, 1.0), 3),
                ),
            )
        )
        return len(self._file.materials) - 1

    def _add_vectors(self, values: Any) -> int:
        return self._add_accessor(values.astype(np.float32), "VEC3", limits=True)

    def _add_accessor(
        self,
        values: Any,
        kind: str,
        target: int | None = None,
        *,
        limits: bool = False,
        normalized: bool = False,
    ) -> int:
        """Append an array to the file and return its number."""
        lib = self._lib
        if target is None and kind != "SCALAR":
            target = _VERTICES
        content = np.ascontiguousarray(values)
        start = len(self._bytes)
        self._bytes += content.tobytes()
        self._bytes += bytes(-len(self._bytes) % 4)
        view = lib.BufferView(buffer=0, byteOffset=start, byteLength=content.nbytes, target=target)
        self._file.bufferViews.append(view)
        component = {"f": _FLOAT, "u": _UNSIGNED}[content.dtype.kind]
        rows = content.reshape(len(content), -1)
        self._file.accessors.append(
            lib.Accessor(
                bufferView=len(self._file.bufferViews) - 1,
                componentType=_BYTE if content.dtype == np.uint8 else component,
                normalized=normalized,
                count=len(content),
                type=kind,
                min=rows.min(axis=0).tolist() if limits else None,
                max=rows.max(axis=0).tolist() if limits else None,
            )
        )
        return len(self._file.accessors) - 1
