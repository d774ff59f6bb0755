"""The face: meshes, rigs, and the built-in head."""

from mocap_fit.face.lips import lip_gap
from mocap_fit.face.load import load_face
from mocap_fit.face.mesh import Material, Mesh, Part
from mocap_fit.face.rig import RIGS, CompiledRig, Rig, parameters_from

__all__ = [
    "RIGS",
    "CompiledRig",
    "Material",
    "Mesh",
    "Part",
    "Rig",
    "lip_gap",
    "load_face",
    "parameters_from",
]
