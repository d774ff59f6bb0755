"""Sound: wav files, energy, and what ties the sound's clock to that of the recording."""

from mocap_fit.sound.energy import energy_db
from mocap_fit.sound.estimate import OffsetEstimate, estimate_offset
from mocap_fit.sound.pulses import PulseTrain, decode_pulses
from mocap_fit.sound.synchronisation import Synchronisation, SyncKind, synchronise
from mocap_fit.sound.wav import Sound, read_sound, write_sound

__all__ = [
    "OffsetEstimate",
    "PulseTrain",
    "Sound",
    "SyncKind",
    "Synchronisation",
    "decode_pulses",
    "energy_db",
    "estimate_offset",
    "read_sound",
    "synchronise",
    "write_sound",
]
