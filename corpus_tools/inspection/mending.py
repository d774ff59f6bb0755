"""Mending in the window: edits of markers and phones, their history, and their file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from corpus_tools.inspection.gather import gather_recording
from corpus_tools.inspection.material import Material
from corpus_tools.inspection.sources import Sources
from mocap_fit.edits import EDITS_ENDING, Edit, EditHistory, EditList, locate_edits, write_edits
from mocap_fit.tracks import MarkerTracks


@dataclass
class Mending:
    """A recording and what is mended in it.

    Parameters
    ----------
    path
        The recording.
    tracks
        What it holds, without edits.
    edits
        What was mended before.
    sources
        What belongs to it.
    material
        What there is to show.
    """

    path: Path
    tracks: MarkerTracks
    edits: EditList
    sources: Sources
    material: Material

    def __post_init__(self) -> None:
        self._history = EditHistory(self.edits)
        self._saved = self.edits

    @property
    def is_saved(self) -> bool:
        """Whether the file has all edits."""
        return self._history.edits == self._saved

    @property
    def file(self) -> Path:
        """Where the edit list is, or will be."""
        where = self.sources.edits
        known = locate_edits(self.path, where)
        folder = self.path.parent if where is None else Path(where)
        return known or folder / f"{self.path.name}{EDITS_ENDING}"

    def to_edit_times(self, start: float, end: float) -> tuple[float, float]:
        """Return a stretch of time on the recording's clock, as its file is read.

        Parameters
        ----------
        start, end
            Its ends as they are shown, on the clock of the sound, seconds.

        Returns
        -------
        tuple of float
            Times halfway between frames, so that no rounding matters, seconds.
        """
        shown = self.material.recording
        tracks = self.tracks if shown is None else shown
        first, stop = (
            int(np.ceil((time - tracks.start_time) * tracks.rate - 1e-3)) for time in (start, end)
        )
        frames = first, max(stop, first + 1)
        one, other = (self.tracks.start_time + (n - 0.5) / self.tracks.rate for n in frames)
        return round(one, 5), round(other, 5)

    def add(self, edit: Edit) -> Material:
        """Add an edit, if it can be applied.

        Parameters
        ----------
        edit
            The edit.

        Returns
        -------
        Material
            What there is to show now.

        Raises
        ------
        MocapFitError
            If it cannot be applied; the list is then as before.
        """
        material = self._gather(self._history.edits.add(edit))
        self._history.add(edit)
        self.edits = self._history.edits
        return material

    def undo(self) -> Material | None:
        """Take the last edit back; None where there is none.

        Returns
        -------
        Material or None
            What there is to show now.
        """
        return self._change(self._history.undo())

    def redo(self) -> Material | None:
        """Bring back the edit that was taken back last; None where there is none.

        Returns
        -------
        Material or None
            What there is to show now.
        """
        return self._change(self._history.redo())

    def save(self) -> Path:
        """Write the edit list, completely or not at all.

        Returns
        -------
        Path
            Its file.

        Raises
        ------
        FileFormatError
            If it cannot be written.
        """
        write_edits(self.edits, self.file)
        self._saved = self.edits
        return self.file

    def _change(self, has_changed: bool) -> Material | None:
        if not has_changed:
            return None
        self.edits = self._history.edits
        return self._gather(self.edits)

    def _gather(self, edits: EditList) -> Material:
        self.material = gather_recording(self.path, self.tracks, edits, self.sources, self.material)
        return self.material


def start_mending(material: Material, sources: Sources) -> Mending | None:
    """Begin to mend what is shown, where it is a recording.

    Parameters
    ----------
    material
        What is shown.
    sources
        What belongs to it.

    Returns
    -------
    Mending or None
        None for what is no recording.
    """
    if material.edits is None or material.unedited is None:
        return None
    return Mending(material.path, material.unedited, material.edits, sources, material)
