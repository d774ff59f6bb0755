"""``mocap-fit simulate``: a corpus with known truth.

Sentences of a small grammar (`sentences`), phone times from a duration model (`durations`) or
espeak-ng, articulation by overlapping gestures (`articulation`), a sound that follows the phones
(`speech_sound`), and a speaker with markers on (`session`).
"""

from corpus_tools.simulation.sentences import list_languages
from corpus_tools.simulation.session import (
    OTHER_SPEAKER,
    Conditions,
    Session,
    Simulation,
    draw_gesture,
    locate_markers,
)
from corpus_tools.simulation.simulate import DURATIONS, SimulatedCorpus, Spoken, simulate

__all__ = [
    "DURATIONS",
    "OTHER_SPEAKER",
    "Conditions",
    "Session",
    "SimulatedCorpus",
    "Simulation",
    "Spoken",
    "draw_gesture",
    "list_languages",
    "locate_markers",
    "simulate",
]
