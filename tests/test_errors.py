import copy
import errno
import os
import pickle
from pathlib import Path

import pytest

from mocap_fit import errors
from mocap_fit.errors import (
    DataError,
    FileFormatError,
    MissingFileError,
    MocapFitError,
    MocapFitWarning,
)


def test_a_message_says_where_what_and_what_to_do():
    error = FileFormatError(
        "the row is too short",
        path=Path("takes") / "one.tsv",
        line=12,
        found="5 numbers",
        expected="6",
        advice="Export the recording again.",
    )
    assert str(error) == (
        f"{Path('takes') / 'one.tsv'}, line 12: the row is too short "
        "(found 5 numbers, expected 6). Export the recording again."
    )
    assert error.problem == "the row is too short"
    assert (error.line, error.frame) == (12, None)
    assert error.path == str(Path("takes") / "one.tsv")


@pytest.mark.parametrize(
    ("details", "message"),
    [
        ({}, "it is wrong"),
        ({"frame": 0}, "frame 0: it is wrong"),
        ({"line": 3, "frame": 7}, "line 3, frame 7: it is wrong"),
        ({"found": 0}, "it is wrong (found 0)"),
        ({"expected": "1 or more"}, "it is wrong (expected 1 or more)"),
        ({"found": "", "expected": ""}, "it is wrong (found , expected )"),
        ({"advice": "Mend it."}, "it is wrong. Mend it."),
    ],
)
def test_parts_that_are_not_given_leave_no_trace(details, message):
    assert str(DataError("it is wrong", **details)) == message


def test_a_message_is_one_short_line_whatever_the_file_held():
    error = FileFormatError("odd\ncell", found="x" * 10_000 + "\n\t", advice="Look\r\nthere.")
    assert len(str(error).splitlines()) == 1
    assert len(str(error)) < 300
    assert str(error).startswith("odd cell (found xxx")
    assert str(error).endswith("…). Look there.")


@pytest.mark.parametrize(
    "name",
    [
        "ConfigurationError",
        "DataError",
        "FileFormatError",
        "MissingExtraError",
        "MissingFileError",
        "RegistryError",
    ],
)
def test_one_base_class_catches_them_all(name):
    kind = getattr(errors, name)
    assert issubclass(kind, MocapFitError)
    with pytest.raises(MocapFitError, match=r"^frame 3: no$"):
        raise kind("no", frame=3)


def test_errors_survive_the_way_from_a_worker_process():
    error = DataError("no marker is seen", frame=4, found=0, expected=3, advice="Look.")
    twin = pickle.loads(pickle.dumps(error))
    assert type(twin) is DataError
    assert str(twin) == str(error)
    assert (twin.frame, twin.advice) == (4, "Look.")


def test_warnings_can_be_told_from_those_of_others():
    assert issubclass(MocapFitWarning, UserWarning)
    assert not issubclass(MocapFitWarning, MocapFitError)


def test_a_missing_file_is_also_a_file_not_found_error():
    error = MissingFileError(path=Path("takes") / "one.tsv", advice="Check the name.")
    assert isinstance(error, FileFormatError)
    with pytest.raises(FileNotFoundError):
        raise error
    assert str(error) == f"{Path('takes') / 'one.tsv'}: there is no such file. Check the name."
    assert (error.errno, error.filename) == (errno.ENOENT, str(Path("takes") / "one.tsv"))
    for twin in (pickle.loads(pickle.dumps(error)), copy.copy(error), copy.deepcopy(error)):
        assert type(twin) is MissingFileError
        assert str(twin) == str(error)
        assert (twin.errno, twin.filename) == (error.errno, error.filename)
        assert twin.problem == "there is no such file"


@pytest.mark.parametrize("dask", [False, True])
@pytest.mark.parametrize("kind", [DataError, MissingFileError])
def test_a_path_is_added_where_an_error_names_none(kind, dask):
    if dask:  # It changes how exceptions are copied.
        pytest.importorskip("distributed")
    error = kind("no marker is seen", frame=4, found=0, expected=3, advice="Look.")
    named = errors.add_path(error, Path("take.tsv"))
    assert type(named) is kind
    assert error.path is None
    assert str(named) == "take.tsv, " + str(error)
    assert errors.add_path(named, "other.tsv") is named


def test_what_the_system_says_of_a_file_becomes_our_error(tmp_path):
    with pytest.raises(OSError) as caught:
        (tmp_path / "none").open()
    missing = errors.from_os_error(caught.value, tmp_path / "none", "model", "Train one.")
    assert type(missing) is MissingFileError
    assert str(missing) == f"{tmp_path / 'none'}: there is no such model. Train one."
    with pytest.raises(OSError) as caught:
        tmp_path.open()
    folder = errors.from_os_error(caught.value, tmp_path)
    assert type(folder) is FileFormatError
    reason = os.strerror(errno.EISDIR)
    assert str(folder) == (
        f"{tmp_path}: the file cannot be read (found {reason}). Check that you may read it."
    )
    text = errors.from_os_error(ValueError("embedded null byte"), "a")
    assert "found embedded null byte" in str(text)


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (DataError("no marker is seen", path="take.tsv"), "take.tsv: no marker is seen"),
        (MissingFileError(path="take.tsv"), "take.tsv: there is no such file"),
        (PermissionError(13, "Permission denied", "take.tsv"), "take.tsv: Permission denied"),
        (OSError(28, "No space left on device"), "No space left on device"),
        (OSError("odd"), "odd"),
        (TimeoutError(), "TimeoutError"),
        (MemoryError(), "there is not enough memory. Take fewer or shorter recordings at a time."),
        (
            ValueError("no"),
            "this is a bug in mocap-fit (ValueError: no). Set MOCAP_FIT_DEBUG=1, run it again, and "
            "report the traceback that it shows.",
        ),
    ],
)
def test_every_error_is_one_line(error, text):
    assert errors.describe_error(error) == text
