"""What a newcomer tries first: versions, quiet, verbose, completion, colours, narrow terminals."""

import os
import subprocess
import sys

import pytest

from corpus_tools.cli import app as cli
from corpus_tools.cli import console
from mocap_fit._version import __version__
from mocap_fit.errors import DEBUG_VARIABLE

PROGRAM = "import sys; from corpus_tools.cli.app import main; sys.exit(main())"


def run(*arguments, **environment):
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *map(str, arguments)],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
    )


@pytest.mark.parametrize("option", ["-V", "--version"])
def test_the_version(option, capsys):
    assert cli.main([option]) == 0
    assert capsys.readouterr().out == f"mocap-fit {__version__}\n"


def test_help_names_every_exit_status_and_completion(capsys):
    assert cli.main(["--help"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    for status in console.Status:
        assert f" {status.value} " in shown
    assert "--install-completion" in shown


def test_a_shell_is_told_the_commands():
    done = run(_MOCAP_FIT_COMPLETE="complete_bash", COMP_WORDS="mocap-fit va", COMP_CWORD="1")
    assert done.stdout.split() == ["validate"]


def test_quiet_prints_errors_alone(session, tmp_path, capsys):
    call = ["fit", str(session.recordings[0]), "--reference", str(session.reference)]
    call += ["--out", str(tmp_path / "out")]
    assert cli.main(call) == 0
    assert "fitting recordings" in capsys.readouterr().err
    assert cli.main([*call, "--fresh", "-q"]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    assert "layout face30-head5" in " ".join(shown.out.split())
    assert cli.main(["info", "nothing.tsv", "--quiet"]) == 1
    assert "nothing.tsv" in capsys.readouterr().err
    assert console.QUIET_VARIABLE not in os.environ


def test_verbose_prints_tracebacks(capsys):
    assert cli.main(["info", "nothing.tsv"]) == 1
    assert "Traceback" not in capsys.readouterr().err
    assert cli.main(["info", "nothing.tsv", "-v"]) == 1
    assert "Traceback" in capsys.readouterr().err
    assert DEBUG_VARIABLE not in os.environ


@pytest.mark.slow
def test_without_colours_there_is_no_escape_sequence(session):
    forced = {"FORCE_COLOR": "1", "TTY_COMPATIBLE": "1"}
    for call in (["info", session.recordings[0]], ["info", "--help"]):
        assert "\x1b[" in run(*call, **forced).stdout
        assert "\x1b[" not in run(*call, **forced, NO_COLOR="1").stdout


def test_a_narrow_terminal_cuts_no_option(capsys):
    shown = run("fit", "--help", COLUMNS="50").stdout
    for option in ("--reference", "--allow-mirrored", "--reference-as-is", "--max-size"):
        assert f" {option} " in shown
