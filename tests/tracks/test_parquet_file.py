"""Parquet files with a description, whatever their columns are."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mocap_fit.errors import FileFormatError
from mocap_fit.tracks.parquet_file import check_types, read_kind, read_table, write_table


def columns(count=3):
    return {"time": pa.array(np.arange(float(count)))}


def describe(path):
    return pq.read_schema(path).metadata[b"mocap_fit"]


def test_the_order_of_a_description_does_not_matter(tmp_path):
    write_table(columns(), {"kind": "noise", "name": "å", "rate": 50}, tmp_path / "one")
    write_table(columns(), {"rate": 50, "name": "å", "kind": "noise"}, tmp_path / "two")
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
    assert describe(tmp_path / "one") == (
        '{"format_version": 1, "kind": "noise", "name": "å", "rate": 50}'.encode()
    )
    table, description = read_table(tmp_path / "one", ("noise",), "noise", "")
    assert description["name"] == "å"
    assert table.column("time").to_pylist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(("rows", "groups"), [(16384, 1), (16385, 2)])
def test_rows_come_in_groups_that_can_be_read_apart(tmp_path, rows, groups):
    write_table(columns(rows), {"kind": "noise"}, tmp_path / "x")
    assert pq.ParquetFile(tmp_path / "x").metadata.num_row_groups == groups


def test_a_changed_number_is_noticed(tmp_path):
    """Pages have checksums: a bit of the compressed numbers is not taken for another number."""
    path = tmp_path / "x"
    numbers = np.random.default_rng(0).normal(size=500)
    write_table({"x": pa.array(numbers)}, {"kind": "noise"}, path)
    content = bytearray(path.read_bytes())
    content[content.find(numbers[250].tobytes()[:6])] ^= 1
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match="not a whole Parquet file"):
        read_table(path, ("noise",), "noise", "")


@pytest.mark.parametrize("version", [0, 1, 2, "1", None])
def test_formats_up_to_this_one_are_read(tmp_path, version):
    path = tmp_path / "x"
    text = json.dumps({"format_version": version, "kind": "noise"})
    pq.write_table(pa.table(columns()).replace_schema_metadata({"mocap_fit": text}), path)
    if version in (0, 1):
        assert read_table(path, ("noise",), "noise", "")[1]["kind"] == "noise"
    else:
        with pytest.raises(FileFormatError, match=f"format_version {version}, expected at most 1"):
            read_table(path, ("noise",), "noise", "")
    assert read_kind(path) == "noise"


def test_a_kind_is_text_and_one_of_those_that_are_wanted(tmp_path):
    path = tmp_path / "x"
    write_table(columns(), {"kind": 5}, path)
    assert read_kind(path) is None
    write_table(columns(), {"kind": "noise"}, path)
    with pytest.raises(FileFormatError, match=r"used as sound \(found noise, expected sound, ton"):
        read_table(path, ("sound", "tone"), "sound", "")


def test_columns_have_their_types_and_lack_values_where_they_may():
    table = pa.table({"a": pa.array([1.0, None]), "b": pa.array([1, 2])})
    with pytest.raises(TypeError, match="the column a lacks 1 values"):
        check_types(table, {"a": pa.float64(), "b": pa.int64()})
    check_types(table, {"a": pa.float64(), "b": pa.int64()}, ("a",))
    with pytest.raises(TypeError, match="the column b holds int64 and not double"):
        check_types(table, {"b": pa.float64()})
    with pytest.raises(KeyError):
        check_types(table, {"c": pa.float64()})


def test_texts_are_measured_before_they_are_unpacked(tmp_path, monkeypatch):
    """Two megabytes of equal texts have next to no bytes in a file."""
    monkeypatch.setenv("MOCAP_FIT_MAX_SIZE", "1MB")
    path = tmp_path / "x"
    write_table({"text": pa.array(["x" * 1000] * 2000)}, {"kind": "noise"}, path)
    assert path.stat().st_size < 50_000
    with pytest.raises(FileFormatError, match="claims"):
        read_table(path, ("noise",), "noise", "")
    write_table({"text": pa.array(["x" * 1000] * 900)}, {"kind": "noise"}, path)
    assert read_table(path, ("noise",), "noise", "")[0].num_rows == 900
