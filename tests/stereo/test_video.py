"""Videos: their pictures, and files that are none."""

import cv2
import numpy as np
import pytest

from mocap_fit.errors import FileFormatError, MissingFileError
from mocap_fit.stereo.video import count_pictures, read_pictures


def write_video(path, pictures) -> None:
    height, width = pictures[0].shape[:2]
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 30, (width, height))
    for picture in pictures:
        video.write(picture)
    video.release()


def test_pictures_come_as_they_were_written(tmp_path, rng):
    path = tmp_path / "one.mkv"
    pictures = [rng.integers(0, 256, (48, 62, 3), dtype=np.uint8) for _ in range(5)]
    write_video(path, pictures)
    assert count_pictures(path) == 5
    for mine, other in zip(read_pictures(path), pictures, strict=True):
        # FFV1 keeps brightness; OpenCV writes its colours in halves of the picture.
        assert mine.shape == other.shape
    grey = [np.repeat(picture[..., :1], 3, axis=2) for picture in pictures]
    write_video(path, grey)
    for mine, other in zip(read_pictures(path), grey, strict=True):
        assert np.abs(mine.astype(int) - other).max() <= 2


def test_files_that_are_no_videos_are_refused(tmp_path):
    with pytest.raises(MissingFileError, match=r"none\.mkv: there is no such video"):
        next(read_pictures(tmp_path / "none.mkv"))
    for content in (b"", b"not a video at all\n" * 100):
        path = tmp_path / "text.mp4"
        path.write_bytes(content)
        with pytest.raises(FileFormatError, match=r"text\.mp4: this is no video"):
            next(read_pictures(path))


def test_a_video_that_is_cut_off(tmp_path, rng):
    path = tmp_path / "cut.mkv"
    write_video(path, [rng.integers(0, 256, (48, 62, 3), dtype=np.uint8) for _ in range(20)])
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert 0 < len(list(read_pictures(path))) < 20
