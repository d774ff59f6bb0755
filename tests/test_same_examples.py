"""Hypothesis draws the same examples whichever tests run."""

import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).parent
DRAW = """
import sys
sys.path.insert(0, sys.argv[1])
import conftest
from hypothesis import given, strategies as st
drawn = []

@given(st.floats(), st.integers(), st.text())
def collect(number, count, text):
    drawn.append((number, count, text))

{imports}
collect()
print(ascii(drawn))
"""


def draw(imports: str) -> str:
    command = [sys.executable, "-c", DRAW.format(imports=imports), str(TESTS)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    return run.stdout


def test_modules_of_ours_change_no_example():
    alone = draw("")
    assert alone.count("(") > 50
    assert draw("import mocap_fit.io, mocap_fit.labels, mocap_fit.phones, mocap_fit.sound") == alone
