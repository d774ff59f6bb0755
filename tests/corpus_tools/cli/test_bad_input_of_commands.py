"""Bad input of every kind through the command line: one line of error, a status, and no file."""

import os
import shutil
import subprocess
import sys
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from corpus_tools.cli import app as cli
from mocap_fit.io import read_tracks, write_qualisys_tsv

HEAD = ("head_bridge", "head_rim_left", "head_rim_right", "head_temple_left", "head_temple_right")


class Desk:
    """Where a case lays out its files: good ones of the session, spoilt ones of its own."""

    def __init__(self, session, folder):
        self.session = session
        self.folder = folder
        self.out = folder / "out"

    def file(self, name, content):
        path = self.folder / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    def text(self):
        """The good recording as text, with one kind of line end."""
        return self.session.recordings[0].read_text(encoding="utf-8").replace("\r\n", "\n")

    def header(self, key, value):
        """The recording with another value in its header."""
        lines = [
            f"{key}\t{value}" if line.split("\t")[0] == key else line
            for line in self.text().split("\n")
        ]
        return self.file("bad.tsv", "\n".join(lines))

    def cell(self, row, column, value):
        """The recording with another value in its table; row 0 is the first frame."""
        lines = self.text().split("\n")
        first = next(i for i, line in enumerate(lines) if line.startswith("1\t"))
        cells = lines[first + row].split("\t")
        cells[column] = value
        lines[first + row] = "\t".join(cells)
        return self.file("bad.tsv", "\n".join(lines))

    def recording(self, change, source=None, name="bad.tsv"):
        """A recording whose positions and names are what `change` makes of those of a good one."""
        good = read_tracks(source or self.session.recordings[0])
        names, positions = change(good.names, good.positions.copy())
        path = self.folder / name
        write_qualisys_tsv(good.replace(names=names, positions=positions, origin=None), path)
        return path

    def reference(self, change):
        return self.recording(change, self.session.reference, "bad_reference.tsv")

    def layout(self, old="", new="", text=None):
        """The shipped layout with one piece of text in place of another, or other text."""
        if text is None:
            folder = resources.files("mocap_fit.fitting").joinpath("layouts")
            text = folder.joinpath(f"{self.session.layout}.toml").read_text("utf-8")
            assert old in text
            text = text.replace(old, new)
        return self.file("bad_layout.toml", text)

    def rig(self, old="", new="", text=None):
        """The same for the shipped rig."""
        if text is None:
            text = resources.files("mocap_fit.face").joinpath("parke.toml").read_text("utf-8")
            assert old in text
            text = text.replace(old, new, 1)
        return self.file("bad_rig.toml", text)

    def fit(self, recording=None, *, reference=None, layout=None, face=None, out=None):
        """The call of `mocap-fit fit`, good in all that is not given."""
        return [
            "fit",
            str(recording or self.session.recordings[0]),
            "--reference",
            str(reference or self.session.reference),
            "--layout",
            str(layout or self.session.layout),
            "--out",
            str(out or self.out),
            *(("--face", str(face)) if face else ()),
        ]


def without(*gone):
    def change(names, positions):
        kept = [i for i, name in enumerate(names) if name not in gone]
        return tuple(names[i] for i in kept), positions[:, kept]

    return change


def scaled(factor):
    return lambda names, positions: (names, factor * positions)


def never_seen(*gone):
    def change(names, positions):
        positions[:, [names.index(name) for name in gone]] = np.nan
        return names, positions

    return change


def head_on_a_line(names, positions):
    for i, name in enumerate(HEAD):
        positions[:, names.index(name)] = [20.0 * i, 300.0, 1200.0]
    return names, positions


def renamed(names, positions):
    return tuple(f"other_{i}" for i in range(len(names))), positions


def all_in_one_place(names, positions):
    return names, np.full_like(positions, 300.0)


RIG_MESH = """extends = "parke"
mesh = "{mesh}"
"""

OBJ = """o mask
v -40 -60 0
v 40 -60 0
v 40 60 0
v -40 60 0
f 1 2 3
f 1 3 4
"""


