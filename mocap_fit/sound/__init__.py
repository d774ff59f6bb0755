"""Sound: wav files, energy, and what ties the sound's clock to that of the recording."""

from mocap_fit.sound.energy import energy_db
from mocap_fit.sound.wav import Sound, read_sound, write_sound

__all__ = ["Sound", "energy_db", "read_sound", "write_sound"]
