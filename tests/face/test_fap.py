"""The table of facial animation parameters and their units, against the standard's."""

import numpy as np
import pytest

from mocap_fit.errors import ConfigurationError
from mocap_fit.face import Mesh
from mocap_fit.face.builtin import load_built_in_head
from mocap_fit.face.fap import FAP_COUNT, FAPS, measure_fap_units

# ISO/IEC 14496-2:2001, Table C.1: number, name, unit, positive motion, feature point.
STANDARD = """
3 open_jaw MNS down 2.1
4 lower_t_midlip MNS down 2.2
5 raise_b_midlip MNS up 2.3
6 stretch_l_cornerlip MW left 2.4
7 stretch_r_cornerlip MW right 2.5
8 lower_t_lip_lm MNS down 2.6
9 lower_t_lip_rm MNS down 2.7
10 raise_b_lip_lm MNS up 2.8
11 raise_b_lip_rm MNS up 2.9
12 raise_l_cornerlip MNS up 2.4
13 raise_r_cornerlip MNS up 2.5
14 thrust_jaw MNS forward 2.1
15 shift_jaw MW right 2.1
16 push_b_lip MNS forward 2.3
17 push_t_lip MNS forward 2.2
18 depress_chin MNS up 2.10
51 lower_t_midlip_o MNS down 8.1
52 raise_b_midlip_o MNS up 8.2
53 stretch_l_cornerlip_o MW left 8.3
54 stretch_r_cornerlip_o MW right 8.4
55 lower_t_lip_lm_o MNS down 8.5
56 lower_t_lip_rm_o MNS down 8.6
57 raise_b_lip_lm_o MNS up 8.7
58 raise_b_lip_rm_o MNS up 8.8
59 raise_l_cornerlip_o MNS up 8.3
60 raise_r_cornerlip_o MNS up 8.4
"""
# The head frame's +x is the speaker's left, +y up, +z forward.
MOTIONS = {
    "left": (1, 0),
    "right": (-1, 0),
    "up": (1, 1),
    "down": (-1, 1),
    "forward": (1, 2),
}


def test_the_table_is_the_standards() -> None:
    rows = [line.split() for line in STANDARD.split("\n") if line]
    expected = [
        (int(number), name, point, MOTIONS[motion], unit)
        for number, name, unit, motion, point in rows
    ]
    assert [(f.number, f.name, f.point, f.direction, f.unit) for f in FAPS] == expected
    assert FAP_COUNT == 68


# Each of these points has coordinates of its own, so that a wrong point or axis shows.
POINTS = {
    "3.1": (31.0, 66.5, 84.0),
    "3.3": (30.0, 58.25, 83.0),
    "3.5": (32.5, 62.0, 86.0),
    "3.6": (-31.5, 61.0, 85.0),
    "9.15": (0.25, 20.0, 104.0),
    "2.2": (0.5, -0.5, 95.0),
    "2.3": (0.75, -1.5, 94.0),
    "8.3": (24.5, 1.25, 82.0),
    "8.4": (-25.25, 2.25, 81.0),
}


def face(*without: str) -> Mesh:
    names = [name for name in POINTS if name not in without]
    return Mesh(
        np.array([POINTS[name] for name in names]),
        np.array([[0, 1, 2]]),
        feature_points={name: i for i, name in enumerate(names)},
    )


def test_units_are_the_standards_distances() -> None:
    """Facial animation parameter units as Annex C defines them, without the division by 1024."""
    assert measure_fap_units(face()) == {
        "IRISD": 66.5 - 58.25,
        "ES": 32.5 + 31.5,
        "ENS": 62.0 - 20.0,
        "MNS": 20.0 + 0.5,
        "MW": 24.5 + 25.25,
    }


def test_only_the_points_of_the_units_asked_for_are_needed() -> None:
    bare = face("3.1", "3.5", "2.3")
    assert list(measure_fap_units(bare, ["MW", "MNS"])) == ["MW", "MNS"]
    with pytest.raises(ConfigurationError, match=r"found no 3\.5, expected 3\.5, 3\.6"):
        measure_fap_units(bare, ["ES"])


def test_the_built_in_head_has_a_human_faces_units() -> None:
    """Near an adult's: pupils 62 mm apart, mouth 50 mm wide, upper lip 20 mm high."""
    units = measure_fap_units(load_built_in_head())
    assert units["ES"] == pytest.approx(62, rel=0.05)
    assert units["MW"] == pytest.approx(50, rel=0.05)
    assert units["MNS"] == pytest.approx(20, rel=0.1)
