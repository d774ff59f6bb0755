"""Describe what a file or a folder holds: recordings, labels, sound, corpora, models."""

from __future__ import annotations

import os
import warnings
import zipfile
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from corpus_tools.inspection.descriptions import (
    describe_folder,
    describe_settings,
    is_shipped,
)
from mocap_fit.corpus import DESCRIPTION_FILE, Corpus, open_corpus
from mocap_fit.edits import load_edits, locate_edits
from mocap_fit.errors import DataError, MocapFitError, MocapFitWarning
from mocap_fit.fitting import rank_layouts, suggest_reference
from mocap_fit.fitting.marker_names import match_subject
from mocap_fit.fitting.memory import check_memory, estimate_memory
from mocap_fit.io import ReadOptions, describe
from mocap_fit.labels import (
    LABEL_READERS,
    Tier,
    find_label_faults,
    find_label_reader,
    read_all_labels,
)
from mocap_fit.phones import find_phone_sets, read_stored_phones
from mocap_fit.size_limit import measure_file
from mocap_fit.sound import SOUND_ENDINGS, energy_db, read_sound
from mocap_fit.sound.energy import WINDOW
from mocap_fit.tracks import MarkerTracks
from mocap_fit.tracks.parquet_file import read_kind

# More than these are counted only.
_LISTED = 40
# Share of the symbols that a phone set has if they are to be phones.
_MOST = 0.75
# Share of a layout's markers from which it is named.
_NEAR_LAYOUT = 0.5
# Frames of a recording in which a still span is looked for.
_SEARCHED = 20_000


