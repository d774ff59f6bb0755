"""Headers made to be slow cost a reader time in proportion to their size."""

import contextlib
import re
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

from mocap_fit.errors import MocapFitError
from mocap_fit.io import READERS

TRC = "PathFileType\t4\nDataRate\tNumFrames\tUnits\n100\t2\tmm\nFrame#\tTime\t"
NEXUS = "Trajectories\n100\n,,a\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1,2,3\n2,0,1,2,3\n"

EVIL: list[tuple[str, Callable[[int], str]]] = [
    ("csv", lambda n: "time,a" + " " * n + "b_x,a_y,a_z\n0,1,2,3\n"),
    ("csv", lambda n: "time,a" + " " * n + "x,a_y,a_z\n0,1,2,3\n"),
    ("csv", lambda n: "time," + "[(" * (n // 2) + "x,a_y,a_z\n0,1,2,3\n"),
    ("csv", lambda n: "time,a_x [" + " " * n + "m m],a_y,a_z\n0,1,2,3\n"),
    ("csv", lambda n: "time,a_x (" + "m" * n + "!),a_y,a_z\n0,1,2,3\n"),
    ("csv", lambda n: "time,a" + "_.:- " * (n // 5) + "!,a_y,a_z\n0,1,2,3\n"),
    ("csv", lambda n: '"' * n + ",a_x,a_y\n0,1,2,3\n"),
    ("csv", lambda n: "time,a_x,a_y,a_z\n0,1,2," + "1" * n + "\n1,2,3,4\n"),
    ("qualisys-tsv", lambda n: "Frame\tTime\ta" + " " * n + "b X\ta Y\ta Z\n1\t0\t1\t2\t3\n"),
    (
        "qualisys-tsv",
        lambda n: "Frame\tTime\ta" + "_: " * (n // 3) + "X\ta Y\ta Z\n1\t0\t1\t2\t3\n",
    ),
    (
        "qualisys-tsv",
        lambda n: "NO_OF_FRAMES\t1\nA" + "_A" * n + "_\t1\nMARKER_NAMES\ta\n1\t2\t3\n",
    ),
    ("qualisys-tsv", lambda n: "NO_OF_FRAMES 1\nMARKER_NAMES" + " a" * n + "\n1\t2\t3\n"),
    ("qualisys-tsv", lambda n: "NO_OF_FRAMES\t1" + "\t" * n + "\nMARKER_NAMES\ta\n1\t2\t3\n"),
    ("trc", lambda n: TRC + "a" + "\t" * n + "b\n\t\tX1\tY1\tZ1\n1\t0.0\t1" + "\t" * n + "4\n"),
    ("trc", lambda n: TRC + "a\n\t\tX1\tY1\tZ1\n" + "\t\t\t\t\n" * (n // 5) + "1\t0.0\t1\t2\t3\n"),
    ("motive-csv", lambda n: "Format Version,1.23" + ",a" * n + "\n\n,Type,Marker\n"),
    ("motive-csv", lambda n: "Format Version,1.23\n" + "\n" * n + "Frame,Time\n"),
    ("nexus-csv", lambda n: NEXUS + ("," * (n // 4) + "\n") * 4 + "1"),
    ("nexus-csv", lambda n: NEXUS + "\n" * n + "3,0,1,2,3\n"),
    ("nexus-csv", lambda n: "Devices\n100\n" + "1,2\n" * (n // 4) + "Trajectories\n"),
]


def measure(reader: str, path: Path, content: str) -> float:
    """The shortest of several times of the processor."""
    path.write_text(content)
    best = float("inf")
    for _ in range(3):
        begin = time.process_time()
        READERS.get(reader).sniff(path)
        with contextlib.suppress(MocapFitError):
            READERS.get(reader).read(path)
        best = min(best, time.process_time() - begin)
    return best


@pytest.mark.parametrize(("reader", "content"), EVIL)
def test_time_grows_as_the_size(reader: str, content: Callable[[int], str], tmp_path: Path) -> None:
    path = tmp_path / "a"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        short, long = (measure(reader, path, content(size)) for size in (10_000, 40_000))
    # Sixteen times where it is quadratic: seconds.
    assert long < 8 * short + 0.1


@pytest.mark.parametrize("reader", ["csv", "qualisys-tsv", "trc", "motive-csv", "nexus-csv"])
@pytest.mark.parametrize(
    "start", [TRC, "Format Version,1.23\n,", "Trajectories\n100\n,", "time,", 'FREQUENCY\t"']
)
def test_a_cell_of_a_page_is_refused_in_words(reader: str, start: str, tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_text(start + "x" * 200_000 + '"\n1,2,3\n' * 3)
    with pytest.raises(MocapFitError, match=re.escape(str(path))):
        READERS.get(reader).read(path)
