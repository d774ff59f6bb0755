"""The offset of sound by lips and energy: known offsets, and the estimate computed plainly."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from mocap_fit.errors import DataError
from mocap_fit.sound import Sound, energy_db, estimate_offset
from mocap_fit.sound.estimate import (
    _count_near_peak,
    _filter_speech_band,
    _interpolate_peak,
    _remove_slow_part,
)

RATE = 60.0


def syllables(seed=0, duration=4.0, start=0.13, rate=RATE):
    """Lips that open and close, and a voice that is loud when they are open."""
    rng = np.random.default_rng(seed)
    knots = np.arange(-1, duration + 2, 0.11)
    opening = np.clip(rng.uniform(-5, 15, len(knots)), 0, None)
    frames = np.interp(start + np.arange(int(rate * duration)) / rate, knots, opening)
    times = np.arange(int(16000 * (duration + 0.6))) / 16000
    voice = rng.normal(size=len(times)) * np.interp(times, knots, opening) / 60
    return frames, Sound(voice + rng.normal(0, 1e-4, len(times)), 16000)


def plain_correlations(opening, rate, sound, lags):
    """Correlations by numpy alone: band of 300 to 3000 Hz, 40 dB deep, nothing below 3 Hz."""
    band = butter(2, (300, 3000), "bandpass", fs=sound.rate, output="sos")
    speech = Sound(sosfiltfilt(band, sound.samples.mean(axis=1)), sound.rate)
    grid = np.arange(0.0, sound.duration, 0.005)
    energy = energy_db(speech, grid, window=0.04)
    energy = np.clip(energy, energy.max() - 40, None)
    energy = sosfiltfilt(butter(1, 3, "highpass", fs=200, output="sos"), energy, padlen=9)
    visible = np.isfinite(opening)
    times = np.arange(len(opening)) / rate
    lips = np.interp(times, times[visible], opening[visible])
    lips = sosfiltfilt(butter(1, 3, "highpass", fs=rate, output="sos"), lips, padlen=9)
    result = []
    for lag in lags:
        inside = visible & (times + lag >= 0) & (times + lag <= grid[-1])
        at = np.interp(times[inside] + lag, grid, energy)
        result.append(np.corrcoef(lips[inside], at)[0, 1])
    return np.array(result)


@pytest.mark.parametrize("start", [-0.2, 0.0, 0.13, 0.35])
def test_a_known_offset(start):
    opening, sound = syllables(start=start)
    estimate = estimate_offset(opening, RATE, sound)
    assert estimate.start_time == pytest.approx(start, abs=0.02)
    assert estimate.correlation > 0.5
    assert 0 < estimate.half_width < 0.1


@pytest.mark.parametrize(("seed", "start"), [(0, 0.13), (1, 0.31), (2, -0.14)])
def test_it_is_the_largest_correlation(seed, start):
    opening, sound = syllables(seed, start=start)
    opening[100:110] = np.nan
    lags = 0.005 * np.arange(-100, 101)
    correlations = plain_correlations(opening, RATE, sound, lags)
    estimate = estimate_offset(opening, RATE, sound)
    best = int(np.argmax(correlations))
    assert estimate.correlation == pytest.approx(correlations[best], abs=1e-9)
    # The vertex of the parabola through the three highest.
    square, line, _ = np.polyfit([-1, 0, 1], correlations[best - 1 : best + 2], 2)
    vertex = lags[best] - 0.005 * line / (2 * square)
    assert estimate.start_time == pytest.approx(vertex, abs=1e-9)
    near = correlations >= 0.9 * correlations[best]
    left = right = best
    while near[left - 1]:
        left -= 1
    while near[right + 1]:
        right += 1
    assert right > left
    assert estimate.half_width == pytest.approx(0.005 * (right - left) / 2)


@pytest.mark.parametrize(
    ("correlations", "best", "steps"),
    [
        ([0.1, 0.5, 1.0, 0.5, 0.1], 2, 1),
        ([0.1, 0.91, 1.0, 0.89, 0.95], 2, 1),
        ([0.2, 0.44, 0.45, 0.5, 0.46, 0.45, 0.44], 3, 3),
        ([np.nan, 0.95, 1.0, 0.95, np.nan], 2, 2),
        ([0.95, 1.0, 1.0, 0.9], 1, 3),
    ],
)
def test_how_wide_a_peak_is(correlations, best, steps):
    assert _count_near_peak(np.array(correlations), best) == steps


def test_a_peak_of_one_step_is_as_wide_as_a_step():
    """Clicks every 0.8 s and lips that open in one frame."""
    rng = np.random.default_rng(0)
    times = np.arange(16000 * 4) / 16000
    burst = rng.normal(size=len(times)) * (np.abs(times % 0.8 - 0.4) < 0.02)
    opening = np.where(np.abs((np.arange(200) / 50 + 0.1) % 0.8 - 0.4) < 0.011, 1.0, 0.0)
    estimate = estimate_offset(opening, 50.0, Sound(burst, 16000))
    assert estimate.start_time == pytest.approx(0.1, abs=0.02)
    assert 0.0025 <= estimate.half_width < 0.02


def test_the_peak_of_a_parabola():
    values = [-3 * (x - 0.2) ** 2 + 1 for x in (-1, 0, 1)]
    assert _interpolate_peak(*values) == pytest.approx(0.2)
    assert _interpolate_peak(0.5, 0.5, 0.5) == 0
    assert _interpolate_peak(1.0, 1.0, 1.5) == 0
    assert _interpolate_peak(np.nan, 1.0, 0.5) == 0


def test_where_and_how_far_it_is_searched():
    opening, sound = syllables(start=0.35)
    assert estimate_offset(opening, RATE, sound, start_time=0.3, max_offset=0.1).start_time == (
        pytest.approx(0.35, abs=0.02)
    )
    with pytest.raises(DataError, match=r"within 0\.205 s to 0\.295 s"):
        estimate_offset(opening, RATE, sound, start_time=0.25, max_offset=0.05)
    with pytest.raises(DataError, match=r"within 0\.355 s to 0\.445 s"):
        estimate_offset(opening, RATE, sound, start_time=0.4, max_offset=0.05)
    # Half a second either way.
    late, sound = syllables(start=0.47)
    assert estimate_offset(late, RATE, sound).start_time == pytest.approx(0.47, abs=0.02)
    later, sound = syllables(start=0.56)
    assert estimate_offset(later, RATE, sound, max_offset=0.6).start_time == (
        pytest.approx(0.56, abs=0.02)
    )
    assert abs(estimate_offset(later, RATE, sound).start_time) < 0.5


def test_gaps_do_not_matter():
    opening, sound = syllables()
    opening[40:60] = np.nan
    assert estimate_offset(opening, RATE, sound).start_time == pytest.approx(0.13, abs=0.02)


def test_level_and_unit_do_not_matter():
    opening, sound = syllables()
    one = estimate_offset(opening, RATE, sound)
    other = estimate_offset(7 * opening + 3, RATE, sound.replace(samples=0.2 * sound.samples))
    assert other.start_time == pytest.approx(one.start_time, abs=0.006)


@pytest.mark.parametrize("rate", [7.5, 7.6, 25.0])
def test_slow_recordings(rate):
    """At 7.5 Hz and below, nothing is filtered but the mean."""
    values = np.random.default_rng(0).normal(size=50) + 5
    filtered = _remove_slow_part(values, rate)
    if rate == 7.5:
        np.testing.assert_allclose(filtered, values - values.mean())
    else:
        sections = butter(1, 3, "highpass", fs=rate, output="sos")
        np.testing.assert_allclose(filtered, sosfiltfilt(sections, values, padlen=9))
    short = _remove_slow_part(values[:6], 60.0)
    sections = butter(1, 3, "highpass", fs=60, output="sos")
    np.testing.assert_allclose(short, sosfiltfilt(sections, values[:6], padlen=5))


@pytest.mark.parametrize(("rate", "high"), [(16000, 3000), (6000, 2700), (1400, 630)])
def test_the_band_of_speech(rate, high):
    samples = np.random.default_rng(0).normal(size=(rate, 2))
    band = butter(2, (300, high), "bandpass", fs=rate, output="sos")
    expected = sosfiltfilt(band, samples.mean(axis=1))
    filtered = _filter_speech_band(Sound(samples, rate))
    np.testing.assert_allclose(filtered.get_channel(1), expected, atol=1e-12)


def test_sound_of_too_low_a_rate_is_not_filtered():
    low = Sound(np.random.default_rng(0).normal(size=1300), 1300)
    assert _filter_speech_band(low) is low
    # 0.45 of this rate is exactly twice the lower limit.
    exact = Sound(np.ones(1000), 600 / 0.45)
    assert _filter_speech_band(exact) is not exact


def test_what_is_quieter_than_40_decibels_below_the_loudest_is_silence():
    opening, sound = syllables()
    hiss = np.random.default_rng(5).normal(size=len(sound)) * np.linspace(0, 2e-5, len(sound))
    one = estimate_offset(opening, RATE, sound)
    other = estimate_offset(opening, RATE, sound.replace(samples=sound.samples[:, 0] + hiss))
    assert other.correlation == pytest.approx(one.correlation, abs=1e-4)


@pytest.mark.parametrize(("decibels", "is_speech"), [(0.6, False), (1.6, True)])
def test_speech_varies_by_a_decibel_at_least(decibels, is_speech):
    """A tone of 1 kHz whose level goes up and down once a second."""
    opening, _ = syllables()
    times = np.arange(16000 * 5) / 16000
    level = 0.1 * 10 ** (decibels / 40 * np.sin(2 * np.pi * times))
    tone = Sound(level * np.sin(2 * np.pi * 1000 * times), 16000)
    middle = tone.replace(samples=tone.samples[8000:-8000])
    with pytest.raises(DataError, match="cannot be estimated") as caught:
        estimate_offset(opening, RATE, middle, start_time=0.0, max_offset=0.02)
    assert ("lips or sound that do not change" in str(caught.value)) != is_speech


def test_what_is_refused(rng):
    opening, sound = syllables()
    with pytest.raises(DataError, match="lips or sound that do not change"):
        estimate_offset(np.ones(240), RATE, sound)
    with pytest.raises(DataError, match="lips or sound that do not change"):
        estimate_offset(opening, RATE, Sound(np.zeros(64000), 16000))
    with pytest.raises(DataError, match="overlap too little"):
        estimate_offset(opening, RATE, sound, start_time=30.0)
    with pytest.raises(DataError, match=r"overlap too little.*0\.083 s of movement, 4\.600 s"):
        estimate_offset(opening[:5], RATE, sound)
    with pytest.raises(DataError, match="overlap too little"):
        estimate_offset(np.full(240, np.nan), RATE, sound)
    with pytest.raises(DataError, match="a correlation of"):
        estimate_offset(opening, RATE, Sound(rng.normal(size=70000), 16000))
    bad = ((opening[:, None], RATE, 0.5), (opening, 0.0, 0.5), (opening, np.inf, 0.5))
    for values, rate, max_offset in (*bad, (opening, RATE, 0.0), (opening, -1.0, 0.5)):
        with pytest.raises(DataError, match="cannot be used"):
            estimate_offset(values, rate, sound, max_offset=max_offset)


def problem_of(*arguments, **options):
    try:
        estimate_offset(*arguments, **options)
    except DataError as error:
        return error.problem
    return ""


@pytest.mark.parametrize(
    ("rate", "frames", "is_enough"), [(60.0, 29, False), (60.0, 30, True), (60.0, 31, True)]
)
def test_half_a_second_of_movement_is_the_least(rate, frames, is_enough):
    opening, sound = syllables(3, rate=rate)
    problem = problem_of(opening[:frames], rate, sound, max_offset=0.05, start_time=0.13)
    assert ("overlap too little" in problem) != is_enough


@pytest.mark.parametrize(("frames", "is_enough"), [(9, False), (10, True)])
def test_ten_frames_are_the_least(frames, is_enough):
    opening, sound = syllables(3, rate=10.0)
    with pytest.raises(DataError) as caught:
        estimate_offset(np.where(np.arange(40) < frames, opening, np.nan), 10.0, sound)
    # Ten frames of forty are still too few for the share of three fifths.
    assert "overlap too little" in str(caught.value)
    problem = problem_of(opening[:frames], 10.0, sound, start_time=0.13, max_offset=0.1)
    assert ("overlap too little" in problem) != is_enough


@pytest.mark.parametrize(("cut", "is_enough"), [(0.58, False), (0.62, True)])
def test_three_fifths_of_the_frames_must_lie_in_the_sound(cut, is_enough):
    opening, sound = syllables(1, start=0.0)
    short = sound.replace(samples=sound.samples[: round(cut * 4.0 * 16000)])
    if is_enough:
        estimate = estimate_offset(opening, RATE, short, max_offset=0.02)
        assert estimate.start_time == pytest.approx(0.0, abs=0.02)
    else:
        with pytest.raises(DataError, match="overlap too little"):
            estimate_offset(opening, RATE, short, max_offset=0.02)


@pytest.mark.parametrize(("share", "is_enough"), [(0.05, False), (0.75, True)])
def test_a_correlation_of_a_quarter_is_the_least(share, is_enough):
    """Lips that are mostly noise are refused; those that are mostly speech are not."""
    opening, sound = syllables(2)
    noise = np.random.default_rng(0).normal(size=len(opening)) * opening.std()
    mixed = share * opening + (1 - share) * noise
    if is_enough:
        assert estimate_offset(mixed, RATE, sound).correlation > 0.25
    else:
        with pytest.raises(DataError, match=r"a correlation of 0\.\d\d .* one above 0\.25"):
            estimate_offset(mixed, RATE, sound)
