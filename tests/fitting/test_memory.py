"""The memory of a recording: what it is measured to be, and more than is free."""

import os
import resource
import subprocess
import sys

import pytest

from mocap_fit.errors import DataError
from mocap_fit.fitting import memory
from mocap_fit.fitting.memory import check_memory, estimate_memory, free_memory

FIT = """
import re, sys
import numpy as np
from mocap_fit.face import load_face
from mocap_fit.fitting import bind_markers, fit_orientation, fit_over_time, fit_shape, load_layout
from corpus_tools.simulation import Conditions, Session
frames, smooth = int(sys.argv[1]), sys.argv[2] == "smooth"
session = Session(load_layout("face30-head5"), load_face(), Conditions(duration=2.0))
recording = session.record(np.random.default_rng(1)).recording
positions = np.resize(recording.positions, (frames, *recording.positions.shape[1:]))
recording = recording.replace(positions=positions, origin=None)
fit = fit_shape(session.binding, recording)
if smooth:
    fit_over_time(session.binding, recording, fit)
# Not of getrusage, which begins with what the process that started this one had.
print(1024 * int(re.search(r"VmHWM:\\s+(\\d+) kB", open("/proc/self/status").read()).group(1)))
"""


def test_an_hour_of_thirty_five_markers_needs_a_gigabyte_and_a_half():
    assert estimate_memory(60 * 3600, 35) == pytest.approx(1.5 * 2**30, rel=0.1)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux says it of a process alone")
@pytest.mark.parametrize("smooth", [False, True])
def test_the_estimate_is_above_what_a_fit_takes_but_not_far(smooth):
    frames = 20_000
    done = subprocess.run(
        [sys.executable, "-c", FIT, str(frames), "smooth" if smooth else "alone"],
        capture_output=True,
        check=True,
        encoding="utf-8",
    )
    used = int(done.stdout)
    assert used < estimate_memory(frames, 35, smooth=smooth) < 2 * used


def test_free_memory_is_less_than_all_and_more_than_this_process_has():
    free = free_memory()
    assert free is not None
    assert free > 2**20
    if sys.platform == "linux":
        everything = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        assert free < everything - used / 4


def test_more_than_is_free_is_refused_with_what_to_do():
    needed = check_memory(1000, 35)
    assert needed == estimate_memory(1000, 35)
    with pytest.raises(DataError, match=r"--between START-END") as caught:
        check_memory(10**12, 35, path="take.tsv")
    assert caught.value.path == "take.tsv"
    assert "1000000000000 frames of 35 markers" in str(caught.value.found)


def test_several_processes_share_what_is_free():
    """But for the program, which they may share."""
    needed, program = estimate_memory(1000, 35), estimate_memory(0, 35)
    for processes in (1, 2, 5):
        free = program + processes * (needed - program)
        assert check_memory(1000, 35, processes=processes, free=free) == needed
    with pytest.raises(DataError, match="fewer than --jobs 5") as caught:
        check_memory(1000, 35, processes=5, free=free - 1)
    assert "1000 frames of 35 markers in each of 5 processes" in str(caught.value.found)
    with pytest.raises(DataError, match=r"Fit it a part at a time") as caught:
        check_memory(1000, 35, free=needed - 1)
    assert "--jobs" not in str(caught.value)


def test_nothing_is_refused_where_the_system_does_not_say(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: None)
    assert check_memory(10**12, 35) > 10**12
