"""A control model of another laboratory: a level for each kind of phones."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import NonNegativeFloat

from mocap_fit.control import ControlModel, LogEntry
from mocap_fit.errors import DataError

KINDS = ("vowel", "consonant", "silence")


@dataclass(eq=False, repr=False)
class Levels(ControlModel):
    """The mean of all vowels, all consonants and all silence, times a factor."""

    factor: NonNegativeFloat = 1.0

    name: ClassVar[str] = "lab-levels"
    title: ClassVar[str] = "Levels of a lab"

    look_ahead = 0.0
    look_back = 0.0

    @property
    def parameter_count(self):
        return 3 * len(self.parameter_names_)

    def _classify(self, phones, times):
        kinds = [KINDS.index(self.phone_set_.get_phone(segment).kind) for segment in phones]
        segments = phones.at(times)
        return np.where(segments >= 0, np.array(kinds)[segments], 2)

    def _fit(self, corpus, validation, progress, checkpoint):
        tracks = [utterance.read_tracks() for utterance in corpus]
        phones = [utterance.read_phones() for utterance in corpus]
        values = np.concatenate([each.values for each in tracks])
        pairs = zip(phones, tracks, strict=True)
        kinds = np.concatenate([self._classify(p, each.times) for p, each in pairs])
        # Frames with a missing value of a parameter do not count for it.
        parts = [np.ma.masked_invalid(values[kinds == kind]) for kind in range(3)]
        self.levels_ = np.array([self.factor * part.mean(axis=0).filled(0.0) for part in parts])
        progress(LogEntry(1, 0.0, None if validation is None else 0.0))

    def _predict(self, phones, times):
        return self.levels_[self._classify(phones, times)]

    def _state(self):
        return {}, {"levels": self.levels_}

    def _restore(self, values, arrays):
        self.levels_ = arrays["levels"]
        shape = (3, len(self.parameter_names_))
        if self.levels_.shape != shape or not np.isfinite(self.levels_).all():
            raise DataError("the levels of the model are damaged", expected=shape)
