"""Commands that are killed: no process goes on, and nothing unfinished has its final name."""

import os
import shutil

import killing
import pytest

from corpus_tools.cli import app as cli

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.name != "posix", reason="signals of POSIX"),
]


@pytest.mark.parametrize("jobs", [1, 2])
def test_validate(jobs, session, tmp_path):
    takes, flag, page = tmp_path / "takes", tmp_path / "flag", tmp_path / "page.html"
    shutil.copytree(session.path / "recordings", takes)
    (takes / "waiting.crash").write_text(f"CRASH wait {flag}")
    given = ["validate", takes, "--jobs", jobs, "--html", page]
    process = killing.start(*given)
    killing.wait_until(lambda: process.poll() is not None or flag.exists())
    process.kill()
    killing.wait_until_gone(process)
    assert flag.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flag", "takes"]
    (takes / "waiting.crash").unlink()
    assert cli.main([*map(str, given)]) == 0
    assert page.stat().st_size > 1000


def test_speak(drawing, tmp_path):
    pytest.importorskip("espeakng_loader")
    out = tmp_path / "head.mp4"
    how = ["--lang", "en", "--model", "rule-based", "--size", 64, "--out", out]
    process = killing.start("speak", "It never ends. " * 200, *how)
    killing.wait_until(lambda: process.poll() is not None or any(tmp_path.iterdir()))
    process.kill()
    killing.wait_until_gone(process)
    assert process.returncode < 0
    assert not out.exists()
    assert cli.main(["speak", "Now.", *map(str, how)]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["head.mp4"]