def with_mesh(name, content, more=""):
    def case(desk):
        if content is not None:
            desk.file(name, content)
        return desk.fit(face=desk.rig(text=RIG_MESH.format(mesh=name) + more))

    return case


# Name of the case → what makes the call, and words that the error must have.
RECORDINGS = {
    "empty": (lambda d: d.fit(d.file("bad.tsv", "")), ("bad.tsv", "empty")),
    "only blank lines": (lambda d: d.fit(d.file("bad.tsv", "\n\n\n")), ("bad.tsv",)),
    "header cut off": (lambda d: d.fit(d.file("bad.tsv", d.text()[:60])), ("bad.tsv",)),
    "no frame": (
        lambda d: d.fit(d.file("bad.tsv", d.text()[: d.text().index("\n1\t") + 1])),
        ("bad.tsv",),
    ),
    "cut off in the first frame": (
        lambda d: d.fit(d.file("bad.tsv", d.text()[: d.text().index("\n1\t") + 40])),
        ("bad.tsv",),
    ),
    "fewer markers than names": (
        lambda d: d.fit(d.header("NO_OF_MARKERS", "34")),
        ("bad.tsv", "34", "35"),
    ),
    "more markers than names": (lambda d: d.fit(d.header("NO_OF_MARKERS", "36")), ("36", "35")),
    "number of markers in words": (
        lambda d: d.fit(d.header("NO_OF_MARKERS", "many")),
        ("bad.tsv", "line 4", "many"),
    ),
    "text in a number": (lambda d: d.fit(d.cell(3, 5, "abc")), ("bad.tsv", "line", "abc")),
    "a number too many": (lambda d: d.fit(d.cell(3, 5, "1.0\t2.0")), ("bad.tsv", "line")),
    "an infinite number": (lambda d: d.fit(d.cell(3, 5, "inf")), ("bad.tsv",)),
    "a number beyond all": (lambda d: d.fit(d.cell(3, 5, "1e300")), ("bad.tsv",)),
    "two markers of one name": (
        lambda d: d.fit(d.file("bad.tsv", d.text().replace("lip_lower_mid", "lip_upper_mid"))),
        ("bad.tsv", "lip_upper_mid"),
    ),
    "rate of zero": (lambda d: d.fit(d.header("FREQUENCY", "0")), ("bad.tsv", "rate")),
    "negative rate": (lambda d: d.fit(d.header("FREQUENCY", "-60")), ("bad.tsv", "-60")),
    "rate in words": (lambda d: d.fit(d.header("FREQUENCY", "fast")), ("bad.tsv", "fast")),
    "rate not a number": (lambda d: d.fit(d.header("FREQUENCY", "nan")), ("bad.tsv",)),
    "no marker seen in any frame": (
        lambda d: d.fit(d.recording(scaled(np.nan))),
        ("bad.tsv",),
    ),
    "binary": (lambda d: d.fit(d.file("bad.tsv", bytes(range(256)) * 40)), ("bad.tsv",)),
    "a picture": (
        lambda d: d.fit(d.file("bad.tsv", b"\x89PNG\r\n\x1a\n" + bytes(500))),
        ("bad.tsv",),
    ),
    "sixteen bits a letter, cut": (
        lambda d: d.fit(d.file("bad.tsv", d.text().encode("utf-16")[:501])),
        ("bad.tsv",),
    ),
    "a header line of 20 MB": (
        lambda d: d.fit(d.header("DESCRIPTION", "x" * 20_000_000)),
        ("bad.tsv",),
    ),
    "in metres": (
        lambda d: d.fit(d.recording(scaled(0.001))),
        ("bad.tsv", "in metres", "millimetres"),
    ),
    "C3D of zeros": (
        lambda d: d.fit(d.file("bad.c3d", b"\x02\x50" + bytes(510))),
        ("bad.c3d",),
    ),
    "no reference marker": (
        lambda d: d.fit(d.recording(without(*HEAD))),
        ("bad.tsv", "reference markers"),
    ),
    "two reference markers": (lambda d: d.fit(d.recording(without(*HEAD[2:]))), ("bad.tsv",)),
    "reference markers never seen": (lambda d: d.fit(d.recording(never_seen(*HEAD))), ("bad.tsv",)),
    "reference markers on a line": (lambda d: d.fit(d.recording(head_on_a_line)), ("bad.tsv",)),
    "all markers in one place": (lambda d: d.fit(d.recording(all_in_one_place)), ("bad.tsv",)),
    "a face marker is not there": (
        lambda d: d.fit(d.recording(without("lip_upper_mid"))),
        ("bad.tsv", "lip_upper_mid", "layout"),
    ),
    "face markers never seen": (
        lambda d: d.fit(
            d.recording(lambda n, p: never_seen(*(m for m in n if m not in HEAD))(n, p))
        ),
        ("bad.tsv",),
    ),
    "of another layout": (lambda d: d.fit(d.recording(renamed)), ("bad.tsv",)),
    "not there": (lambda d: d.fit(d.folder / "no.tsv"), ("no.tsv",)),
    "a folder without recordings": (lambda d: d.fit(d.folder), ("no recording",)),
    "a folder with the name of a file": (
        lambda d: d.fit(made_folder(d.folder / "take.tsv")),
        ("take.tsv",),
    ),
    "a pattern without match": (lambda d: d.fit(d.folder / "*.tsv"), ("*.tsv", "no recording")),
    "a link to nowhere": (lambda d: d.fit(link(d.folder / "gone.tsv")), ("gone.tsv",)),
    "an unknown format": (lambda d: d.fit(d.file("bad.xyz", "1 2 3\n")), ("bad.xyz",)),
    "parameters in place of markers": (
        lambda d: d.fit(d.session.truth[0]),
        ("sim001.parquet", "parameter"),
    ),
    "poses in place of markers": (lambda d: d.fit(d.session.poses[0]), ("sim001.parquet",)),
    "Parquet of another program": (
        lambda d: d.fit(d.file("bad.parquet", b"PAR1" + bytes(50) + b"PAR1")),
        ("bad.parquet",),
    ),
    "C3D cut off": (lambda d: d.fit(d.file("bad.c3d", b"\x02P" + bytes(20))), ("bad.c3d",)),
    "CSV without numbers": (lambda d: d.fit(d.file("bad.csv", "a,b,c\nd,e,f\n")), ("bad.csv",)),
    "TRC without a table": (
        lambda d: d.fit(d.file("bad.trc", "PathFileType\t4\t(X/Y/Z)\tbad.trc\n")),
        ("bad.trc",),
    ),
}

