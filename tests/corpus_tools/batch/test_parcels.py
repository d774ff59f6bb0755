"""Items on their way to a cluster: opened where they are, or sent with their content."""

import hashlib
import os
from dataclasses import replace

import pytest

from corpus_tools.batch import Item, ItemResult
from corpus_tools.batch.cluster import ContentNeeded, Done
from corpus_tools.batch.parcel import Parcel, process_parcel
from corpus_tools.batch.run import _receive
from mocap_fit.errors import DataError
from mocap_fit.size_limit import VARIABLE, get_largest_size


class Copying:
    """Writes what it reads in capitals, and says from where."""

    step = "copy"

    def compute_fingerprint(self, item, sums):
        return "".join(sums.values())

    def is_complete(self, item, out, figures):
        return True

    def process(self, item, context):
        content = (context.folder / item.sources[0]).read_text()
        if content == "bad":
            raise DataError("these are bad")
        (context.out / item.targets[0]).write_text(content.upper())
        size = get_largest_size()
        return {"from": context.folder, "sum": context.fingerprint, "max_size": size}


@pytest.fixture
def parcel(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, "3GB")
    folder = tmp_path / "lab"
    (folder / "takes").mkdir(parents=True)
    (folder / "takes" / "a.txt").write_text("words")
    item = Item("a", folder, ("takes/a.txt",), ("texts/a.txt",), f"lab{os.sep}")
    return Parcel(item, "print", {"takes/a.txt": hashlib.sha256(b"words").hexdigest()}, 12345)


def process(parcel):
    return process_parcel(Copying(), parcel, lambda done, of: None)


def test_files_that_are_here_are_opened(parcel):
    result = process(parcel)
    assert result.files == {"texts/a.txt": b"WORDS"}
    # A worker does not inherit what our environment says.
    assert result.figures == {"from": parcel.item.folder, "sum": "print", "max_size": 12345}


@pytest.mark.parametrize("content", [None, b"", b"wordz", b"words and more"])
def test_where_they_are_absent_or_others_their_content_is_needed(parcel, content):
    path = parcel.item.folder / "takes" / "a.txt"
    sent = parcel.load()
    path.unlink() if content is None else path.write_bytes(content)
    assert process(parcel) == ContentNeeded()
    assert sent.contents == {"takes/a.txt": b"words"}
    result = process(sent)
    assert result.files == {"texts/a.txt": b"WORDS"}
    assert result.figures["from"] != parcel.item.folder
    assert not result.figures["from"].exists()


@pytest.mark.parametrize("content", [None, b"other words"])
def test_what_changed_since_is_not_sent_under_the_former_sum(parcel, content):
    path = parcel.item.folder / "takes" / "a.txt"
    path.unlink() if content is None else path.write_bytes(content)
    done = parcel.load()
    assert isinstance(done, Done)
    words = "No such file" if content is None else "has changed since the run began"
    assert done.result.error.startswith(os.path.join("lab", "takes", "a.txt"))
    assert words in done.result.error


@pytest.mark.parametrize("is_sent", [False, True])
def test_an_error_names_the_file_as_its_user_does_and_nothing_is_written(parcel, is_sent):
    (parcel.item.folder / "takes" / "a.txt").write_text("bad")
    parcel = replace(parcel, sums={"takes/a.txt": hashlib.sha256(b"bad").hexdigest()})
    result = process(parcel.load() if is_sent else parcel)
    assert result.error == f"{os.path.join('lab', 'takes', 'a.txt')}: these are bad"
    assert not result.files


def test_what_is_received_is_written(parcel, tmp_path):
    (tmp_path / "texts").mkdir()
    assert _receive(parcel.item, process(parcel), tmp_path).error is None
    assert (tmp_path / "texts" / "a.txt").read_bytes() == b"WORDS"
    # What cannot be written is the error of its item.
    failed = _receive(parcel.item, process(parcel), tmp_path / "absent")
    assert isinstance(failed, ItemResult)
    assert "cannot be written" in failed.error
