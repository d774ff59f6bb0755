"""A reader of the files of an imagined tracker, as a laboratory would write it."""

import numpy as np

from mocap_fit.errors import FileFormatError
from mocap_fit.tracks import MarkerTracks

description = "the My Lab tracker's text export"
extensions = (".mylab",)


def sniff(path):
    """Return whether a file starts as the tracker's exports do."""
    with open(path, "rb") as file:
        return file.read(6) == b"MYLAB "


def read(path, *, names=None, rate=None):
    """Read the markers: centimetres in the file, -999 where a marker is missing."""
    with open(path, encoding="utf-8") as file:
        first, titles, *rows = file.read().splitlines()
    if not first.startswith("MYLAB "):
        raise FileFormatError(
            "this is not an export of the My Lab tracker",
            path=path,
            line=1,
            found=first[:20],
            expected="MYLAB and the rate in hertz",
        )
    numbers = np.array([row.split() for row in rows], dtype=float)
    numbers[numbers == -999] = np.nan
    return MarkerTracks(
        names or titles.split(),
        rate or float(first.split()[1]),
        10.0 * numbers.reshape(len(rows), -1, 3),
        name=path.stem,
    ).add_step("read", {"reader": "mylab", "file": path.name})
