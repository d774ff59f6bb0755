"""Bring the names of reference poses and recordings to those of the layout."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from difflib import get_close_matches

from mocap_fit.errors import DataError
from mocap_fit.fitting.layout import Layout
from mocap_fit.io.names import find_doubled, split_subject, to_plain
from mocap_fit.tracks import MarkerTracks

_SUGGESTED = 3
"""Number of options that an error spells out."""


def match_names(layout: Layout, tracks: MarkerTracks, *, complete: bool = False) -> MarkerTracks:
    """Return a recording with the names of the layout where only the subject's prefix differs.

    Parameters
    ----------
    layout
        The marker layout.
    tracks
        A recording or a reference pose.
    complete
        Whether the head markers must all be there, as in a reference pose.

    Returns
    -------
    MarkerTracks
        The recording, with a step of provenance where markers were renamed.

    Raises
    ------
    DataError
        If markers of the layout are not there, or one has a name that the file had twice; both
        lists of names are in the message, and the options that would mend it.
    """
    noun = "reference pose" if complete else "recording"
    wanted = [marker.name for marker in layout.markers]
    tracks = match_subject(layout, tracks)
    _check_doubled(wanted, tracks, noun)
    lacking = [name for name in wanted if name not in tracks.names]
    head = () if complete else [marker.name for marker in layout.head_markers]
    if any(name not in head for name in lacking):
        others = [name for name in tracks.names if name not in wanted]
        raise DataError(
            f"the {noun} lacks {len(lacking)} of the {len(wanted)} markers of the layout "
            f"'{layout.name}'",
            found=others or "no other marker",
            expected=lacking,
            advice=_suggest(lacking, others),
        )
    return tracks


def match_subject(layout: Layout, tracks: MarkerTracks) -> MarkerTracks:
    """Return a recording with the names of the layout, if one subject has those that are lacking.

    Parameters
    ----------
    layout
        The marker layout; its names may have a prefix that those of the recording lack.
    tracks
        A recording.

    Returns
    -------
    MarkerTracks
        The recording, with a step of provenance where markers were renamed.
    """
    plain = {
        split_subject(marker.name)[1]: marker.name
        for marker in layout.markers
        if marker.name not in tracks.names
    }
    matches: dict[str | None, dict[str, str]] = {}
    for name in tracks.names if plain else ():
        owner, rest = split_subject(name)
        if rest in plain:
            matches.setdefault(owner, {})[name] = plain[rest]
    # The markers of two people are not one face.
    if len(matches) != 1:
        return tracks
    (changes,) = matches.values()
    names = tuple(changes.get(name, name) for name in tracks.names)
    return tracks.replace(names=names).add_step("rename", {"names": changes})


def _check_doubled(wanted: Sequence[str], tracks: MarkerTracks, noun: str) -> None:
    doubled = find_doubled(tracks)
    name = next((name for name in wanted if name in doubled), None)
    if name is None:
        return
    label = doubled[name]
    twins = [twin for twin in doubled if doubled[twin] == label]
    raise DataError(
        f"the {noun} has the marker '{label:.40}' of the layout more than once, and nothing says "
        "which it is",
        found=twins,
        expected="one",
        advice="Name the others otherwise: "
        + " ".join(_to_option(twin, f"other {twin}") for twin in twins[1 : 1 + _SUGGESTED])
        + ".",
    )


def _suggest(lacking: Sequence[str], others: Sequence[str]) -> str:
    """Return what would bring the names of a file to those of the layout."""
    left = {to_plain(name): name for name in reversed(others)}
    options = []
    for name in lacking:
        close = get_close_matches(to_plain(name), left, 1, 0.8)
        if close:
            options.append(_to_option(left.pop(close[0]), name))
    if not options:
        return (
            "Choose the layout that it was recorded with, or rename its markers "
            "(--rename OLD=NEW; rename={'OLD': 'NEW'} in Python)."
        )
    more = f" and so on, {len(options)} in all" if len(options) > _SUGGESTED else ""
    return f"If these are the same: {' '.join(options[:_SUGGESTED])}{more}."


def _to_option(old: str, new: str) -> str:
    return f"--rename {shlex.quote(f'{old}={new}')}"
