"""Sheets of pictures, and pictures on disk."""

import numpy as np
import pytest
from sheets import join_sheets, make_sheet

from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.render import save_picture


def picture(level: int, height: int = 60, width: int = 80) -> np.ndarray:
    return np.full((height, width, 3), level, dtype=np.uint8)


def test_pictures_stand_row_by_row():
    sheet = make_sheet([picture(10 * i) for i in range(5)], columns=3, margin=4)
    assert sheet.shape == (4 + 2 * 64, 4 + 3 * 84, 3)
    for i in range(5):
        top, left = 4 + (i // 3) * 64, 4 + (i % 3) * 84
        assert (sheet[top : top + 60, left : left + 80] == 10 * i).all()
    assert (sheet[:4] == 255).all()
    assert (sheet[68:, 4 + 2 * 84 :] == 255).all()


def test_a_sheet_is_no_wider_than_its_pictures():
    assert make_sheet([picture(0)], columns=6, margin=0).shape == (60, 80, 3)


def test_labels_are_written_under_their_pictures():
    pictures = [picture(200), picture(100)]
    sheet = make_sheet(pictures, columns=2, labels=["rest", ""], margin=4)
    plain = make_sheet(pictures, columns=2, labels=["", ""], margin=4)
    changed = np.argwhere((sheet != plain).any(axis=2))
    assert len(changed) > 20
    assert changed[:, 0].min() >= 64
    assert changed[:, 1].max() < 4 + 80 + 4
    other = make_sheet(pictures, columns=2, labels=["$x_1$", ""], margin=4)
    assert (other != sheet).any()


@pytest.mark.parametrize(
    ("images", "columns", "labels"),
    [
        ([], 3, None),
        ([picture(0)], 0, None),
        ([picture(0), picture(0, width=81)], 2, None),
        ([np.zeros((5, 5), dtype=np.uint8)], 2, None),
        ([picture(0)], 2, ["one", "two"]),
    ],
)
def test_impossible_sheets_are_refused(images, columns, labels):
    with pytest.raises(DataError):
        make_sheet(images, columns, labels)


def test_a_saved_picture_is_read_back(tmp_path, rng):
    from matplotlib.image import imread

    image = rng.integers(0, 256, (20, 30, 3), dtype=np.uint8)
    save_picture(image, tmp_path / "a.png")
    read = np.rint(imread(tmp_path / "a.png")[..., :3] * 255).astype(np.uint8)
    np.testing.assert_array_equal(read, image)
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.png"]


def test_the_same_picture_gives_the_same_bytes(tmp_path):
    for name in ("a.png", "b.png"):
        save_picture(picture(7), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_pictures_that_cannot_be_written_are_refused(tmp_path):
    with pytest.raises(FileFormatError, match=r"\.png"):
        save_picture(picture(0), tmp_path / "a.jpg")
    with pytest.raises(FileFormatError, match="cannot be written"):
        save_picture(picture(0), tmp_path / "nowhere" / "a.png")
    assert not list(tmp_path.iterdir())


def test_sheets_stand_beside_each_other_on_white():
    tall, low = np.zeros((30, 20, 3), np.uint8), np.full((12, 8, 3), 7, np.uint8)
    joined = join_sheets(tall, low)
    assert joined.shape == (30, 28, 3)
    assert (joined[:, :20] == 0).all()
    assert (joined[:12, 20:] == 7).all()
    assert (joined[12:, 20:] == 255).all()