REFERENCES = {
    "not there": (lambda d: d.fit(reference=d.folder / "no.tsv"), ("no.tsv",)),
    "empty": (lambda d: d.fit(reference=d.file("r.tsv", "")), ("r.tsv", "empty")),
    "a folder": (lambda d: d.fit(reference=d.folder), ("folder",)),
    "in metres": (
        lambda d: d.fit(reference=d.reference(scaled(0.001))),
        ("bad_reference.tsv", "millimetres"),
    ),
    "in micrometres": (
        lambda d: d.fit(reference=d.reference(scaled(1000.0))),
        ("bad_reference.tsv",),
    ),
    "lacks markers": (
        lambda d: d.fit(reference=d.reference(without("chin_mid", "jaw_left"))),
        ("bad_reference.tsv", "chin_mid", "jaw_left"),
    ),
    "a face marker never seen": (
        lambda d: d.fit(reference=d.reference(never_seen("chin_mid"))),
        ("bad_reference.tsv", "chin_mid"),
    ),
    "head markers never seen": (
        lambda d: d.fit(reference=d.reference(never_seen(*HEAD[1:]))),
        ("bad_reference.tsv", "only 1"),
    ),
    "head markers on a line": (
        lambda d: d.fit(reference=d.reference(head_on_a_line)),
        ("bad_reference.tsv", "line"),
    ),
    "all markers in one place": (
        lambda d: d.fit(reference=d.reference(all_in_one_place)),
        ("bad_reference.tsv",),
    ),
    "of another layout": (
        lambda d: d.fit(reference=d.reference(renamed)),
        ("bad_reference.tsv", "layout"),
    ),
    "parameters in place of markers": (
        lambda d: d.fit(reference=d.session.truth[0]),
        ("sim001.parquet",),
    ),
}

