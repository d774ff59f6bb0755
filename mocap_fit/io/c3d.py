"""C3D files: points of every processor, as integers or floats, with their units and events.

Real files break the rules of the format in many ways; what is read here, and what is made of it:

Layout (`mocap_fit.io.c3d_parameters`, `mocap_fit.io.c3d_layout`). Parameters and data are where the
header says, or else POINT:DATA_START, or else the noted number of blocks. What header and
parameters say differently is decided by the length of the file, with a warning. The analog data are
passed over, so that it does not matter whether their scales, offsets and rates make sense. A file
that is cut off is read as far as it goes, with a warning. Damaged parameters are a warning where
labels and unit are there, else an error.

Names follow the rules of `mocap_fit.io.names`. Points that `POINT` lists as angles, forces,
moments, powers or scalars are not positions and are left out.

Gaps and origin. A negative residual is a gap. By the C3D convention a residual of 0 and no camera
mean a point that was not measured; it becomes `Origin.FILLED`. But Qualisys writes 0 for all
points, so this applies only to a file that has some residual or camera.

Numbers. Integers are multiplied by POINT:SCALE, or without it by the scale of the header. A unit
that was cut (``mete``) is completed; without one, millimetres are taken. The rate is POINT:RATE, or
without it that of the header; where they differ a warning names both.

Time. `start_time` is the number of the first frame (from 0) over the rate, so that the times of the
events, which count from the start of the measurement, fit a recording that was trimmed. The header
has 16 bits for that number; TRIAL:ACTUAL_START_FIELD has more.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence

from mocap_fit.errors import FileFormatError, MocapFitWarning, from_os_error
from mocap_fit.io import finalise
from mocap_fit.io.c3d_events import read_events
from mocap_fit.io.c3d_layout import determine_layout
from mocap_fit.io.c3d_points import read_points
from mocap_fit.io.c3d_structure import Structure, is_c3d, read_structure
from mocap_fit.io.names import name_tracks
from mocap_fit.io.text import check_file, read_head
from mocap_fit.io.timing import check_rate, warn_of_rate
from mocap_fit.tracks import MarkerTracks

NAME = "c3d"
description = "C3D file"
extensions = (".c3d",)

_NOT_POSITIONS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS")


def sniff(path: str | os.PathLike[str]) -> bool:
    """Return whether a file starts as a C3D file does.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        Whether it looks like a C3D file.
    """
    return is_c3d(read_head(path, 512))


def read(
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
) -> MarkerTracks:
    """Read the points of a C3D file as markers.

    Parameters
    ----------
    path
        File to read.
    names
        Names of the markers, in the order of the file; they replace those of the file.
    rate
        Frame rate, hertz; it replaces that of the file.
    unit
        Unit of length of the file, such as ``m``; it replaces that of the file.
    subject
        Subject whose tracks alone are read, where the names have subjects.

    Returns
    -------
    MarkerTracks
        Positions in millimetres, in the axes of the file.

    Raises
    ------
    FileFormatError
        If the file is damaged, is not a C3D file, or has no markers.

    Warns
    -----
    MocapFitWarning
        If the file contradicts itself, is cut off or damaged, does not say its unit, or some points
        are not positions.
    """
    file = check_file(path)
    try:
        structure = read_structure(file)
        layout = determine_layout(structure)
        labels = structure.get_texts("POINT", "LABELS")[: layout.frame.points]
        _check_damage(structure, has_labels=bool(labels or names), has_unit=unit is not None)
        labels += [""] * (layout.frame.points - len(labels))
        selected = _select_positions(structure, labels)
        used = name_tracks([labels[index] for index in selected], names, path=file, subject=subject)
        used_rate = check_rate(_read_rate(structure) if rate is None else rate, path=file)
        warn_of_rate(file, rate, structure.get_value("POINT", "RATE"))
        unit = unit or _read_unit(structure)
        factor = finalise.get_millimetres(unit, path=file)
        positions, origin = read_points(structure, layout, factor, selected)
    except OSError as error:
        raise from_os_error(error, file) from None
    return finalise.create_tracks(
        MarkerTracks,
        file,
        NAME,
        used,
        used_rate,
        {"positions": positions, "origin": origin},
        start_time=layout.first / used_rate,
        events=read_events(structure),
        arguments=finalise.list_arguments(used, rate, unit),
    )


def _check_damage(structure: Structure, *, has_labels: bool, has_unit: bool) -> None:
    """Refuse parameters of which something that is needed may be lost, and warn of others."""
    if structure.damage is None:
        return
    if not (has_labels and (has_unit or structure.get_texts("POINT", "UNITS"))):
        structure.refuse("the chain of parameters is broken", structure.damage)
    _warn(structure, f"the chain of parameters is broken ({structure.damage}); some may be lost")


def _select_positions(structure: Structure, labels: list[str]) -> list[int]:
    """Return the indices of the points that are positions."""
    others = {label for name in _NOT_POSITIONS for label in structure.get_texts("POINT", name)}
    # A label may have a subject that the list does not have.
    is_other = [
        bool(label) and (label in others or label.partition(":")[2] in others) for label in labels
    ]
    left_out = [label for label, other in zip(labels, is_other, strict=True) if other]
    if len(left_out) == len(labels):
        raise FileFormatError(
            "the file holds no positions of markers",
            path=structure.path,
            found=f"{len(labels)} angles, forces, moments, powers or scalars",
            advice="Export a recording with markers.",
        )
    if left_out:
        _warn(
            structure,
            "left out, because the file lists them as angles, forces, moments, powers or scalars: "
            f"{', '.join(left_out[:5])}{', …' if len(left_out) > 5 else ''}",
        )
    return [index for index, other in enumerate(is_other) if not other]


def _read_rate(structure: Structure) -> float:
    """Return the frame rate, hertz."""
    noted, header = structure.get_value("POINT", "RATE"), structure.get_float(11)
    if not noted > 0:
        return header if header > 0 or noted != noted else noted
    if header > 0 and abs(noted - header) > 1e-4 * noted:
        text = f"its header says {header:g} Hz and POINT:RATE {noted:g} Hz, which is taken"
        _warn(structure, f"{text}; give the rate if it is wrong")
    return noted


def _read_unit(structure: Structure) -> str:
    units = [unit for unit in structure.get_texts("POINT", "UNITS") if unit]
    if units:
        return units[0]
    _warn(structure, "the file does not say its unit of length; millimetres are taken")
    return "mm"


def _warn(structure: Structure, text: str) -> None:
    warnings.warn(f"{structure.path}: {text}", MocapFitWarning, stacklevel=4)
