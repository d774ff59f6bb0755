"""Work over processes of this machine."""

import json
import multiprocessing
import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from mocap_fit import processes

# Work for processes: it must be found by name, and so stands at the top of the module.


def square(shared, item, progress):
    progress(1, 2)
    return shared + item * item, os.getpid()


def die_at_three(shared, item, progress):
    if item == 3:
        os._exit(9)
    return item


def fail_at_three(shared, item, progress):
    if item == 3:
        raise ZeroDivisionError("three")
    time.sleep(600 if item > 3 else 0)
    return item


def first_is_slow(begun, item, progress):
    (begun / str(item)).touch()
    time.sleep(1.0 if item == 0 else 0.0)
    return item


def ignore(index, done, of):
    pass


class TestProcesses:
    def test_each_item_is_done_once_by_other_processes(self):
        results = dict(processes.run_in_processes(square, 100, range(9), 2, ignore))
        assert {i: result for i, (result, _) in results.items()} == {
            i: 100 + i * i for i in range(9)
        }
        workers = {process for _, process in results.values()}
        assert os.getpid() not in workers
        assert 1 <= len(workers) <= 2

    @pytest.fixture
    def nothing_left_behind(self):
        """No thread either: of one that tidies up when the program ends Python complains."""
        before = set(threading.enumerate())
        yield
        assert set(threading.enumerate()) <= before
        assert not multiprocessing.active_children()

    def test_fewer_items_than_processes(self, nothing_left_behind):
        """What was meant for a process that is not needed would fill a pipe."""
        large = np.zeros(400_000)
        results = dict(processes.run_in_processes(square, large, range(2), 4, ignore))
        assert [results[i][0][-1] for i in range(2)] == [0, 1]

    def test_in_order_no_more_are_begun_than_are_under_way(self, tmp_path):
        """Who asks for results in order then holds few."""
        results = processes.run_in_processes(
            first_is_slow, tmp_path, range(12), 2, ignore, in_order=True
        )
        assert next(results) == (0, 0)
        assert len(list(tmp_path.iterdir())) <= 4
        assert list(results) == [(i, i) for i in range(1, 12)]

    def test_an_item_that_kills_its_process_is_named_and_the_others_are_done(
        self, nothing_left_behind
    ):
        results = dict(processes.run_in_processes(die_at_three, None, range(6), 2, ignore))
        assert sorted(results) == list(range(6))
        dead = {i for i, result in results.items() if isinstance(result, processes.DeadProcess)}
        assert dead == {3}
        assert "killed" in results[3].reason
        assert [results[i] for i in (0, 1, 2, 4, 5)] == [0, 1, 2, 4, 5]

    def test_a_mistake_of_ours_ends_the_work_at_once(self, nothing_left_behind):
        began = time.monotonic()
        with pytest.raises(ZeroDivisionError, match="three"):
            list(processes.run_in_processes(fail_at_three, None, range(20), 2, ignore))
        assert time.monotonic() - began < 300


# What a program of its own does: this one has threads of the libraries that other tests use.
BY_COPIES = """
import json, os
from mocap_fit import processes

loaded_here = []

def work(shared, item, progress):
    if item == 3:
        os._exit(9)
    return shared + item, len(loaded_here)

if __name__ == "__main__":
    loaded_here.append("before the processes began")
    for count in (3, 6):
        results = dict(processes.run_in_processes(work, 100, range(count), 2, lambda *_: None))
        died = [i for i, result in results.items() if isinstance(result, processes.DeadProcess)]
        print(json.dumps([died, [results[i] for i in range(count) if i not in died]]))
"""

LOADED = """
from mocap_fit import processes
processes.limit_threads()
from corpus_tools import convert, fit
import mocap_fit.fitting.compiled_solver, pandas, pyarrow.parquet, threading
found = [processes.choose_start_method()]
over = threading.Event()
thread = threading.Thread(target=over.wait)
thread.start()
found.append(processes.choose_start_method())
over.set()
print(*found)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere processes are not copied")
class TestCopies:
    def run(self, code, tmp_path):
        (tmp_path / "program.py").write_text(code, encoding="utf-8")
        done = subprocess.run(
            [sys.executable, "-W", "error", tmp_path / "program.py"],
            capture_output=True,
            check=True,
            encoding="utf-8",
            cwd=tmp_path,
        )
        assert done.stderr == ""
        return done.stdout

    def test_a_process_without_threads_is_copied_and_one_with_threads_is_not(self, tmp_path):
        """The first also tells of a library that begins a thread when it is imported."""
        assert self.run(LOADED, tmp_path).split() == ["fork", "spawn"]

    def test_copies_have_what_is_loaded_and_one_that_dies_is_named(self, tmp_path):
        whole, with_a_death = map(json.loads, self.run(BY_COPIES, tmp_path).splitlines())
        assert whole == [[], [[100 + i, 1] for i in range(3)]]
        # What was under way with the dead one may be done by processes that are not copies.
        died, results = with_a_death
        assert died == [3]
        assert [result for result, _ in results] == [100 + i for i in (0, 1, 2, 4, 5)]
