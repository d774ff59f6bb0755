"""The derivatives of the dominance model in numpy, an equation a line."""

import numpy as np

from mocap_fit.control.dominance import Frames, _compute_exponents, _normalise
from mocap_fit.tracks import FloatArray


def jacobian(free: FloatArray, frames: Frames) -> tuple[FloatArray, FloatArray]:
    """Return the trajectory and its derivatives by the free parameters of the utterance's phones.

    Equations 9-14, with the sign of eq. 14 corrected (dD/dc is negative where the distance is more
    than one unit of time), and by the logarithms of alpha, theta, phi and c. At a segment's own
    centre the derivatives by theta, phi and c are 0.

    Parameters
    ----------
    free
        Free parameters of all phones of the model, ``(phones, 5)``, no unit.
    frames
        The frames.

    Returns
    -------
    trajectory
        The articulatory parameter, ``(frames,)``.
    derivatives
        Five columns for the first distinct phone, then those of the next,
        ``(frames, 5 * distinct)``.
    """
    exponents, powers = _compute_exponents(free, frames)
    shares = _normalise(exponents)
    segments = frames.segments
    targets = free[frames.phones, 0][segments]
    values = np.sum(shares * targets, axis=1)
    by_alpha = shares * (targets - values[:, None])
    by_power = -by_alpha * np.where(shares > 0, powers, 0.0)
    before = np.arange(powers.shape[1]) < frames.before[:, None]
    c = np.exp(free[frames.phones, 4])[segments]
    logarithms = np.where(shares > 0, frames.logarithms, 0.0)
    five = (
        shares,
        by_alpha,
        np.where(before, 0.0, by_power),
        np.where(before, by_power, 0.0),
        by_power * c * logarithms,
    )
    derivatives = np.zeros((len(frames), len(frames.phones), 5))
    rows = np.arange(len(frames))[:, None]
    for position, each in enumerate(five):
        np.add.at(derivatives[:, :, position], (rows, segments), each)
    return values, derivatives.reshape(len(frames), -1)
