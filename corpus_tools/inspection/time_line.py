"""The state of time in a window: what is shown, the cursor, the selection, and how it plays."""

from __future__ import annotations

from dataclasses import dataclass

# Seconds: no window is shorter.
_SHORTEST = 0.01
# Keys zoom by this, as in Praat.
_ZOOM = 2.0


@dataclass
class TimeLine:
    """What of the time is shown, and where one is in it; all times are seconds.

    Parameters
    ----------
    first, last
        Start and end of what there is, seconds.
    rate
        Frames a second, hertz.
    origin
        Time of frame 0, seconds.
    loops
        Whether it plays again and again.
    speed
        A factor: 1 plays as fast as it was, 0.5 half as fast.
    """

    first: float
    last: float
    rate: float
    origin: float = 0.0
    loops: bool = False
    speed: float = 1.0

    def __post_init__(self) -> None:
        self.start, self.end = self.first, self.last
        self.cursor = self.first
        self.selection: tuple[float, float] | None = None
        self._range: tuple[float, float] | None = None
        self._began = 0.0

    @property
    def is_playing(self) -> bool:
        """Whether it plays."""
        return self._range is not None

    @property
    def nearest_frame(self) -> int:
        """The frame that is nearest to the cursor, from 0."""
        return round((self.cursor - self.origin) * self.rate)

    @property
    def span(self) -> float:
        """Length of what is shown, seconds."""
        return self.end - self.start

    def move_cursor(self, time: float) -> None:
        """Move the cursor, and what is shown where it would leave it.

        Parameters
        ----------
        time
            The time, seconds.
        """
        self.cursor = min(max(time, self.first), self.last)
        if not self.start <= self.cursor <= self.end:
            # As a page is turned.
            self.show(self.cursor - 0.1 * self.span, self.cursor + 0.9 * self.span)

    def step(self, frames: int) -> None:
        """Move the cursor by frames, to the time of a frame.

        Parameters
        ----------
        frames
            How many; below 0 backwards.
        """
        self.move_cursor(self.origin + (self.nearest_frame + frames) / self.rate)

    def select(self, one: float, other: float) -> None:
        """Select a stretch of time, and put the cursor at its start.

        Parameters
        ----------
        one, other
            Its ends, seconds, in any order.
        """
        low, high = sorted(min(max(each, self.first), self.last) for each in (one, other))
        self.selection = (low, high) if high > low else None
        self.move_cursor(low)

    def show(self, start: float, end: float) -> None:
        """Show a stretch of time, as far as it is there.

        Parameters
        ----------
        start, end
            Its ends, seconds.
        """
        span = min(max(end - start, _SHORTEST), self.last - self.first)
        self.start = min(max(start, self.first), self.last - span)
        self.end = self.start + span

    def zoom(self, factor: float, centre: float | None = None) -> None:
        """Show a shorter or longer stretch of time.

        Parameters
        ----------
        factor
            A factor: above 1 shows less of the time, larger.
        centre
            The time that stays where it is, seconds; the cursor by default.
        """
        about = self.cursor if centre is None else centre
        about = min(max(about, self.start), self.end)
        part = (about - self.start) / self.span
        span = min(max(self.span / factor, _SHORTEST), self.last - self.first)
        self.show(about - part * span, about - part * span + span)

    def zoom_in(self) -> None:
        """Show half as much."""
        self.zoom(_ZOOM)

    def zoom_out(self) -> None:
        """Show twice as much."""
        self.zoom(1 / _ZOOM)

    def zoom_to_selection(self) -> None:
        """Show the selection and nothing else."""
        if self.selection is not None:
            self.show(*self.selection)

    def zoom_to_all(self) -> None:
        """Show all."""
        self.show(self.first, self.last)

    def scroll(self, part: float) -> None:
        """Show what is before or after.

        Parameters
        ----------
        part
            How far, a part of what is shown: 1 is the next page, -1 the one before.
        """
        self.show(self.start + part * self.span, self.end + part * self.span)

    def play(self, now: float, *, only_selection: bool = False) -> tuple[float, float]:
        """Begin to play.

        Parameters
        ----------
        now
            Time of a clock, seconds.
        only_selection
            Whether the selection is played, or what is shown where there is none; else from the
            cursor to the end.

        Returns
        -------
        tuple of float
            Start and end of what is played, seconds.
        """
        if only_selection:
            self._range = self.selection or (self.start, self.end)
            self.cursor = self._range[0]
        else:
            if self.cursor >= self.last - 0.5 / self.rate:
                self.cursor = self.first
            self._range = self.cursor, self.last
        self._began = now
        return self._range

    def stop(self) -> None:
        """Stop playing, where the cursor is."""
        self._range = None

    def advance(self, now: float, position: float | None = None) -> bool:
        """Move the cursor to where it plays.

        Parameters
        ----------
        now
            Time of the clock, seconds.
        position
            Where the sound is, seconds; None without sound: the clock says it.

        Returns
        -------
        bool
            Whether a new round begins: the sound must begin again too.
        """
        if self._range is None:
            return False
        start, end = self._range
        time = start + (now - self._began) * self.speed if position is None else position
        if time < end:
            self.move_cursor(time)
            return False
        self.move_cursor(start if self.loops else end)
        if self.loops:
            self._began = now
            return True
        self.stop()
        return False
