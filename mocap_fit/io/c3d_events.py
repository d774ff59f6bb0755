"""The events of a C3D file: those of the group EVENT, or else of the header."""

from __future__ import annotations

import math
import warnings

from mocap_fit.errors import MocapFitWarning
from mocap_fit.io.c3d_parameters import Parameter
from mocap_fit.io.c3d_structure import Structure
from mocap_fit.tracks import Event

_MOST = 18
"""Events for which the header has room."""

_LONG_LABELS = 12345
"""Key of a header whose labels have four characters; those of older ones have two."""


def read_events(structure: Structure) -> list[Event]:
    """Read the events of a file.

    Times are minutes and seconds, whatever their dimensions are; as many numbers as there are
    events are seconds alone.

    Parameters
    ----------
    structure
        Header and parameters of the file.

    Returns
    -------
    list of Event
        The events in the order of the file.

    Warns
    -----
    MocapFitWarning
        If an event has no time; it is left out.
    """
    group = "EVENTS" if ("EVENTS", "TIMES") in structure.parameters else "EVENT"
    numbers = structure.get_values(group, "TIMES")
    if not numbers:
        return _read_header_events(structure)
    labels = structure.get_texts(group, "LABELS")
    contexts = structure.get_texts(group, "CONTEXTS")
    used = structure.get_count(group, "USED")
    if used is None:
        used = len(labels) or len(numbers) // 2
    times = _pair_times(numbers, structure.parameters[group, "TIMES"].dimensions, used)
    events = []
    for index, time in enumerate(times[:used]):
        words = [word for word in contexts[index : index + 1] if word.lower() != "general"]
        words += labels[index : index + 1]
        if math.isfinite(time):
            events.append(Event(" ".join(filter(None, words)) or f"event {index + 1}", time))
    if len(events) < used:
        warnings.warn(
            f"{structure.path}: {used - len(events)} of {used} events have no time; left out",
            MocapFitWarning,
            stacklevel=4,
        )
    return events


def _pair_times(numbers: list[float], dimensions: tuple[int, ...], used: int) -> list[float]:
    """Return times in seconds."""
    if len(numbers) == used and not (len(dimensions) == 2 and dimensions[0] == 2):
        return numbers
    minutes, seconds = numbers[::2], numbers[1::2]
    if len(dimensions) == 2 and dimensions[1] == 2 != dimensions[0]:
        minutes, seconds = numbers[: dimensions[0]], numbers[dimensions[0] :]
    return [60 * full + rest for full, rest in zip(minutes, seconds, strict=False)]


def _read_header_events(structure: Structure) -> list[Event]:
    count = min(structure.get_word(151), _MOST)
    length = 4 if structure.get_word(150) == _LONG_LABELS else 2
    labels = Parameter(-1, (length, count), structure.header[396 : 396 + length * count]).texts
    times = [structure.get_float(153 + 2 * index) for index in range(count)]
    pairs = zip(labels, times, strict=True)
    return [Event(label, time) for label, time in pairs if label and math.isfinite(time)]
