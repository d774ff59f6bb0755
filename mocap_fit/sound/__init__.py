"""Sound: files, energy, and what ties the sound's clock to that of the recording."""

from mocap_fit.sound.energy import energy_db
from mocap_fit.sound.estimate import OffsetEstimate, estimate_offset
from mocap_fit.sound.pulses import PulseTrain, decode_pulses
from mocap_fit.sound.resampling import resample
from mocap_fit.sound.sound import Sound
from mocap_fit.sound.sound_file import SOUND_ENDINGS, is_plain_wav, read_sound, write_sound
from mocap_fit.sound.synchronisation import Synchronisation, SyncKind, synchronise

__all__ = [
    "SOUND_ENDINGS",
    "OffsetEstimate",
    "PulseTrain",
    "Sound",
    "SyncKind",
    "Synchronisation",
    "decode_pulses",
    "energy_db",
    "estimate_offset",
    "is_plain_wav",
    "read_sound",
    "resample",
    "synchronise",
    "write_sound",
]
