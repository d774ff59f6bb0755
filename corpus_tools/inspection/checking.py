"""What `validate` says of the material that is shown."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator

from corpus_tools.inspection.material import Material
from corpus_tools.validation.corpora import check_between
from corpus_tools.validation.findings import Finding, Location, sort_findings
from corpus_tools.validation.references import check_pose
from corpus_tools.validation.subject import Context, Subject, check_subject
from corpus_tools.validation.thresholds import load_thresholds
from mocap_fit.errors import DataError, MocapFitError, MocapFitWarning
from mocap_fit.io import ReadOptions
from mocap_fit.labels import Tier
from mocap_fit.phones import PhoneSet, find_phone_sets, load_phone_set

REFERENCES = ("reference", "rest")
"""Names of files that hold the reference pose of the recordings beside them."""


def check_material(
    material: Material,
    *,
    phone_set: PhoneSet | None = None,
    on_one_clock: bool = False,
    options: ReadOptions | None = None,
) -> tuple[Finding, ...]:
    """Check what is shown.

    Parameters
    ----------
    material
        What is shown.
    phone_set
        Phone set of the labels; by default the shipped one that has all of their symbols.
    on_one_clock
        Whether the times of recording and labels are those of the sound.
    options
        How the recording was read.

    Returns
    -------
    tuple of Finding
        What is wrong, the gravest first.
    """
    tier = material.tiers.get("phones")
    subject = Subject(
        material.path.stem,
        markers=material.recording,
        parameters=next(iter(material.heads.values()), None),
        tier=tier,
        sound=material.sound,
        files={"markers": str(material.path)},
        on_one_clock=on_one_clock,
    )
    limits = load_thresholds()
    phone_set = phone_set or guess_phone_set(tier)
    context = Context(
        limits, material.layout, material.rig, phone_set, options=options or ReadOptions()
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        findings, summary = check_subject(subject, context)
        findings += check_between([summary], limits, splits=False)
        findings += _check_reference(material)
    graded = [limits.grade(finding) for finding in findings]
    return tuple(sort_findings(each for each in graded if each is not None))


def guess_phone_set(tier: Tier | None) -> PhoneSet | None:
    """Guess the phone set of labels: the shipped one that has all of their symbols.

    Parameters
    ----------
    tier
        The phones; None without.

    Returns
    -------
    PhoneSet or None
        The phone set; None where none has them all.
    """
    symbols = {label.text.strip() for label in tier.entries} - {""} if tier else set()
    names, count = find_phone_sets(dict.fromkeys(symbols, 1))
    return load_phone_set(names[0]) if symbols and count == len(symbols) else None


def _check_reference(material: Material) -> Iterator[Finding]:
    """Check a reference pose that is shown: by its name, or where an edit sets it."""
    recording, layout, edits = material.recording, material.layout, material.edits
    chosen = None if edits is None else edits.reference
    if recording is None or layout is None:
        return
    if chosen is None and material.path.stem not in REFERENCES:
        return
    pose = recording
    if chosen is not None and chosen.recording is None:
        with contextlib.suppress(DataError):
            pose = recording.between(chosen.start, chosen.end)
    with contextlib.suppress(MocapFitError):
        yield from check_pose(pose, recording, layout, material.path, Location(str(material.path)))
