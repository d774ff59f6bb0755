"""Where the points of a C3D file are: header, parameters and the length of the file decide.

Header and parameters say most counts twice, and real files contradict themselves: POINT:USED or
the analog counts are wrong, a scale has the wrong sign, POINT:FRAMES counts padding. The number of
frames is that of the header, if the file is long enough, or else one that the parameters say and
the file confirms. For what a frame holds, the header comes
first too, but the data must fill the file to its last block; where they never do, what leaves the
least of it over is taken.

Frames beyond 65,535 do not fit the header's 16 bits. POINT:LONG_FRAMES, POINT:FRAMES or the TRIAL
group may say them; where none does, the length of the file says how many there are, without the
zeros at its end.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.io.c3d_structure import BLOCK, Structure
from mocap_fit.size_limit import check_size

_LONG = 65535
"""A last frame of this number means that the header's 16 bits did not suffice."""

_STEP = 2**16
"""Bytes that are searched at a time."""

_MEMORY = 25
"""Bytes of a point in memory: three coordinates and its origin."""


@dataclass(frozen=True)
class Frame:
    """What a frame holds: four numbers a point, then the analog samples.

    Parameters
    ----------
    points
        Number of points of all kinds.
    analog
        Number of analog samples.
    width
        Bytes of a number: 2 for integers, 4 for floats.
    """

    points: int
    analog: int
    width: int

    @property
    def size(self) -> int:
        """Size of a frame, bytes."""
        return self.width * (4 * self.points + self.analog)


@dataclass(frozen=True)
class Layout:
    """Location of the points in a file.

    Parameters
    ----------
    frames
        Number of frames.
    first
        Number of the first frame, from 0.
    frame
        What a frame holds.
    """

    frames: int
    first: int
    frame: Frame


def determine_layout(structure: Structure) -> Layout:
    """Determine where the points of a file are.

    Parameters
    ----------
    structure
        Header and parameters of the file.

    Returns
    -------
    Layout
        Location of the points.

    Raises
    ------
    FileFormatError
        If the file holds no points or no frames, or less than it says.

    Warns
    -----
    MocapFitWarning
        If the file contradicts itself, is cut off, or holds more frames than it says.
    """
    kinds = _list_frame_kinds(structure)
    counts = _list_frame_counts(structure)
    ends = [end - structure.data_start for end in structure.data_ends]
    # Where another section begins may be wrong too.
    available = next((end for end in ends if counts[0] * kinds[0].size <= end), ends[-1])
    frames, kind = _fit_frames(counts, kinds, available)
    left = available - frames * kind.size
    if frames == 0:
        frames = _count_remaining(structure, counts[0], kinds, available)
    else:
        if left > BLOCK and structure.get_word(5) == _LONG:
            kind = kinds[0]
            frames = _extend_count(structure, frames, kind, available)
        elif left > BLOCK and len(kinds) > 1:
            _warn(structure, "header and parameters contradict each other, and neither fills it")
        elif left >= kind.size:
            frames = _extend_count(structure, frames, kind, available)
        _warn_of_contradictions(structure, frames, kind.points)
    check_size(frames * kind.points * _MEMORY, path=structure.path)
    return Layout(frames, _find_first_frame(structure, frames), kind)


def _fit_frames(counts: list[int], kinds: list[Frame], available: int) -> tuple[int, Frame]:
    """Return the number of frames that fit a length, 0 where none does, and what a frame holds."""
    left = {kind: available - counts[0] * kind.size for kind in kinds}
    filling = [kind for kind in kinds if 0 <= left[kind] <= BLOCK]
    if left[kinds[0]] >= 0:
        fitting = [kind for kind in kinds if left[kind] >= 0]
        return counts[0], (filling or sorted(fitting, key=lambda kind: left[kind]))[0]
    count = next((count for count in counts if count * kinds[0].size <= available), 0)
    if filling and not (count and available - count * kinds[0].size <= BLOCK):
        return counts[0], filling[0]
    return count, kinds[0]


def _list_frame_kinds(structure: Structure) -> list[Frame]:
    """Return what a frame may hold, the most probable first."""
    points = [structure.get_word(2), structure.get_count("POINT", "USED") or 0]
    samples, per_frame = structure.get_word(3), structure.get_word(10)
    channels = structure.get_count("ANALOG", "USED")
    ratio = structure.get_value("ANALOG", "RATE") / (structure.get_value("POINT", "RATE") or 1)
    # Some programs write the number of channels for that of the samples.
    analog = [samples, (samples if channels is None else channels) * per_frame]
    if channels and 1 <= ratio <= _LONG:
        analog.append(channels * round(ratio))
    scales = (structure.get_float(7), structure.get_value("POINT", "SCALE"))
    # The sign of a scale says whether the numbers are floats.
    widths = [4 if scale < 0 else 2 for scale in scales if scale and not math.isnan(scale)]
    if not any(points):
        _refuse_without_points(structure, any(analog))
    if not widths:
        structure.refuse("neither the header nor POINT:SCALE says a scale", "0")
    kinds = [Frame(*each) for each in product(points, analog, widths) if each[0] > 0]
    return list(dict.fromkeys(kinds))


