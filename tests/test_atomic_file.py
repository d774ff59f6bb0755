"""Files that are written completely or not at all."""

import errno
import os
import subprocess
import sys

import pytest

from mocap_fit.atomic_file import make_folder, remove_partials, write_atomically, write_text
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, MissingFileError


def fail(target, error):
    with write_atomically(target) as partial:
        partial.write_text("new")
        raise error


def copy(source, target):
    with write_atomically(target) as partial:
        partial.write_bytes(source.read_bytes())


def test_the_file_is_there_when_all_is_written(tmp_path):
    target = tmp_path / "out.txt"
    target.write_text("old")
    with write_atomically(target) as partial:
        partial.write_text("new")
        assert partial.parent == tmp_path
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert os.listdir(tmp_path) == ["out.txt"]


@pytest.mark.parametrize("error", [ZeroDivisionError(), DataError("no"), KeyboardInterrupt()])
def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path, error):
    target = tmp_path / "out.txt"
    target.write_text("old")
    with pytest.raises(type(error)) as caught:
        fail(target, error)
    assert caught.value is error
    assert target.read_text() == "old"
    assert os.listdir(tmp_path) == ["out.txt"]


def test_another_file_that_fails_is_the_one_that_is_named(tmp_path):
    source, target = tmp_path / "in.wav", tmp_path / "out.wav"
    with pytest.raises(MissingFileError, match=r"in\.wav: there is no such file"):
        copy(source, target)
    source.mkdir()
    with pytest.raises(FileFormatError, match=r"in\.wav: the file cannot be read"):
        copy(source, target)


def test_a_target_that_cannot_be_written_is_named_with_its_noun(tmp_path):
    for target in (tmp_path / "none" / "out.svg", tmp_path):
        with pytest.raises(FileFormatError) as caught:
            write_text(target, "new", "figure")
        assert type(caught.value) is FileFormatError
        assert str(caught.value).startswith(f"{target}: the figure cannot be written (found ")
        assert "partial" not in str(caught.value)


def test_a_full_disk_is_a_fault_of_the_target(tmp_path):
    reason = os.strerror(errno.ENOSPC)
    with pytest.raises(FileFormatError, match=rf"out\.txt: .*cannot be written \(found {reason}"):
        fail(tmp_path / "out.txt", OSError(errno.ENOSPC, reason))


def test_text_is_utf_8_with_the_line_ends_that_it_has(tmp_path):
    write_text(tmp_path / "a.txt", "ä\nb\r\n")
    assert (tmp_path / "a.txt").read_bytes() == "ä\nb\r\n".encode()


def test_folders_are_made_with_their_parents(tmp_path):
    make_folder(tmp_path / "a" / "b")
    make_folder(tmp_path / "a" / "b")
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match=r"cannot be made \(found a file of that name"):
        make_folder(tmp_path / "file")
    with pytest.raises(ConfigurationError, match="found Not a directory"):
        make_folder(tmp_path / "file" / "b")


@pytest.mark.skipif(os.name == "nt", reason="a process cannot be looked for there")
def test_what_a_killed_process_left_of_a_file_is_removed(tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    names = [f".o[u]t.{ended.pid}.partial", f".o[u]t.{os.getpid()}.partial", ".o[u]t.x.partial"]
    names += [".o[u]t.99999999999999999999.partial", f".out.{ended.pid}.partial", "o[u]t"]
    for name in names:
        (tmp_path / name).write_text("half")
    remove_partials(tmp_path / "o[u]t")
    assert sorted(os.listdir(tmp_path)) == sorted(names[1:])
