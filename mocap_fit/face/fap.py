"""MPEG-4 facial animation parameters (FAP): the table, and the units they are measured in.

ISO/IEC 14496-2, Annex C: how far a feature point is from rest along an axis, in 1024ths of a
distance of the same face at rest, its facial animation parameter unit (FAPU).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mocap_fit.errors import ConfigurationError
from mocap_fit.face.mesh import Mesh

FAP_COUNT = 68
# Unit → the feature points that it lies between, and the axis along which it is measured.
FAP_UNITS: dict[str, tuple[str, str, int]] = {
    "IRISD": ("3.1", "3.3", 1),
    "ES": ("3.5", "3.6", 0),
    "ENS": ("3.5", "9.15", 1),
    "MNS": ("9.15", "2.2", 1),
    "MW": ("8.3", "8.4", 0),
}
_RIGHT, _LEFT, _DOWN, _UP, _FORWARD = (-1, 0), (1, 0), (-1, 1), (1, 1), (1, 2)


@dataclass(frozen=True)
class Fap:
    """One facial animation parameter of MPEG-4.

    Parameters
    ----------
    number
        Number in the standard, 1 to 68.
    name
        Name in the standard.
    point
        The feature point that it moves.
    direction
        Sign and axis (0 to 2) in which it is positive.
    unit
        The unit it is measured in 1024ths of: ``MNS``, mouth-nose separation, or ``MW``, mouth
        width.
    """

    number: int
    name: str
    point: str
    direction: tuple[int, int]
    unit: str = "MNS"


# Those of the jaw and the lips: the rig moves nothing else.
FAPS: tuple[Fap, ...] = (
    Fap(3, "open_jaw", "2.1", _DOWN),
    Fap(4, "lower_t_midlip", "2.2", _DOWN),
    Fap(5, "raise_b_midlip", "2.3", _UP),
    Fap(6, "stretch_l_cornerlip", "2.4", _LEFT, "MW"),
    Fap(7, "stretch_r_cornerlip", "2.5", _RIGHT, "MW"),
    Fap(8, "lower_t_lip_lm", "2.6", _DOWN),
    Fap(9, "lower_t_lip_rm", "2.7", _DOWN),
    Fap(10, "raise_b_lip_lm", "2.8", _UP),
    Fap(11, "raise_b_lip_rm", "2.9", _UP),
    Fap(12, "raise_l_cornerlip", "2.4", _UP),
    Fap(13, "raise_r_cornerlip", "2.5", _UP),
    Fap(14, "thrust_jaw", "2.1", _FORWARD),
    Fap(15, "shift_jaw", "2.1", _RIGHT, "MW"),
    Fap(16, "push_b_lip", "2.3", _FORWARD),
    Fap(17, "push_t_lip", "2.2", _FORWARD),
    Fap(18, "depress_chin", "2.10", _UP),
    Fap(51, "lower_t_midlip_o", "8.1", _DOWN),
    Fap(52, "raise_b_midlip_o", "8.2", _UP),
    Fap(53, "stretch_l_cornerlip_o", "8.3", _LEFT, "MW"),
    Fap(54, "stretch_r_cornerlip_o", "8.4", _RIGHT, "MW"),
    Fap(55, "lower_t_lip_lm_o", "8.5", _DOWN),
    Fap(56, "lower_t_lip_rm_o", "8.6", _DOWN),
    Fap(57, "raise_b_lip_lm_o", "8.7", _UP),
    Fap(58, "raise_b_lip_rm_o", "8.8", _UP),
    Fap(59, "raise_l_cornerlip_o", "8.3", _UP),
    Fap(60, "raise_r_cornerlip_o", "8.4", _UP),
)


def measure_fap_units(mesh: Mesh, units: Sequence[str] = tuple(FAP_UNITS)) -> dict[str, float]:
    """Measure facial animation parameter units on a face at rest.

    Parameters
    ----------
    mesh
        The face, with the feature points that the units lie between.
    units
        Names of the units: ``IRISD``, the opening of the eye (3.1 to 3.3); ``ES``, eye
        separation (3.5 to 3.6); ``ENS``, eye-nose separation (3.5 to 9.15); ``MNS``, mouth-nose
        separation (9.15 to 2.2); ``MW``, mouth width (8.3 to 8.4).

    Returns
    -------
    dict
        Name → millimetres.

    Raises
    ------
    ConfigurationError
        If the mesh lacks one of the feature points.
    """
    needed = dict.fromkeys(point for unit in units for point in FAP_UNITS[unit][:2])
    missing = [name for name in needed if name not in mesh.feature_points]
    if missing:
        raise ConfigurationError(
            "facial animation parameters are measured in distances of the face, and it lacks "
            "feature points for them",
            found=f"no {', '.join(missing)}",
            expected=", ".join(needed),
            advice="Name them in the rig file.",
        )
    lengths = {}
    for unit in units:
        first, second, axis = FAP_UNITS[unit]
        ends = [mesh.vertices[mesh.get_feature_point(name), axis] for name in (first, second)]
        lengths[unit] = float(ends[0] - ends[1])
    return lengths
