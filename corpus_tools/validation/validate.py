"""``mocap-fit validate``: every check, with the frames, markers and labels that fail."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from corpus_tools.tasks import TaskProgress, count_steps
from mocap_fit.atomic_file import check_targets
from mocap_fit.errors import ConfigurationError

if TYPE_CHECKING:
    from corpus_tools.validation import Context, Report


def validate(
    paths: Sequence[str | os.PathLike[str]],
    *,
    thresholds: str | os.PathLike[str] | None = None,
    layout: str | None = None,
    phone_set: str | None = None,
    edits: str | os.PathLike[str] | None = None,
    reference: Sequence[str | os.PathLike[str]] = (),
    page: str | os.PathLike[str] | None = None,
    rate: float | None = None,
    unit: str | None = None,
    subject: str | None = None,
    rename: Mapping[str, str] | None = None,
    jobs: int = 1,
    progress: TaskProgress | None = None,
) -> Report:
    """Check recordings, labels, sound and corpora.

    What cannot be read or checked is a finding, and does not keep the others from being checked;
    where there are several processes, one that dies takes only its utterance with it.

    Parameters
    ----------
    paths
        Corpora (folders with a ``corpus.toml``), folders, or single files; files of one name are
        one utterance.
    thresholds
        A TOML file that changes what counts as wrong.
    layout
        Name or file of the marker layout, in place of what a corpus or the names of markers say.
    phone_set
        Name or file of the phone set, in place of what a corpus says.
    edits
        An edit list, or a folder of ``RECORDING.edits.toml``; those beside the recordings where
        left out. Edits are applied before anything is checked.
    reference
        Reference poses, ``FILE`` or ``FILE@START-END`` (seconds), besides those that the manifest
        of a folder names, or its ``reference.*``.
    page
        A new HTML file with the report and its pictures; None for no page.
    rate
        Frame rate of the recordings, hertz, in place of what the files say.
    unit
        Unit of length of the files, such as ``m``, in place of what they say.
    subject
        Subject whose markers are read, where files name several.
    rename
        New names of markers by those in the files.
    jobs
        Number of processes; 0 for one per core.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    Report
        What was checked and found.

    Raises
    ------
    ConfigurationError
        If thresholds, layout or phone set cannot be used, or the page cannot be written.
    """
    from corpus_tools.validation import Context, Report, load_thresholds
    from corpus_tools.validation.references import check_reference
    from mocap_fit.corpus import DESCRIPTION_FILE
    from mocap_fit.fitting import load_layout
    from mocap_fit.io import ReadOptions
    from mocap_fit.phones import load_phone_set

    if page is not None:
        check_targets([page], [*paths, thresholds, layout, phone_set, edits])
    if page is not None and not Path(page).absolute().parent.is_dir():
        advice = "Make the folder, or choose another one."
        raise ConfigurationError(
            "the page cannot be written", path=page, found="no such folder", advice=advice
        )
    limits = load_thresholds(None if thresholds is None else Path(thresholds))
    context = Context(
        limits,
        None if layout is None else load_layout(layout),
        phone_set=None if phone_set is None else load_phone_set(phone_set),
        options=ReadOptions(rate, unit, subject, rename or {}),
        edits=edits,
    )
    report = Report(limits)
    loose = []
    for path in map(Path, paths):
        if (path / DESCRIPTION_FILE).is_file():
            _validate_corpus(path, context, report, jobs, progress)
        else:
            loose.append(path)
    if loose:
        _validate_files(loose, context, report, jobs, progress)
    for source in reference:
        report.add(list(check_reference(source, context)))
        report.checked.append(f"{source}: a reference pose")
    report.finish()
    if page is not None:
        from corpus_tools.validation.page import write_page

        write_page(report, Path(page))
    return report


def _validate_corpus(
    path: Path, context: Context, report: Report, jobs: int, progress: TaskProgress | None
) -> None:
    from corpus_tools.validation import corpora
    from corpus_tools.validation.many import check_each

    opened, findings = corpora.open_for_checks(path, context)
    report.add(findings)
    if opened is None:
        report.checked.append(f"{path}: a corpus that cannot be opened")
        return
    corpus = opened.corpus
    advance = count_steps(progress, "checking utterances", len(corpus))
    work = corpora.check_utterance, corpora.locate_utterance
    summaries = check_each(work, opened, corpus.utterances, report, jobs, advance)
    report.add(list(corpora.check_between(summaries, context.limits, splits=True)))
    report.summaries += summaries
    rig = opened.context.rig
    if rig is not None:
        pairs = zip(rig.parameter_names, rig.bounds.tolist(), strict=True)
        report.bounds = {name: (low, high) for name, (low, high) in pairs}
    seconds = sum(utterance.duration for utterance in corpus)
    report.checked.append(
        f"{path}: a corpus of {len(corpus)} utterances, {seconds:.1f} s, in the splits "
        f"{', '.join(corpus.splits) or 'none'}"
    )


def _validate_files(
    paths: Sequence[Path],
    context: Context,
    report: Report,
    jobs: int,
    progress: TaskProgress | None,
) -> None:
    from corpus_tools.validation import corpora, reading
    from corpus_tools.validation.findings import Finding, Location
    from corpus_tools.validation.many import check_each
    from corpus_tools.validation.references import check_reference, find_references

    chosen: list[Path] = []
    for path in paths:
        if path.is_dir():
            inside, others = reading.list_files(path)
            chosen += inside
            for source in find_references(path):
                # What cannot be read is said of the file as such.
                faults = (f for f in check_reference(source, context) if f.code != "MF001")
                report.add(list(faults))
            if not inside:
                report.add([Finding("MF002", Location(str(path)), "no recording, label or sound")])
            if others:
                names = ", ".join(str(other) for other in others[:5])
                more = f" and {len(others) - 5} more" if len(others) > 5 else ""
                what = "no reader takes these files"
                report.add([Finding("MF003", Location(str(path)), f"{what}: {names}{more}")])
            report.checked.append(f"{path}: a folder with {len(inside)} files that can be checked")
        else:
            chosen.append(path)
            report.checked.append(str(path))
    groups, unknown = reading.group_files(chosen)
    report.add([reading.describe_unknown(path) for path in unknown])
    advance = count_steps(progress, "checking files", len(groups))
    work = reading.check_files, reading.locate_files
    summaries = check_each(work, context, groups, report, jobs, advance)
    report.add(list(corpora.check_between(summaries, context.limits, splits=False)))
    report.summaries += summaries