LAYOUTS = {
    "not there": (lambda d: d.fit(layout=d.folder / "no.toml"), ("no.toml",)),
    "unknown name": (lambda d: d.fit(layout="face31-head5"), ("face31-head5", "face30-head5")),
    "a folder": (lambda d: d.fit(layout=d.folder), ("layout",)),
    "empty": (lambda d: d.fit(layout=d.layout(text="")), ("bad_layout.toml", "markers")),
    "not TOML": (lambda d: d.fit(layout=d.layout(text="markers = [")), ("bad_layout.toml", "TOML")),
    "binary": (lambda d: d.fit(layout=d.file("b.toml", b"\xff\xfe\x00")), ("b.toml",)),
    "unknown key": (
        lambda d: d.fit(layout=d.layout("orientation = true", "oriented = true")),
        ("bad_layout.toml", "oriented"),
    ),
    "no strategic point": (
        lambda d: d.fit(layout=d.layout("orientation = true", "")),
        ("bad_layout.toml", "orientation"),
    ),
    "a marker twice": (
        lambda d: d.fit(layout=d.layout("lip_lower_mid", "lip_upper_mid")),
        ("bad_layout.toml", "lip_upper_mid"),
    ),
    "unknown region": (
        lambda d: d.fit(layout=d.layout('["upper_lip", ', '["moustache", ')),
        ("bad_layout.toml", "moustache"),
    ),
    "unknown feature point": (
        lambda d: d.fit(layout=d.layout('"8.1"', '"8.99"')),
        ("bad_layout.toml", "8.99"),
    ),
    "unknown parameter": (
        lambda d: d.fit(
            layout=d.layout("[reference_parameters]", "[reference_parameters]\nsmile = 0.3")
        ),
        ("bad_layout.toml", "smile"),
    ),
    "a parameter that is no number": (
        lambda d: d.fit(
            layout=d.layout("[reference_parameters]", "[reference_parameters]\njaw_shift = 'a'")
        ),
        ("bad_layout.toml", "jaw_shift"),
    ),
    "unknown role": (
        lambda d: d.fit(layout=d.layout('role = "head"', 'role = "hat"')),
        ("bad_layout.toml", "role"),
    ),
    "negative weight": (
        lambda d: d.fit(layout=d.layout("orientation = true", "orientation = true\nweight = -1")),
        ("bad_layout.toml", "weight"),
    ),
    "markers above the skin by a metre": (
        lambda d: d.fit(layout=d.layout("marker_offset = 2.0", "marker_offset = 1000.0")),
        ("bad_layout.toml", "marker_offset"),
    ),
    "markers that do not exist": (
        lambda d: d.fit(layout=d.layout("chin_mid", "chin_tip")),
        ("chin_tip", "reference.tsv"),
    ),
    "a lip in the region of the forehead": (
        lambda d: d.fit(layout=d.layout('["upper_lip", "upper_lip_skin"]', '["forehead"]')),
        ("bad_layout.toml", "lip_upper_mid"),
    ),
    "two markers in all": (
        lambda d: d.fit(layout=d.layout(text='[[markers]]\nname="a"\nfeature_point="8.1"\n' * 2)),
        ("bad_layout.toml",),
    ),
}

