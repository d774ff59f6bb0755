"""Every test here draws."""

import sys
from pathlib import Path

import pytest

# The sheets of pictures that the documentation shows.
sys.path.insert(0, str(Path(__file__).parents[2] / "fixtures" / "pictures"))


@pytest.fixture(scope="session", autouse=True)
def _can_draw(drawing: None) -> None:
    pass
