"""Describe what a file or a corpus holds: recordings, labels, sound, corpora, models."""

from __future__ import annotations

import os
import warnings
import zipfile
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mocap_fit.corpus import DESCRIPTION_FILE, Corpus, open_corpus
from mocap_fit.errors import DataError, MocapFitWarning
from mocap_fit.fitting.memory import check_memory, estimate_memory
from mocap_fit.io import describe
from mocap_fit.labels import (
    LABEL_READERS,
    Labels,
    Tier,
    find_label_faults,
    find_label_reader,
    read_all_labels,
)
from mocap_fit.phones import list_phone_sets, load_phone_set, read_stored_phones
from mocap_fit.sound import energy_db, read_sound
from mocap_fit.tracks.parquet_file import read_kind

_SOUND = (".wav", ".flac", ".aif", ".aiff", ".ogg")
# More than these are counted only.
_LISTED = 40


def describe_contents(path: str | os.PathLike[str]) -> Mapping[str, Any]:
    """Describe what a file or a folder holds, whatever its kind.

    Parameters
    ----------
    path
        A recording, parameters, phones, labels, sound, a trained model, or a corpus's folder.

    Returns
    -------
    Mapping[str, Any]
        ``file``, ``content`` (the kind) and properties of that kind, as JSON can hold them.

    Raises
    ------
    MocapFitError
        If it cannot be read.
    """
    file = Path(path)
    if file.is_dir() or file.name == DESCRIPTION_FILE:
        return _describe_corpus(path, file.parent if file.name == DESCRIPTION_FILE else file)
    if file.suffix.lower() in _SOUND:
        return _describe_sound(path)
    if file.suffix.lower() == ".parquet" and read_kind(file) == "phones":
        return _describe_phones(path)
    if _is_labels(file):
        return _describe_labels(path)
    if zipfile.is_zipfile(file):
        return _describe_model(path)
    return _describe_recording(path)


def _is_labels(file: Path) -> bool:
    """Whether a file holds labels; tables of numbers are distinguished by their content."""
    if not file.is_file():
        return False
    for name in LABEL_READERS.names():
        reader = LABEL_READERS.get(name)
        ending = file.suffix.lower()
        if ending in reader.extensions and (ending not in (".csv", ".tsv") or reader.sniff(file)):
            return True
    return False


def _describe_labels(path: str | os.PathLike[str]) -> dict[str, Any]:
    name = find_label_reader(path)
    utterances = read_all_labels(path, reader=name)
    about: dict[str, Any] = {
        "file": os.fspath(path),
        "format": name,
        "description": LABEL_READERS.get(name).description,
        "content": "labels",
    }
    if len(utterances) != 1:
        rows = [
            {"name": labels.name, "duration": labels.end - labels.start, **_count_labels(labels)}
            for labels in utterances
        ]
        total = {"count": len(rows)} if len(rows) > _LISTED else {}
        return {**about, **total, "utterances": rows[:_LISTED]}
    (labels,) = utterances
    faults = [str(fault) for fault in find_label_faults(labels)]
    return {
        **about,
        "name": labels.name,
        "start": labels.start,
        "end": labels.end,
        "tiers": [_describe_tier(tier) for tier in labels.tiers],
        "faults": faults[:_LISTED],
    }


def _count_labels(labels: Labels) -> dict[str, int]:
    return {tier.name or "labels": len(tier.entries) for tier in labels.tiers}


def _describe_tier(tier: Tier) -> dict[str, Any]:
    symbols = Counter(entry.text.strip() for entry in tier.entries if entry.text.strip())
    return {
        "name": tier.name,
        "kind": tier.kind,
        "labels": len(tier.entries),
        "different": len(symbols),
        "phone_sets": _find_phone_sets(symbols),
    }


def _find_phone_sets(symbols: Mapping[str, int]) -> list[str]:
    """Return the names of the shipped phone sets that have all of the symbols."""
    fitting = []
    for name in list_phone_sets():
        phone_set = load_phone_set(name)
        # A set that computes its phones has nearly everything.
        if phone_set.compute is None and all(phone_set.parse(s) is not None for s in symbols):
            fitting.append(name)
    return fitting if symbols else []