FACES = {
    "unknown": (lambda d: d.fit(face="no-such-face"), ("no-such-face",)),
    "a folder": (lambda d: d.fit(face=d.folder), ("rig",)),
    "not TOML": (lambda d: d.fit(face=d.rig(text="kind = [")), ("bad_rig.toml", "TOML")),
    "empty": (lambda d: d.fit(face=d.rig(text="")), ("bad_rig.toml",)),
    "binary": (lambda d: d.fit(face=d.file("b.toml", b"\xff\x00\xfe")), ("b.toml",)),
    "unknown key": (lambda d: d.fit(face=d.rig('kind = "parke"', "sort = 1")), ("sort",)),
    "unknown kind": (
        lambda d: d.fit(face=d.rig('kind = "parke"', 'kind = "puppet"')),
        ("puppet", "parke"),
    ),
    "extends nothing known": (
        lambda d: d.fit(face=d.rig(text='extends = "nobody"')),
        ("bad_rig.toml", "nobody"),
    ),
    "bounds the wrong way round": (
        lambda d: d.fit(face=d.rig("jaw_rotation = [-0.5, 1.5]", "jaw_rotation = [1.5, -0.5]")),
        ("bad_rig.toml", "jaw_rotation"),
    ),
    "a transform of an unknown parameter": (
        lambda d: d.fit(face=d.rig('parameter = "lip_rounding"', 'parameter = "smile"')),
        ("bad_rig.toml", "smile"),
    ),
    "a transform with an unknown weight": (
        lambda d: d.fit(face=d.rig('weight = "mouth"', 'weight = "beard"')),
        ("bad_rig.toml", "beard"),
    ),
    "an unknown transform": (
        lambda d: d.fit(face=d.rig('kind = "scaling"', 'kind = "shearing"')),
        ("bad_rig.toml", "kind"),
    ),
    "a translation to nowhere": (
        lambda d: d.fit(face=d.rig("by = [0, 0, 7]", "")),
        ("bad_rig.toml", "by"),
    ),
    "a weight of no kind": (
        lambda d: d.fit(face=d.rig("radii = [42, 30, 46]", "")),
        ("bad_rig.toml", "lips"),
    ),
    "radii of zero": (
        lambda d: d.fit(face=d.rig("radii = [42, 30, 46]", "radii = [42, 0, 46]")),
        ("bad_rig.toml", "radii"),
    ),
    "a weight at an unknown feature point": (
        lambda d: d.fit(face=d.rig('centre = { at = "8.3"', 'centre = { at = "8.33"')),
        ("bad_rig.toml", "8.33"),
    ),
    "a weight in an unknown region": (
        lambda d: d.fit(face=d.rig('regions = ["lower_lip"]', 'regions = ["beard"]')),
        ("bad_rig.toml", "beard"),
    ),
    "a number that is not finite": (
        lambda d: d.fit(face=d.rig("mouth_width = 50.0", "mouth_width = nan")),
        ("bad_rig.toml", "mouth_width"),
    ),
    "mesh not there": (with_mesh("no.obj", None), ("no.obj",)),
    "mesh empty": (with_mesh("m.obj", ""), ("m.obj", "empty")),
    "mesh of an unknown format": (with_mesh("m.max", "x"), ("m.max",)),
    "OBJ broken": (with_mesh("m.obj", "v 1 2\nf 1 2 3\n"), ("m.obj",)),
    "OBJ names vertices that are not there": (
        with_mesh("m.obj", OBJ + "f 1 2 99\n"),
        ("m.obj", "99"),
    ),
    "PLY broken": (with_mesh("m.ply", "ply\nformat ascii 1.0\nelement"), ("m.ply",)),
    "STL without triangles": (with_mesh("m.stl", "solid empty\nendsolid empty\n"), ("m.stl",)),
    "GLB broken": (with_mesh("m.glb", b"glTF" + bytes(30)), ("m.glb",)),
    "mesh in metres": (with_mesh("m.obj", OBJ.replace("0 ", "0e-4 ")), ("m.obj", "scale")),
    "mesh without feature points": (with_mesh("m.obj", OBJ), ("feature point",)),
    "feature point beyond the mesh": (
        with_mesh("m.obj", OBJ, '[feature_points]\n"8.1" = 4000\n'),
        ("8.1",),
    ),
    "impossible axes": (with_mesh("m.obj", OBJ, 'axes = "x x z"\n'), ("axes",)),
    "negative scale": (with_mesh("m.obj", OBJ, "scale = -1.0\n"), ("scale",)),
}


