"""Files that are not what they seem: hollow tables, heavy models, pipes, shared hard cases."""

import io
import json
import os
import sys
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from corpus_tools.cli import app as cli
from mocap_fit import control, size_limit
from mocap_fit.errors import FileFormatError, MocapFitError
from mocap_fit.io.samples import load_sample
from mocap_fit.tracks import read_parquet

DESCRIPTION = {
    "format_version": 1,
    "kind": "markers",
    "name": "a",
    "names": ["a"],
    "rate": 100.0,
    "start_time": 0.0,
    "events": [],
    "provenance": [],
}


def write_parquet(path, columns, description=None):
    text = json.dumps(DESCRIPTION) if description is None else description
    table = pa.table(columns).replace_schema_metadata({b"mocap_fit": text.encode()})
    pq.write_table(table, path, compression="zstd")
    return path


def repeat(text, count):
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(count, np.int32)), pa.array([text]))


class TestTables:
    def test_many_rows_of_nothing(self, tmp_path, monkeypatch):
        monkeypatch.setenv(size_limit.VARIABLE, "1MB")
        path = write_parquet(tmp_path / "a.parquet", {"a_x": np.zeros(200_000)})
        assert path.stat().st_size < 5000
        with pytest.raises(FileFormatError, match=r"a\.parquet: the table claims.*1,600,000 bytes"):
            read_parquet(path)

    @pytest.mark.parametrize("nested", [False, True])
    def test_one_long_text_many_times(self, tmp_path, monkeypatch, nested):
        monkeypatch.setenv(size_limit.VARIABLE, "50MB")
        texts = repeat("x" * 100_000, 1000)
        if nested:
            texts = pa.ListArray.from_arrays(pa.array(np.arange(1001)), texts)
        path = write_parquet(tmp_path / "a.parquet", {"a_x": np.zeros(1000), "utterance": texts})
        assert path.stat().st_size < 20_000
        with pytest.raises(FileFormatError, match=r"claims.*100,000,000 bytes"):
            read_parquet(path)

    @pytest.mark.parametrize(
        "description",
        [
            "[" * 100_000,
            '{"a": ' + "9" * 5000 + "}",
            json.dumps({**DESCRIPTION, "rate": 10**30}),
            json.dumps({**DESCRIPTION, "names": [1, None]}),
            json.dumps({**DESCRIPTION, "rate": "x"}),
            json.dumps({**DESCRIPTION, "events": {"a": 1}}),
            "\ufeff",
            "null",
            "",
        ],
    )
    def test_damaged_descriptions(self, tmp_path, description):
        path = write_parquet(tmp_path / "a.parquet", {"a_x": np.zeros(3)}, description)
        with pytest.raises(MocapFitError, match=r"a\.parquet"):
            read_parquet(path)


def write_npz(path, compression=zipfile.ZIP_STORED, **members):
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)
    return path


