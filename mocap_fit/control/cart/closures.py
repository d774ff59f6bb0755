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
    """What a parameter keeps to in the middle of a bilabial stop.

    Parameters
    ----------
    bound
        Where the lips are closed, in the unit of the parameter.
    opening
        1 where the lips open with greater values, -1 where they open with smaller ones.
    """

    bound: float
    opening: int

    def kept(self, value: FloatArray) -> FloatArray:
        """Values that are not more open than the bound."""
        return np.minimum(value, self.bound) if self.opening > 0 else np.maximum(value, self.bound)


def learned_closure(of_stops: FloatArray, of_others: FloatArray) -> Closure | None:
    """Where lips are closed, as a corpus has it.

    Parameters
    ----------
    of_stops
        Targets of bilabial stops; NaN where missing.
    of_others
        Targets of vowels.

    Returns
    -------
    Closure | None
        At the median of the stops; open is where the median of the vowels is. None without stops.
    """
    stops, others = of_stops[np.isfinite(of_stops)], of_others[np.isfinite(of_others)]
    if not len(stops):
        return None
    bound = float(np.median(stops))
    is_below = len(others) > 0 and float(np.median(others)) < bound
    return Closure(bound, -1 if is_below else 1)


def learned_closures(
    wanted: Mapping[str, Any],
    parameter_names: Sequence[str],
    symbols: NDArray[np.str_],
    targets: FloatArray,
    phone_set: PhoneSet,
) -> dict[int, Closure]:
    """The closures of the settings, from the targets of a corpus.

    Parameters
    ----------
    wanted
        By parameter a bound, or ``learned``.
    parameter_names
        Of the targets.
    symbols, targets
        `(segments,)` and `(segments, parameters)`.
    phone_set
        What the symbols are from.

    Returns
    -------
    dict[int, Closure]
        By parameter, from 0.

    Raises
    ------
    DataError
        If one is to be learned, and the corpus has no bilabial stop.
    """
    if not wanted:
        return {}
    classes = {str(symbol): phone_set.get_classes(str(symbol)) for symbol in np.unique(symbols)}
    is_stop = np.array(["bilabial_stop" in classes[str(symbol)] for symbol in symbols])
    is_vowel = np.array(["vowel" in classes[str(symbol)] for symbol in symbols])
    found: dict[int, Closure] = {}
    for name, bound in wanted.items():
        place = list(parameter_names).index(name)
        closure = learned_closure(targets[is_stop, place], targets[is_vowel, place])
        if bound != "learned":
            found[place] = Closure(float(bound), closure.opening if closure else 1)
        elif closure is None:
            raise DataError(
                f"the closure of '{name}' cannot be learned",
                found="no bilabial stop with a target",
                advice="Give the value at which the lips are closed.",
            )
        else:
            found[place] = closure
    return found


def check_closures(closures: Mapping[str, object], parameter_names: Sequence[str]) -> None:
    """Refuse closures that cannot be.

    Raises
    ------
    ConfigurationError
        If a parameter is unknown, or a bound is neither ``learned`` nor a number.
    """
    for name, bound in closures.items():
        if name not in parameter_names:
            raise ConfigurationError(
                f"there is no parameter '{name}' to guarantee a closure of",
                expected=f"some of {', '.join(parameter_names)}",
            )
        is_number = isinstance(bound, (int, float)) and not isinstance(bound, bool)
        if bound != "learned" and not (is_number and np.isfinite(float(str(bound)))):
            raise ConfigurationError(
                f"the closure of '{name}' is neither learned nor a number",
                found=bound,
                expected='"learned", or a value of the parameter',
            )
