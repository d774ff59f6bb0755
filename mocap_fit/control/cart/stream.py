"""Live use of CART: frames come as soon as the phones that they depend on are known."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mocap_fit.control.cart.curves import get_smoothing_reach
from mocap_fit.control.streaming import WindowStream

if TYPE_CHECKING:
    from mocap_fit.control.cart.model import Cart


class CentreStream(WindowStream):
    """A stream whose look-ahead is a number of phones, not a time.

    Parameters
    ----------
    model
        A trained model.
    rate
        Frames per second, hertz.
    phones_behind
        How many phones before a segment matter for the curve after its centre.
    """

    def __init__(self, model: Cart, rate: float, phones_behind: int) -> None:
        super().__init__(model, rate)
        self._phones_ahead, self._phones_behind = model.phones_ahead, phones_behind
        self._reach = get_smoothing_reach(model.smoothing)

    def _find_known_end(self) -> float:
        last = len(self._segments) - 1 - self._phones_ahead
        return self._segments[last].centre - self._reach if last >= 0 else -math.inf

    def _count_passed(self, time: float) -> int:
        passed = sum(segment.centre <= time - self._reach for segment in self._segments)
        return max(passed - 1 - self._phones_behind, 0)
