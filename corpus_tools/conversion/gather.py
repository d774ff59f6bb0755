"""The corpus: its folder, its table, and the removal of what does not belong to it any more."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from corpus_tools.batch import ItemResult
from corpus_tools.conversion.entries import Entry
from corpus_tools.conversion.manifest import Manifest
from corpus_tools.conversion.plan import AUDIO, PARTS, Plan
from corpus_tools.conversion.utterance import STEP
from mocap_fit.atomic_file import make_folder, write_atomically
from mocap_fit.corpus import DESCRIPTION_FILE, Corpus, Utterance, write_corpus
from mocap_fit.errors import ConfigurationError, MocapFitError
from mocap_fit.settings_file import read_toml
from mocap_fit.tracks import Step
from mocap_fit.utterance import UTTERANCES_FILE, read_utterances

# Says that the folder is one of ours, also while there is no corpus in it yet: what does not
# belong to a corpus is removed from it, and nobody's recordings must be.
_OURS = ".mocap-fit-corpus"
# Seconds in which the processes of a conversion that was killed have ended too.
_PATIENCE = 2.0


@contextlib.contextmanager
def open_folder(out: Path) -> Iterator[None]:
    """Make the folder of a corpus, or open an earlier one and remove what killed runs have left.

    Parameters
    ----------
    out
        The folder.

    Yields
    ------
    None
        Nothing; until the end no other conversion may use the folder.

    Raises
    ------
    ConfigurationError
        If the folder has something else in it.
    """
    make_folder(out)
    present = {path.name for path in out.iterdir()}
    # Hidden files are lost where a corpus is packed and sent.
    ours = _OURS in present or {DESCRIPTION_FILE, UTTERANCES_FILE} <= present
    if present and not ours:
        raise ConfigurationError(
            "the folder for the corpus is not empty, and is no corpus of an earlier conversion",
            path=out,
            found=", ".join(sorted(present)[:5]),
            advice="Give the name of a new folder.",
        )
    if _OURS not in present:
        (out / _OURS).write_bytes(b"")
    with _lock(out):
        # What earlier runs have left, also of utterances that are not in the manifest any more.
        for folder in (out, *(out / part for part in (*PARTS, AUDIO))):
            for path in folder.glob(".*.partial"):
                path.unlink(missing_ok=True)
        yield


@contextlib.contextmanager
def _lock(out: Path) -> Iterator[None]:
    """Let no other conversion into the folder; the lock ends with the process."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    end = time.monotonic() + _PATIENCE
    with open(out / _OURS, "rb") as stream:
        while True:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if time.monotonic() < end:
                    time.sleep(0.05)
                    continue
                raise ConfigurationError(
                    "another conversion is at work in this folder",
                    path=out,
                    advice="Wait for it to end, or end it.",
                ) from None
            except OSError:  # A disk that cannot lock.
                pass
            break
        yield


def read_former_splits(out: Path, manifest: Manifest) -> dict[str, str]:
    """Return the splits that an earlier conversion drew in the same way.

    Parameters
    ----------
    out
        Folder of the corpus.
    manifest
        The manifest.

    Returns
    -------
    dict[str, str]
        Splits by utterance; empty where there are none.
    """
    try:
        content = read_toml(out / DESCRIPTION_FILE, noun="corpus")
        steps = [step for step in content["provenance"] if step["step"] == STEP]
        same = steps[-1]["arguments"]["splits"] == manifest.to_dict()["splits"]
        rows = read_utterances(out)
    except (KeyError, TypeError, IndexError, MocapFitError):
        return {}
    return {row.id: row.split for row in rows} if same else {}


def finish(plan: Plan, results: Mapping[str, ItemResult], out: Path) -> list[str]:
    """Write the corpus's table and description, and remove the files of other utterances.

    Parameters
    ----------
    plan
        What there was to do.
    results
        Result of every utterance, by id.
    out
        Folder of the corpus.

    Returns
    -------
    list[str]
        Utterances that were in the corpus and are not in it any more.
    """
    good = {name: result.figures for name, result in results.items() if result.error is None}
    utterances = tuple(_to_utterance(e, good[e.id], out) for e in plan.entries if e.id in good)
    wanted = {f"{part}/{name}.parquet" for name in good for part in PARTS}
    wanted |= {f"{AUDIO}/{name}.wav" for name, known in good.items() if "audio" in known}
    before = {path.stem for path in (out / PARTS[-1]).glob("*.parquet")}
    if utterances:
        _write_description(plan, utterances, good, out)
    else:
        for name in (DESCRIPTION_FILE, UTTERANCES_FILE):
            (out / name).unlink(missing_ok=True)
    for folder, ending in (*((part, "parquet") for part in PARTS), (AUDIO, "wav")):
        for path in (out / folder).glob(f"*.{ending}"):
            if f"{folder}/{path.name}" not in wanted:
                path.unlink()
    return sorted(before - set(good))


def _to_utterance(entry: Entry, figures: Mapping[str, Any], out: Path) -> Utterance:
    names = (entry.id, entry.speaker, entry.session, entry.split)
    sources, checks = tuple(figures["sources"]), tuple(figures["checks"])
    return Utterance(*names, figures["duration"], entry.text, sources, checks, out)


def _write_description(
    plan: Plan,
    utterances: tuple[Utterance, ...],
    good: Mapping[str, Mapping[str, object]],
    out: Path,
) -> None:
    settings = plan.settings
    manifest, speaker = settings.manifest, next(iter(settings.speakers.values()))
    rates = {good[u.id]["recorded_rate"] for u in utterances}
    rate = manifest.rate or (rates.pop() if len(rates) == 1 else None)
    file = None
    if plan.phone_set_file is not None:
        file, content = plan.phone_set_file
        with write_atomically(out / file) as partial:
            partial.write_bytes(content)
    corpus = Corpus(
        utterances,
        phone_set=settings.phone_set,
        parameter_names=speaker.binding.rig.parameter_names,
        rate=rate if isinstance(rate, float) else None,
        language=manifest.language or settings.phone_set.language,
        face=speaker.face_name,
        layout=speaker.layout.name,
        folder=out,
        provenance=(Step(STEP, manifest.to_dict()),),
    )
    write_corpus(corpus, out, file)
