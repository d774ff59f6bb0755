"""A speaker with markers on, recorded: head motion, noise and drop-outs over known gestures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import ndtr

from mocap_fit.errors import ConfigurationError
from mocap_fit.face import Mesh, Rig
from mocap_fit.fitting import Binding, Layout, Orientation, bind_markers
from mocap_fit.fitting.objective import Evaluator
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks, PoseTracks

# How far each gesture of running speech goes, as values of its parameter.
_GESTURES = {
    "jaw_rotation": (0.0, 0.9),
    "lip_rounding": (-0.2, 1.0),
    "upper_lip_retraction": (-0.2, 0.6),
    "upper_lip_raise": (-0.1, 0.8),
    "lower_lip_retraction": (-0.2, 0.7),
    "lower_lip_depression": (-0.2, 0.9),
    "left_corner_stretch": (-0.3, 0.9),
    "right_corner_stretch": (-0.3, 0.9),
    "jaw_thrust": (-0.4, 0.6),
    "jaw_shift": (-0.4, 0.4),
}
_ANY_GESTURE = (-0.2, 0.8)
# Speech gestures fade out above this rate, head motion above that one, in hertz.
_GESTURE_RATE, _HEAD_RATE = 3.0, 0.4
# A speaker whose head differs from the built-in one in size and proportions.
OTHER_SPEAKER = {
    "size": 0.92,
    "width": 1.05,
    "depth": 1.04,
    "lower_face": 1.08,
    "mouth_width": 0.92,
}
# The camera system's axes (x right, y away, z up) and the position of the head in them.
_LABORATORY = Rotation.from_matrix([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
_HEAD_POSITION = np.array([120.0, -340.0, 1250.0])


@dataclass(frozen=True)
class Conditions:
    """The conditions of a simulated session.

    Parameters
    ----------
    noise
        Standard deviation of every coordinate of every marker, millimetres.
    drop_outs
        Part of the samples that are lost, in gaps of a few frames, 0 to 0.9.
    head_translation
        Largest head motion to either side along each axis, millimetres.
    head_rotation
        Largest head motion to either side about each axis, radians.
    rate
        Frames per second, hertz.
    duration
        Length of a recording of free gestures, seconds.
    reference_duration
        Length of the recording of the reference pose, seconds.
    """

    noise: float = 0.3
    drop_outs: float = 0.05
    head_translation: float = 30.0
    head_rotation: float = float(np.radians(20.0))
    rate: float = 60.0
    duration: float = 4.0
    reference_duration: float = 2.0

    def __post_init__(self) -> None:
        if self.rate <= 0 or self.duration * self.rate < 2 or self.reference_duration <= 0:
            raise ConfigurationError(
                "a simulated recording needs a rate above 0 and two frames or more",
                found=f"{self.duration} s at {self.rate} Hz",
            )
        if not 0 <= self.drop_outs < 0.9 or self.noise < 0:
            raise ConfigurationError(
                "the noise or the drop-outs are not possible",
                found=f"noise {self.noise} mm, drop-outs {self.drop_outs}",
                expected="noise of 0 or more, drop-outs from 0 to below 0.9",
            )


@dataclass(frozen=True, eq=False)
class Simulation:
    """One simulated recording and its truth.

    Parameters
    ----------
    recording
        The markers, as a camera system would export them.
    parameters
        The true face parameters.
    pose
        The true pose of the head, from reference to recording.
    """

    recording: MarkerTracks
    parameters: ParameterTracks
    pose: PoseTracks


class Session:
    """A speaker with markers on, ready to be recorded.

    Parameters
    ----------
    layout
        The marker layout.
    face
        The speaker's face: the built-in head, or one of its other proportions.
    conditions
        The conditions of the session.

    Attributes
    ----------
    still
        One frame of all markers at rest, in head coordinates, without noise.
    binding
        The virtual markers that make the recordings.
    """

    def __init__(self, layout: Layout, face: Rig, conditions: Conditions) -> None:
        self.layout = layout
        self.face = face
        self.conditions = conditions
        locations = locate_markers(layout, face.mesh)
        self.still = MarkerTracks(
            tuple(locations), conditions.rate, np.array(list(locations.values()))[None]
        )
        self.binding: Binding = bind_markers(face, layout, self.still, Orientation())
        self._evaluator = Evaluator(self.binding, "squares", 1.0)

    def record_reference(self, rng: np.random.Generator) -> MarkerTracks:
        """Record the reference pose: face and head at rest.

        Parameters
        ----------
        rng
            Generator of the noise.

        Returns
        -------
        MarkerTracks
            The recording.
        """
        frames = max(1, round(self.conditions.reference_duration * self.conditions.rate))
        still = np.repeat(self.still.positions, frames, axis=0)
        return self._observe(still, rng, drop_outs=0.0, name="reference")

    def record(self, rng: np.random.Generator, name: str = "simulated") -> Simulation:
        """Record smooth random gestures, as long as the conditions say.

        Parameters
        ----------
        rng
            Generator of gestures, head motion, noise and drop-outs.
        name
            Name of the recording.

        Returns
        -------
        Simulation
            The recording and its truth.
        """
        conditions = self.conditions
        frames = round(conditions.duration * conditions.rate)
        names = self.face.parameter_names
        ranges = [_GESTURES.get(name, _ANY_GESTURE) for name in names]
        values = draw_gestures(rng, frames, conditions.rate, _GESTURE_RATE, ranges)
        values = np.clip(values, *self.face.bounds.T)
        return self.play(ParameterTracks(names, conditions.rate, values, name=name), rng)

    def play(self, truth: ParameterTracks, rng: np.random.Generator) -> Simulation:
        """Record a face that moves by known parameters.

        Parameters
        ----------
        truth
            The face parameters, in the order of the face's, at the session's rate.
        rng
            Generator of head motion, noise and drop-outs.

        Returns
        -------
        Simulation
            The recording and its truth.
        """
        conditions, frames = self.conditions, truth.frames
        shift, turn = (
            draw_gestures(rng, frames, conditions.rate, _HEAD_RATE, 3 * [(-largest, largest)])
            for largest in (conditions.head_translation, conditions.head_rotation)
        )
        # The head turns about the top of the neck, not about its middle.
        neck = np.array([0.0, -60.0, -20.0])
        rotations = Rotation.from_euler("xyz", turn).as_matrix()
        translations = neck + shift - rotations @ neck
        face = self._evaluator.evaluate_frames(truth.values)[0]
        head = np.repeat(self.binding.head_positions[None], frames, axis=0)
        names = (*self.binding.names, *self.binding.head_names)
        markers = np.concatenate([face, head], axis=1)[:, list(map(names.index, self.still.names))]
        markers = np.einsum("fij,fmj->fmi", rotations, markers) + translations[:, None]
        recording = self._observe(markers, rng, drop_outs=conditions.drop_outs, name=truth.name)
        # From reference to recording, both in the laboratory.
        axes = _LABORATORY.as_matrix()
        rotations = axes @ rotations @ axes.T
        translations = translations @ axes.T + _HEAD_POSITION - rotations @ _HEAD_POSITION
        arrays = rotations[:, None], translations[:, None], np.zeros((frames, 1))
        pose = PoseTracks(("head",), conditions.rate, *arrays, name=truth.name)
        return Simulation(recording, truth, pose.replace(start_time=truth.start_time))

    def _observe(
        self, markers: FloatArray, rng: np.random.Generator, *, drop_outs: float, name: str
    ) -> MarkerTracks:
        """Return what cameras see of markers in the axes of the head, ``(frames, markers, 3)``."""
        shape = markers.shape
        positions = _LABORATORY.apply(markers.reshape(-1, 3)).reshape(shape) + _HEAD_POSITION
        positions += rng.normal(0.0, self.conditions.noise, shape)
        positions[_draw_drop_outs(rng, shape[0], shape[1], drop_outs)] = np.nan
        return MarkerTracks(self.still.names, self.conditions.rate, positions, name=name)


def locate_markers(layout: Layout, mesh: Mesh) -> dict[str, FloatArray]:
    """Locate the markers of a layout on the built-in head, or on it in another shape.

    Face markers are ``marker_offset`` above the skin: at their feature point, or at the vertex
    of their region nearest to their position. Head markers are where their position says.

    Parameters
    ----------
    layout
        The layout; each marker has a feature point or a position.
    mesh
        The built-in head, or a `reshape_head` of it.

    Returns
    -------
    dict of str to ndarray
        Positions by the name of the marker, ``(3,)`` each, millimetres.

    Raises
    ------
    ConfigurationError
        If a marker has neither feature point nor position.
    """
    from mocap_fit.face.builtin import load_built_in_head

    standard = load_built_in_head()
    normals = mesh.compute_normals()
    locations = {}
    for marker in layout.markers:
        if marker.role == "head" and marker.position is not None:
            locations[marker.name] = np.asarray(marker.position)
            continue
        if marker.position is not None:
            members = (
                np.unique(np.concatenate([mesh.get_region(r) for r in marker.region]))
                if marker.region
                else mesh.get_region("skin")
            )
            apart = np.linalg.norm(standard.vertices[members] - marker.position, axis=1)
            vertex = int(members[np.argmin(apart)])
        elif marker.feature_point is not None:
            vertex = mesh.get_feature_point(marker.feature_point)
        else:
            raise ConfigurationError(
                f"the layout does not say where the marker '{marker.name}' is",
                expected="a position, or a feature point",
                advice="Add position = [x, y, z] on the built-in head to simulate with it.",
            )
        locations[marker.name] = mesh.vertices[vertex] + layout.marker_offset * normals[vertex]
    return locations


def draw_gesture(
    rng: np.random.Generator, frames: int, rate: float, fade: float, lower: float, upper: float
) -> FloatArray:
    """Draw a smooth random track whose values are evenly distributed between two bounds.

    It is Gaussian noise whose spectrum fades as a Gaussian, through the normal distribution
    function.

    Parameters
    ----------
    rng
        Generator of the noise.
    frames
        Number of frames.
    rate
        Frames per second, hertz.
    fade
        Where the spectrum has fallen to exp(-1/2), hertz.
    lower, upper
        The bounds, in the unit of the track.

    Returns
    -------
    ndarray
        The track, ``(frames,)``.
    """
    margin = int(np.ceil(2 * rate / fade))
    white = rng.standard_normal(frames + 2 * margin)
    frequencies = np.fft.rfftfreq(len(white), 1 / rate)
    spectrum = np.fft.rfft(white) * np.exp(-0.5 * (frequencies / fade) ** 2)
    filtered = np.fft.irfft(spectrum, len(white))
    track = lower + (upper - lower) * ndtr(filtered / filtered.std())
    return np.asarray(track[margin : margin + frames])


def draw_gestures(
    rng: np.random.Generator,
    frames: int,
    rate: float,
    fade: float,
    ranges: Iterable[tuple[float, float]],
) -> FloatArray:
    """Draw smooth random tracks as `draw_gesture` does, one after another.

    Parameters
    ----------
    rng
        Generator of the noise.
    frames
        Number of frames.
    rate
        Frames per second, hertz.
    fade
        Where the spectrum has fallen to exp(-1/2), hertz.
    ranges
        Lower and upper bound of each track, in the unit of the track.

    Returns
    -------
    ndarray
        The tracks, ``(frames, tracks)``, each in the unit of its bounds.
    """
    return np.stack([draw_gesture(rng, frames, rate, fade, *pair) for pair in ranges], axis=1)


def _draw_drop_outs(
    rng: np.random.Generator, frames: int, markers: int, share: float
) -> NDArray[np.bool_]:
    """Draw which samples are lost, ``(frames, markers)``: gaps of three frames on average."""
    lost = np.zeros((frames, markers), dtype=bool)
    length = 3.0
    for marker in range(markers):
        while lost[:, marker].sum() < share * frames - 0.5 * length * rng.random():
            start = rng.integers(frames)
            lost[start : start + rng.geometric(1 / length), marker] = True
    return lost
