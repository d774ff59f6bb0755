"""The command line: exit statuses, what goes to which stream, what people and programs read."""

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import warnings

import numpy as np
import pytest
import typer

import mocap_fit
from corpus_tools.batch.progress import Tracker
from corpus_tools.cli import app as cli
from corpus_tools.cli import console, display
from corpus_tools.tasks import count_steps
from mocap_fit.errors import DataError, FileFormatError, MocapFitWarning
from mocap_fit.size_limit import VARIABLE

RECORDING = (
    "NO_OF_FRAMES\t4\n"
    "NO_OF_CAMERAS\t6\n"
    "NO_OF_MARKERS\t2\n"
    "FREQUENCY\t100\n"
    "NO_OF_ANALOG\t0\n"
    "ANALOG_FREQUENCY\t0\n"
    "DESCRIPTION\t--\n"
    "TIME_STAMP\t2026-01-01, 10:00:00.000\t0.0\n"
    "DATA_INCLUDED\t3D\n"
    "MARKER_NAMES\tlip {odd} [bold]\tzunge ü\n"
    "1.000\t2.000\t3.000\t4.000\t5.000\t6.000\n"
    "1.100\t2.000\t3.000\t4.000\t5.000\t6.000\n"
    "1.200\t2.000\t3.000\t0.000\t0.000\t0.000\n"
    "1.300\t2.000\t3.000\t4.000\t5.000\t6.000\n"
)

PROGRAM = "import sys; from corpus_tools.cli.app import main; sys.exit(main())"


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "take_01.tsv"
    path.write_text(RECORDING, encoding="utf-8")
    return path


def run_program(*arguments, **options):
    """The program as a process, as a user starts it."""
    environment = {**os.environ, "PYTHONIOENCODING": "utf-8", **options.pop("env", {})}
    return subprocess.run(
        [sys.executable, "-c", PROGRAM, *map(str, arguments)],
        capture_output=True,
        encoding="utf-8",
        env=environment,
        timeout=600,
        check=False,
        **options,
    )


def error_lines(capsys):
    return capsys.readouterr().err.splitlines()


class TestCalls:
    def test_version(self, capsys):
        assert cli.main(["--version"]) == 0
        assert capsys.readouterr().out == f"mocap-fit {mocap_fit.__version__}\n"

    def test_help_names_every_command_and_the_statuses(self, capsys):
        assert cli.main(["--help"]) == 0
        shown = capsys.readouterr()
        assert shown.err == ""
        assert "Exit status" in shown.out
        for command in cli.app.registered_commands:
            assert f" {command.name} " in shown.out

    @pytest.mark.parametrize("arguments", [["nonsense"], ["train"], ["info", "--nonsense", "x"]])
    def test_a_wrong_call_is_status_2(self, arguments, capsys):
        assert cli.main(arguments) == 2
        shown = capsys.readouterr()
        assert shown.out == ""
        assert "Usage" in shown.err

    def test_the_installed_program_is_this_one(self):
        from importlib.metadata import entry_points

        (entry,) = {
            point.value for point in entry_points(group="console_scripts", name="mocap-fit")
        }
        assert entry == "corpus_tools.cli.app:main"


