import pickle
from pathlib import Path

import pytest

from mocap_fit import errors, settings_file
from mocap_fit.errors import DataError, FileFormatError, MocapFitError, MocapFitWarning


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
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is DataError
    assert str(copy) == str(error)
    assert (copy.frame, copy.advice) == (4, "Look.")


def test_warnings_can_be_told_from_those_of_others():
    assert issubclass(MocapFitWarning, UserWarning)
    assert not issubclass(MocapFitWarning, MocapFitError)


@pytest.mark.parametrize(
    ("location", "message", "place", "problem"),
    [
        (("rate",), "Field required", "rate", "this is missing"),
        (("rows", 1, "size"), "Input should be 3", "rows.1 'b'.size", "input should be 3"),
        (
            ("rows", 1, "name", "str"),
            "Value error, 'b' is taken",
            "rows.1 'b'.name",
            "'b' is taken",
        ),
        (("rows", 5), "Field required", "rows.5", "this is missing"),
        ((), "Value error, too few rows", "", "too few rows"),
    ],
)
def test_the_first_fault_of_a_file_of_tables(location, message, place, problem):
    content = {"rows": [{"size": 1}, {"name": "b", "size": 2}]}
    faults = [{"loc": location, "msg": message}, {"loc": ("other",), "msg": "other"}]
    assert settings_file.find_first_fault(content, faults) == (place, problem)
