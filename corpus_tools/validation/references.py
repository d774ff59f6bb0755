"""Checks of reference poses: whether the face speaks or moves in them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from corpus_tools.conversion.entries import find_one_file
from corpus_tools.conversion.manifest import SpeakerEntry, load_manifest
from corpus_tools.validation.findings import Finding, Location
from corpus_tools.validation.reading import describe_failure
from corpus_tools.validation.subject import Context
from mocap_fit.errors import MocapFitError
from mocap_fit.fitting import Layout, find_layout, parse_reference, read_reference
from mocap_fit.fitting.marker_names import match_names
from mocap_fit.fitting.reference_pose import find_reference_faults
from mocap_fit.tracks import MarkerTracks

_CODES = {"speaks": "MF128", "moves": "MF129", "worse": "MF130"}


def find_references(folder: Path) -> list[str]:
    """Return the reference poses in a folder: those of its manifest, or ``reference.*``.

    Parameters
    ----------
    folder
        The folder.

    Returns
    -------
    list of str
        Files, with their spans.
    """
    patterns = [SpeakerEntry().reference]
    sources = []
    try:
        if (folder / "manifest.toml").is_file():
            manifest = load_manifest(folder / "manifest.toml")
            named = [speaker.reference for speaker in manifest.speakers]
            named += [s.reference for s in manifest.sessions if s.reference is not None]
            patterns = list(dict.fromkeys(named))
        for pattern in patterns:
            where = parse_reference(pattern)
            path = find_one_file(folder, str(where.path))
            if path is not None:
                sources.append(str(path) + pattern[len(str(where.path)) :])
    except MocapFitError:
        # The manifest is that of another program, or `convert` says what is wrong with it.
        return []
    return sources


def check_reference(source: str | os.PathLike[str], context: Context) -> Iterator[Finding]:
    """Find what is wrong with a reference pose.

    Parameters
    ----------
    source
        ``FILE`` or ``FILE@START-END``, seconds.
    context
        How it is read, and its layout.

    Yields
    ------
    Finding
        What is wrong.
    """
    location = Location(str(source))
    try:
        pose, take = read_reference(source, context.options.read_tracks)
        path = parse_reference(source).path
        layout = context.layout or find_layout(take, [path.parent]).layout
        yield from check_pose(pose, take, layout, path, location)
    except MocapFitError as error:
        yield describe_failure(error, str(source))


def check_pose(
    pose: MarkerTracks, take: MarkerTracks, layout: Layout, path: Path, location: Location
) -> Iterator[Finding]:
    """Find what is wrong with a reference pose that is read.

    Parameters
    ----------
    pose
        The reference pose.
    take
        The recording that it is from.
    layout
        The marker layout.
    path
        The recording's file.
    location
        The location of the findings.

    Yields
    ------
    Finding
        What is wrong.

    Raises
    ------
    MocapFitError
        If markers of the layout are missing.
    """
    pose, take = (match_names(layout, tracks, complete=True) for tracks in (pose, take))
    for fault in find_reference_faults(layout, pose, take, path):
        code = _CODES[fault.kind]
        yield Finding(code, location, fault.problem, fault.expected, advice=fault.advice)