class TestBoundary:
    def test_done(self):
        assert console.run_guarded(lambda: None) == 0

    def test_bad_data_is_one_line(self, capsys):
        def action():
            raise FileFormatError("a number\nis broken", path="a.tsv", line=3, found="x\x1b[31my")

        assert console.run_guarded(action) == 1
        (line,) = error_lines(capsys)
        assert line == "mocap-fit: error: a.tsv, line 3: a number is broken (found x\\x1b[31my)"

    def test_a_wrong_call_found_in_a_command(self, capsys):
        app = typer.Typer(pretty_exceptions_enable=False)

        @app.command()
        def command() -> None:
            raise typer.BadParameter("these two exclude each other")

        assert console.run_guarded(lambda: app(args=[])) == 2
        assert "exclude each other" in capsys.readouterr().err

    def test_a_failing_disk_is_not_our_bug(self, capsys):
        def action():
            raise OSError(28, "No space left on device", "out.parquet")

        assert console.run_guarded(action) == 1
        assert error_lines(capsys) == ["mocap-fit: error: out.parquet: No space left on device"]

    def test_no_memory(self, capsys):
        def action():
            raise MemoryError

        assert console.run_guarded(action) == 1
        assert "memory" in error_lines(capsys)[0]

    def test_our_bug_is_one_line_that_tells_how_to_see_more(self, capsys, monkeypatch):
        monkeypatch.delenv("MOCAP_FIT_DEBUG", raising=False)
        assert console.run_guarded(lambda: {}["there\nis nothing"]) == 70
        (line,) = error_lines(capsys)
        assert "bug in mocap-fit (KeyError" in line
        assert "MOCAP_FIT_DEBUG=1" in line

    @pytest.mark.parametrize("error", [KeyError("x"), DataError("x")])
    def test_tracebacks_for_those_who_ask(self, error, capsys, monkeypatch):
        def action():
            raise error

        monkeypatch.setenv("MOCAP_FIT_DEBUG", "1")
        console.run_guarded(action)
        lines = error_lines(capsys)
        assert lines[0].startswith("Traceback")
        assert lines[-1].startswith("mocap-fit: error: ")

    @pytest.mark.parametrize(("code", "status"), [(None, 0), (0, 0), (3, 3), ("words", 1)])
    def test_exits_keep_their_status(self, code, status):
        assert console.run_guarded(lambda: sys.exit(code)) == status

    @pytest.mark.parametrize(
        ("error", "status", "lines"),
        [
            (KeyboardInterrupt(), 130, ["mocap-fit: stopped"]),
            (BrokenPipeError(32, "Broken pipe"), 141, []),
            (DataError("no frames"), 1, ["mocap-fit: error: no frames"]),
            (OSError(13, "Permission denied", "a"), 1, ["mocap-fit: error: a: Permission denied"]),
        ],
    )
    def test_typer_leaves_these_to_us(self, error, status, lines, capsys):
        app = typer.Typer(cls=cli._Commands, pretty_exceptions_enable=False)

        @app.callback()
        def program() -> None:
            pass

        @app.command()
        def command() -> None:
            raise error

        assert console.run_guarded(lambda: app(args=["command"])) == status
        assert error_lines(capsys) == lines

    def test_ctrl_c_before_a_command_has_begun(self, capsys):
        def action():
            raise KeyboardInterrupt

        assert console.run_guarded(action) == 130
        assert error_lines(capsys) == ["mocap-fit: stopped"]

    @pytest.mark.parametrize("made", [TypeError("cannot compare"), DataError("no number")])
    def test_ctrl_c_that_a_library_makes_another_error_of(self, made, capsys):
        """As numpy does where it compares rows, and Python where a text becomes a number."""
        before = signal.getsignal(signal.SIGINT)

        def action():
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                raise made from None

        assert console.run_guarded(action) == 130
        assert error_lines(capsys) == ["mocap-fit: stopped"]
        assert signal.getsignal(signal.SIGINT) is before

    def test_long_work_stops_where_a_library_swallows_ctrl_c(self, capsys):
        """As `int` of a text does, and pandas with it."""
        done = []

        def swallow(told):
            for number in range(3):
                with contextlib.suppress(KeyboardInterrupt):
                    signal.raise_signal(signal.SIGINT)
                told(number)
                done.append(number)

        def items():
            with display.show_progress() as progress:
                swallow(lambda number: progress("counting", number, 3))

        def frames():
            with display.show_batch_progress("counting") as progress:
                tracker = Tracker([1.0], progress)
                swallow(lambda number: tracker.update(0, number, 3))

        for action in (items, frames):
            assert console.run_guarded(action) == 130
            assert error_lines(capsys) == ["mocap-fit: stopped"]
        assert done == []
        # The next command knows nothing of it.
        with display.show_progress() as progress:
            progress("counting", 1, 1)

    def test_warnings_are_a_line_each_and_once(self, capsys):
        def action():
            for _ in range(3):
                for file in ("a.tsv", "b.tsv"):
                    warnings.warn(f"{file}: one row\nis cut off", MocapFitWarning, stacklevel=1)

        assert console.run_guarded(action) == 0
        assert error_lines(capsys) == [
            "mocap-fit: warning: a.tsv: one row is cut off",
            "mocap-fit: warning: b.tsv: one row is cut off",
        ]

    def test_users_do_not_see_warnings_for_programmers(self, capsys):
        def action():
            for category in (FutureWarning, DeprecationWarning, UserWarning):
                warnings.warn("strange", category, stacklevel=1)

        assert console.run_guarded(action) == 0
        assert error_lines(capsys) == []

    def test_a_stream_that_cannot_show_a_name(self, monkeypatch):
        written = io.BytesIO()
        monkeypatch.setattr(sys, "stderr", io.TextIOWrapper(written, encoding="ascii"))
        console.say("zunge ü")
        sys.stderr.flush()
        assert written.getvalue() == b"mocap-fit: zunge \\xfc" + os.linesep.encode()


class TestProgress:
    @pytest.mark.parametrize(("total", "lines"), [(0, 0), (1, 1), (3, 3), (10, 10), (287, 10)])
    def test_few_lines_where_there_is_no_terminal(self, total, lines, capsys):
        with display.show_progress() as progress:
            advance = count_steps(progress, "fitting recordings", total)
            for _ in range(total):
                advance()
        shown = capsys.readouterr()
        assert shown.out == ""
        assert len(shown.err.splitlines()) == lines
        if total:
            last = shown.err.splitlines()[-1]
            assert last == f"mocap-fit: fitting recordings: {total} of {total}"

    def test_a_bar_on_a_terminal(self, monkeypatch, capsys):
        class Terminal(io.StringIO):
            def isatty(self):
                return True

        screen = Terminal()
        monkeypatch.setattr(sys, "stderr", screen)
        monkeypatch.setenv("TERM", "xterm")
        with display.show_progress() as progress:
            progress("fitting recordings", 1, 2)
            progress("fitting recordings", 2, 2)
        assert "fitting recordings" in screen.getvalue()
        assert "2 of 2" in screen.getvalue()
        assert capsys.readouterr().out == ""


