"""The face and a simulated session, made once."""

from collections.abc import Callable

import numpy as np
import pytest

from corpus_tools.simulation import Conditions, Session
from mocap_fit.face import Rig, load_face
from mocap_fit.fitting import Binding, Layout, load_layout
from mocap_fit.tracks import MarkerTracks

MakeTracks = Callable[..., MarkerTracks]


@pytest.fixture(scope="session")
def face() -> Rig:
    return load_face()


@pytest.fixture(scope="session")
def layout() -> Layout:
    return load_layout("face30-head5")


@pytest.fixture(scope="session")
def session(layout: Layout, face: Rig) -> Session:
    """A speaker who is the built-in head, without noise or drop-outs."""
    return Session(layout, face, Conditions(noise=0.0, drop_outs=0.0, duration=1.0))


@pytest.fixture(scope="session")
def binding(session: Session) -> Binding:
    """The markers of the layout tied to the head that wears them, in its own coordinates."""
    return session.binding


@pytest.fixture
def some_values() -> np.ndarray:
    """Parameters of a face in mid-speech."""
    return np.array([0.4, 0.3, 0.2, 0.1, 0.15, 0.3, 0.2, -0.1, 0.1, -0.2])


@pytest.fixture(scope="session")
def make_tracks() -> MakeTracks:
    """Face markers of parameters over time, in the speaker's head coordinates."""

    def make(binding: Binding, values: np.ndarray, rate: float = 60.0) -> MarkerTracks:
        markers = np.array([binding.evaluate(v)[0] for v in np.atleast_2d(values)])
        names, positions = binding.names, binding.orientation.undo(markers)
        if binding.head_names:
            head = binding.orientation.undo(binding.head_positions)
            head = np.repeat(head[None], len(positions), axis=0)
            names = (*names, *binding.head_names)
            positions = np.concatenate([positions, head], axis=1)
        return MarkerTracks(names, rate, positions, name="made")

    return make
