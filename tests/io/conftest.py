"""The small recordings of the folder `fixtures`, and the script that makes them."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

FIXTURES = Path(__file__).parents[2] / "fixtures"


@pytest.fixture(scope="session")
def made() -> ModuleType:
    """The script, whose functions know the truth of what it writes."""
    specification = importlib.util.spec_from_file_location(
        "make_fixtures", FIXTURES / "make_fixtures.py"
    )
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Files that a reader takes."""
    return FIXTURES / "recordings"


@pytest.fixture(scope="session")
def defects() -> Path:
    """Files that a reader must refuse."""
    return FIXTURES / "defects"
