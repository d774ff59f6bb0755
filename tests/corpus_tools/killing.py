"""Start the program, and end it at a moment that no clock decides."""

import os
import subprocess
import sys
import time
from pathlib import Path

PLUG_IN = Path(__file__).parent / "plug_in"
# Where tests run in the background, Ctrl-C may be set to be ignored, and that is inherited.
PROGRAM = """
import signal, sys
from corpus_tools.cli.app import main
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.exit(main())
"""
# Seconds after which a test gives up; a busy machine may need many.
PATIENCE = 600.0


def start(*arguments):
    """The program in a process group of its own, with the reader of ``plug_in``."""
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(PLUG_IN), *sys.path])},
    )


def wait_until(true):
    end = time.monotonic() + PATIENCE
    while not true():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.01)


def wait_until_gone(process):
    """Wait for the program, and for all that it started."""
    process.communicate(timeout=PATIENCE)

    def is_gone():
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return True
        return False

    wait_until(is_gone)
