"""Checks of sound: clipping, silence, and the clocks of sound and recording."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from corpus_tools.validation.findings import Finding, Location
from corpus_tools.validation.labels import Loudness
from corpus_tools.validation.thresholds import Thresholds
from mocap_fit.errors import DataError
from mocap_fit.sound import Sound, decode_pulses
from mocap_fit.tracks import FloatArray, Tracks
from mocap_fit.tracks.interpolation import find_runs

_STEP = 0.01
# Hertz.
_BAND = (200.0, 4000.0)
_TENTH = 0.1


def measure_loudness(sound: Sound) -> Loudness:
    """Measure the energy of the band of speech, every 10 ms over 25 ms.

    Rumble of a room or a car is below the band, and is no sign of speech.

    Parameters
    ----------
    sound
        The sound.

    Returns
    -------
    Loudness
        Times and energy.
    """
    from scipy.signal import butter, sosfilt

    samples = sound.samples.mean(axis=1)
    if 0.45 * sound.rate > 2 * _BAND[0]:
        band = (_BAND[0], min(_BAND[1], 0.45 * sound.rate))
        samples = sosfilt(butter(2, band, "bandpass", fs=sound.rate, output="sos"), samples)
    half = max(1, round(0.0125 * sound.rate))
    sums = np.concatenate([[0.0], np.cumsum(samples**2)])
    centres = np.arange(0, len(samples), max(1, round(_STEP * sound.rate)))
    low, high = np.maximum(centres - half, 0), np.minimum(centres + half, len(samples))
    power = (sums[high] - sums[low]) / (high - low)
    return Loudness(centres / sound.rate, 10 * np.log10(np.maximum(power, 1e-10)))


def check_sound(sound: Sound, location: Location, limits: Thresholds) -> Iterator[Finding]:
    """Find sound that is clipped or silent.

    Parameters
    ----------
    sound
        Speech, without a channel of pulses.
    location
        The file and the utterance.
    limits
        What counts as wrong.

    Yields
    ------
    Finding
        What is wrong.
    """
    rules = limits.sound
    for number in range(1, sound.channels + 1):
        channel = sound.get_channel(number)
        top = float(np.abs(channel).max())
        flat = (np.abs(channel) >= rules.clipped_level * top) & (top >= rules.clipped_level)
        clipped = [run for run in find_runs(flat) if run.stop - run.start >= rules.clipped_run]
        count = sum(run.stop - run.start for run in clipped)
        if count > rules.clipped_share * len(channel):
            first = clipped[0].start / sound.rate
            last = clipped[-1].stop / sound.rate
            where = location.at(f"channel {number}", seconds=(first, last))
            text = f"{count} samples at full scale, in {len(clipped)} places"
            yield Finding("MF401", where, text, f"at most {rules.clipped_share:.2%} of the samples")
    levels = measure_tenths(sound)
    loudest, quietest = float(levels.max()), float(levels.min())
    if loudest < rules.silent_db or loudest - quietest < rules.speech_over_noise:
        text = f"the loudest tenth of a second has {loudest:.0f} dB, the quietest {quietest:.0f} dB"
        expected = f"more than {rules.silent_db:g} dB, and {rules.speech_over_noise:g} dB apart"
        yield Finding("MF402", location, text, expected)


def measure_tenths(sound: Sound) -> FloatArray:
    """Measure the energy of every tenth of a second.

    Parameters
    ----------
    sound
        The sound.

    Returns
    -------
    ndarray
        Energy, ``(tenths,)``, decibels.
    """
    size = max(1, round(_TENTH * sound.rate))
    samples = sound.samples.mean(axis=1)
    length = len(samples) // size * size
    parts = samples[:length].reshape(-1, size) if length else samples[None]
    return np.asarray(10 * np.log10(np.maximum((parts**2).mean(axis=1), 1e-10)))


def check_lengths(
    tracks: Tracks,
    sound_end: float,
    labels_end: float | None,
    location: Location,
    limits: Thresholds,
) -> Iterator[Finding]:
    """Compare the lengths of a recording, its sound and its labels.

    What two of the three agree on is taken for right: a recording that differs has another rate
    than it says, a sound that differs was cut.

    Parameters
    ----------
    tracks
        The recording.
    sound_end
        End of the sound, seconds.
    labels_end
        End of the labels, seconds; None where there are none.
    location
        The file and the utterance.
    limits
        What counts as wrong.

    Yields
    ------
    Finding
        What is wrong.
    """
    rules = limits.time

    def is_different(one: float, other: float) -> bool:
        allowed: float = max(rules.length, rules.length_share * max(one, other))
        return abs(one - other) > allowed

    frames, rate, start_time = tracks.frames, tracks.rate, tracks.start_time
    recorded = start_time + frames / rate
    if not is_different(recorded, sound_end):
        return
    likely = frames / max(sound_end - start_time, 1e-9)
    if labels_end is not None and not is_different(labels_end, sound_end):
        # Labels may stop before the recording does; only the recording can be stretched.
        text = f"{frames} frames at {rate:g} Hz last until {recorded:.3f} s; "
        text += f"sound and labels end at {sound_end:.3f} s"
        times = f"{likely / rate:.3g} times"
        expected = f"about {likely:.4g} Hz ({times}), or a recording of {sound_end:.3f} s"
        yield Finding("MF141", location, text, expected)
        return
    cut = labels_end is not None and not is_different(labels_end, recorded)
    text = f"the recording ends at {recorded:.3f} s, the sound at {sound_end:.3f} s"
    text += ", the labels with the recording" if cut else ""
    reason = ": the sound was cut" if cut and sound_end < recorded else f", or {likely:.4g} Hz"
    yield Finding("MF143", location, text, f"the same length{reason}")


def check_pulses(
    sound: Sound, rate: float, frames: int, location: Location, limits: Thresholds
) -> tuple[int | None, list[Finding]]:
    """Look for a channel with a pulse a frame, and compare the clocks.

    Parameters
    ----------
    sound
        Of two or more channels.
    rate
        Frame rate of the recording, hertz.
    frames
        Of the recording.
    location
        The file and the utterance.
    limits
        What counts as wrong.

    Returns
    -------
    channel
        The number of the channel; None where there is none.
    findings
        What is wrong with it.
    """
    for number in range(1, sound.channels + 1):
        try:
            train = decode_pulses(sound.get_channel(number), sound.rate, rate)
        except DataError:
            continue
        where = location.at(f"channel {number}")
        findings = list(check_clock(train.drift_ppm, train.residual or 0.0, where, limits))
        share = float(train.present.sum()) / max(1, frames)
        if train.frames != frames or share < limits.time.pulses_heard:
            text = f"{int(train.present.sum())} pulses, {int((~train.present).sum())} missing"
            findings.append(Finding("MF146", where, text, f"{frames}, one a frame"))
        return number, findings
    return None, []


def check_clock(
    drift_ppm: float, residual: float, location: Location, limits: Thresholds
) -> Iterator[Finding]:
    """Judge the drift between two clocks, and the scatter of the pulses.

    Parameters
    ----------
    drift_ppm
        Drift between the clocks, millionths.
    residual
        Scatter of the pulses, seconds.
    location
        The file and the utterance.
    limits
        What counts as wrong.

    Yields
    ------
    Finding
        What is wrong.
    """
    rules = limits.time
    if abs(drift_ppm) > rules.drift:
        yield Finding("MF145", location, f"{drift_ppm:+.0f} ppm", f"at most {rules.drift:g} ppm")
    if residual > rules.pulse_residual:
        text = f"pulses scatter by {1000 * residual:.2f} ms about an even clock"
        yield Finding("MF146", location, text, f"at most {1000 * rules.pulse_residual:g} ms")
