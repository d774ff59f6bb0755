"""Memory that a recording needs when it is read and fitted in one piece."""

from __future__ import annotations

import os
from pathlib import Path

from mocap_fit.errors import DataError

# Bytes at the peak of reading and fitting, measured on Qualisys TSV files of 1,000 to 72,000 frames
# and 35 to 65 markers: of the program, a frame, a frame's marker, and a frame when all frames are
# fitted together, for the ten parameters of the built-in head.
_PROGRAM, _PER_FRAME, _PER_MARKER, _PER_SMOOTH_FRAME = 300 * 2**20, 500, 150, 20_000


def estimate_memory(frames: int, markers: int, *, smooth: bool = False) -> int:
    """Estimate the memory that reading and fitting a recording takes.

    Parameters
    ----------
    frames
        Number of frames.
    markers
        Number of markers.
    smooth
        Whether `fit_over_time` follows.

    Returns
    -------
    int
        Bytes: what a process takes at most, with Python and the libraries.
    """
    per_frame = _PER_FRAME + _PER_MARKER * markers + _PER_SMOOTH_FRAME * smooth
    return _PROGRAM + frames * per_frame


def free_memory() -> int | None:
    """Return the memory that this machine has free.

    Returns
    -------
    int or None
        Bytes; where the system does not say what is free, all of its memory; None where it says
        neither.
    """
    try:
        for line in Path("/proc/meminfo").read_text("ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None


def check_memory(
    frames: int,
    markers: int,
    *,
    smooth: bool = False,
    path: str | os.PathLike[str] | None = None,
    processes: int = 1,
    free: int | None = None,
) -> int:
    """Refuse a recording that needs more memory than this machine has free.

    Parameters
    ----------
    frames
        Number of frames.
    markers
        Number of markers.
    smooth
        Whether `fit_over_time` follows.
    path
        File of the recording, for the message.
    processes
        Number of processes that fit at once, each a recording that may be as large.
    free
        Memory for all of them, bytes; by default what is free now.

    Returns
    -------
    int
        Bytes that the recording needs, from `estimate_memory`.

    Raises
    ------
    DataError
        If it needs more than is free.
    """
    needed = estimate_memory(frames, markers, smooth=smooth)
    free = free_memory() if free is None else free
    # Processes may share what the program takes.
    total = _PROGRAM + processes * (needed - _PROGRAM)
    if free is not None and total > free:
        size = f"{total / 2**30:.1f} GB for {frames} frames of {markers} markers"
        advice = "it a part at a time: mocap-fit fit with --between START-END."
        if processes > 1:
            size += f" in each of {processes} processes"
            advice = f"it with fewer than --jobs {processes}, or {advice}"
        raise DataError(
            "the recording needs more memory than is free",
            path=path,
            found=size,
            expected=f"at most {free / 2**30:.1f} GB",
            advice=f"Fit {advice}",
        )
    return needed
