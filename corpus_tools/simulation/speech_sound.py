"""A sound that follows the phones, and the pulses beside it.

A buzz of a falling pitch and white noise pass through resonances and bands that change every five
milliseconds, with the numbers of ``speech_sound.toml``. What matters is that energy follows the
phones: loud vowels, quieter nasals, hissing, silent closures with bursts.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from corpus_tools.simulation.session import draw_gesture
from corpus_tools.simulation.traits import Rule, get_traits, load_table
from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.settings_file import StrictModel
from mocap_fit.tracks import FloatArray

RATE = 16000
"""Samples a second."""

_HOP, _WINDOW = 80, 320
_SILENT = -99.0
# The longest burst of a stop, seconds.
_BURST = 0.025
# Frames over which levels and formants go over into each other.
_LEVEL_FRAMES, _FORMANT_FRAMES = 4, 10
# Seconds, at most this part of a frame; part of full scale.
_PULSE, _PULSE_SHARE, _PULSE_HEIGHT = 0.001, 0.25, 0.7


class _Sound(Rule):
    voice: float
    noise: float
    centre: float = 2000.0
    width: float = 1000.0
    closed: float = 0.0


class _Formants(StrictModel):
    first: dict[str, float]
    second: dict[str, float]
    third: dict[str, float]
    widths: tuple[float, float, float]


class _Voice(StrictModel):
    start: float
    end: float
    accent: float
    wandering: float
    without_stress: float
    open: float
    background: float
    peak: float


class SpeechSound(StrictModel):
    """The settings of the synthetic voice, ``speech_sound.toml``."""

    sounds: tuple[_Sound, ...]
    formants: _Formants
    voice: _Voice


@cache
def load_speech_sound() -> SpeechSound:
    """Load the table that comes with the simulation.

    Returns
    -------
    SpeechSound
        Levels, formants and noise of all phones.
    """
    return load_table("speech_sound", SpeechSound)


def synthesise_sound(
    phones: PhoneSequence,
    phone_set: PhoneSet,
    rng: np.random.Generator,
    table: SpeechSound | None = None,
) -> FloatArray:
    """Synthesise a sound whose energy follows the phones.

    Parameters
    ----------
    phones
        The phones, from 0 s.
    phone_set
        Their set.
    rng
        Generator of the pitch and the noise.
    table
        The voice; the one that comes with the simulation where it is None.

    Returns
    -------
    ndarray
        The sound, ``(samples,)``, at `RATE` samples a second, -1 to 1.
    """
    table = load_speech_sound() if table is None else table
    duration = phones[len(phones) - 1].end
    count = round(duration * RATE)
    frames = count // _HOP + _WINDOW // _HOP + 1
    times = (np.arange(frames) * _HOP + _HOP / 2 - _WINDOW / 2) / RATE
    levels, formants, band, accents = _compute_tracks(phones, phone_set, times, table)
    pitch = np.interp(times, [0.0, duration], [table.voice.start, table.voice.end])
    slow = draw_gesture(rng, frames, RATE / _HOP, 2.0, -1.0, 1.0)
    pitch = pitch * (1.0 + table.voice.accent * accents + table.voice.wandering * slow)
    length = frames * _HOP + _WINDOW
    phase = np.cumsum(np.interp(np.arange(length), np.arange(frames) * _HOP, pitch)) / RATE
    buzz = np.diff(np.floor(phase), prepend=0.0)
    hiss = rng.standard_normal(length)
    frequencies = np.arange(_WINDOW // 2 + 1, dtype=np.float64) * (RATE / _WINDOW)
    shapes = (_compute_resonances(frequencies, formants, table), _compute_bands(frequencies, band))
    window = np.sqrt(np.hanning(_WINDOW + 1)[:-1])
    starts = np.arange(frames)[:, None] * _HOP + np.arange(_WINDOW)
    out = np.zeros(length)
    for source, shape, level in zip((buzz, hiss), shapes, levels.T, strict=True):
        spectrum = np.fft.rfft(source[starts] * window) * shape
        part = np.fft.irfft(spectrum, _WINDOW)
        # Every frame as loud as its level says, whatever its spectrum.
        power = np.sqrt(np.mean(part**2, axis=1, keepdims=True))
        part *= 10.0 ** (level[:, None] / 20.0) / np.maximum(power, 1e-9) * window
        np.add.at(out, starts.ravel(), part.ravel())
    out = out[_WINDOW // 2 : _WINDOW // 2 + count]
    loudest = float(np.abs(out).max())
    if loudest > 0:
        out *= table.voice.peak / loudest
    background = table.voice.peak * 10.0 ** (table.voice.background / 20.0)
    return np.asarray(np.clip(out + background * rng.standard_normal(count), -1.0, 1.0))


def create_sync_pulses(times: FloatArray, samples: int, rate: float = RATE) -> FloatArray:
    """Create a channel with a pulse at each of the times.

    Parameters
    ----------
    times
        Beginnings of the pulses, ``(frames,)``, seconds; each is moved to the nearest sample.
    samples
        Length of the channel.
    rate
        Samples a second, hertz.

    Returns
    -------
    ndarray
        The channel, ``(samples,)``, 0 to 1.
    """
    channel = np.zeros(samples)
    width = max(1, round(min(_PULSE, _PULSE_SHARE * float(np.median(np.diff(times)))) * rate))
    for start in locate_pulses(times, rate):
        channel[max(start, 0) : max(start + width, 0)] = _PULSE_HEIGHT
    return channel


def locate_pulses(times: FloatArray, rate: float = RATE) -> list[int]:
    """Return the samples at which pulses begin.

    Parameters
    ----------
    times
        Beginnings of the pulses, ``(frames,)``, seconds.
    rate
        Samples a second, hertz.

    Returns
    -------
    list of int
        The nearest sample of each.
    """
    return [int(sample) for sample in np.round(times * rate)]


def _compute_tracks(
    phones: PhoneSequence, phone_set: PhoneSet, times: FloatArray, table: SpeechSound
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Compute levels ``(frames, 2)``, formants ``(frames, 3)``, noise bands and accents."""
    count = len(times)
    levels = np.full((count, 2), _SILENT)
    formants = np.tile([table.formants.first["base"], 1450.0, 2550.0], (count, 1))
    band = np.tile([2000.0, 1000.0], (count, 1))
    accents = np.zeros(count)
    indices = phones.at(times)
    for i, segment in enumerate(phones):
        inside = indices == i
        if not inside.any():
            continue
        traits = get_traits(phone_set.get_phone(segment))
        sound = next(sound for sound in table.sounds if sound.is_met_by(traits))
        voice, noise = sound.voice, np.full(int(inside.sum()), sound.noise)
        if traits["vowel"]:
            voice += table.voice.open * (traits["open"] - 1.0)
            voice += 0.0 if segment.stress else table.voice.without_stress
            accents[inside] = float(segment.stress == 1)
        if sound.closed:
            burst = max(segment.start + sound.closed * segment.duration, segment.end - _BURST)
            if traits["fricative"] == 1:
                burst = segment.start + sound.closed * segment.duration
            noise[times[inside] < burst] = _SILENT
        levels[inside, 0], levels[inside, 1] = voice, noise
        band[inside] = sound.centre, sound.width
        of = table.formants
        formants[inside] = [
            row["base"] + sum(factor * traits[n] for n, factor in row.items() if n != "base")
            for row in (of.first, of.second, of.third)
        ]
    # Levels change in amplitude: a closure is quick to begin, and never a click.
    amplitudes = _spread(10.0 ** (levels / 20.0), _LEVEL_FRAMES)
    levels = 20.0 * np.log10(np.maximum(amplitudes, 1e-5))
    return levels, _spread(formants, _FORMANT_FRAMES), band, _spread(accents[:, None], 20)[:, 0]


def _spread(tracks: FloatArray, frames: int) -> FloatArray:
    weights = np.hanning(frames + 3)[1:-1]
    weights /= weights.sum()
    padded = np.pad(tracks, ((len(weights) // 2, (len(weights) - 1) // 2), (0, 0)), mode="edge")
    return np.stack([np.convolve(row, weights, "valid") for row in padded.T], axis=1)


def _compute_resonances(
    frequencies: FloatArray, formants: FloatArray, table: SpeechSound
) -> FloatArray:
    """Gain of the vocal tract and the voice's own fall, `(frames, frequencies)`."""
    gain: FloatArray = np.tile(1.0 / (1.0 + (frequencies / 400.0) ** 2), (len(formants), 1))
    for centre, width in zip(formants.T, table.formants.widths, strict=True):
        f = centre[:, None]
        gain = gain * f**2 / np.hypot(f**2 - frequencies**2, width * frequencies + 1.0)
    return np.asarray(gain)


def _compute_bands(frequencies: FloatArray, band: FloatArray) -> FloatArray:
    centre, width = band[:, :1], band[:, 1:]
    return np.exp(-0.5 * ((frequencies - centre) / width) ** 2)
