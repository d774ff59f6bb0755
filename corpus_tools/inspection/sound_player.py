"""Play a stretch of sound; silent where the extra ``audio`` is not installed, or no device."""

from __future__ import annotations

from typing import Any

import numpy as np

from mocap_fit.sound import Sound


class SoundPlayer:
    """Plays a sound and says where it is.

    Parameters
    ----------
    sound
        The sound, which begins at 0 s; None plays nothing.
    """

    def __init__(self, sound: Sound | None) -> None:
        self._sound = sound
        self._stream: Any = None
        self._index = self._stop = 0

    @property
    def position(self) -> float | None:
        """Where the sound is, seconds; None where nothing is heard."""
        if self._stream is None or self._sound is None:
            return None
        speed = self._stream.samplerate / self._sound.rate
        return float(self._index / self._sound.rate - self._stream.latency * speed)

    def play(self, start: float, end: float, speed: float = 1.0) -> None:
        """Play a stretch; where there is no device nothing happens.

        Parameters
        ----------
        start, end
            Its ends, seconds.
        speed
            A factor: 1 plays it as it is; slower is lower.
        """
        self.stop()
        if self._sound is None:
            return
        try:
            import sounddevice  # type: ignore[import-untyped]
        except (ImportError, OSError):
            return
        last = len(self._sound)
        self._index = min(max(round(start * self._sound.rate), 0), last)
        self._stop = min(round(end * self._sound.rate), last)
        try:
            self._stream = sounddevice.OutputStream(
                samplerate=self._sound.rate * speed, channels=1, callback=self._fill
            )
            self._stream.start()
        except (sounddevice.PortAudioError, ValueError):
            self._stream = None

    def stop(self) -> None:
        """Be silent."""
        if self._stream is not None:
            self._stream.abort()
            self._stream.close()
            self._stream = None

    def _fill(self, out: Any, frames: int, *_: object) -> None:
        """Fill a block; after the end it is silent, and time goes on."""
        assert self._sound is not None
        part = self._sound.samples[self._index : min(self._index + frames, self._stop)]
        out[:] = 0.0
        out[: len(part), 0] = part.mean(axis=1, dtype=np.float64)
        self._index += frames
