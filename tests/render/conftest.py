"""Every test here draws."""

import pytest


@pytest.fixture(scope="session", autouse=True)
def _can_draw(drawing: None) -> None:
    pass
