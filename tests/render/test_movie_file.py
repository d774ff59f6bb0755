"""Movies on disk: a flash and a click stay together, and what is written is written whole."""

import builtins
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, MissingExtraError
from mocap_fit.render.movie_file import MovieFile, cut_sound, find_ffmpeg, get_movie_kind
from mocap_fit.sound import Sound, read_sound

SIZE = (64, 48)


def grey(level: int) -> np.ndarray:
    return np.full((SIZE[1], SIZE[0], 3), level, dtype=np.uint8)


def decoded_pictures(path) -> np.ndarray:
    return decoded_pictures_of(path, SIZE)


def decoded_pictures_of(path, size) -> np.ndarray:
    """`(frames, height, width)`, how bright."""
    command = [find_ffmpeg(), "-v", "error", "-i", str(path), "-map", "0:v"]
    command += ["-f", "rawvideo", "-pix_fmt", "gray", "-fps_mode", "passthrough", "-"]
    raw = subprocess.run(command, capture_output=True, check=True).stdout
    return np.frombuffer(raw, dtype=np.uint8).reshape(-1, size[1], size[0])


def decoded_sound(path, rate: int = 48000) -> np.ndarray:
    command = [find_ffmpeg(), "-v", "error", "-i", str(path), "-map", "0:a"]
    command += ["-f", "f32le", "-ac", "1", "-ar", str(rate), "-"]
    raw = subprocess.run(command, capture_output=True, check=True).stdout
    return np.frombuffer(raw, dtype=np.float32)


def streams(path) -> str:
    command = [find_ffmpeg(), "-hide_banner", "-i", str(path)]
    return subprocess.run(command, capture_output=True, text=True).stderr


