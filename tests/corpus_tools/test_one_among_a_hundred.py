"""A hundred files, some of them wrong in every way: the others are done, and the wrong ones named.

The program runs in a process of its own, where its processes are copies and begin at once.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.name != "posix", reason="signals and links of POSIX"),
]

PROGRAM = "import sys; from corpus_tools.cli.app import main; sys.exit(main())"
# Of the good ones, for commands that take longer.
FEWER = 20
PLUG_IN = Path(__file__).parent / "plug_in"
# What reading them does, and a part of what is said of it.
RAISING = {
    "raise": "reader 'crash' of crash-reader failed (found IndexError: no such column)",
    "memory": "there is not enough memory",
    "recursion": "reader 'crash' of crash-reader failed (found RecursionError",
    "leave": "reader 'crash' of crash-reader failed (found SystemExit: 0)",
}
DYING = dict.fromkeys(("kill", "exit", "sniff"), "killed, or ran out of memory")


def run(*arguments):
    """Exit status, JSON and lines of errors of the program."""
    paths = [str(PLUG_IN), *sys.path]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *map(str, arguments), "--json"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    assert "Traceback" not in done.stderr
    errors = [line for line in done.stderr.splitlines() if "error: " in line]
    return done.returncode, json.loads(done.stdout or "null"), errors


def write_bad(folder, good, kinds):
    """Bad recordings of every kind, and what is said of each."""
    text = good.read_text("utf-8")
    for kind in kinds:
        (folder / f"bad_{kind}.crash").write_text(f"CRASH {kind}")
    said = {f"bad_{kind}": words for kind, words in kinds.items()}
    (folder / "bad_text.tsv").write_bytes(b"\0\xff no recording" * 9)
    (folder / "bad_empty.tsv").write_bytes(b"")
    (folder / "bad_cut.tsv").write_text(text[:300])
    (folder / "bad_rate.tsv").write_text(text.replace("FREQUENCY\t", "FREQUENCY\t-"))
    (folder / "bad_marker.tsv").write_text(text.replace("jaw", "paw").replace("chin", "shin"))
    half = text.index("\t", len(text) // 2) + 1
    (folder / "bad_number.tsv").write_text(f"{text[:half]}1.2.3{text[half:]}")
    names = ("text", "empty", "cut", "rate", "number")
    return said | {f"bad_{name}": "" for name in names}


@pytest.fixture(scope="module")
def good(simulate, tmp_path_factory):
    folder = simulate(tmp_path_factory.mktemp("hundred") / "session", "--utterances", 1)
    (folder.path / "takes").mkdir()
    for number in range(99):
        name = folder.path / "takes" / f"good{number:02d}.tsv"
        shutil.copy(folder.recordings[0], name)
    return folder


@pytest.fixture(scope="module")
def fitted(good, tmp_path_factory):
    out = tmp_path_factory.mktemp("fitted")
    assert fit([good.path / "takes"], good, out)[0] == 0
    return contents(out)


def fit(recordings, folder, out, *options):
    about = ("--reference", folder.reference, "--layout", folder.layout, "--out", out)
    return run("fit", *recordings, *about, *options)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def check_errors(errors, said):
    """Every bad one is named, with why, and nothing else is."""
    assert sorted(errors) == sorted(said)
    for name, words in said.items():
        assert words in errors[name], errors[name]
        assert name in errors[name]
        assert "bug in mocap-fit" not in errors[name]


@pytest.mark.parametrize("jobs", [1, 2])
def test_fit(jobs, good, fitted, tmp_path):
    kinds = RAISING if jobs == 1 else RAISING | DYING
    said = write_bad(tmp_path, good.recordings[0], kinds) | {"bad_marker": ""}
    if jobs == 1 and os.geteuid():
        (tmp_path / "bad_empty.tsv").chmod(0)
    out = tmp_path / "out"
    recordings = [good.path / "takes", tmp_path]
    status, report, lines = fit(recordings, good, out, "--jobs", jobs)
    assert status == 1
    check_errors({r["recording"]: r["error"] for r in report["recordings"] if "error" in r}, said)
    assert len(lines) == len(said)
    assert contents(out) == fitted


@pytest.mark.parametrize("jobs", [1, 2])
def test_validate(jobs, good, tmp_path):
    kinds = RAISING if jobs == 1 else RAISING | DYING
    takes = tmp_path / "takes"
    takes.mkdir()
    for path in sorted((good.path / "takes").iterdir())[:FEWER]:
        shutil.copy(path, takes)
    _, expected, _ = run("validate", takes, "--jobs", jobs)
    said = write_bad(takes, good.recordings[0], kinds)
    (takes / "bad_marker.tsv").unlink()
    # Tables of other things may lie in a folder: a note names those that no reader takes.
    unknown = [said.pop(name) or f"{name}.tsv" for name in ("bad_empty", "bad_text")]
    status, report, _ = run("validate", takes, "--jobs", jobs)
    assert status == 1
    assert report["utterances"] == expected["utterances"] == FEWER
    findings = [f for f in report["findings"] if "bad_" in f["file"]]
    (note,) = [f for f in report["findings"] if f["code"] == "MF003" and "bad_" in f["found"]]
    assert all(name in note["found"] for name in unknown)
    errors = {f["utterance"]: f"{f['file']}: {f['found']}" for f in findings}
    check_errors(errors, {name: words.replace("(found ", "(") for name, words in said.items()})
    assert [f for f in report["findings"] if f not in [*findings, note]] == expected["findings"]


def test_info(good, tmp_path):
    said = write_bad(tmp_path, good.recordings[0], RAISING)
    status, report, lines = run("info", good.path / "takes", tmp_path)
    assert status == 1
    report = [each for each in report if each.get("content") != "folder"]
    assert len(report) == 99 + len(said) + 1
    errors = {Path(each["file"]).stem: each["error"] for each in report if "error" in each}
    check_errors(errors, said)
    assert len(lines) == len(said)


@pytest.fixture(scope="module")
def hundred(lab, tmp_path_factory):
    """A lab with many equal sentences."""
    folder = tmp_path_factory.mktemp("hundred") / "lab"
    shutil.copytree(lab, folder, ignore=shutil.ignore_patterns("truth", "sim*"))
    manifest = (
        (folder / "manifest.toml")
        .read_text()
        .replace('"recordings/{id}.tsv"', '"recordings/{id}.*"')
    )
    (folder / "manifest.toml").write_text(manifest)
    names = [f"good{number:02d}" for number in range(FEWER)]
    for name in names:
        for part, ending in (("recordings", "tsv"), ("labels", "TextGrid"), ("sound", "wav")):
            os.link(lab / part / f"sim002.{ending}", folder / part / f"{name}.{ending}")
    return folder, names


@pytest.mark.parametrize("jobs", [1, 2])
def test_convert(jobs, hundred, lab, tmp_path):
    folder, names = hundred
    folder = Path(shutil.copytree(folder, tmp_path / "lab", copy_function=os.link))
    kinds = RAISING if jobs == 1 else RAISING | DYING
    said = write_bad(folder / "recordings", folder / "recordings" / "good00.tsv", kinds)
    said |= {"bad_marker": "", "bad_sound": "", "bad_labels": ""}
    # The manifest's rate takes its place.
    del said["bad_rate"]
    for name in ("bad_sound", "bad_labels"):
        os.link(folder / "recordings" / "good00.tsv", folder / "recordings" / f"{name}.tsv")
    for name in said:
        for part, ending in (("labels", "TextGrid"), ("sound", "wav")):
            path = folder / part / f"{name}.{ending}"
            if name == f"bad_{part}":
                path.write_bytes(b"cut off")
            else:
                os.link(folder / part / f"good00.{ending}", path)
    rows = [f"{name}\t{name}\tspeaker\t1" for name in (*names, *said)]
    table = "\n".join(["utterance\ttext\tspeaker\tsession", *rows])
    (folder / "sentences.tsv").unlink()
    (folder / "sentences.tsv").write_text(table + "\n")
    status, report, _ = run("convert", folder, "--out", tmp_path / "out", "--jobs", jobs)
    assert status == 1
    assert (report["converted"], report["bad"]) == (FEWER, len(said))
    errors = {u["id"]: f"{u['id']}: {u['error']}" for u in report["utterances"] if "error" in u}
    check_errors(errors, said)
