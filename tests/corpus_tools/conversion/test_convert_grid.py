"""A real speaker's 287 sentences, converted, killed, and resumed; numbers with ``pytest -s``."""

import hashlib
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import killing
import numpy as np
import pytest

from corpus_tools.cli import app as cli
from mocap_fit.corpus import open_corpus

pytestmark = [pytest.mark.real_data, pytest.mark.slow]

MANIFEST = Path(__file__).parents[3] / "fixtures" / "manifests" / "grid_s1.toml"
PROGRAM = "import sys; from corpus_tools.cli.app import main; sys.exit(main())"


def arguments(folder, out, *options):
    return ["convert", str(MANIFEST), "--root", str(folder), "--out", str(out), *options]


def sums(folder):
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture(scope="module")
def folder(data_folder):
    return data_folder / "grid_s1"


@pytest.fixture(scope="module")
def corpus(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("grid") / "corpus"
    assert cli.main(arguments(folder, out)) == 0
    return out


def phones_of(path):
    """Phones of a TextGrid, read by other means than ours."""
    text = path.read_text("utf-8")
    text = text[text.index('name = "phones"') :]
    found = re.findall(r'xmin = ([\d.]+)\s+xmax = ([\d.]+)\s+text = "(.*?)"', text)
    return [(float(start), float(end), phone or "sil") for start, end, phone in found]


def test_every_utterance_and_every_phone_is_there(folder, corpus):
    opened = open_corpus(corpus)
    assert len(opened) == 287
    assert {name: len(opened.get_split(name)) for name in opened.splits} == {
        "test": 87,
        "train": 200,
    }
    tokens = 0
    for utterance in opened:
        expected = phones_of(folder / "labels" / f"{utterance.id}.TextGrid")
        found = [(s.start, s.end, s.phone) for s in utterance.read_phones()]
        assert found == expected
        tokens += len(found)
        assert all(np.isfinite(s.energy_db) for s in utterance.read_phones())
        assert utterance.read_tracks().start_time == 0.02
        assert utterance.read_tracks().rate == 25.0
    frames = [u.read_tracks() for u in opened]
    unseen = sum(int(np.isnan(t.residuals).sum()) for t in frames)
    print(f"\n287 utterances, {tokens} phones, {sum(t.frames for t in frames)} frames")
    # Frames in which the video shows no landmark at all.
    assert unseen == 45


def test_vowels_are_louder_than_silence(corpus):
    energies = {"vowel": [], "silence": []}
    opened = open_corpus(corpus)
    for utterance in opened:
        for segment in utterance.read_phones():
            kind = opened.phone_set.get_phone(segment.phone).kind
            if kind in energies:
                energies[kind].append(segment.energy_db)
    assert np.median(energies["vowel"]) > np.median(energies["silence"]) + 20


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_killed_ten_times_and_resumed_it_is_the_same(folder, corpus, tmp_path):
    out = tmp_path / "corpus"
    draw = random.Random(1)
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    begun = [sys.executable, "-c", PROGRAM, *arguments(folder, out)]
    killed, counts = 0, []
    while killed < 10:
        # Two processes half of the time: the children must go with their parent.
        process = subprocess.Popen(
            [*begun, "--jobs", str(1 + killed % 2)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=environment,
            start_new_session=True,
        )
        # From when it works on, so that no kill is wasted on the start of Python. When it
        # comes does not decide anything: every moment must do.
        wanted = len(list(out.glob("*/*"))) + draw.randrange(1, 110)
        while process.poll() is None and len(list(out.glob("*/*"))) < wanted:
            time.sleep(0.02)
        time.sleep(draw.uniform(0, 0.1))
        process.send_signal(signal.SIGKILL)
        # Done before it was killed: the rest is tried on what is whole.
        killed += process.wait() == -signal.SIGKILL
        killing.wait_until_gone(process)
        counts.append(len(list((out / "tracks").glob("*.parquet"))))
        if counts[-1] == 287 and killed < 10:
            draw_again(out, draw)
    assert counts[0] < 287
    assert cli.main(arguments(folder, out)) == 0
    assert sums(out) == sums(corpus)
    print(f"\nkilled after {counts} utterances")


def draw_again(out, draw):
    """Take some of what is done away, so that there is something to do."""
    for path in draw.sample(sorted((out / "tracks").glob("*.parquet")), 40):
        path.unlink()
