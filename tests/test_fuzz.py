"""Damaged files: every reader reads them or refuses them in words, in bounded time and memory."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "fixtures" / "fuzz.py"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="limits and copies of processes of Linux"),
]


def fuzz(*options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, SCRIPT, *map(str, options)],
        capture_output=True,
        encoding="utf-8",
        check=False,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )


def test_damaged_files_end_in_errors_of_ours(tmp_path: Path) -> None:
    """The long form is `python fixtures/fuzz.py --inputs 300000`."""
    result = fuzz("--inputs", 5000, "--seed", 1, "--jobs", 2, "--out", tmp_path)
    assert result.stdout.splitlines() == ["0 finds"], result.stdout + result.stderr


class TestTheProgramItself:
    """What it looks for is noticed when it is there."""

    @pytest.fixture
    def broken(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.syspath_prepend(SCRIPT.parent)
        import fuzz as program
        import fuzz_targets

        def run(read):
            target = fuzz_targets.Target(read, [(".txt", b"text")])
            monkeypatch.setattr(program, "create_targets", lambda folder: {"broken": target})
            monkeypatch.setattr(program, "SECONDS", 1.0)
            return [find.problem for find in program.run(2, jobs=1, out=tmp_path / "finds")]

        return run

    def test_an_exception(self, broken, tmp_path: Path) -> None:
        def read(path):
            return {}["absent"]

        finds = broken(read)
        assert len(finds) == 2
        assert all("KeyError: 'absent'" in find for find in finds)
        assert len(list((tmp_path / "finds").glob("broken_0_?.txt"))) == 2

    def test_the_end_of_the_process(self, broken) -> None:
        def read(path):
            os.kill(os.getpid(), signal.SIGSEGV)

        assert broken(read) == ["the process ended with signal 11"] * 2

    def test_a_loop(self, broken) -> None:
        def read(path):
            while True:
                pass

        assert broken(read) == ["it hangs"] * 2

    def test_memory(self, broken) -> None:
        (first, *_) = broken(lambda path: bytearray(500_000_000))
        assert first.endswith("MB of memory")

    def test_a_warning(self, broken) -> None:
        import warnings

        assert broken(lambda path: warnings.warn("odd", stacklevel=1))[0].startswith(
            "a warning: odd"
        )
