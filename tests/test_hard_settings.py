"""Files that people write, spoilt in every way: read, or refused by one error that names them."""

import copy
import datetime
import math
import tomllib
import warnings
from importlib import resources
from pathlib import Path

import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from corpus_tools.conversion.manifest import load_manifest, read_example
from corpus_tools.validation import load_thresholds
from mocap_fit.control.rule_table import load_rules
from mocap_fit.corpus import open_corpus
from mocap_fit.errors import MocapFitError
from mocap_fit.face.rig_file import read_rig_file
from mocap_fit.fitting import load_layout
from mocap_fit.parsing import parse_json, parse_toml
from mocap_fit.phones import load_phone_set


def shipped(package, *path):
    text = resources.files(package).joinpath(*path).read_text("utf-8")
    return tomllib.loads(text)


def load_corpus_of(path):
    """Open a corpus whose description is the file; its table is not there."""
    (path.parent / "corpus.toml").write_bytes(path.read_bytes())
    return open_corpus(path.parent)


DESCRIPTION = {
    "format_version": 1,
    "language": "sv",
    "phone_set": "sv-sta",
    "face": "built-in",
    "layout": "face30-head5",
    "parameters": ["jaw_rotation"],
    "rate": 60.0,
    "units": {"length": "mm"},
    "provenance": [{"step": "convert", "arguments": {"a": [1]}, "version": "1"}],
}
# The function that reads each, and a file that it reads.
KINDS = {
    "layout": (load_layout, shipped("mocap_fit.fitting", "layouts", "face30-head5.toml")),
    "rig": (read_rig_file, shipped("mocap_fit.face", "parke.toml")),
    "phone set": (load_phone_set, shipped("mocap_fit.phones", "sets", "sv-sta.toml")),
    "rules": (
        lambda path: load_rules(load_phone_set("sv-sta"), str(path)),
        shipped("mocap_fit.control", "rules", "sv.toml"),
    ),
    "manifest": (load_manifest, tomllib.loads(read_example())),
    "thresholds": (load_thresholds, shipped("corpus_tools.validation", "thresholds.toml")),
    "corpus": (load_corpus_of, DESCRIPTION),
}
VALUES = (
    *(True, False, 0, -1, 1, 10**18, -(2**63), 0.0, -1.5, 1e308, 5e-324),
    *(math.nan, math.inf, -math.inf, "", "x", "\0", "../..", "a\n\x1b[31m\u202e", "9" * 5000),
    *([], [[]], [1, 2], ["a", 1.0], {}, {"x": 1}, [{}], "x" * 100_000),
    datetime.date(2026, 1, 1),
)


def list_paths(content, path=()):
    yield path
    items = content.items() if isinstance(content, dict) else enumerate(content[:3])
    for key, value in items:
        if isinstance(value, dict | list):
            yield from list_paths(value, (*path, key))
        else:
            yield (*path, key)


PATHS = {
    kind: [path for path in list_paths(content) if path] for kind, (_, content) in KINDS.items()
}


def spoil(content, path, change, value):
    changed = copy.deepcopy(content)
    at = changed
    for key in path[:-1]:
        at = at[key]
    if change == "left out":
        del at[path[-1]]
    elif change == "renamed" and isinstance(at, dict):
        at["x" * 3000] = at.pop(path[-1])
    elif change == "doubled" and isinstance(at, list):
        at.append(at[path[-1]])
    else:
        at[path[-1]] = value
    return changed


def assert_read_or_refused(load, path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        message = path.name
        try:
            load(path)
        except MocapFitError as error:
            message = str(error)
    assert path.name in message or path.parent.name in message
    assert len(message) < 3000


@pytest.mark.parametrize("kind", KINDS)
@settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(data=st.data())
def test_a_spoilt_value(kind, tmp_path, data):
    load, content = KINDS[kind]
    path = data.draw(st.sampled_from(PATHS[kind]))
    change = data.draw(st.sampled_from(("value", "value", "left out", "doubled", "renamed")))
    changed = spoil(content, path, change, data.draw(st.sampled_from(VALUES)))
    file = tmp_path / "spoilt.toml"
    file.write_text(tomli_w.dumps(changed), encoding="utf-8")
    assert_read_or_refused(load, file)


TEXTS = {
    "empty": b"",
    "no TOML": b"a = ",
    "not UTF-8": b"name = '\xff'",
    "zero bytes": bytes(1000),
    "deep lists": b"a = " + b"[" * 20_000 + b"]" * 20_000,
    "deep tables": b"a = " + b"{a = " * 20_000,
    "deep names": b"a" + b".a" * 20_000 + b" = 1",
    "deep quoted names": b"['a'" + b" . 'a'" * 20_000 + b"]",
    "5,000 digits": b"a = " + b"9" * 5000,
    "5,000 hexadecimal digits": b"format_version = 0x" + b"f" * 5000,
    "65 bits": b"a = 36893488147419103232",
    "a long line": b"#" + b"x" * 3_000_000,
    "too long": b"#" + b"x" * 17_000_000,
    "no key": b"= 1",
    "twice": b"a = 1\na = 2",
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", TEXTS)
def test_what_is_hardly_toml(kind, name, tmp_path):
    path = tmp_path / "spoilt.toml"
    path.write_bytes(TEXTS[name])
    assert_read_or_refused(KINDS[kind][0], path)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "corpus"])
@pytest.mark.parametrize("name", ["a folder", "too long", "a loop", "a zero", "/dev/zero"])
def test_what_is_no_file(kind, name, tmp_path):
    paths = {
        "a folder": tmp_path,
        "too long": tmp_path / ("x" * 300),
        "a loop": tmp_path / "loop.toml",
        "a zero": Path(f"{tmp_path}/\0.toml"),
        "/dev/zero": Path("/dev/zero"),
    }
    (tmp_path / "loop.toml").symlink_to(tmp_path / "loop.toml")
    with pytest.raises(MocapFitError):
        KINDS[kind][0](paths[name])


@pytest.mark.parametrize("parse", [parse_json, parse_toml])
def test_nesting_and_integers_have_limits(parse):
    start = "" if parse is parse_json else "a = "
    parse(start + "[" * 90 + "]" * 90)
    parse(f"{start}{2**64 - 1}")
    for text in ("[" * 101 + "]" * 101, "[" * 100_000, str(2**64), str(-(2**63) - 1), "9" * 5000):
        with pytest.raises(ValueError, match=r"deep|64 bits|digits"):
            parse(start + text)


def test_a_byte_order_mark_is_no_damage(tmp_path):
    path = tmp_path / "mine.toml"
    text = resources.files("mocap_fit.fitting").joinpath("layouts", "face30-head5.toml")
    path.write_bytes(b"\xef\xbb\xbf" + text.read_bytes().replace(b"\n", b"\r\n"))
    assert load_layout(path) == load_layout("face30-head5")


def test_a_corpus_is_described_by_what_it_says(tmp_path):
    """What this test spoils is read as long as it is not spoilt."""
    path = tmp_path / "good.toml"
    path.write_text(tomli_w.dumps(DESCRIPTION))
    with pytest.raises(MocapFitError, match=r"utterances\.parquet.*no such file"):
        load_corpus_of(path)
