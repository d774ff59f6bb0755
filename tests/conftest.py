"""Fixtures that several test modules share."""

import importlib.util
import os
from pathlib import Path
from types import ModuleType

import hypothesis
import numpy as np
import pytest
from hypothesis.internal.conjecture import providers

FIXTURES = Path(__file__).parents[1] / "fixtures"

# What passed once passes again: a change is judged by what it does, not by a new draw of examples.
# To look for new ones: pytest --hypothesis-profile draw
hypothesis.settings.register_profile("same", derandomize=True)
hypothesis.settings.register_profile("draw", derandomize=False)
hypothesis.settings.load_profile("same")
# Hypothesis also draws constants that it finds in our modules which happen to be imported, so that
# a test would see other examples alone than in the suite. It has no setting for that.
providers.is_local_module_file = lambda path: False


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The real recordings; the test is skipped where they are not."""
    folder = Path(os.environ.get("MOCAP_FIT_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"real data not found in {folder} (set MOCAP_FIT_DATA)")
    return folder


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed."""
    return np.random.default_rng(20260101)


@pytest.fixture(scope="session")
def drawing() -> None:
    """Faces can be drawn here; the test is skipped where they cannot."""
    from mocap_fit.errors import MissingExtraError
    from mocap_fit.render import require_off_screen

    try:
        require_off_screen()
    except MissingExtraError as error:
        pytest.skip(str(error))


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