def to_npy(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


HEADER = to_npy(np.frombuffer(json.dumps({"format_version": 2}).encode(), np.uint8))


class TestModels:
    def test_arrays_that_nobody_needs(self, tmp_path):
        path = tmp_path / "a.model"
        write_npz(path, zipfile.ZIP_DEFLATED, header=HEADER, more=to_npy(np.zeros(3_000_000)))
        assert path.stat().st_size < 50_000
        with pytest.raises(FileFormatError, match=r"a\.model: the model is shorter than"):
            control.load(path)

    @pytest.mark.parametrize(
        "array",
        [
            np.zeros(3, complex),
            np.array(["a"]),
            np.array([b"a"]),
            np.zeros(2, [("a", "f8")]),
            np.zeros(2, "datetime64[s]"),
        ],
    )
    def test_arrays_of_other_types(self, tmp_path, array):
        path = write_npz(tmp_path / "a.model", header=HEADER, more=to_npy(array))
        with pytest.raises(FileFormatError, match=r"not a trained model.*an array of"):
            control.load(path)

    @pytest.mark.parametrize("shape", ["(3000000000,)", "(-1,)", "(2, 2)", "(" * 3000, "'x'"])
    def test_shapes_that_are_not_there(self, tmp_path, shape):
        text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode() + b"\n"
        data = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(24)
        path = write_npz(tmp_path / "a.model", header=HEADER, more=data)
        with pytest.raises(FileFormatError, match=r"a\.model"):
            control.load(path)


@pytest.mark.skipif(sys.platform == "win32", reason="no pipes with names")
@pytest.mark.parametrize("ending", ["tsv", "c3d", "csv", "trc", "parquet", "model", "TextGrid"])
def test_pipes_are_not_waited_for(ending, tmp_path, capsys):
    path = tmp_path / f"a.{ending}"
    os.mkfifo(path)
    calls = [["info", path], ["fit", path, "--reference", load_sample("rest")]]
    calls[1] += ["--layout", "face30-head5", "--out", tmp_path / "out"]
    for call in calls:
        assert cli.main([str(argument) for argument in call]) == 1
        assert "this is not an ordinary file" in capsys.readouterr().err
    for read in (read_parquet, control.load):
        with pytest.raises(FileFormatError, match="not an ordinary file"):
            read(path)


@pytest.fixture(scope="module")
def hard(data_folder) -> Path:
    """The shared inputs that were found by mutation; skipped where they are not."""
    folder = data_folder.parent / "cases" / "hard"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    return folder


def fit(**options):
    values = {"reference": load_sample("rest"), "layout": "face30-head5", **options}
    given = [part for name, value in values.items() for part in (f"--{name}", value)]
    return ["fit", load_sample("take_01"), *given]


@pytest.mark.real_data
class TestSharedCases:
    """Each ends in one line, with the status of bad data."""

    def refuse(self, capsys, *call):
        assert cli.main([str(argument) for argument in call]) == 1
        shown = capsys.readouterr()
        (line,) = [line for line in shown.err.splitlines() if "fitting recordings" not in line]
        assert line.startswith("mocap-fit: error: ")
        assert "bug" not in line
        assert len(line) < 2000
        return line

    @pytest.mark.parametrize("name", ["deep.toml", "biginteger.toml"])
    def test_settings(self, hard, name, tmp_path, capsys):
        path = hard / name
        for option in ("layout", "face"):
            assert name in self.refuse(capsys, *fit(out=tmp_path / "out", **{option: path}))
        self.refuse(capsys, "convert", path, "--out", tmp_path / "corpus")
        for option in ("--thresholds", "--layout", "--phone-set"):
            self.refuse(capsys, "validate", load_sample("take_01"), option, path)
        rules = ["--set", f"rules={path}"]
        (tmp_path / "corpus.toml").write_bytes(path.read_bytes())
        for call in (["info", tmp_path], ["train", tmp_path, "--model", "rule-based", *rules]):
            more = ["--out", tmp_path / "m"] if call[0] == "train" else []
            self.refuse(capsys, *call, *more)
        assert not (tmp_path / "corpus").exists()

    @pytest.mark.parametrize(
        "name", ["deepjson.parquet", "bigint.parquet", "corpus_90a80d1c.parquet"]
    )
    def test_tables(self, hard, name, tmp_path, capsys):
        assert name in self.refuse(capsys, "info", hard / name)
        target = tmp_path / "a.csv"
        assert name in self.refuse(capsys, "export", hard / name, "--to", "csv", "--out", target)
        (tmp_path / "corpus.toml").write_text(
            'format_version=1\nlanguage="sv"\nphone_set="sv-sta"\nface="a"\nlayout="b"\n'
            "parameters=[]\nprovenance=[]\n"
        )
        (tmp_path / "utterances.parquet").write_bytes((hard / name).read_bytes())
        assert cli.main(["info", str(tmp_path)]) in (0, 1)
        assert "bug" not in capsys.readouterr().err

    @pytest.mark.parametrize("name", ["model_577735d1.model", "model_95e01533.model"])
    def test_models(self, hard, name, tmp_path, capsys):
        assert name in self.refuse(capsys, "info", hard / name)
        with zipfile.ZipFile(hard / name) as old, zipfile.ZipFile(tmp_path / name, "w") as new:
            for member in old.namelist():
                data = old.read(member)
                new.writestr(member, data.replace(b'"format_version": 1', b'"format_version": 2'))
        assert cli.main(["info", str(tmp_path / name)]) in (0, 1)
        assert "bug" not in capsys.readouterr().err

    @pytest.mark.parametrize("name", ["mesh_049dd387.ply", "huge_index.ply", "crash.vtk"])
    def test_meshes(self, hard, name, tmp_path, capsys):
        rig = tmp_path / "rig.toml"
        rig.write_text(f"extends = 'parke'\nmesh = '{hard / name}'\n")
        assert name in self.refuse(capsys, *fit(face=rig, out=tmp_path / "out"))

    def test_long_keys(self, hard, tmp_path, capsys):
        layout, manifest = hard / "layout_82a4a552.toml", hard / "manifest_84a50310.toml"
        line = self.refuse(capsys, *fit(layout=layout, out=tmp_path / "out"))
        assert len(line) < 600
        line = self.refuse(capsys, "convert", manifest, "--out", tmp_path / "corpus")
        assert len(line) < 600

    def test_dollars(self, hard, tmp_path, capsys):
        page = tmp_path / "page.html"
        call = ["validate", hard / "dollar.csv", "--layout", hard / "dollar_layout.toml"]
        assert cli.main([*map(str, call), "--html", str(page)]) in (0, 1)
        assert "bug" not in capsys.readouterr().err
        assert page.stat().st_size > 10_000
