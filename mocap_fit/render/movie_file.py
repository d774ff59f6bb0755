"""Moving pictures on disk: MP4 with sound, GIF, or a folder of PNG pictures.

MP4 and GIF are written by ffmpeg, which the extra ``movie`` brings along and which runs as a
process of its own. Whatever it is, it is there whole or not at all.
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
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import NDArray

from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, MissingExtraError
from mocap_fit.render.pictures import save_picture
from mocap_fit.sound import Sound, write_sound

Image = NDArray[np.uint8]
Kind = Literal["mp4", "gif", "png"]

# AAC goes by blocks of 1024 samples. At these rates one is shorter than a picture.
_SOUND_RATES = (44100, 48000)
# GIF counts hundredths of a second, and what is shown for one of them alone is shown slowly.
_LARGEST_GIF_RATE = 50.0
_LARGEST_RATE = 240.0
# Colours as televisions and browsers expect them, and marked so.
_COLOURS = (
    "scale=out_color_matrix=bt709:out_range=tv",
    "setparams=colorspace=bt709:color_primaries=bt709:color_trc=bt709:range=tv",
)


def movie_kind(path: str | os.PathLike[str]) -> Kind:
    """What a name asks for: ``.mp4``, ``.gif``, or, without an ending, a folder of PNG pictures.

    Raises
    ------
    ConfigurationError
        If it ends in something else.
    """
    ending = Path(path).suffix.lower()
    if ending == ".mp4":
        return "mp4"
    if ending == ".gif":
        return "gif"
    if ending == "":
        return "png"
    raise ConfigurationError(
        "movies are not written in this format",
        path=path,
        found=ending,
        expected=".mp4, .gif, or a name without an ending for a folder of PNG pictures",
    )


def checked_rate(rate: float) -> float:
    """The frame rate of a movie.

    Raises
    ------
    DataError
        If it is not above 0, or above 240 a second.
    """
    if not math.isfinite(rate) or not 0 < rate <= _LARGEST_RATE:
        raise DataError(
            "a movie cannot have this frame rate",
            found=f"{rate} Hz",
            expected=f"above 0, up to {_LARGEST_RATE:g} Hz",
        )
    return float(rate)


def ffmpeg_program() -> str:
    """Where the ffmpeg of the extra ``movie`` is.

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

    Use it in a ``with`` block: at its end the file is complete, and takes its name; after an
    error nothing of it is left.

    Parameters
    ----------
    path
        As for `movie_kind`.
    rate
        Pictures per second.
    size
        Width and height of each; MP4 needs even numbers.
    sound
        Heard from the first picture on, as long as the pictures are seen; `sound_between` cuts or
        fills it so. Only MP4 holds sound.

    Raises
    ------
    ConfigurationError
        If the ending is unknown, or a folder of that name holds something.
    DataError
        If the rate or the size is not possible.
    MissingExtraError
        If ffmpeg is needed and not there.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        rate: float,
        size: tuple[int, int],
        sound: Sound | None = None,
    ) -> None:
        self.path = Path(path)
        self.kind = movie_kind(path)
        self.rate = checked_rate(rate)
        self.size = (int(size[0]), int(size[1]))
        self.frames = 0
        self._sound = sound
        if self.kind == "mp4" and (self.size[0] % 2 or self.size[1] % 2):
            raise DataError(
                "an MP4 movie has an even number of pixels each way",
                path=path,
                found=f"{self.size[0]} × {self.size[1]}",
            )
        if self.kind == "gif" and self.rate > _LARGEST_GIF_RATE:
            raise DataError(
                "a GIF cannot have this frame rate",
                path=path,
                found=f"{self.rate:g} Hz",
                expected=f"at most {_LARGEST_GIF_RATE:g} Hz",
                advice="Write an MP4, or take a lower rate.",
            )
        if self.kind == "png" and self.path.exists() and not _replaceable(self.path):
            raise ConfigurationError(
                "this is not a new folder, nor one that holds only pictures of a movie",
                path=path,
                advice="Give the name of a new folder.",
            )
        self._program = "" if self.kind == "png" else ffmpeg_program()
        self._folder: Path | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._messages: IO[bytes] | None = None

    def __enter__(self) -> MovieFile:
        try:
            # Beside the movie, so that the last step is a mere renaming.
            self._folder = Path(tempfile.mkdtemp(dir=self.path.parent, prefix=".movie-"))
        except OSError as error:
            raise self._unwritable(error) from None
        try:
            if self.kind != "png":
                self._start()
        except BaseException:
            self._clean_up()
            raise
        return self

    def add(self, image: Image) -> None:
        """Append a picture, `(height, width, 3)`, uint8.

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
                # ffmpeg has ended before us: what it said is the reason.
                raise self._failed() from None
        self.frames += 1

    def __exit__(self, kind: object, *rest: object) -> None:
        try:
            if kind is None:
                self._complete()
        finally:
            self._clean_up()

    def _start(self) -> None:
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
            sounding = self._sound_file()
            if sounding is not None:
                command += ["-i", str(sounding), "-c:a", "aac", "-b:a", "128k"]
            # The number of threads decides a little what x264 does: it is fixed, so that the same
            # pictures give the same bytes on every machine.
            command += ["-c:v", "libx264", "-preset", "veryfast", "-crf", "18", "-threads", "2"]
            command += ["-pix_fmt", "yuv420p", "-vf", ",".join(_COLOURS)]
            command += ["-movflags", "+faststart", "-map_metadata", "-1"]
        command += ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-flags:a", "+bitexact"]
        command += [str(self._content)]
        self._messages = open(self._folder / "messages.txt", "w+b")  # noqa: SIM115
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=self._messages,
                **_no_window(),
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

    def _sound_file(self) -> Path | None:
        if self._sound is None or not len(self._sound.samples):
            return None
        assert self._folder is not None
        sound = _for_aac(self._sound)
        path = self._folder / "sound.wav"
        write_sound(sound, path)
        return path

    def _complete(self) -> None:
        assert self._folder is not None
        if not self.frames:
            raise DataError("the movie has no pictures", path=self.path)
        if self._process is None:
            try:
                if self.path.exists():
                    shutil.rmtree(self.path)
                os.replace(self._folder, self.path)
                # A folder for temporary things is its owner's alone.
                self.path.chmod(0o777 & ~_umask())
            except OSError as error:
                raise self._unwritable(error) from None
            return
        assert self._process.stdin is not None
        try:
            self._process.stdin.close()
        except OSError:
            raise self._failed() from None
        if self._process.wait() != 0:
            raise self._failed()
        try:
            os.replace(self._content, self.path)
        except OSError as error:
            raise self._unwritable(error) from None

    def _failed(self) -> FileFormatError:
        assert self._process is not None
        assert self._messages is not None
        self._process.wait()
        self._messages.seek(0)
        said = self._messages.read().decode(errors="replace").strip().splitlines()
        return FileFormatError(
            "ffmpeg could not write the movie",
            path=self.path,
            found=said[-1] if said else f"exit status {self._process.returncode}",
            advice="Check that the disk is not full.",
        )

    def _unwritable(self, error: OSError) -> FileFormatError:
        return FileFormatError(
            "the movie cannot be written",
            path=self.path,
            found=error.strerror,
            advice="Check that the folder exists and may be written to.",
        )

    def _clean_up(self) -> None:
        if self._process is not None:
            if self._process.poll() is None:
                self._process.kill()
                self._process.wait()
            if self._process.stdin is not None and not self._process.stdin.closed:
                with contextlib.suppress(OSError):
                    self._process.stdin.close()
            self._process = None
        if self._messages is not None:
            self._messages.close()
            self._messages = None
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None


def sound_between(sound: Sound, start: float, end: float) -> Sound:
    """A stretch of a sound, with silence where the stretch goes beyond it.

    Parameters
    ----------
    sound
        Begins at 0 s.
    start, end
        Seconds.

    Raises
    ------
    DataError
        If the end does not come after the start.
    """
    if not end > start:
        raise DataError("a stretch of sound ends after its start", found=f"{start} s to {end} s")
    first, last = round(start * sound.rate), round(end * sound.rate)
    stretch = np.zeros((max(last - first, 1), sound.channels))
    inside = slice(max(first, 0), max(min(last, len(sound.samples)), 0))
    part = sound.samples[inside]
    if len(part):
        stretch[inside.start - first : inside.start - first + len(part)] = part
    return sound.replace(samples=stretch)


def _for_aac(sound: Sound) -> Sound:
    """The sound at a rate of movies, in one channel or two."""
    if sound.channels > 2:
        sound = sound.to_mono()
    if sound.rate in _SOUND_RATES:
        return sound
    from scipy.signal import resample_poly

    rate = _SOUND_RATES[-1]
    ratio = Fraction(rate / sound.rate).limit_denominator(2000)
    samples = resample_poly(sound.samples, ratio.numerator, ratio.denominator, axis=0)
    return Sound(samples, rate, name=sound.name)


def _replaceable(folder: Path) -> bool:
    """Whether a folder holds nothing but pictures that a movie put there."""
    if not folder.is_dir():
        return False
    return all(
        entry.name.startswith("frame_") and entry.suffix == ".png" for entry in folder.iterdir()
    )


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _no_window() -> dict[str, Any]:
    """On Windows a console program would open a window."""
    flags = getattr(subprocess, "CREATE_NO_WINDOW", 0)
    return {"creationflags": flags} if flags else {}
