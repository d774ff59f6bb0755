"""What is said of many utterances at once."""

from corpus_tools.batch import ItemResult
from corpus_tools.conversion.report import format_messages
from mocap_fit.phones import UnknownPhone


def test_many_warnings_are_cut_short():
    outcomes = {f"u{i:02d}": ItemResult("u", warnings=("look",)) for i in range(30)}
    lines = format_messages(outcomes)
    assert lines[0] == "warning: u00: look"
    assert len(lines) == 11
    assert "20 more" in lines[-1]


def test_one_reason_is_one_line():
    outcomes = {f"u{i}": ItemResult("u", error="no reference") for i in range(8)} | {
        "a": ItemResult("a", error="bad")
    }
    lines = format_messages(outcomes)
    assert lines == ["error: a: bad", "error: u0, u1, u2, u3, u4 and 3 more: no reference"]


def test_unknown_phones_of_all_are_one_list():
    outcomes = {
        name: ItemResult(
            name, error="unknown", details=(UnknownPhone("Q", 2, ((name, 0.5), (name, 0.75))),)
        )
        for name in ("a", "b")
    }
    more = UnknownPhone("X", 1, (("b", 1.0),))
    outcomes["b"] = ItemResult("b", error="unknown", details=(*outcomes["b"].details, more))
    (line,) = format_messages(outcomes)
    assert "2 symbols are not in the phone set" in line
    assert "'Q' 4× (a at 0.500 s, a at 0.750 s, b at 0.500 s, b at 0.750 s)" in line
    assert "'X' 1× (b at 1.000 s)" in line


def test_recordings_in_no_row():
    assert (
        "2 recordings are not in the table of sentences: x, y" in format_messages({}, ["x", "y"])[0]
    )