def _refuse_without_points(structure: Structure, has_analog: bool) -> None:
    contents = ["rotations"] * (structure.get_value("ROTATION", "USED") > 0)
    contents += ["analog data"] * has_analog
    raise FileFormatError(
        f"the file holds {' and '.join(contents)} only, no markers"
        if contents
        else "the file holds no markers",
        path=structure.path,
        advice="Export a recording with markers.",
    )


def _list_frame_counts(structure: Structure) -> list[int]:
    """Return how many frames there may be, the most probable first."""
    first, last = structure.get_word(4), structure.get_word(5)
    header, noted = _count_header_frames(structure), list(_get_noted_counts(structure).values())
    if last == _LONG:
        counts = sorted([header, *noted], reverse=True)
    else:
        # A count that did not suffice may have lost its upper bits.
        longer = [count for count in noted if count > _LONG and (count - header) % 2**16 == 0]
        counts = [*longer, header, *noted]
    counts = [count for count in dict.fromkeys(counts) if count > 0]
    if not counts:
        structure.refuse("the recording has no frames", f"first {first}, last {last}")
    return counts


def _count_header_frames(structure: Structure) -> int:
    first, last = structure.get_word(4), structure.get_word(5)
    return 0 if first == last == 0 else max(last - first + 1, 0)


def _get_noted_counts(structure: Structure) -> dict[str, int]:
    """Return the numbers of frames by the parameters that say them."""
    trial = _read_trial(structure)
    counts = {
        "POINT:LONG_FRAMES": structure.get_count("POINT", "LONG_FRAMES"),
        "TRIAL": trial[1] - trial[0] + 1 if trial else None,
        "POINT:FRAMES": structure.get_count("POINT", "FRAMES"),
    }
    return {name: count for name, count in counts.items() if count is not None}


def _read_trial(structure: Structure) -> tuple[int, int] | None:
    """Return the numbers of the first and the last frame of the trial."""
    first = structure.get_count("TRIAL", "ACTUAL_START_FIELD")
    last = structure.get_count("TRIAL", "ACTUAL_END_FIELD")
    return None if first is None or last is None else (first, last)


def _find_first_frame(structure: Structure, frames: int) -> int:
    """Return the number of the first frame, from 0."""
    first, trial = structure.get_word(4), _read_trial(structure)
    if trial and ((trial[0] - first) % 2**16 == 0 or trial[1] - trial[0] + 1 == frames):
        first = trial[0]
    # Frames count from 1; some programs begin with 0.
    return max(first - 1, 0)


def _count_remaining(structure: Structure, count: int, kinds: list[Frame], available: int) -> int:
    """Return the number of frames of a file that is cut off."""
    frames = available // kinds[0].size
    if len(kinds) > 1:
        structure.refuse(
            "header and parameters contradict each other, and the file is shorter than both say",
            f"{available} bytes of data",
            f"{count} frames of {' or '.join(str(kind.size) for kind in kinds)} bytes",
        )
    if frames == 0:
        structure.refuse("the file is cut off in its data", "no frame", f"{count} frames")
    _warn(structure, f"it is cut off: {frames} of {count} frames are there; these are read")
    return frames


def _extend_count(structure: Structure, frames: int, kind: Frame, available: int) -> int:
    """Return the number of frames by the length of a file that goes on behind those it says."""
    behind = frames * kind.size
    size = _find_padding(structure.path, structure.data_start + behind, available - behind)
    in_file = min(-(-(behind + size) // kind.size), available // kind.size)
    if in_file in _get_noted_counts(structure).values():
        return in_file
    if available - behind <= BLOCK or size < kind.size:
        return frames
    # A count that did not suffice may have lost its upper bits.
    if structure.get_word(5) == _LONG or (in_file - frames) % 2**16 == 0:
        _warn(structure, f"it says {frames} frames and holds {in_file}; all are read")
        return in_file
    _warn(structure, f"it goes on for {size} bytes behind its last frame; these are not read")
    return frames


def _find_padding(path: Path, start: int, size: int) -> int:
    """Return how many bytes of a part of a file come before the zeros at its end."""
    with path.open("rb") as file:
        for begin in range(size // _STEP * _STEP, -1, -_STEP):
            file.seek(start + begin)
            content = file.read(min(_STEP, size - begin)).rstrip(b"\0")
            if content:
                return begin + len(content)
    return 0


def _warn_of_contradictions(structure: Structure, frames: int, points: int) -> None:
    noted, header = structure.get_count("POINT", "USED"), structure.get_word(2)
    if noted is not None and noted != header:
        text = f"its header says {header} points and POINT:USED {noted}; {points} are read"
        _warn(structure, text)
    if frames > _LONG or structure.get_word(5) == _LONG:
        return
    header = _count_header_frames(structure)
    others = {
        name: count for name, count in _get_noted_counts(structure).items() if count != header
    }
    if others:
        listed = " and ".join(f"{name} {count}" for name, count in others.items())
        _warn(structure, f"its header says {header} frames and {listed}; {frames} are read")


def _warn(structure: Structure, text: str) -> None:
    warnings.warn(f"{structure.path}: {text}", MocapFitWarning, stacklevel=5)
