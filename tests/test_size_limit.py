"""How much a file may unpack to."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocap_fit.errors import ConfigurationError, FileFormatError
from mocap_fit.size_limit import VARIABLE, check_size, format_size, get_largest_size, parse_size


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("8GB", 8_000_000_000),
        ("8gb", 8_000_000_000),
        ("1.5 MB", 1_500_000),
        ("2GiB", 2 * 2**30),
        ("64k", 64_000),
        (" 4096 ", 4096),
        ("12B", 12),
        ("1TB", 10**12),
    ],
)
def test_sizes_in_words(text, size):
    assert parse_size(text) == size


@pytest.mark.parametrize(
    "text", ["", "much", "-1GB", "0", "0.2", "1e9", "nan", "inf", "8 G B", "9" * 5000, "1PB", "٣MB"]
)
def test_what_is_no_size(text):
    with pytest.raises(ConfigurationError, match="not a size"):
        parse_size(text)


def test_the_limit_is_2_gb_and_the_environment_changes_it(monkeypatch, tmp_path):
    monkeypatch.delenv(VARIABLE, raising=False)
    assert get_largest_size() == 2_000_000_000
    check_size(2_000_000_000, path=tmp_path)
    with pytest.raises(FileFormatError, match=r"found 2,000,000,001 bytes.*--max-size"):
        check_size(2_000_000_001, path=tmp_path)
    monkeypatch.setenv(VARIABLE, "8GB")
    check_size(8_000_000_000, path=tmp_path)
    monkeypatch.setenv(VARIABLE, "")
    assert get_largest_size() == 2_000_000_000
    monkeypatch.setenv(VARIABLE, "plenty")
    with pytest.raises(ConfigurationError, match="plenty"):
        check_size(1, path=tmp_path)


def test_a_claim_above_what_the_file_holds(tmp_path):
    check_size(100, path=tmp_path / "a.c3d", available_bytes=100)
    with pytest.raises(FileFormatError, match=r"a\.c3d: the recording is shorter.*99 bytes") as e:
        check_size(100, path=tmp_path / "a.c3d", available_bytes=99, noun="recording")
    assert e.value.found == "99 bytes"


@given(st.integers(0, 10**6000))
def test_any_size_can_be_said(size):
    text = format_size(size)
    assert len(text) < 40
    if size < 10**18:
        assert int(text.removesuffix(" bytes").replace(",", "")) == size