class TestTables:
    CELLS = ("Cohen-Massaro", "8.91 [8.61, 9.16]", "0.795 [0.779, 0.809]", "100.0 %")

    @pytest.mark.parametrize("columns", [20, 60, 200])
    def test_no_cell_is_cut_or_broken_however_narrow_the_screen(self, columns, capsys, monkeypatch):
        monkeypatch.setenv("COLUMNS", str(columns))
        header = ("model", "error in % of the range", "correlation but silence", "lips closed")
        display.create_screen().print(display.create_table(header, [self.CELLS]))
        *above, last = capsys.readouterr().out.splitlines()
        assert [cell.strip() for cell in last.split("  ") if cell.strip()] == list(self.CELLS)
        words = " ".join(above).split()
        assert {word for name in header for word in name.split()} <= set(words)
        assert (len(above) > 2) == (columns < 200)


class TestJson:
    def test_what_is_not_json_becomes_json(self, tmp_path, capsys):
        display.print_json(
            {
                "array": np.array([1.0, np.nan, np.inf]),
                "number": np.float64(2.5),
                "count": np.int64(3),
                "path": tmp_path,
                "names": ("ü",),
            }
        )
        text = capsys.readouterr().out
        assert text.isascii()
        assert json.loads(text) == {
            "array": [1.0, None, None],
            "number": 2.5,
            "count": 3,
            "path": str(tmp_path),
            "names": ["ü"],
        }


class TestInfo:
    def test_tables_for_people(self, recording, capsys, monkeypatch):
        monkeypatch.setenv("COLUMNS", "60")
        assert cli.main(["info", str(recording)]) == 0
        shown = capsys.readouterr()
        assert shown.err == ""
        assert str(recording) in shown.out.splitlines()
        assert "lip {odd} [bold]" in shown.out
        assert "zunge ü" in shown.out
        assert "100 Hz" in shown.out
        assert "25.0 %" in shown.out

    def test_json_for_programs(self, recording, capsys):
        assert cli.main(["info", "--json", str(recording)]) == 0
        shown = capsys.readouterr()
        (content,) = json.loads(shown.out)
        assert content["file"] == str(recording)
        assert content["rate"] == 100
        assert content["frames"] == 4
        assert content["markers"] == [
            {"name": "lip {odd} [bold]", "gap_rate": 0.0},
            {"name": "zunge ü", "gap_rate": 0.25},
        ]

    def test_a_bad_file_is_named_and_the_others_are_described(self, recording, tmp_path, capsys):
        bad = tmp_path / "bad.tsv"
        bad.write_bytes(b"\x00\x01\x02")
        missing = tmp_path / "missing.tsv"
        files = [str(file) for file in (bad, recording, missing)]
        assert cli.main(["info", "--json", *files]) == 1
        shown = capsys.readouterr()
        first, second, third = json.loads(shown.out)
        assert [first["file"], second["file"], third["file"]] == files
        assert "error" in first
        assert "error" not in second
        assert "error" in third
        lines = shown.err.splitlines()
        assert len(lines) == 2
        assert "bad.tsv" in lines[0]
        assert "missing.tsv" in lines[1]


class TestProcess:
    def test_a_bad_file_leaves_no_traceback(self, tmp_path):
        run = run_program("info", tmp_path / "missing.tsv")
        assert run.returncode == 1
        assert run.stdout == ""
        assert len(run.stderr.splitlines()) == 1
        assert run.stderr.startswith("mocap-fit: error: ")

    def test_names_that_the_output_cannot_show(self, recording):
        run = run_program("info", recording, env={"PYTHONIOENCODING": "ascii", "COLUMNS": "200"})
        assert run.returncode == 0
        assert "zunge \\xfc" in run.stdout

    @pytest.mark.skipif(os.name == "nt", reason="Windows has no such pipes")
    @pytest.mark.parametrize("options", [[], ["--json"]])
    def test_a_reader_who_leaves_is_no_error(self, options, recording):
        read_end, write_end = os.pipe()
        os.close(read_end)
        with os.fdopen(write_end, "w") as pipe:
            run = subprocess.run(
                [sys.executable, "-c", PROGRAM, "info", *options, str(recording)],
                stdout=pipe,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                timeout=600,
                check=False,
            )
        assert run.stderr == ""
        assert run.returncode == 141


def test_max_size_holds_for_one_command_and_its_processes(recording, monkeypatch, capsys):
    monkeypatch.setenv(VARIABLE, "3GB")
    seen = []

    def look(*_, **__):
        seen.append(os.environ[VARIABLE])
        raise DataError("enough")

    monkeypatch.setattr("corpus_tools.inspection.info.info", look)
    assert cli.main(["info", str(recording), "--max-size", "8GB"]) == 1
    assert cli.main(["info", str(recording)]) == 1
    assert seen == ["8GB", "3GB"]
    assert os.environ[VARIABLE] == "3GB"
    assert cli.main(["info", str(recording), "--max-size", "plenty"]) == 2
    assert "plenty" in capsys.readouterr().err
    assert len(seen) == 2
