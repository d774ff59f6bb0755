"""The shape fit: face parameters frame by frame (Beskow eq. 3)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocap_fit.fitting.binding import Binding
from mocap_fit.fitting.objective import Objective
from mocap_fit.fitting.solving import NEWTON_NLOPT, NOT_FITTED
from mocap_fit.fitting.stretches import StretchFitter
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """What a shape fit found, and how.

    Parameters
    ----------
    parameters
        The parameter tracks, with standard deviations and residuals in millimetres of the
        speaker.
    marker_names
        Names of the face markers.
    marker_residuals
        `(frames, markers)`: distance of each visible marker from its virtual marker,
        millimetres of the speaker; NaN where hidden.
    costs
        `(frames,)`: the objective at the answer, in the face's millimetres.
    evaluations
        `(frames,)`: how often the objective was evaluated.
    status
        `(frames,)`: why the solver stopped; `mocap_fit.fitting.solving.STATUS` says each in words.
    pose_corrections
        `(frames, 6)`: rotation vector (radians) about the middle of the head markers, and
        translation (millimetres of the face), found with ``refine_pose``; else zeros.
    noise
        Standard deviation of a coordinate of a marker as the residuals show it, millimetres of
        the speaker.
    """

    parameters: ParameterTracks
    marker_names: tuple[str, ...]
    marker_residuals: FloatArray
    costs: FloatArray
    evaluations: NDArray[np.int64]
    status: NDArray[np.int64]
    pose_corrections: FloatArray
    noise: float

    @property
    def fitted(self) -> NDArray[np.bool_]:
        """Which frames were fitted."""
        return np.asarray(self.status != NOT_FITTED)

    def __str__(self) -> str:
        fitted = self.fitted
        residuals = self.parameters.residuals[fitted]
        middle = float(np.nanmedian(residuals)) if fitted.any() else float("nan")
        return (
            f"{int(fitted.sum())} of {len(fitted)} frames fitted, median residual {middle:.3f} mm, "
            f"{float(self.evaluations[fitted].mean()) if fitted.any() else 0:.0f} evaluations a "
            f"frame, {int(self.parameters.uncertain.any(axis=1).sum())} frames with an uncertain "
            "parameter"
        )


def fit_shape(
    binding: Binding,
    recording: MarkerTracks,
    *,
    objective: Objective = "distances",
    solver: str = NEWTON_NLOPT,
    huber_threshold: float = 1.0,
    refine_pose: bool = False,
    maximum_evaluations: int = 2000,
    progress: Callable[[int], object] | None = None,
) -> ShapeFit:
    """Find the face parameters that best explain the markers, frame by frame.

    Parameters
    ----------
    binding
        The virtual markers; from `bind_markers`.
    recording
        The recording in head coordinates; from `remove_head_motion`.
    objective
        What is minimised over the visible markers: the weighted sum of ``distances`` (eq. 3),
        of ``squares``, or ``huber``.
    solver
        ``newton-nlopt``: Newton's method predicts, and nlopt, started there, certifies.
        ``newton``: Newton's method alone. Or one of nlopt's algorithms alone, such as
        ``LN_PRAXIS``, Powell's, as in the paper.
    huber_threshold
        Where Huber's objective turns from squares to distances, millimetres of the speaker.
    refine_pose
        Find a small correction of the head's pose together with the shape, from all markers:
        few reference markers make a noisy pose.
    maximum_evaluations
        nlopt stops a frame after so many.
    progress
        Called with the number of frames done so far.

    Returns
    -------
    ShapeFit
        Parameters, residuals, and what the solver did in every frame.

    Raises
    ------
    DataError
        If the recording lacks a marker of the layout, or no frame can be fitted.
    ConfigurationError
        If the objective or the solver is unknown, or a setting is not possible.

    Notes
    -----
    Each frame starts from the answer of the frame before. Hidden markers are left out. A
    parameter that the visible markers leave undetermined keeps its value from the frame before,
    and its standard deviation is infinite.
    """
    fitter = StretchFitter(
        binding,
        objective=objective,
        solver=solver,
        huber_threshold=huber_threshold,
        refine_pose=refine_pose,
        maximum_evaluations=maximum_evaluations,
    )
    found = fitter.fit(recording, progress)
    fitter.finish(recording.name)
    tracks = ParameterTracks(
        binding.parameter_names,
        recording.rate,
        found.values,
        fitter.standard_deviations(found.deviations),
        found.residuals,
        start_time=recording.start_time,
        name=recording.name,
        events=recording.events,
        provenance=recording.provenance,
    ).with_step("fit_shape", fitter.arguments)
    return ShapeFit(
        tracks,
        binding.names,
        found.distances,
        found.costs,
        found.evaluations,
        found.status,
        found.corrections,
        fitter.noise,
    )
