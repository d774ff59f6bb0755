"""The steps that led to tracks, and the moments that were marked in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mocap_fit._version import __version__


@dataclass(frozen=True)
class Step:
    """One step of a provenance.

    Parameters
    ----------
    name
        What was done, such as ``fill_gaps``.
    arguments
        The arguments of the step: values that JSON can hold; never a clock time, an absolute path
        or a number of jobs, so that the same input gives the same bytes.
    version
        The version of mocap-fit that did it.
    """

    name: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    version: str = field(default_factory=lambda: __version__)

    def to_dict(self) -> dict[str, Any]:
        """Return the step as values that JSON can hold.

        Returns
        -------
        dict
            ``step``, ``arguments`` and ``version``.
        """
        return {"step": self.name, "arguments": dict(self.arguments), "version": self.version}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Step:
        """Make a step of what `to_dict` returned.

        Parameters
        ----------
        values
            ``step``, ``arguments`` and ``version``.

        Returns
        -------
        Step
            The step.
        """
        return cls(values["step"], values.get("arguments", {}), values.get("version", ""))


Provenance = tuple[Step, ...]


@dataclass(frozen=True)
class Event:
    """A moment that the operator or the recorder marked.

    Parameters
    ----------
    name
        What happened.
    time
        When, in seconds.
    """

    name: str
    time: float
