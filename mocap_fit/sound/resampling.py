"""Sound at another sampling rate."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from mocap_fit.tracks import FloatArray

# The smaller part of the ratio of two rates. Odd rates are off by less than a millisecond an hour.
_LARGEST_PART = 2000


def resample(samples: FloatArray, rate: float, new_rate: float) -> FloatArray:
    """Convert samples to another rate, without what the lower one of both rates cannot hold.

    Parameters
    ----------
    samples
        Samples, ``(samples,)`` or ``(samples, channels)``, no unit.
    rate
        Their rate, hertz.
    new_rate
        The rate that is wanted, hertz.

    Returns
    -------
    ndarray
        Samples at that rate, ``(samples,)`` or ``(samples, channels)``, no unit: of the same scale,
        the first at the same time.
    """
    from scipy.signal import resample_poly

    higher, lower = max(rate, new_rate), min(rate, new_rate)
    ratio = (Fraction(higher) / Fraction(lower)).limit_denominator(_LARGEST_PART)
    parts = ratio.numerator, ratio.denominator
    up, down = parts if new_rate > rate else parts[::-1]
    return np.asarray(resample_poly(samples, up, down, axis=0), dtype=np.float64)
