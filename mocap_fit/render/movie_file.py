"""Movies on disk: MP4 with sound, GIF, or a folder of PNG pictures.

MP4 and GIF are written by ffmpeg, which the extra ``movie`` installs and which runs as a separate
process. Each is written completely or not at all.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import subprocess
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import IO, Literal

import numpy as np

from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, MissingExtraError
from mocap_fit.render.pictures import Image, save_picture
from mocap_fit.sound import Sound, resample, write_sound

try:
    import fcntl
except ImportError:
    fcntl = None  # type: ignore[assignment]

# A folder beside the movie with what there is of it, and a file that its process has locked.
_PREFIX, _LOCK, _UNLOCKED = ".movie-", "lock", "unlocked"

MovieKind = Literal["mp4", "gif", "png"]
# The sound, in a folder of pictures.
_SOUND = "sound.wav"
_KINDS: dict[str, MovieKind] = {".mp4": "mp4", ".gif": "gif", "": "png"}

# AAC works in blocks of 1024 samples. At these rates one is shorter than a picture.
_SOUND_RATES = (44100, 48000)
# GIF counts hundredths of a second, and viewers slow down pictures of one hundredth.
_MAX_GIF_RATE = 50.0
_MAX_RATE = 240.0
# Colours as televisions and browsers expect them, and labelled so.
_COLOURS = (
    "scale=out_color_matrix=bt709:out_range=tv",
    "setparams=colorspace=bt709:color_primaries=bt709:color_trc=bt709:range=tv",
)


def get_movie_kind(path: str | os.PathLike[str]) -> MovieKind:
    """Return the kind of movie that a file name stands for.

    Parameters
    ----------
    path
        A name in ``.mp4`` or ``.gif``, or without an ending: a folder of PNG pictures.

    Returns
    -------
    str
        ``mp4``, ``gif`` or ``png``.

    Raises
    ------
    ConfigurationError
        If it ends in something else.
    """
    # The name of a hidden file is no ending.
    name = Path(path).name.lower()
    if (ending := Path(name).suffix) not in _KINDS or name in (".mp4", ".gif"):
        raise ConfigurationError(
            "movies are not written in this format",
            path=path,
            found=ending or name,
            expected=".mp4, .gif, or a name without an ending for a folder of PNG pictures",
        )
    return _KINDS[ending]


def check_frame_rate(rate: float) -> float:
    """Check the frame rate of a movie.

    Parameters
    ----------
    rate
        Frame rate, hertz.

    Returns
    -------
    float
        The frame rate, hertz.

    Raises
    ------
    DataError
        If it is not above 0 and up to 240 Hz.
    """
    if not math.isfinite(rate) or not 0 < rate <= _MAX_RATE:
        raise DataError(
            "a movie cannot have this frame rate",
            found=f"{rate} Hz",
            expected=f"above 0, up to {_MAX_RATE:g} Hz",
        )
    return float(rate)


def find_ffmpeg() -> str:
    """Find the ffmpeg of the extra ``movie``.

    Returns
    -------
    str
        Path of the program.

    Raises
    ------
    MissingExtraError
        If the extra is not installed, or has no program for this machine.
    """
    advice = 'pip install "mocap-fit[movie]", or write PNG pictures: a name without an ending.'
    try:
        import imageio_ffmpeg
    except ImportError:
        raise MissingExtraError(
            "MP4 and GIF need the extra 'movie', which is not installed", advice=advice
        ) from None
    try:
        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except RuntimeError:
        raise MissingExtraError(
            "the extra 'movie' has no ffmpeg for this machine",
            advice="Install ffmpeg and set IMAGEIO_FFMPEG_EXE to its path.",
        ) from None


class MovieFile:
    """A movie that is being written, picture by picture.

    Use it in a ``with`` block: at its end the file is completed and renamed; after an error
    nothing of it is left.

    Parameters
    ----------
    path
        A name in ``.mp4`` or ``.gif``, or without an ending: a folder of PNG pictures.
    rate
        Frame rate, hertz.
    size
        Width and height of each picture, pixels; even numbers for MP4.
    sound
        Sound from the first picture on, as long as the movie (`cut_sound`). Only MP4 holds sound.

    Raises
    ------
    ConfigurationError
        If the ending is unknown, or a folder of that name holds something.
    DataError
        If the rate or the size is out of range.
    MissingExtraError
        If ffmpeg is needed and not installed.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        rate: float,
        size: tuple[int, int],
        sound: Sound | None = None,
    ) -> None:
        self.path = Path(path)
        self.kind = get_movie_kind(path)
        self.rate = check_frame_rate(rate)
        self.size = (int(size[0]), int(size[1]))
        self.frames = 0
        self._sound = sound
        if self.kind == "mp4" and (self.size[0] % 2 or self.size[1] % 2):
            raise DataError(
                "an MP4 movie has an even number of pixels each way",
                path=path,
                found=f"{self.size[0]} × {self.size[1]}",
            )
        if self.kind == "gif" and self.rate > _MAX_GIF_RATE:
            raise DataError(
                "a GIF cannot have this frame rate",
                path=path,
                found=f"{self.rate:g} Hz",
                expected=f"at most {_MAX_GIF_RATE:g} Hz",
                advice="Write an MP4, or take a lower rate.",
            )
        if self.kind == "png" and self.path.exists() and not _is_replaceable(self.path):
            raise ConfigurationError(
                "this is not a new folder, nor one that holds only pictures of a movie",
                path=path,
                advice="Give the name of a new folder.",
            )
        if self.kind != "png" and self.path.is_dir():
            raise ConfigurationError(
                "this is a folder", path=path, expected=f"a file name in .{self.kind}"
            )
        self._program = "" if self.kind == "png" else find_ffmpeg()
        self._folder: Path | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._messages: IO[bytes] | None = None
        self._lock: IO[bytes] | None = None

    def __enter__(self) -> MovieFile:
        # ffmpeg takes a name that begins with a hyphen for an option.
        parent = self.path.parent.absolute()
        remove_abandoned(parent)
        try:
            # Beside the movie, so that the last step is a renaming.
            self._folder = Path(tempfile.mkdtemp(dir=parent, prefix=_PREFIX))
            self._lock = lock_folder(self._folder)
        except OSError as error:
            self._clean_up()
            raise self._describe_os_error(error) from None
        try:
            if self.kind != "png":
                self._start_ffmpeg()
        except BaseException:
            self._clean_up()
            raise
        return self

    def add(self, image: Image) -> None:
        """Append a picture.

        Parameters
        ----------
        image
            The picture, ``(height, width, 3)``, 0 to 255, uint8.

        Raises
        ------
        DataError
            If it has another size.
        FileFormatError
            If it cannot be written.
        """
        assert self._folder is not None, "used outside its with block"
        if image.shape != (self.size[1], self.size[0], 3) or image.dtype != np.uint8:
            raise DataError(
                "a picture of the movie has another size",
                frame=self.frames,
                found=f"{image.shape}, {image.dtype}",
                expected=(self.size[1], self.size[0], 3),
            )
        if self._process is None:
            save_picture(image, self._folder / f"frame_{self.frames:06d}.png")
        else:
            assert self._process.stdin is not None
            try:
                self._process.stdin.write(np.ascontiguousarray(image).data)
            except OSError:
                # ffmpeg has ended: its message is the reason.
                raise self._describe_failure() from None
        self.frames += 1

    def __exit__(self, kind: object, *rest: object) -> None:
        try:
            if kind is None:
                self._complete()
        finally:
            self._clean_up()

    def _start_ffmpeg(self) -> None:
        assert self._folder is not None
        width, height = self.size
        rate = Fraction(self.rate).limit_denominator(100_000)
        command = [self._program, "-hide_banner", "-loglevel", "error", "-nostdin", "-y"]
        command += ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"]
        command += ["-r", f"{rate.numerator}/{rate.denominator}", "-i", "pipe:0"]
        if self.kind == "gif":
            command += ["-vf", "split[a][b];[a]palettegen=stats_mode=diff[p];[b][p]paletteuse"]
            command += ["-loop", "0"]
        else:
            if self._sound is not None and len(self._sound.samples):
                sound_file = self._folder / "sound.wav"
                sound = _convert_for_wav(self._sound)
                write_sound(sound, sound_file)
                command += ["-i", f"file:{sound_file}", "-c:a", "aac", "-b:a", "128k"]
                if sound.rate not in _SOUND_RATES:
                    command += ["-ar", f"{_SOUND_RATES[-1]}"]
            # The output of x264 depends on the number of threads: it is fixed, so that the same
            # pictures give the same bytes on every machine.
            command += ["-c:v", "libx264", "-preset", "veryfast", "-crf", "18", "-threads", "2"]
            command += ["-pix_fmt", "yuv420p", "-vf", ",".join(_COLOURS)]
            command += ["-movflags", "+faststart", "-map_metadata", "-1"]
        command += ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-flags:a", "+bitexact"]
        # The protocol is named, so that a part of a folder's name cannot be one.
        command += [f"file:{self._content}"]
        self._messages = open(self._folder / "messages.txt", "w+b")  # noqa: SIM115
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._messages,
                # No window for a console program on Windows.
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            raise MissingExtraError(
                "ffmpeg cannot be run",
                found=error.strerror,
                advice="Install mocap-fit[movie] again.",
            ) from None

    @property
    def _content(self) -> Path:
        assert self._folder is not None
        return self._folder / f"movie.{self.kind}"

    def _complete(self) -> None:
        assert self._folder is not None
        if not self.frames:
            raise DataError("the movie has no pictures", path=self.path)
        if self._process is not None:
            assert self._process.stdin is not None
            try:
                self._process.stdin.close()
            except OSError:
                raise self._describe_failure() from None
            if self._process.wait() != 0:
                raise self._describe_failure()
        try:
            if self.kind != "png":
                os.replace(self._content, self.path)
                return
            if self._sound is not None and len(self._sound.samples):
                write_sound(self._sound, self._folder / _SOUND)
            if self.path.exists():
                shutil.rmtree(self.path)
            assert self._lock is not None
            if fcntl is None:
                self._lock.close()
            for name in (_LOCK, _UNLOCKED):
                (self._folder / name).unlink(missing_ok=True)
            os.replace(self._folder, self.path)
            # Only its owner may read a temporary folder.
            self.path.chmod(0o777 & ~_read_umask())
        except OSError as error:
            raise self._describe_os_error(error) from None

    def _describe_failure(self) -> FileFormatError:
        assert self._process is not None
        assert self._messages is not None
        self._process.wait()
        self._messages.seek(0)
        lines = self._messages.read().decode(errors="replace").strip().splitlines()
        return FileFormatError(
            "ffmpeg could not write the movie",
            path=self.path,
            found=lines[-1] if lines else f"exit status {self._process.returncode}",
            advice="Check that the disk is not full.",
        )

    def _describe_os_error(self, error: OSError) -> FileFormatError:
        return FileFormatError(
            "the movie cannot be written",
            path=self.path,
            found=error.strerror,
            advice="Check that the folder exists and may be written to.",
        )

    def _clean_up(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None
        if self._messages is not None:
            self._messages.close()
            self._messages = None
        # Windows does not remove the lock while it is open; elsewhere it must be until the end.
        for _ in range(2):
            if self._folder is not None:
                shutil.rmtree(self._folder, ignore_errors=True)
            if self._lock is not None:
                self._lock.close()
        self._folder = self._lock = None


def lock_folder(folder: Path) -> IO[bytes]:
    """Mark a temporary folder as that of a living process.

    Parameters
    ----------
    folder
        The folder.

    Returns
    -------
    file
        A file in it that is locked as long as it is open: until the process ends at the latest.
    """
    if fcntl is None:
        return open(folder / _LOCK, "wb")
    lock = open(folder / _UNLOCKED, "wb")  # noqa: SIM115
    # Some disks of networks have no locks; nothing is removed there.
    with contextlib.suppress(OSError):
        fcntl.flock(lock, fcntl.LOCK_EX)
        # Under this name it is always locked.
        os.replace(folder / _UNLOCKED, folder / _LOCK)
    return lock


def remove_abandoned(parent: Path) -> None:
    """Remove what processes that were killed have left of their movies.

    Parameters
    ----------
    parent
        The folder for movies.
    """
    for lock in parent.glob(f"{_PREFIX}*/{_LOCK}"):
        with contextlib.suppress(OSError):
            if fcntl is not None:
                with open(lock, "rb") as stream:
                    fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            else:
                # Windows does not remove a file that is open.
                lock.unlink()
            shutil.rmtree(lock.parent)


def cut_sound(sound: Sound, start: float, end: float) -> Sound:
    """Return a part of a sound, with silence where it goes beyond the sound.

    Parameters
    ----------
    sound
        The sound, which begins at 0 s.
    start
        Start of the part, seconds; it may be negative.
    end
        End of the part, seconds.

    Returns
    -------
    Sound
        Its duration is that of the part.

    Raises
    ------
    DataError
        If the end does not come after the start.
    """
    if not end > start:
        raise DataError("a part of a sound ends after its start", found=f"{start} s to {end} s")
    first, last = round(start * sound.rate), round(end * sound.rate)
    samples = np.zeros((max(last - first, 1), sound.channels))
    inside = slice(max(first, 0), max(min(last, len(sound.samples)), 0))
    part = sound.samples[inside]
    if len(part):
        samples[inside.start - first : inside.start - first + len(part)] = part
    return sound.replace(samples=samples)


def _convert_for_wav(sound: Sound) -> Sound:
    """Return the sound at a rate that a file can have, with one or two channels."""
    if sound.channels > 2:
        sound = sound.to_mono()
    if sound.rate.is_integer():
        return sound
    rate = _SOUND_RATES[-1]
    return Sound(resample(sound.samples, sound.rate, rate), rate, name=sound.name)


def _is_replaceable(folder: Path) -> bool:
    """Return whether a folder holds nothing but the pictures and the sound of a movie."""
    if not folder.is_dir() or folder.is_symlink():
        return False
    return all(
        (entry.name.startswith("frame_") and entry.suffix == ".png") or entry.name == _SOUND
        for entry in folder.iterdir()
    )


def _read_umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
