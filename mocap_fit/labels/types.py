"""Labels of an utterance: tiers of labelled times."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

from mocap_fit.errors import DataError, shorten

TierKind = Literal["interval", "point"]


@dataclass(frozen=True, slots=True)
class Label:
    """An entry of a tier.

    Errors of a file are preserved: the end may be before the start.

    Parameters
    ----------
    start
        Start, seconds; the time of a point.
    end
        End, seconds; the time of a point.
    text
        Text as in the file; may be empty.
    extra
        Further data of the format: ``score=...`` of HTK, ``colour=...`` of ESPS, ``symbol=...``
        of TIMIT where another one is read.

    Raises
    ------
    DataError
        If a time is not finite.
    """

    start: float
    end: float
    text: str
    extra: str = ""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.start) and math.isfinite(self.end)):
            raise DataError(
                f"the label '{shorten(self.text, 40)}' has an impossible time",
                found=f"{self.start} to {self.end} s",
                expected="finite seconds",
            )


@dataclass(frozen=True)
class Tier:
    """Labels of one kind, such as phones or words.

    Parameters
    ----------
    name
        Name as in the file.
    entries
        Entries in the order of the file.
    kind
        ``interval`` for segments of time, ``point`` for moments.
    start
        Start of the tier, seconds; None where it is that of the file.
    end
        End of the tier, seconds; None where it is that of the file.
    """

    name: str
    entries: tuple[Label, ...]
    kind: TierKind = "interval"
    start: float | None = None
    end: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "entries", tuple(self.entries))


@dataclass(frozen=True, repr=False)
class Labels:
    """All labels of an utterance.

    Parameters
    ----------
    tiers
        Tiers in the order of the file.
    start
        Start of the labels, seconds.
    end
        End of the labels, seconds.
    name
        Name of the utterance: that in a .mlf, or that of the file.
    header
        Lines of the header that are written back (ESPS).
    """

    tiers: tuple[Tier, ...]
    start: float
    end: float
    name: str = field(default="", kw_only=True)
    header: tuple[str, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tiers", tuple(self.tiers))
        object.__setattr__(self, "header", tuple(self.header))

    def __repr__(self) -> str:
        tiers = ", ".join(
            f"{tier.name or 'unnamed'} ({len(tier.entries)} {tier.kind}s)" for tier in self.tiers
        )
        return f"<Labels {self.name}: {self.start:g} to {self.end:g} s, tiers {tiers or 'none'}>"

    def get_tier(self, name: str) -> Tier:
        """Return the first tier of a name.

        Parameters
        ----------
        name
            Name of the tier.

        Returns
        -------
        Tier
            The tier.

        Raises
        ------
        DataError
            If there is none; the names of all tiers are listed.
        """
        for tier in self.tiers:
            if tier.name == name:
                return tier
        raise DataError(
            f"'{self.name}' has no tier '{name}'",
            found=", ".join(tier.name for tier in self.tiers) or "no tier",
            advice="Name one of the file's tiers.",
        )
