"""``mocap-fit convert``: recordings, labels and sound → a corpus."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from corpus_tools.batch import BatchProgress, ItemResult, run_batch
from corpus_tools.conversion.entries import list_entries, list_recordings
from corpus_tools.conversion.gather import finish, open_folder, read_former_splits
from corpus_tools.conversion.manifest import Manifest, load_manifest
from corpus_tools.conversion.plan import make_plan
from corpus_tools.conversion.report import ConversionReport, format_messages
from corpus_tools.conversion.utterance import ConversionJob
from mocap_fit.errors import ConfigurationError, MocapFitError, MocapFitWarning
from mocap_fit.phones import list_phone_sets
from mocap_fit.settings_file import validate_settings

_MANIFEST = "manifest.toml"


def convert(
    manifest: str | os.PathLike[str],
    *,
    out: str | os.PathLike[str],
    root: str | os.PathLike[str] | None = None,
    phone_set: str | None = None,
    layout: str | None = None,
    edits: str | None = None,
    allow_mirrored: bool = False,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
    rename: Mapping[str, str] | None = None,
    reference_as_is: bool = False,
    jobs: int = 1,
    cluster: str | None = None,
    fresh: bool = False,
    progress: Callable[[BatchProgress], object] | None = None,
) -> ConversionReport:
    """Convert a folder of recordings, labels and sound to a corpus.

    A bad utterance is left out, and the rest goes on. What an earlier run has converted from the
    same bytes in the same way stays as it is; what is not in the manifest any more is removed.

    Parameters
    ----------
    manifest
        The TOML file, or a folder: its ``manifest.toml``, or without one the folder convention.
    out
        Folder of the corpus: a new one, or that of an earlier conversion.
    root
        Folder that the manifest's paths are under; by default the manifest's folder.
    phone_set
        In place of the manifest's phone set; needed where there is no manifest.
    layout
        In place of the manifest's marker layout; without either, the one that fits the reference
        pose.
    edits
        Path of edit lists under the root, with ``{id}`` for the utterance, in place of the
        manifest's; without either, ``RECORDING.edits.toml`` beside the recordings.
    allow_mirrored
        Whether mirrored recordings and reference poses are mended, and not refused; also where
        the manifest does not say so.
    rate
        Frame rate of the recordings, hertz, in place of what manifest and files say.
    unit
        Unit of length of the files, such as ``m``, in place of what manifest and files say.
    subject
        Subject whose markers are read, where files name several.
    rename
        New names of markers by those in the files, besides those of the manifest.
    reference_as_is
        Whether reference poses are read without these options; also where the manifest does not
        say so.
    jobs
        Number of processes; 0 for one per core.
    cluster
        Address of a dask scheduler whose workers convert in place of this machine.
    fresh
        Whether utterances are converted again that an earlier run has converted.
    progress
        Called with the state after every change; it has the results as they come.

    Returns
    -------
    ConversionReport
        Figures of every utterance; its ``errors`` names those that were left out.

    Raises
    ------
    MocapFitError
        If the manifest, the table of sentences, the phone set, the layout or the face cannot be
        used, or the folder holds something else.
    """
    began = time.perf_counter()
    options = {
        "phone_set": phone_set,
        "layout": layout,
        "edits": edits,
        "rate": rate,
        "unit": unit,
        "subject": subject,
        "rename": dict(rename) if rename else None,
        "reference_as_is": reference_as_is or None,
        "fit": {"allow_mirrored": True} if allow_mirrored else None,
    }
    changes = {key: value for key, value in options.items() if value is not None}
    settings, base = _read_manifest(Path(manifest), changes)
    base = base if root is None else Path(root)
    if not base.is_dir():
        raise ConfigurationError(
            "the folder of recordings is not there", path=base, advice="Give it as --root."
        )
    folder = Path(out)
    entries = list_entries(settings, base, read_former_splits(folder, settings))
    plan = make_plan(settings, entries, base)
    job = ConversionJob(plan.settings)
    refused = [ItemResult(name, error=reason) for name, reason in plan.refused.items()]
    with open_folder(folder):
        converted = run_batch(
            job, plan.items, folder, jobs=jobs, cluster=cluster, fresh=fresh, progress=progress
        )
        results = {result.name: result for result in (*refused, *converted)}
        try:
            removed = finish(plan, results, folder)
        except (MocapFitError, OSError):
            # What is wrong with utterances is said all the same.
            for line in format_messages(results):
                warnings.warn(line.partition(": ")[2], MocapFitWarning, stacklevel=2)
            raise
    unlisted = set(list_recordings(settings, base)) - {entry.stem for entry in entries}
    seconds = time.perf_counter() - began
    layout_name = next((s.layout.name for s in plan.settings.speakers.values()), "")
    return ConversionReport(
        folder, layout_name, entries, results, sorted(unlisted), removed, seconds
    )


def _read_manifest(path: Path, changes: Mapping[str, Any]) -> tuple[Manifest, Path]:
    """Return the manifest with some keys changed, and the folder that its paths are under."""
    if path.is_dir() and (path / _MANIFEST).is_file():
        path = path / _MANIFEST
    if not path.is_dir():
        content = load_manifest(path).model_dump()
        for key, value in changes.items():
            content[key] = {**content[key], **value} if isinstance(value, dict) else value
        return validate_settings(Manifest, content, path, "manifest"), path.parent
    if "phone_set" not in changes:
        raise ConfigurationError(
            f"there is no {_MANIFEST}, and nothing says which phones the labels are written in",
            path=path,
            expected=f"--phone-set with one of {', '.join(list_phone_sets())}, or a file",
        )
    return validate_settings(Manifest, changes, path, "call"), path
