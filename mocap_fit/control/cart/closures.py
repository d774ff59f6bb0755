"""Guarantees for bilabial stops: in their middle a parameter is not more open than closed lips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.phones import PhoneSet
from mocap_fit.tracks import FloatArray


class Closure(NamedTuple):
    """The bound of a parameter in the middle of a bilabial stop.

    Parameters
    ----------
    bound
        Where the lips are closed, in the unit of the parameter.
    opening
        1 where the lips open with greater values, -1 where they open with smaller ones.
    """

    bound: float
    opening: int

    def clip(self, values: FloatArray) -> FloatArray:
        """Limit values to those that are not more open than the bound.

        Parameters
        ----------
        values
            ``(times,)``, in the unit of the parameter.

        Returns
        -------
        ndarray
            ``(times,)``, in the unit of the parameter.
        """
        return (
            np.minimum(values, self.bound) if self.opening > 0 else np.maximum(values, self.bound)
        )


def learn_closure(of_stops: FloatArray, of_vowels: FloatArray) -> Closure | None:
    """Find where lips are closed: at the median target of the bilabial stops.

    Parameters
    ----------
    of_stops
        Targets of bilabial stops, ``(stops,)``, in the unit of the parameter; NaN where missing.
    of_vowels
        Targets of vowels, ``(vowels,)``, in the unit of the parameter; NaN where missing.

    Returns
    -------
    Closure | None
        It opens towards the median of the vowels; None without stops.
    """
    stops, vowels = of_stops[np.isfinite(of_stops)], of_vowels[np.isfinite(of_vowels)]
    if not len(stops):
        return None
    bound = float(np.median(stops))
    is_below = len(vowels) > 0 and float(np.median(vowels)) < bound
    return Closure(bound, -1 if is_below else 1)


def learn_closures(
    settings: Mapping[str, Any],
    parameter_names: Sequence[str],
    symbols: NDArray[np.str_],
    targets: FloatArray,
    phone_set: PhoneSet,
) -> dict[int, Closure]:
    """Find the closures that the settings ask for in the targets of a corpus.

    Parameters
    ----------
    settings
        By parameter a bound, or ``learned``.
    parameter_names
        Names of the parameters.
    symbols
        Phone of each segment, ``(segments,)``.
    targets
        ``(segments, parameters)``, in the unit of each parameter; NaN where missing.
    phone_set
        The set of the symbols.

    Returns
    -------
    dict[int, Closure]
        By index of the parameter.

    Raises
    ------
    DataError
        If one is to be learned and the corpus has no bilabial stop.
    """
    if not settings:
        return {}
    classes = {str(symbol): phone_set.get_classes(str(symbol)) for symbol in np.unique(symbols)}
    is_stop = np.array(["bilabial_stop" in classes[str(symbol)] for symbol in symbols])
    is_vowel = np.array(["vowel" in classes[str(symbol)] for symbol in symbols])
    closures: dict[int, Closure] = {}
    for name, bound in settings.items():
        p = list(parameter_names).index(name)
        closure = learn_closure(targets[is_stop, p], targets[is_vowel, p])
        if bound != "learned":
            closures[p] = Closure(float(bound), closure.opening if closure else 1)
        elif closure is None:
            raise DataError(
                f"the closure of '{name}' cannot be learned",
                found="no bilabial stop with a target",
                advice="State the value at which the lips are closed.",
            )
        else:
            closures[p] = closure
    return closures


def check_closures(closures: Mapping[str, object], parameter_names: Sequence[str]) -> None:
    """Check the closures of the settings.

    Parameters
    ----------
    closures
        By parameter a bound, or ``learned``.
    parameter_names
        Names of the parameters of the corpus.

    Raises
    ------
    ConfigurationError
        If a parameter is unknown, or a bound is neither ``learned`` nor a number.
    """
    for name, bound in closures.items():
        if name not in parameter_names:
            raise ConfigurationError(
                f"there is no parameter '{name}' to close the lips with",
                expected=f"some of {', '.join(parameter_names)}",
            )
        is_number = isinstance(bound, (int, float)) and not isinstance(bound, bool)
        if bound != "learned" and not (is_number and np.isfinite(float(str(bound)))):
            raise ConfigurationError(
                f"the closure of '{name}' is neither learned nor a number",
                found=bound,
                expected='"learned", or a value of the parameter',
            )
