"""Closed and full streams, and names of files and markers that are no plain text."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from corpus_tools.cli import app as cli
from mocap_fit.corpus import open_corpus
from mocap_fit.io.samples import load_sample
from mocap_fit.plain_text import escape_controls, to_unicode
from mocap_fit.tracks import read_parquet

PROGRAM = "import sys; from corpus_tools.cli.app import main; sys.exit(main())"
# A byte that is not UTF-8, an escape code, a sign that turns the direction of writing.
RAW = b"n\xe4sa\x1b\xe2\x80\xae"
NAME = os.fsdecode(RAW)
HOSTILE = ("\x1b", "\u202e", "\x07", "\x9b", "\udce4")

needs_any_names = pytest.mark.skipif(sys.platform != "linux", reason="names are text there")


def run_in_shell(command, *files):
    """Run ``$M`` in a shell, as a user does who closes streams."""
    program = f'"{sys.executable}" -c "{PROGRAM}"'
    return subprocess.run(
        ["bash", "-c", command.replace("$M", program), "bash", *map(str, files)],
        capture_output=True,
        timeout=60,
        check=False,
    )


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="a shell, and /dev/full")
class TestStreams:
    @pytest.mark.parametrize(
        ("command", "status"),
        [
            ("$M info $1 >&-", 0),
            ("$M info $1 --json >&-", 0),
            ("$M info $1 <&- >&- 2>&-", 0),
            ("$M info nothing 2>&-", 1),
            ("$M info nothing 2>/dev/full", 1),
            ("$M info $1 | head -c0; exit ${PIPESTATUS[0]}", 141),
        ],
    )
    def test_closed(self, command, status):
        done = run_in_shell(command, load_sample("take_01"))
        assert done.returncode == status
        assert b"Traceback" not in done.stderr
        assert b"Exception" not in done.stderr

    @pytest.mark.parametrize("option", ["", "--json"])
    def test_a_full_disk_is_one_line(self, option):
        done = run_in_shell(f"$M info $1 {option} >/dev/full", load_sample("take_01"))
        assert done.returncode == 1
        assert done.stderr.decode() == "mocap-fit: error: No space left on device\n"

    def test_a_result_does_not_hold_what_was_printed(self, tmp_path):
        """Without standard output the first file that is opened would take its place."""
        (tmp_path / "a.txt").write_text("this is a test\n")
        command = "$M select-sentences $1 --dictionary $2 --count 1 --out $3 >&- 2>&-"
        (tmp_path / "d.txt").write_text("THIS DH IH S\nIS IH Z\nA AH\nTEST T EH S T\n")
        done = run_in_shell(command, tmp_path / "a.txt", tmp_path / "d.txt", tmp_path / "out")
        assert done.returncode == 0
        assert (tmp_path / "out" / "sentences.txt").read_text() == "this is a test\n"


def assert_harmless(text):
    assert not [character for character in HOSTILE if character in text]


@pytest.fixture
def folder(tmp_path):
    """The sample session under names that are no text."""
    for sample in ("take_01.tsv", "take_01.wav", "take_01.TextGrid", "rest.tsv"):
        stem = NAME if sample.startswith("take") else f"rest{NAME}"
        source = load_sample(sample.removesuffix(".tsv"))
        shutil.copy(source, tmp_path / f"{stem}.{sample.partition('.')[2]}")
    return tmp_path


@pytest.mark.slow
@needs_any_names
class TestNames:
    def run(self, capsys, *arguments):
        status = cli.main([str(argument) for argument in arguments])
        shown = capsys.readouterr()
        assert_harmless(shown.out + shown.err)
        assert status == 0, shown.err
        return shown.out

    def test_info_and_validate(self, folder, capsys):
        files = sorted(folder.iterdir())
        out = self.run(capsys, "info", *files)
        assert r"n\udce4sa\x1b\u202e.tsv" in out
        content = json.loads(self.run(capsys, "info", "--json", *files))
        assert [os.fsencode(each["file"]) for each in content] == [os.fsencode(f) for f in files]
        page = folder / f"{NAME}.html"
        takes = [file for file in files if not file.name.startswith("rest")]
        self.run(capsys, "validate", *takes, "--phone-set", "sv-sta", "--html", page)
        assert_harmless(page.read_text("utf-8"))
        json.loads(self.run(capsys, "validate", "--json", *takes, "--phone-set", "sv-sta"))

    def test_fit_and_export(self, folder, capsys):
        out = folder / f"out{NAME}"
        call = ["fit", folder / f"{NAME}.tsv", "--reference", folder / f"rest{NAME}.tsv"]
        call += ["--layout", "face30-head5", "--out", out, "--between", "0.5-0.7"]
        assert "x1b" in self.run(capsys, *call)
        (result,) = out.iterdir()
        assert os.fsencode(result.name) == RAW + b".parquet"
        tracks = read_parquet(result)
        assert tracks.name == "n%E4sa\x1b\u202e"
        again = json.loads(self.run(capsys, *call, "--json"))
        assert [row["kept"] for row in again["recordings"]] == [True]
        for kind, ending in (("csv", "csv"), ("gltf", "glb"), ("fap", "fap")):
            target = folder / f"{NAME}.{ending}"
            self.run(capsys, "export", result, "--to", kind, "--out", target)
            assert target.stat().st_size > 100

    def test_convert(self, folder, capsys):
        for part, ending in (("recordings", "tsv"), ("labels", "TextGrid"), ("sound", "wav")):
            (folder / part).mkdir()
            (folder / f"{NAME}.{ending}").rename(folder / part / f"{NAME}.{ending}")
        (folder / f"rest{NAME}.tsv").rename(folder / "reference.tsv")
        out = folder / f"corpus{NAME}"
        call = ["convert", folder, "--phone-set", "sv-sta", "--layout", "face30-head5"]
        call += ["--out", out]
        self.run(capsys, *call)
        assert "1 of them from before" in self.run(capsys, *call)
        corpus = open_corpus(out)
        assert [utterance.id for utterance in corpus] == ["n%E4sa\x1b\u202e"]
        assert corpus.utterances[0].read_tracks().frames > 100
        assert corpus.utterances[0].sound_file is not None
        self.run(capsys, "info", out)
        assert cli.main(["validate", str(out)]) == 0
        assert_harmless(capsys.readouterr().out)


def test_names_of_markers_reach_no_terminal_and_no_page_raw(tmp_path, capsys):
    header = "time," + ",".join(
        f"{name}_{axis}" for name in ("a\x1b[31m", "b\u202e") for axis in "xyz"
    )
    rows = [f"{i / 100},{i},2,3,4,{i},6" for i in range(20)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([header, *rows]), encoding="utf-8")
    page = tmp_path / "page.html"
    assert cli.main(["info", str(path)]) == 0
    cli.main(["validate", str(path), "--html", str(page)])
    shown = capsys.readouterr()
    assert "x1b" in shown.out
    assert_harmless(shown.out + shown.err + page.read_text("utf-8"))


def test_what_is_shown_and_what_is_stored():
    assert escape_controls("näsa 鼻 𝄞 \u00a0\n\t") == "näsa 鼻 𝄞 \u00a0\n\t"
    assert escape_controls("\x1b[31m\u202e\r\x00\x7f\x85\u2028\ud800") == (
        r"\x1b[31m\u202e\r\x00\x7f\x85\u2028\ud800"
    )
    assert to_unicode("näsa\udcff\udc80\ud800") == "näsa%FF%80%00"