def under_a_file(desk):
    return desk.fit(out=desk.file("taken", "mine") / "deeper")


def full_folder(desk):
    desk.out.mkdir()
    (desk.out / "precious.txt").write_text("mine")
    return desk.out


def made_folder(path):
    path.mkdir()
    return path


def link(path):
    path.symlink_to(path.parent / "nowhere")
    return path


def locked(desk):
    desk.out.mkdir()
    desk.out.chmod(0o500)
    return desk.fit(), desk.out, os.W_OK


def unreadable(desk):
    path = desk.file("locked.tsv", desk.text())
    path.chmod(0)
    return desk.fit(path), path, os.R_OK


def folder_in_place_of_a_result(desk):
    (desk.out / "sim001.parquet").mkdir(parents=True)
    return desk.fit()


FOLDERS = {
    "fit: a folder where a result goes": (folder_in_place_of_a_result, ("sim001.parquet",)),
    "fit: a file where the results go": (
        lambda d: d.fit(out=d.file("taken", "mine")),
        ("taken",),
    ),
    "fit: results under a file": (under_a_file, ("taken",)),
    "simulate: a folder with something in it": (
        lambda d: ["simulate", str(full_folder(d))],
        ("out", "not empty"),
    ),
    "simulate: a file": (lambda d: ["simulate", str(d.file("taken", "mine"))], ("taken",)),
    "simulate: under a file": (
        lambda d: ["simulate", str(d.file("taken", "mine") / "deeper")],
        ("taken",),
    ),
    "simulate: an unknown layout": (
        lambda d: ["simulate", str(d.out), "--layout", "none"],
        ("none", "face30-head5"),
    ),
    "simulate: a layout without places": (
        lambda d: ["simulate", str(d.out), "--layout", "grid_s1"],
        ("position",),
    ),
    "simulate: a layout of another face": (
        lambda d: ["simulate", str(d.out), "--layout", str(d.layout('"8.1"', '"8.99"'))],
        ("8.99",),
    ),
    "simulate: one frame": (
        lambda d: ["simulate", str(d.out), "--duration", "0.1", "--rate", "10"],
        ("two frames",),
    ),
    "demo: a folder with something in it": (
        lambda d: ["demo", "--out", str(full_folder(d))],
        ("out", "not empty"),
    ),
    "demo: a file": (lambda d: ["demo", "--out", str(d.file("taken", "mine"))], ("taken",)),
    "demo: under a file": (
        lambda d: ["demo", "--out", str(d.file("taken", "mine") / "deeper")],
        ("taken",),
    ),
    "info: not there": (lambda d: ["info", str(d.folder / "no.tsv")], ("no.tsv",)),
    "info: a folder": (lambda d: ["info", str(d.folder)], ("folder",)),
}

CASES = {
    f"{kind}: {name}" if kind else name: case
    for kind, cases in (
        ("recording", RECORDINGS),
        ("reference", REFERENCES),
        ("layout", LAYOUTS),
        ("face", FACES),
        ("", FOLDERS),
    )
    for name, case in cases.items()
}

WRONG_CALLS = {
    "no command": [],
    "unknown command": ["fits"],
    "unknown option": ["fit", "a.tsv", "--quickly"],
    "no recording": ["fit", "--reference", "r.tsv", "--layout", "l", "--out", "o"],
    "no reference": ["fit", "a.tsv", "--layout", "l", "--out", "o"],
    "quiet and verbose": ["info", "a.tsv", "-q", "-v"],
    "a setting that is a table too": [
        *("train", "c", "--model", "cart", "--out", "o"),
        *("--set", "a=1", "--set", "a.b=1"),
    ],
    "no folder for the results": ["fit", "a.tsv", "--reference", "r.tsv", "--layout", "l"],
    "unknown solver": [
        *("fit", "a.tsv", "--reference", "r.tsv", "--layout", "l", "--out", "o"),
        *("--solver", "MAGIC"),
    ],
    "a solver that ignores bounds": [
        *("fit", "a.tsv", "--reference", "r.tsv", "--layout", "l", "--out", "o"),
        *("--solver", "LN_NEWUOA"),
    ],
    "unknown objective": [
        *("fit", "a.tsv", "--reference", "r.tsv", "--layout", "l", "--out", "o"),
        *("--objective", "beauty"),
    ],
    "negative utterances": ["simulate", "o", "--utterances", "-1"],
    "utterances in words": ["simulate", "o", "--utterances", "two"],
    "negative seed of the demo": ["demo", "--out", "o", "--seed", "-1"],
    "an argument too many": ["demo", "here"],
}


