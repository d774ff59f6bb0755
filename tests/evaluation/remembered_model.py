"""A small corpus, and a control model of a few lines whose errors are known exactly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mocap_fit.control import ControlModel, Progress
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.phones import PhoneSegment, PhoneSequence
from mocap_fit.tracks import ParameterTracks

RATE = 50.0


@dataclass
class Remembered(ControlModel):
    """It remembers the utterances it saw, by name, and is wrong by as much as it is told."""

    shift: float = 0.0
    scale: float = 1.0
    name: ClassVar[str] = "remembered"
    title: ClassVar[str] = "Remembered"

    def _fit(
        self,
        corpus: Corpus,
        validation: Corpus | None,
        progress: Progress,
        checkpoint: Path | None,
    ) -> None:
        self.tracks_ = {u.id: u.read_tracks() for u in corpus}

    def _predict(self, phones: PhoneSequence, times: np.ndarray) -> np.ndarray:
        tracks = self.tracks_[phones.name]
        columns = [np.interp(times, tracks.times, column) for column in tracks.values.T]
        return self.shift + self.scale * np.stack(columns, axis=1)

    @property
    def parameter_count(self) -> int:
        return sum(tracks.values.size for tracks in self.tracks_.values())

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        return {}, {}

    def _restore(self, values: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
        pass


def spoken(name: str, seed: int, names: tuple[str, ...]) -> Utterance:
    """Silence, a bilabial, an open vowel, a consonant, silence; random smooth tracks."""
    segments = (
        PhoneSegment(0.0, 0.2, "SIL"),
        PhoneSegment(0.2, 0.4, "B"),
        PhoneSegment(0.4, 0.8, "AA", 1),
        PhoneSegment(0.8, 1.0, "S"),
        PhoneSegment(1.0, 1.2, "SIL"),
    )
    phones = PhoneSequence(segments, phone_set="en-arpabet", name=name)
    rng = np.random.default_rng(seed)
    times = np.arange(60) / RATE
    waves = rng.uniform(2, 9, len(names)) * times[:, None] + rng.uniform(0, 6, len(names))
    values = 0.02 * np.sin(waves)
    if "jaw_rotation" in names:
        values[:, names.index("jaw_rotation")] = np.interp(
            times, [0.2, 0.3, 0.45, 0.6, 0.8], [0.05, 0.0, 0.5, 0.6, 0.1]
        )
    return Utterance.from_tracks(ParameterTracks(names, RATE, values, name=name), phones)
