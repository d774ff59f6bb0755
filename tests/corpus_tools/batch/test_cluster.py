"""A dask cluster whose workers die, start anew, or see other files than we do."""

import hashlib
import os
import shutil
import signal
import subprocess
from dataclasses import dataclass

import pytest

from corpus_tools.batch.cluster import ContentNeeded, Done, run_on_cluster
from corpus_tools.cli import app as cli
from mocap_fit._version import __version__
from mocap_fit.errors import ConfigurationError
from mocap_fit.processes import DeadProcess

pytestmark = pytest.mark.slow
distributed = pytest.importorskip("distributed")


def start_cluster(workers=2, **options):
    """Workers with nannies that start them again."""
    return distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address=None,
        **options,
    )


# Work stands at the top of the module, where workers find it.


def die_at_three_and_seven(shared, item, progress):
    if item in (3, 7):
        os._exit(0)
    return shared + item, os.getpid()


@dataclass(frozen=True)
class Sent:
    """An item that no worker can open; odd ones cannot be loaded either."""

    number: int
    content: str | None = None

    def load(self):
        if self.number % 2:
            return Done(f"{self.number} is lost")
        return Sent(self.number, "content")


def read_sent(shared, item, progress):
    return ContentNeeded() if item.content is None else f"{item.number} {item.content}"


def run(work, shared, items, cluster, **options):
    return run_on_cluster(work, shared, items, cluster.scheduler_address, __version__, **options)


@pytest.fixture(scope="module")
def cluster():
    with start_cluster() as running:
        yield running


def test_items_that_kill_their_workers_are_named_and_the_others_are_done(cluster):
    results = dict(run(die_at_three_and_seven, 100, range(40), cluster))
    assert sorted(results) == list(range(40))
    dead = {i for i, result in results.items() if isinstance(result, DeadProcess)}
    assert dead == {3, 7}
    assert all(results[i][0] == 100 + i for i in range(40) if i not in dead)


def test_workers_that_are_killed_from_outside_cost_nothing(cluster):
    results = {}
    for index, result in run(die_at_three_and_seven, 0, range(10, 150), cluster):
        results[index] = result
        # The worker that has just answered; the second one has begun in the first one's stead.
        if len(results) in (5, 60):
            os.kill(result[1], signal.SIGKILL)
    assert {i: number for i, (number, _) in results.items()} == {i: 10 + i for i in range(140)}
    assert len({process for _, process in results.values()}) >= 3


def test_content_is_sent_where_files_cannot_be_opened(cluster):
    results = dict(run(read_sent, None, map(Sent, range(12)), cluster))
    assert results == {i: f"{i} is lost" if i % 2 else f"{i} content" for i in range(12)}


def fit(recordings, session, out, *options):
    given = ["fit", *map(str, recordings), "--out", str(out), "--layout", session.layout]
    return cli.main([*given, "--reference", str(session.reference), *options])


def sums(folder):
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


@pytest.fixture
def takes(session, tmp_path, crash_reader):
    """Good recordings, two that kill their worker once, and one that always does."""
    folder = tmp_path / "takes"
    folder.mkdir()
    for name in ("a", "d", "f", "g", "i"):
        shutil.copy(session.recordings[0], folder / f"{name}.tsv")
    for name in ("b", "h"):
        flag = tmp_path / f"{name}.flag"
        (folder / f"{name}.crash").write_text(f"CRASH once {flag} {session.recordings[1]}")
    (folder / "e.crash").write_text("CRASH kill")
    return folder


def test_a_fit_whose_workers_die_in_its_midst(session, takes, tmp_path, capsys):
    with start_cluster() as cluster:
        given = ("--dask", cluster.scheduler_address)
        assert fit([takes], session, tmp_path / "there", *given) == 1
    errors = [line for line in capsys.readouterr().err.splitlines() if "error: " in line]
    assert len(errors) == 1
    assert os.path.join("takes", "e.crash") in errors[0]
    assert "killed, or ran out of memory" in errors[0]
    (takes / "e.crash").unlink()
    assert fit([takes], session, tmp_path / "here") == 0
    assert len(sums(tmp_path / "here")) == 7
    assert sums(tmp_path / "there") == sums(tmp_path / "here")


@pytest.mark.skipif(not os.path.exists("/proc/self/cwd"), reason="a path of Linux")
def test_a_fit_whose_workers_see_no_recording(session, tmp_path, monkeypatch, capsys):
    """A path that is another folder in another process, as on another machine."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    with start_cluster(1) as cluster:
        monkeypatch.chdir(session.path)
        recordings = [f"/proc/self/cwd/recordings/{path.name}" for path in session.recordings]
        given = ("--dask", cluster.scheduler_address)
        assert fit(recordings, session, tmp_path / "there", *given) == 0
    assert fit(recordings, session, tmp_path / "here") == 0
    assert sums(tmp_path / "there") == sums(tmp_path / "here")


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl")
def test_tls_is_an_address(tmp_path):
    key, certificate = str(tmp_path / "key.pem"), str(tmp_path / "cert.pem")
    make = [
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "rsa:2048",
        "-nodes",
        "-days",
        "2",
        "-subj",
        "/CN=localhost",
    ]
    given = [*make, "-keyout", key, "-out", certificate]
    subprocess.run(given, check=True, capture_output=True)
    import dask

    settings = {"distributed.comm.tls.ca-file": certificate}
    for side in ("client", "scheduler", "worker"):
        settings[f"distributed.comm.tls.{side}.key"] = key
        settings[f"distributed.comm.tls.{side}.cert"] = certificate
    # Without certificates it is an error in words.
    with pytest.raises(ConfigurationError, match=r"tls://127.*distributed\.comm\.tls"):
        next(run_on_cluster(die_at_three_and_seven, 0, [1], "tls://127.0.0.1:1", __version__))
    with dask.config.set(settings):
        security = distributed.security.Security(require_encryption=True)
        with start_cluster(1, protocol="tls://", security=security) as cluster:
            assert cluster.scheduler_address.startswith("tls://")
            ((_, (number, _)),) = run(die_at_three_and_seven, 5, [2], cluster)
    assert number == 7


@pytest.mark.parametrize("protocol", ["tls", "ucx", "wss"])
def test_no_address_is_a_bug(protocol):
    address = f"{protocol}://127.0.0.1:1"
    with pytest.raises(ConfigurationError, match=f"scheduler at {address} does not answer"):
        next(run_on_cluster(die_at_three_and_seven, 0, [1], address, __version__))