@pytest.mark.parametrize(
    ("rate", "sampling"), [(25, 16000), (30, 22050), (60, 44100), (29.97, 48000)]
)
def test_flash_and_click_are_within_a_frame_at_start_and_end(tmp_path, rate, sampling):
    frames = round(4 * rate)
    flashes = [3, frames - 4]
    samples = np.zeros(round(frames / rate * sampling))
    for flash in flashes:
        begin = round(flash / rate * sampling)
        samples[begin : begin + sampling // 200] = 0.9
    path = tmp_path / "a.mp4"
    with MovieFile(path, rate, SIZE, Sound(samples, sampling)) as movie:
        for frame in range(frames):
            movie.add(grey(255 if frame in flashes else 0))
    pictures, sound = decoded_pictures(path), np.abs(decoded_sound(path))
    assert len(pictures) == frames
    seen = np.flatnonzero(pictures.mean(axis=(1, 2)) > 128)
    np.testing.assert_array_equal(seen, flashes)
    half = len(sound) // 2
    heard = [np.argmax(sound[:half] > 0.3) / 48000, (half + np.argmax(sound[half:] > 0.3)) / 48000]
    np.testing.assert_allclose(heard, np.array(flashes) / rate, atol=1 / rate)
    # Neither stream outlasts the other by more than a frame.
    assert abs(len(sound) / 48000 - frames / rate) < max(1 / rate, 1024 / 44100)


def test_the_streams_are_h264_and_aac(tmp_path):
    path = tmp_path / "a.mp4"
    with MovieFile(path, 25, SIZE, Sound(np.zeros(16000), 16000)) as movie:
        for frame in range(25):
            movie.add(grey(10 * frame))
    said = streams(path)
    assert "Video: h264" in said
    assert "yuv420p" in said
    assert "Audio: aac" in said
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mp4"]


def test_without_sound_there_is_no_stream_of_it(tmp_path):
    with MovieFile(tmp_path / "a.mp4", 25, SIZE) as movie:
        movie.add(grey(7))
    assert "Audio" not in streams(tmp_path / "a.mp4")


@pytest.mark.parametrize("name", ["x.mp4", "x.gif"])
def test_the_same_pictures_give_the_same_bytes(tmp_path, name):
    contents = []
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        path = tmp_path / folder / name
        with MovieFile(path, 20, SIZE, Sound(np.zeros(8000), 16000)) as movie:
            for frame in range(10):
                movie.add(grey(20 * frame))
        contents.append(path.read_bytes())
    assert contents[0] == contents[1]


def test_a_gif_has_all_pictures_at_their_time(tmp_path):
    from PIL import Image

    with MovieFile(tmp_path / "a.gif", 20, SIZE) as movie:
        for frame in range(8):
            movie.add(grey(30 * frame))
    with Image.open(tmp_path / "a.gif") as gif:
        assert gif.n_frames == 8
        assert gif.info["duration"] == 50


def test_a_folder_of_pictures_is_replaced_by_the_next_but_nothing_else_is(tmp_path):
    from matplotlib.image import imread

    path = tmp_path / "frames"
    for count in (5, 3):
        with MovieFile(path, 25, SIZE) as movie:
            for frame in range(count):
                movie.add(grey(50 * frame))
        assert [p.name for p in sorted(path.iterdir())] == [
            f"frame_{i:06d}.png" for i in range(count)
        ]
    assert np.rint(imread(path / "frame_000002.png")[..., :3] * 255).max() == 100
    # With sound beside, it is still one.
    for _ in range(2):
        with MovieFile(path, 25, SIZE, Sound(np.zeros(1600), 16000)) as movie:
            movie.add(grey(50))
        assert sorted(p.name for p in path.iterdir()) == ["frame_000000.png", "sound.wav"]
    assert read_sound(path / "sound.wav").duration == 0.1
    (path / "notes.txt").write_text("mine")
    with pytest.raises(ConfigurationError, match="new folder"):
        MovieFile(path, 25, SIZE)
    assert (path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("name", ["a.mp4", "a.gif", "a"])
def test_after_an_error_nothing_is_left(tmp_path, name):
    class Trouble(Exception):
        pass

    def write() -> None:
        with MovieFile(tmp_path / name, 25, SIZE) as movie:
            movie.add(grey(1))
            raise Trouble

    with pytest.raises(Trouble):
        write()
    assert not list(tmp_path.iterdir())


def test_an_older_movie_survives_a_failed_one(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"older")
    with (
        pytest.raises(DataError, match="another size"),
        MovieFile(tmp_path / "a.mp4", 25, SIZE) as movie,
    ):
        movie.add(grey(1)[:10])
    assert (tmp_path / "a.mp4").read_bytes() == b"older"


def test_a_movie_needs_a_picture(tmp_path):
    with pytest.raises(DataError, match="no pictures"), MovieFile(tmp_path / "a.mp4", 25, SIZE):
        pass
    assert not list(tmp_path.iterdir())


def test_impossible_movies_are_refused(tmp_path):
    with pytest.raises(ConfigurationError, match=r"\.avi"):
        get_movie_kind("a.avi")
    with pytest.raises(DataError, match="even"):
        MovieFile(tmp_path / "a.mp4", 25, (63, 48))
    for rate in (0.0, -1.0, float("nan"), 1000.0):
        with pytest.raises(DataError, match="frame rate"):
            MovieFile(tmp_path / "a.mp4", rate, SIZE)
    with pytest.raises(DataError, match="GIF"):
        MovieFile(tmp_path / "a.gif", 60, SIZE)
    with (
        pytest.raises(FileFormatError, match="cannot be written"),
        MovieFile(tmp_path / "nowhere" / "a.mp4", 25, SIZE),
    ):
        pass


@pytest.mark.parametrize("name", ["-d/x.mp4", "take:1/x.mp4", "file:x.mp4", "%d 'a'.gif", "-y.mp4"])
def test_names_that_ffmpeg_would_take_for_something_else(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    path = Path(name)
    path.parent.mkdir(exist_ok=True)
    with MovieFile(name, 25, SIZE, Sound(np.zeros(8000), 8000)) as movie:
        movie.add(grey(7))
    written = [entry for entry in tmp_path.rglob("*") if entry.is_file()]
    assert written == [tmp_path / path]
    assert len(decoded_pictures(f"file:{tmp_path / path}")) == 1


@pytest.mark.skipif(os.name == "nt", reason="names are Unicode there")
def test_a_name_that_is_not_unicode(tmp_path):
    path = os.fsdecode(os.fsencode(tmp_path) + b"/t\xe4ke.mp4")
    with MovieFile(path, 25, SIZE, Sound(np.zeros(8000), 8000)) as movie:
        movie.add(grey(7))
    assert os.listdir(os.fsencode(tmp_path)) == [b"t\xe4ke.mp4"]


def test_a_folder_in_the_way_is_seen_before_the_work(tmp_path):
    (tmp_path / "a.mp4").mkdir()
    with pytest.raises(ConfigurationError, match="this is a folder"):
        MovieFile(tmp_path / "a.mp4", 25, SIZE)
    (tmp_path / "frames").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "frames")
    with pytest.raises(ConfigurationError, match="new folder"):
        MovieFile(tmp_path / "link", 25, SIZE)
    with pytest.raises(ConfigurationError, match=r"found \.mp4"):
        get_movie_kind(tmp_path / ".mp4")


_HALF = """
import sys, numpy as np
from mocap_fit.render.movie_file import MovieFile
with MovieFile(sys.argv[1], 25, (64, 48)) as movie:
    movie.add(np.zeros((48, 64, 3), np.uint8))
    print("begun", flush=True)
    sys.stdin.read()
"""


@pytest.mark.parametrize("name", ["x.mp4", "x"])
def test_what_a_killed_process_left_is_removed_and_nothing_else(tmp_path, name):
    command = [sys.executable, "-c", _HALF]
    processes = [
        subprocess.Popen(
            [*command, str(tmp_path / f"{number}{name}")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        for number in range(2)
    ]
    killed, living = processes
    for process in processes:
        assert process.stdout.readline() == b"begun\n"
    (tmp_path / ".movie-of-mine").mkdir()
    killed.kill()
    killed.communicate()
    assert len(list(tmp_path.glob(".movie-*"))) == 3
    with MovieFile(tmp_path / "z.gif", 25, SIZE) as movie:
        movie.add(grey(7))
    assert len(list(tmp_path.glob(".movie-*"))) == 2
    living.communicate(b"")
    assert living.returncode == 0
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [
        ".movie-of-mine",
        f"1{name}",
        "z.gif",
    ]


def test_without_the_extra_it_says_what_to_install(tmp_path, monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **options):
        if name == "imageio_ffmpeg":
            raise ImportError(name)
        return real(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtraError, match=r"mocap-fit\[movie\]"):
        MovieFile(tmp_path / "a.mp4", 25, SIZE)
    with MovieFile(tmp_path / "frames", 25, SIZE) as movie:
        movie.add(grey(0))
    assert len(list((tmp_path / "frames").iterdir())) == 1


def test_a_stretch_of_sound_is_filled_with_silence():
    sound = Sound(np.arange(1, 11) / 10, 10)
    np.testing.assert_allclose(cut_sound(sound, -0.2, 0.3).samples[:, 0], [0, 0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(cut_sound(sound, 0.8, 1.2).samples[:, 0], [0.9, 1.0, 0, 0])
    assert not cut_sound(sound, 5, 6).samples.any()
    with pytest.raises(DataError):
        cut_sound(sound, 1, 1)