@pytest.fixture
def desk(session, tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    return Desk(session, folder)


def snapshot(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
        if not path.is_dir()
    }


def assert_refused(desk, arguments, words, capsys):
    capsys.readouterr()
    before = snapshot(desk.folder)
    status = cli.main(arguments)
    shown = capsys.readouterr()
    errors = [line for line in shown.err.splitlines() if "error: " in line]
    assert status == 1, shown.err
    assert len(errors) == 1, shown.err
    assert errors[0].startswith("mocap-fit: error: ")
    assert "Traceback" not in shown.err
    assert "bug" not in shown.err
    assert len(errors[0]) < 2000
    assert shown.out == ""
    for word in words:
        assert word in errors[0]
    assert snapshot(desk.folder) == before


# Faults that are known, with their reason; a case that is mended must leave the list.
KNOWN_FAULTS: dict[str, str] = {}


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=pytest.mark.xfail(reason=KNOWN_FAULTS[case], strict=True))
        if case in KNOWN_FAULTS
        else case
        for case in CASES
    ],
)
def test_bad_input(case, desk, capsys):
    build, words = CASES[case]
    assert_refused(desk, build(desk), words, capsys)


def test_there_are_more_than_forty_kinds():
    assert len(CASES) > 40


@pytest.mark.slow
def test_a_header_line_of_100_mb(desk, capsys):
    bad = desk.header("DESCRIPTION", "x" * 100_000_000)
    assert_refused(desk, desk.fit(bad), ("bad.tsv",), capsys)


@pytest.mark.parametrize("build", [locked, unreadable], ids=lambda build: build.__name__)
def test_what_the_user_may_not_touch(build, desk, capsys):
    arguments, path, mode = build(desk)
    if os.name == "nt" or os.access(path, mode):
        pytest.skip("this user may read and write everything")
    try:
        assert cli.main(arguments) == 1
        shown = capsys.readouterr()
        (line,) = [line for line in shown.err.splitlines() if "error: " in line]
        assert path.name in line
        assert shown.out == ""
    finally:
        path.chmod(0o700)
    assert not list(desk.out.iterdir())


@pytest.mark.parametrize("case", ["recording: binary", "layout: unknown name"])
def test_the_installed_program(case, desk):
    program = shutil.which("mocap-fit", path=str(Path(sys.executable).parent))
    if program is None:
        pytest.skip("mocap-fit is not installed beside this Python")
    build, words = CASES[case]
    arguments = build(desk)
    before = snapshot(desk.folder)
    done = subprocess.run(
        [program, *arguments], capture_output=True, encoding="utf-8", timeout=600, check=False
    )
    assert done.returncode == 1
    assert done.stdout == ""
    (line,) = [line for line in done.stderr.splitlines() if "error: " in line]
    assert line.startswith("mocap-fit: error: ")
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in line
    assert snapshot(desk.folder) == before


@pytest.mark.parametrize("arguments", WRONG_CALLS.values(), ids=WRONG_CALLS)
def test_wrong_calls(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(arguments) == 2
    shown = capsys.readouterr()
    assert "Traceback" not in shown.err
    assert "Usage" in shown.err + (shown.out if not arguments else "")
    assert arguments == [] or shown.out == ""
    assert not list(tmp_path.iterdir())
