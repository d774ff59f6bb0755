"""``mocap-fit simulate``: a corpus with known truth.

Sentences of a small grammar (`sentences`), phone times from a duration model (`durations`) or
espeak-ng, articulation by overlapping gestures (`articulation`), a sound that follows the phones
(`speech_sound`), and a speaker with markers on (`session`).
"""

from corpus_tools.simulation.sentences import languages
from corpus_tools.simulation.session import (
    OTHER_SPEAKER,
    Conditions,
    Session,
    Simulation,
    gesture,
    marker_places,
)
from corpus_tools.simulation.writing import DURATIONS, Spoken, simulate

__all__ = [
    "DURATIONS",
    "OTHER_SPEAKER",
    "Conditions",
    "Session",
    "Simulation",
    "Spoken",
    "gesture",
    "languages",
    "marker_places",
    "simulate",
]