def describe_contents(path: str | os.PathLike[str], options: ReadOptions) -> Mapping[str, Any]:
    """Describe what a file or a folder holds, whatever its kind.

    Parameters
    ----------
    path
        A recording, parameters, phones, labels, sound, a trained model, a TOML file, a folder, or
        the name of a shipped layout or phone set.
    options
        How recordings are read.

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
    if not file.exists() and is_shipped(str(path)):
        return {"file": os.fspath(path), **describe_settings(path)}
    if file.suffix.lower() == ".toml" and file.name != DESCRIPTION_FILE:
        return {"file": os.fspath(path), **describe_settings(path)}
    if file.is_dir() and not (file / DESCRIPTION_FILE).is_file():
        return {"file": os.fspath(path), **describe_folder(file)}
    if file.is_dir() or file.name == DESCRIPTION_FILE:
        content = _describe_corpus(file.parent if file.name == DESCRIPTION_FILE else file)
        return {"file": os.fspath(path), **content}
    measure_file(file)
    if file.suffix.lower() in SOUND_ENDINGS:
        content = _describe_sound(path)
    elif file.suffix.lower() == ".parquet" and read_kind(file) == "phones":
        content = _describe_phones(path)
    elif _is_labels(file):
        content = _describe_labels(path)
    elif zipfile.is_zipfile(file):
        content = _describe_model(path)
    else:
        content = _describe_recording(path, options)
    return {"file": os.fspath(path), **content}


def _is_labels(file: Path) -> bool:
    """Whether a file holds labels; tables and texts are distinguished by their content."""
    ending = file.suffix.lower()
    readers = LABEL_READERS.load_all()
    fitting = [name for name, reader in readers.items() if ending in (*reader.extensions, ".txt")]
    if not fitting or not file.is_file():
        return False
    if ending not in (".csv", ".tsv", ".txt"):
        return True
    for name in fitting:
        with LABEL_READERS.guard(name, file):
            if readers[name].sniff(file):
                return True
    return False


def _describe_labels(path: str | os.PathLike[str]) -> dict[str, Any]:
    name = find_label_reader(path)
    utterances = read_all_labels(path, reader=name)
    about: dict[str, Any] = {
        "format": name,
        "description": LABEL_READERS.get(name).description,
        "content": "labels",
    }
    if len(utterances) != 1:
        rows = [
            {"name": labels.name, "duration": labels.end - labels.start}
            | {tier.name or "labels": len(tier.entries) for tier in labels.tiers}
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
    """Return the shipped phone sets that the symbols fit best, and how well where not entirely."""
    names, count = find_phone_sets(symbols)
    if count == len(symbols):
        return list(names)
    return [f"{n} ({count} of {len(symbols)})" for n in names if count >= _MOST * len(symbols)]


def _describe_phones(path: str | os.PathLike[str]) -> dict[str, Any]:
    phones = read_stored_phones(path)
    counts = Counter(phones.phones)
    return {
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
    times = np.arange(min(0.0125, 0.5 * sound.duration), sound.duration, 0.025)
    # A channel of slow signals has fewer than two samples in the usual window.
    window = max(WINDOW, 4 / sound.rate)
    channels = []
    for number in range(1, sound.channels + 1):
        samples = sound.get_channel(number)
        energies = energy_db(sound.replace(samples=samples), times, window=window)
        peak = float(np.abs(samples).max())
        channels.append(
            {
                "channel": number,
                "peak": peak,
                "clipped": int((np.abs(samples) >= 1.0 - 2.0**-15).sum()),
                "loudest_db": float(energies.max()),
                "quietest_db": float(energies.min()),
            }
        )
    return {
        "content": "sound",
        "name": sound.name,
        "encoding": sound.encoding,
        "rate": sound.rate,
        "samples": len(sound),
        "duration": sound.duration,
        "channels": channels,
    }


def _describe_corpus(folder: Path) -> dict[str, Any]:
    corpus = open_corpus(folder)
    splits = {name: corpus.get_split(name) for name in corpus.splits}
    sessions = Counter((u.speaker, u.session) for u in corpus)
    return {
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
        "splits": [
            {"split": name, "utterances": len(part), "duration": sum(u.duration for u in part)}
            for name, part in splits.items()
        ],
        "speakers": [
            {"speaker": speaker, "session": session, "utterances": count}
            for (speaker, session), count in sorted(sessions.items())
        ],
        "checks": [f"{u.id}: {line}" for u in corpus for line in u.checks][:_LISTED],
        "provenance": [step.to_dict() for step in corpus.provenance],
    }


def _get_clock(corpus: Corpus) -> str:
    """Return how recordings were put on the clock of the sound, as the description says."""
    kinds = (step.arguments.get("sync", {}).get("kind") for step in corpus.provenance)
    kind = next((kind for kind in kinds if kind is not None), "not known")
    return "estimated" if kind == "estimate" else str(kind)


def _describe_model(path: str | os.PathLike[str]) -> dict[str, Any]:
    from mocap_fit.control import load

    model = load(path)
    return {
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


def _describe_markers(recording: MarkerTracks, path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the layout that fits a recording, and its stillest span with closed lips."""
    matches = rank_layouts(recording, [Path(path).parent])
    best = matches[0] if matches else None
    if best is None or best.share < _NEAR_LAYOUT:
        return {"layout": None}
    about: dict[str, Any] = {"layout": best.source}
    if best.lacking:
        about["lacking_markers"] = list(best.lacking)
    if not best.has_shape:
        about["layout"] = f"{best.source} by its names, but not by its shape"
        return about
    try:
        some = match_subject(best.layout, recording)
        if some.frames > _SEARCHED:
            some = some.between(None, float(some.times[_SEARCHED]))
        span = suggest_reference(some, best.layout)
    except DataError:
        return about
    return {
        **about,
        "stillest_span": f"{os.fspath(path)}@{span}",
        "stillest_residual": round(span.residual, 3),
    }


def _describe_recording(path: str | os.PathLike[str], options: ReadOptions) -> dict[str, Any]:
    content = describe(path, read=options.read)
    edits = locate_edits(path)
    if edits is not None:
        try:
            listed = load_edits(path)
            names = "; ".join(listed.describe() if listed else ())
        except MocapFitError as error:
            warnings.warn(str(error), MocapFitWarning, stacklevel=2)
            names = "cannot be used"
        content["edits"] = f"{edits.name}: {names}"
    if content["content"] == "markers":
        content |= _describe_markers(options.read_tracks(path), path)
        size = content["frames"], len(content["markers"])
        content["memory_to_fit"] = round(estimate_memory(*size) / 2**30, 2)
        try:
            check_memory(*size, path=path)
        except DataError as error:
            warnings.warn(str(error), MocapFitWarning, stacklevel=2)
    return content
