"""Edits of the phones of an utterance; times are seconds, those of the labels."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from typing_extensions import override

from mocap_fit.edits.marker_edits import Name
from mocap_fit.errors import DataError
from mocap_fit.labels import Label
from mocap_fit.settings_file import StrictModel

# Seconds: a boundary of labels that is as near is meant.
_NEAR = 1e-3


class LabelEdit(StrictModel):
    """An edit of the phones of an utterance."""

    @property
    def symbols(self) -> tuple[str, ...]:
        """New symbols of phones."""
        return ()

    def apply(self, entries: Sequence[Label]) -> list[Label]:
        """Return the labels of the phones with the edit.

        Parameters
        ----------
        entries
            Labels of the phones, in the order of time.

        Returns
        -------
        list of Label
            The labels, edited.

        Raises
        ------
        DataError
            If there is no such phone or boundary, or it would pass another one.
        """
        raise NotImplementedError


class MoveBoundary(LabelEdit):
    """Another time of the boundary between two phones, or of the start or end of one.

    Parameters
    ----------
    time
        Where it is, seconds.
    to
        Where it should be, seconds: within the phones that it is between.
    """

    edit: Literal["move_boundary"] = "move_boundary"
    time: float
    to: float

    @override
    def apply(self, entries: Sequence[Label]) -> list[Label]:
        time = _find_boundary(entries, self.time)
        result = []
        for entry in entries:
            start = self.to if entry.start == time else entry.start
            end = self.to if entry.end == time else entry.end
            beside = time in (entry.start, entry.end)
            # Nor may it go into a phone that it is not beside.
            inside = not beside and entry.start < self.to < entry.end
            if (beside and not start < end) or inside:
                raise DataError(
                    f"the boundary would pass a boundary of '{entry.text}'",
                    found=f"{self.to:g} s",
                    expected=f"a time {'outside' if inside else 'within'} "
                    f"{entry.start:g} to {entry.end:g} s",
                )
            result.append(dataclasses.replace(entry, start=start, end=end))
        return result


class Relabel(LabelEdit):
    """Another symbol of a phone.

    Parameters
    ----------
    time
        Any time within the phone, seconds.
    phone
        The new symbol.
    former
        The symbol that the phone must have; any where empty.
    """

    edit: Literal["relabel"] = "relabel"
    time: float
    phone: Name
    former: str = ""

    @property
    @override
    def symbols(self) -> tuple[str, ...]:
        return (self.phone,)

    @override
    def apply(self, entries: Sequence[Label]) -> list[Label]:
        index = _find_entry(entries, self.time)
        text = entries[index].text.strip()
        if self.former and text != self.former:
            raise DataError(
                f"another phone is labelled at {self.time:g} s", found=text, expected=self.former
            )
        result = list(entries)
        result[index] = dataclasses.replace(result[index], text=self.phone)
        return result


class Split(LabelEdit):
    """A phone that is two.

    Parameters
    ----------
    time
        The boundary between the two, seconds: within the phone.
    phones
        Their symbols.
    """

    edit: Literal["split"] = "split"
    time: float
    phones: tuple[Name, Name]

    @property
    @override
    def symbols(self) -> tuple[str, ...]:
        return self.phones

    @override
    def apply(self, entries: Sequence[Label]) -> list[Label]:
        index = _find_entry(entries, self.time)
        entry = entries[index]
        if not entry.start < self.time:
            raise DataError(
                f"'{entry.text}' cannot be split at its start",
                found=f"{self.time:g} s",
                expected=f"a time within {entry.start:g} to {entry.end:g} s",
            )
        first = dataclasses.replace(entry, end=self.time, text=self.phones[0])
        second = dataclasses.replace(entry, start=self.time, text=self.phones[1])
        return [*entries[:index], first, second, *entries[index + 1 :]]


class Merge(LabelEdit):
    """Two phones that are one.

    Parameters
    ----------
    time
        The boundary between the two, seconds.
    phone
        The symbol of the one.
    """

    edit: Literal["merge"] = "merge"
    time: float
    phone: Name

    @property
    @override
    def symbols(self) -> tuple[str, ...]:
        return (self.phone,)

    @override
    def apply(self, entries: Sequence[Label]) -> list[Label]:
        time = _find_boundary(entries, self.time)
        index = next((k for k, entry in enumerate(entries) if entry.start == time), 0)
        if not index or entries[index - 1].end != time:
            raise DataError(f"no two phones meet at {self.time:g} s")
        one = dataclasses.replace(entries[index - 1], end=entries[index].end, text=self.phone)
        return [*entries[: index - 1], one, *entries[index + 1 :]]


def _find_entry(entries: Sequence[Label], time: float) -> int:
    """Return the index of the phone at a time."""
    for index, entry in enumerate(entries):
        if entry.start <= time < entry.end:
            return index
    reach = f"{entries[0].start:g} to {entries[-1].end:g} s" if entries else "no label at all"
    raise DataError(f"no phone is labelled at {time:g} s", expected=f"a time within {reach}")


def _find_boundary(entries: Sequence[Label], time: float) -> float:
    """Return the time of the boundary that is nearest to a time, and near."""
    known = sorted({t for entry in entries for t in (entry.start, entry.end)})
    nearest = min(known, key=lambda t: abs(t - time), default=np.inf)
    if not abs(nearest - time) <= _NEAR:
        raise DataError(
            f"no phone begins or ends at {time:g} s",
            expected=f"a boundary, such as the nearest, at {nearest:g} s" if known else None,
        )
    return nearest