def _describe_phones(path: str | os.PathLike[str]) -> dict[str, Any]:
    phones = read_stored_phones(path)
    counts = Counter(phones.phones)
    return {
        "file": os.fspath(path),
        "content": "phones",
        "name": phones.name,
        "phone_set": phones.phone_set,
        "count": len(phones),
        "duration": phones.duration,
        "phones": [{"phone": phone, "count": count} for phone, count in sorted(counts.items())],
        "provenance": [step.to_dict() for step in phones.provenance],
    }


def _describe_sound(path: str | os.PathLike[str]) -> dict[str, Any]:
    sound = read_sound(path)
    times = np.arange(0.0125, max(sound.duration, 0.013), 0.025)
    channels = []
    for number in range(1, sound.channels + 1):
        samples = sound.get_channel(number)
        energies = energy_db(sound.replace(samples=samples), times[times <= sound.duration])
        peak = float(np.abs(samples).max())
        channels.append(
            {
                "channel": number,
                "peak": peak,
                "clipped": int((np.abs(samples) >= 1.0 - 2.0**-15).sum()),
                "loudest_db": float(energies.max(initial=-np.inf)),
                "quietest_db": float(energies.min(initial=np.inf)),
            }
        )
    return {
        "file": os.fspath(path),
        "content": "sound",
        "name": sound.name,
        "encoding": sound.encoding,
        "rate": sound.rate,
        "samples": len(sound),
        "duration": sound.duration,
        "channels": channels,
    }


def _describe_corpus(path: str | os.PathLike[str], folder: Path) -> dict[str, Any]:
    corpus = open_corpus(folder)
    splits = [
        {
            "split": name,
            "utterances": len(corpus.get_split(name)),
            "duration": sum(u.duration for u in corpus.get_split(name)),
        }
        for name in corpus.splits
    ]
    return {
        "file": os.fspath(path),
        "content": "corpus",
        "language": corpus.language,
        "phone_set": corpus.phone_set.name,
        "face": corpus.face,
        "layout": corpus.layout,
        "rate": corpus.rate,
        "parameters": list(corpus.parameter_names),
        "utterances": len(corpus),
        "duration": sum(u.duration for u in corpus),
        "synchronised": _get_clock(corpus),
        "splits": splits,
        "speakers": [
            {"speaker": speaker, "session": session, "utterances": count}
            for (speaker, session), count in sorted(
                Counter((u.speaker, u.session) for u in corpus).items()
            )
        ],
        "checks": [f"{u.id}: {line}" for u in corpus for line in u.checks][:_LISTED],
        "provenance": [step.to_dict() for step in corpus.provenance],
    }


def _get_clock(corpus: Corpus) -> str:
    """Return how recordings were put on the clock of the sound, as the description says."""
    for step in corpus.provenance:
        kind = step.arguments.get("sync", {}).get("kind")
        if kind is not None:
            return "estimated" if kind == "estimate" else str(kind)
    return "not known"


def _describe_model(path: str | os.PathLike[str]) -> dict[str, Any]:
    from mocap_fit.control import load

    model = load(path)
    return {
        "file": os.fspath(path),
        "content": "model",
        "model": model.name,
        "settings": model.get_params(),
        "parameters": list(model.parameter_names_),
        "phone_set": model.phone_set_.name,
        "rate": model.rate_,
        "look_ahead": model.look_ahead,
        "parameter_count": model.parameter_count,
        "trained_on": model.trained_on_,
        "epochs": len(model.log_),
    }


def _describe_recording(path: str | os.PathLike[str]) -> dict[str, Any]:
    content = describe(path)
    if content["content"] == "markers":
        size = content["frames"], len(content["markers"])
        content["memory_to_fit"] = round(estimate_memory(*size) / 2**30, 2)
        try:
            check_memory(*size, path=path)
        except DataError as error:
            warnings.warn(str(error), MocapFitWarning, stacklevel=2)
    return content
