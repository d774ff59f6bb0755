"""The face: meshes, rigs, and the built-in head."""

from mocap_fit.face.lips import compute_lip_gap
from mocap_fit.face.load import load_face
from mocap_fit.face.mesh import Material, Mesh, Part
from mocap_fit.face.rig import RIGS, CompiledRig, Rig, to_parameters

__all__ = [
    "RIGS",
    "CompiledRig",
    "Material",
    "Mesh",
    "Part",
    "Rig",
    "compute_lip_gap",
    "load_face",
    "to_parameters",
]
