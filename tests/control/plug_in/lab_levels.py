"""A control model of a lab of its own: a level for vowels, one for consonants, one for silence."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mocap_fit.control import ControlModel, LogEntry
from mocap_fit.errors import DataError

KINDS = ("vowel", "consonant", "silence")


@dataclass(eq=False)
class Levels(ControlModel):
    """Levels."""

    factor: float = 1.0

    name: ClassVar[str] = "lab-levels"
    title: ClassVar[str] = "Levels of a lab"

    look_ahead = 0.0
    look_back = 0.0

    @property
    def parameter_count(self):
        return 3 * len(self.parameter_names_)

    def _levels(self, phones, times):
        kinds = [KINDS.index(self.phone_set_.get_phone(s).kind) for s in phones]
        found = phones.at(times)
        return np.where(found >= 0, np.array(kinds)[found], 2)

    def _fit(self, corpus, validation, progress, checkpoint):
        values = np.concatenate([u.read_tracks().values for u in corpus])
        levels = np.concatenate(
            [self._levels(u.read_phones(), u.read_tracks().times) for u in corpus]
        )
        self.levels_ = np.zeros((3, values.shape[1]))
        for level in range(3):
            for column in range(values.shape[1]):
                part = values[levels == level, column]
                part = part[np.isfinite(part)]
                self.levels_[level, column] = self.factor * part.mean() if len(part) else 0.0
        progress(LogEntry(1, 0.0, None if validation is None else 0.0))

    def _predict(self, phones, times):
        return self.levels_[self._levels(phones, times)]

    def _state(self):
        return {}, {"levels": self.levels_}

    def _restore(self, values, arrays):
        self.levels_ = arrays["levels"]
        if self.levels_.shape != (3, len(self.parameter_names_)):
            raise DataError("the levels do not fit")
        if not np.isfinite(self.levels_).all():
            raise DataError("the levels are not finite")
