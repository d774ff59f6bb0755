"""Edit lists, and their history."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Collection, Iterator, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from mocap_fit.edits.label_edits import LabelEdit, Merge, MoveBoundary, Relabel, Split
from mocap_fit.edits.marker_edits import (
    DropMarker,
    DropSpan,
    MarkerEdit,
    Mirror,
    Rename,
    SetReference,
    Swap,
)
from mocap_fit.errors import DataError
from mocap_fit.labels import Label, Labels, find_phone_tier
from mocap_fit.phones import PhoneSet
from mocap_fit.settings_file import StrictModel
from mocap_fit.tracks import MarkerTracks

Edit = (
    Rename
    | Swap
    | DropSpan
    | DropMarker
    | Mirror
    | SetReference
    | MoveBoundary
    | Relabel
    | Split
    | Merge
)
"""Any edit."""


class EditList(StrictModel):
    """What a person mended in a recording and its labels, in order.

    Parameters
    ----------
    recording
        Name of the recording's file.
    sha256
        SHA-256 of the recording's file, 64 hexadecimal digits: the list is for no other.
    edits
        The edits, in the order in which they are applied.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> from mocap_fit.edits import DropSpan, Relabel, Swap, start_edits
    >>> path = mf.load_sample("take_01")
    >>> edits = start_edits(path).add(
    ...     Swap(markers=("lip_upper_mid", "lip_lower_mid"), start=1.0, end=1.5),
    ...     DropSpan(markers=("fold_left",), start=0.2, end=0.3),
    ...     Relabel(time=0.9, phone="O", former="A"),
    ... )
    >>> edits
    <EditList of take_01.tsv: swap, drop_span, relabel>
    >>> before = mf.read_tracks(path)
    >>> after = edits.apply(before)
    >>> bool((after["lip_upper_mid"][-1] == before["lip_upper_mid"][-1]).all())
    True
    >>> after.provenance[-1].name
    'edit'
    """

    format_version: Literal[1] = 1
    recording: str = ""
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    edits: tuple[Annotated[Edit, Field(discriminator="edit")], ...] = ()

    def __repr__(self) -> str:
        return f"<EditList of {self.recording}: {', '.join(e.edit for e in self.edits) or 'empty'}>"

    __str__ = __repr__

    @property
    def reference(self) -> SetReference | None:
        """The last edit that sets the reference pose; None without one."""
        return next((e for e in reversed(self.edits) if isinstance(e, SetReference)), None)

    @property
    def digest(self) -> str:
        """SHA-256 over all that the list says, as hexadecimal digits."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()

    def describe(self) -> list[str]:
        """Return the edits in words.

        Returns
        -------
        list of str
            Such as ``swap: start 1 s, end 1.5 s, lip_upper, lip_lower``.
        """
        return [_describe(edit) for edit in self.edits]

    def add(self, *edits: Edit) -> EditList:
        """Return a list with more edits at its end.

        Parameters
        ----------
        *edits
            The edits.

        Returns
        -------
        EditList
            The longer list.
        """
        return self.model_copy(update={"edits": (*self.edits, *edits)})

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return the edits as JSON and TOML can hold them.

        Returns
        -------
        list of dict
            The values of each edit that are set.
        """
        return [edit.model_dump(mode="json", exclude_none=True) for edit in self.edits]

    def apply(self, tracks: MarkerTracks) -> MarkerTracks:
        """Apply the edits of markers to the recording.

        Parameters
        ----------
        tracks
            The recording, as read.

        Returns
        -------
        MarkerTracks
            The recording, edited; all edits of the list are a step of its provenance.

        Raises
        ------
        DataError
            If an edit cannot be applied; the message says which.
        """
        for number, edit in self._number(MarkerEdit):
            try:
                tracks = edit.apply(tracks)
            except DataError as error:
                raise _name_edit(error, number, edit) from None
        return tracks.add_step("edit", {"edits": self.to_dicts()}) if self.edits else tracks

    def apply_to_labels(
        self,
        labels: Labels,
        tier: str | None = None,
        phone_set: PhoneSet | None = None,
        table: Collection[str] = (),
    ) -> Labels:
        """Apply the edits of phones to the labels of the recording.

        Parameters
        ----------
        labels
            The labels, as read.
        tier
            Name of the tier of phones; found by name and content where left out.
        phone_set
            Phone set of the labels, which must have the new symbols; None where it is not known.
        table
            Symbols that are replaced later, and may be used as well.

        Returns
        -------
        Labels
            The labels, edited.

        Raises
        ------
        DataError
            If an edit cannot be applied; the message says which.
        """
        edits = list(self._number(LabelEdit))
        if not edits:
            return labels
        phones = find_phone_tier(labels, phone_set) if tier is None else labels.get_tier(tier)
        entries: Sequence[Label] = phones.entries
        for number, edit in edits:
            try:
                _check_symbols(edit.symbols, phone_set, table)
                entries = edit.apply(entries)
            except DataError as error:
                raise _name_edit(error, number, edit) from None
        edited = dataclasses.replace(phones, entries=tuple(entries))
        tiers = tuple(edited if one is phones else one for one in labels.tiers)
        return dataclasses.replace(labels, tiers=tiers)

    def _number(self, kind: Any) -> Iterator[tuple[int, Any]]:
        """Yield the edits of a kind with their numbers in the list, from 1."""
        return ((n, edit) for n, edit in enumerate(self.edits, 1) if isinstance(edit, kind))


def _describe(edit: Edit) -> str:
    parts = []
    for name, value in edit.model_dump(exclude={"edit"}, exclude_none=True).items():
        if isinstance(value, float):
            parts.append(f"{name} {value:g} s")
        elif value:
            parts += [value] if isinstance(value, str) else value
    return f"{edit.edit.replace('_', ' ')}: {', '.join(parts) or 'all'}"


def _check_symbols(
    symbols: Collection[str], phone_set: PhoneSet | None, table: Collection[str]
) -> None:
    for symbol in symbols:
        if phone_set is not None and symbol not in table and phone_set.parse(symbol) is None:
            raise DataError(
                f"the phone '{symbol}' is not in the phone set '{phone_set.name}'",
                expected=f"one of {', '.join(phone_set.list_symbols(stress=False))}",
            )


def _name_edit(error: DataError, number: int, edit: Edit) -> DataError:
    """Return an error that says which edit it is of."""
    return DataError(
        f"edit {number} of the edit list ({edit.edit}) cannot be applied: {error.problem}",
        found=error.found,
        expected=error.expected,
        advice=error.advice or "Correct the edit, or take it out of the list.",
    )


class EditHistory:
    """An edit list that grows, and can be taken back.

    Parameters
    ----------
    edits
        The list at the beginning.

    Examples
    --------
    >>> history = EditHistory(EditList(recording="take_01.tsv", sha256="0" * 64))
    >>> history.add(Mirror())
    >>> history.undo(), history.edits
    (True, <EditList of take_01.tsv: empty>)
    >>> history.redo(), history.edits
    (True, <EditList of take_01.tsv: mirror>)
    """

    def __init__(self, edits: EditList) -> None:
        self._lists = [edits]
        self._index = 0

    @property
    def edits(self) -> EditList:
        """The list as it is now."""
        return self._lists[self._index]

    def add(self, edit: Edit) -> None:
        """Add an edit; what was taken back before cannot be brought back any more.

        Parameters
        ----------
        edit
            The edit.
        """
        self._index += 1
        self._lists[self._index :] = [self._lists[self._index - 1].add(edit)]

    def undo(self) -> bool:
        """Take the last edit back.

        Returns
        -------
        bool
            False where there was none.
        """
        return self._step(-1)

    def redo(self) -> bool:
        """Bring back the edit that was taken back last.

        Returns
        -------
        bool
            False where there was none.
        """
        return self._step(1)

    def _step(self, by: int) -> bool:
        moves = 0 <= self._index + by < len(self._lists)
        self._index += by if moves else 0
        return moves
