"""What is looked at, whatever the path is: a head that moves, markers, labels, sound, findings."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from corpus_tools.validation.findings import Finding
from mocap_fit.edits import EditList
from mocap_fit.errors import DataError
from mocap_fit.face import Rig
from mocap_fit.fitting import Layout
from mocap_fit.fitting.speaker import Speaker
from mocap_fit.labels import Labels, Tier, find_phone_tier
from mocap_fit.labels.tiers import find_word_tier
from mocap_fit.phones import PhoneSequence
from mocap_fit.sound import Sound
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks
from mocap_fit.utterance import Utterance

# Frames in which a marker is computed on the face at most, where the fit does not say it.
_MOST_TRACED = 300
Path_ = str | os.PathLike[str]


@dataclass(frozen=True, eq=False)
class Material:
    """What is shown of a path, on one clock.

    Parameters
    ----------
    title
        What it is called.
    path
        The file or folder.
    notes
        Lines that say more.
    rig
        The face; None where none is known.
    heads
        Face parameters by their labels, such as ``fit`` or the name of a model.
    recording
        The markers in the recording's coordinates, with all edits; None without.
    measured
        The markers in the coordinates of the face; None where they are not known.
    marker_residuals
        Distance of each marker of the speaker's binding from where the face has it,
        ``(frames, face markers)``, millimetres of the speaker; None where that is not known yet.
    speaker
        Ties the markers to the face; None where it is not known.
    layout
        The layout of the markers; None where it is not known.
    labels
        Tiers of labels, with all edits; None without.
    phones
        The phones of the labels; None without.
    sound
        Sound, which begins at 0 s; None without.
    findings
        What `validate` says.
    is_checked
        Whether it was asked: long recordings are checked when their findings are looked at.
    is_on_one_clock
        Whether pulses say that recording and sound have one clock.
    utterances
        All utterances of the corpus that it is one of.
    edits
        What was mended; None for what cannot be mended.
    unedited
        The recording as it was read; None for what cannot be mended.
    """

    title: str
    path: Path
    notes: tuple[str, ...] = ()
    rig: Rig | None = None
    heads: Mapping[str, ParameterTracks] = field(default_factory=dict)
    recording: MarkerTracks | None = None
    measured: MarkerTracks | None = None
    marker_residuals: FloatArray | None = None
    speaker: Speaker | None = None
    layout: Layout | None = None
    labels: Labels | None = None
    phones: PhoneSequence | None = None
    sound: Sound | None = None
    findings: tuple[Finding, ...] = ()
    is_checked: bool = True
    is_on_one_clock: bool = False
    utterances: tuple[Utterance, ...] = ()
    edits: EditList | None = None
    unedited: MarkerTracks | None = None

    @property
    def tracks(self) -> tuple[MarkerTracks | ParameterTracks, ...]:
        """All that has frames."""
        markers = [each for each in (self.recording, self.measured) if each is not None]
        return (*self.heads.values(), *markers)

    @property
    def extent(self) -> tuple[float, float]:
        """Start and end, seconds."""
        starts = [each.start_time for each in self.tracks]
        ends = [each.start_time + each.duration for each in self.tracks]
        if self.sound is not None:
            starts, ends = [*starts, 0.0], [*ends, self.sound.duration]
        if self.labels is not None:
            starts, ends = [*starts, self.labels.start], [*ends, self.labels.end]
        start = min(starts, default=0.0)
        return start, max([*ends, start + 1e-3])

    @property
    def rate(self) -> float:
        """Frames a second, hertz: of the parameters, else of the markers."""
        return next((each.rate for each in self.tracks), 60.0)

    @property
    def tiers(self) -> dict[str, Tier]:
        """The tiers of words and of phones, as far as there are any."""
        if self.labels is None:
            return {}
        try:
            phones = find_phone_tier(self.labels)
        except DataError:
            return {tier.name: tier for tier in self.labels.tiers[:2]}
        words = find_word_tier(self.labels, phones)
        tiers = {} if words in (None, phones) else {"words": words}
        return {**tiers, "phones": phones}

    def compute_virtual(self, label: str, times: FloatArray) -> FloatArray | None:
        """Compute the markers on the face.

        Parameters
        ----------
        label
            Which of the heads.
        times
            Times, ``(times,)``, seconds.

        Returns
        -------
        ndarray or None
            Positions, ``(times, face markers, 3)``, millimetres of the face, in the order of the
            speaker's binding; None without a speaker.
        """
        if self.speaker is None or self.rig is None or label not in self.heads:
            return None
        from mocap_fit.render.sampling import sample_parameters

        values = sample_parameters(self.heads[label], times, self.rig)
        return np.array([self.speaker.binding.evaluate(each)[0] for each in values])

    def trace_residual(self, name: str) -> tuple[FloatArray, FloatArray] | None:
        """Trace how far a marker is from where the face has it.

        Parameters
        ----------
        name
            The marker.

        Returns
        -------
        times : ndarray
            Times at a constant rate, ``(times,)``, seconds.
        residuals : ndarray
            Distances, ``(times,)``, millimetres of the speaker; None without a face.
        """
        measured, speaker = self.measured, self.speaker
        if speaker is None or measured is None or name not in speaker.binding.names:
            return None
        index = speaker.binding.names.index(name)
        if self.marker_residuals is not None:
            return measured.times, self.marker_residuals[:, index]
        label = next(iter(self.heads), "")
        step = max(measured.frames // _MOST_TRACED, 1)
        virtual = self.compute_virtual(label, measured.times[::step])
        if virtual is None:
            return None
        apart = measured[name][::step] - virtual[:, index]
        scale = speaker.binding.orientation.scale
        return measured.times[::step], np.linalg.norm(apart, axis=1) / scale

    def replace(self, **changes: object) -> Material:
        """Return a copy with some fields changed.

        Parameters
        ----------
        **changes
            New values by name of the field.

        Returns
        -------
        Material
            The copy.
        """
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]


def list_marks(findings: Sequence[Finding], rate: float) -> list[tuple[float, float, Finding]]:
    """List the findings that have a time, in order of time.

    Parameters
    ----------
    findings
        What `validate` says.
    rate
        Frames a second of what was checked, hertz.

    Returns
    -------
    list of tuple
        Start and end, seconds, and the finding.
    """
    marks = []
    for finding in findings:
        seconds, frames = finding.location.seconds, finding.location.frames
        if seconds is None and frames is not None:
            seconds = frames[0] / rate, frames[1] / rate
        if seconds is not None:
            marks.append((seconds[0], seconds[1], finding))
    return sorted(marks, key=lambda mark: mark[:2])
