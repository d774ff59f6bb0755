"""Find the layout of a recording: by the names of its markers, confirmed by their shape."""

from __future__ import annotations

import os
import tomllib
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mocap_fit.edits import EDITS_ENDING
from mocap_fit.errors import ConfigurationError, MocapFitError, MocapFitWarning
from mocap_fit.fitting.coordinates import locate_expected
from mocap_fit.fitting.layout import Layout, list_layouts, load_layout
from mocap_fit.fitting.marker_names import match_subject
from mocap_fit.head.alignment import align_shapes
from mocap_fit.io.names import split_subject
from mocap_fit.tracks import MarkerTracks
from mocap_fit.tracks.rigid import compute_spread
from mocap_fit.tracks.rigid_sets import compute_typical_shape
from mocap_fit.tracks.robust import sample_evenly

# A layout is considered where a recording has as many of its markers.
_KNOWN_SHARE = 0.8
# Part of the face's size (root mean square) that the markers may be away from where the layout has
# them, median: landmarks of video are at 0.17, exchanged names far above 1.
_MISFIT = 0.35
# Frames whose shape is compared.
_SAMPLE = 50
# Bytes; a larger file beside a recording is no layout.
_LARGEST = 2_000_000


@dataclass(frozen=True)
class LayoutMatch:
    """How well a layout fits a recording.

    Parameters
    ----------
    layout
        The layout.
    source
        Its name, or its file.
    lacking
        Markers of the layout that the recording lacks.
    misfit
        How far the markers are from where the layout has them on the face, as a part of the
        face's size, median; NaN where that cannot be compared, or many markers are lacking.
    """

    layout: Layout
    source: str
    lacking: tuple[str, ...]
    misfit: float

    @property
    def share(self) -> float:
        """Part of the layout's markers that the recording has, 0 to 1."""
        return 1 - len(self.lacking) / len(self.layout.markers)

    @property
    def has_shape(self) -> bool:
        """Whether the markers are where the layout has them, as far as that can be compared."""
        return not self.misfit > _MISFIT

    def __str__(self) -> str:
        total = len(self.layout.markers)
        text = f"{total - len(self.lacking)} of {total} markers"
        if np.isnan(self.misfit):
            return text
        return f"{text}, {100 * self.misfit:.0f} % of its size off"


def rank_layouts(
    tracks: MarkerTracks, folders: Iterable[str | os.PathLike[str]] = ()
) -> list[LayoutMatch]:
    """Compare a recording with all layouts that are at hand.

    Parameters
    ----------
    tracks
        The recording.
    folders
        Where further layouts may be, besides the shipped ones.

    Returns
    -------
    list of LayoutMatch
        Those that share a marker's name with the recording, the best first.
    """
    matches = [
        match
        for layout, source in _list_candidates(folders)
        if (match := _compare(tracks, layout, source)) is not None
    ]
    return sorted(
        matches, key=lambda m: (not m.has_shape, -m.share, np.nan_to_num(m.misfit), m.source)
    )


def find_layout(
    tracks: MarkerTracks, folders: Iterable[str | os.PathLike[str]] = ()
) -> LayoutMatch:
    """Find the layout that a recording was made with.

    Parameters
    ----------
    tracks
        The recording.
    folders
        Where further layouts may be, besides the shipped ones: TOML files.

    Returns
    -------
    LayoutMatch
        The layout of whose markers at least four in five are there by their names, and where it
        has them on the face.

    Raises
    ------
    ConfigurationError
        If no layout fits; the message says what the nearest lacks.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> find_layout(mf.read_tracks(mf.load_sample("take_01"))).source
    'face30-head5'
    """
    matches = rank_layouts(tracks, folders)
    best = matches[0] if matches else None
    if best is not None and best.share >= _KNOWN_SHARE and best.has_shape:
        return best
    advice = "Give the layout (--layout NAME or FILE)"
    named = max(matches, key=lambda m: m.share, default=None)
    if named is None:
        raise ConfigurationError(
            f"the recording '{tracks.name}' has no marker of any layout",
            found=list(tracks.names),
            expected=f"the markers of {', '.join(list_layouts())}, or of a TOML file beside it",
            advice=f"{advice}, or rename the markers (--rename OLD=NEW).",
        )
    if named.share >= _KNOWN_SHARE:
        raise ConfigurationError(
            f"the markers of '{tracks.name}' have the names of the layout '{named.source}', but "
            "are not where it has them",
            found=f"{100 * named.misfit:.0f} % of the face's size off, median",
            expected=f"at most {100 * _MISFIT:.0f} %",
            advice=f"{advice} if it is this one all the same.",
        )
    raise ConfigurationError(
        f"no layout fits the markers of '{tracks.name}'; the nearest is '{named.source}', of "
        f"which {len(named.lacking)} of {len(named.layout.markers)} markers are lacking",
        found=[name for name in tracks.names if name not in _list_names(named.layout)],
        expected=list(named.lacking),
        advice=f"{advice}, or rename the markers (--rename OLD=NEW).",
    )


def _list_names(layout: Layout) -> list[str]:
    return [marker.name for marker in layout.markers]


def _list_candidates(
    folders: Iterable[str | os.PathLike[str]],
) -> Iterator[tuple[Layout, str]]:
    """Yield the shipped layouts, and those among the TOML files of folders."""
    for name in list_layouts():
        yield load_layout(name), name
    for folder in dict.fromkeys(Path(folder) for folder in folders):
        for path in sorted(folder.glob("*.toml")):
            if path.name.endswith(EDITS_ENDING) or not is_layout(path):
                continue
            try:
                yield load_layout(path), str(path)
            except MocapFitError as error:
                text = f"the layout is not considered: {error}"
                warnings.warn(text, MocapFitWarning, stacklevel=2)


def is_layout(path: Path) -> bool:
    """Whether a TOML file has a list of markers.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    bool
        False also where it cannot be read.
    """
    try:
        if path.stat().st_size > _LARGEST:
            return False
        return isinstance(tomllib.loads(path.read_text("utf-8")).get("markers"), list)
    except (OSError, ValueError, RecursionError):
        return False


def _compare(tracks: MarkerTracks, layout: Layout, source: str) -> LayoutMatch | None:
    """Compare names, and where enough of them are there, shapes."""
    tracks = match_subject(layout, tracks)
    wanted = _list_names(layout)
    # A name with the subject of another is the same marker.
    known = set(tracks.names) | {split_subject(name)[1] for name in tracks.names}
    lacking = tuple(name for name in wanted if name not in known)
    if len(lacking) == len(wanted):
        return None
    match = LayoutMatch(layout, source, lacking, np.nan)
    if match.share < _KNOWN_SHARE:
        return match
    there = [name for name in wanted if name in tracks.names]
    return replace(match, misfit=_measure_misfit(tracks, layout, there))


def _measure_misfit(tracks: MarkerTracks, layout: Layout, names: list[str]) -> float:
    """Return how far the markers are from the layout's, as a part of its size."""
    if not names or not tracks.frames:
        return np.nan
    some = sample_evenly(tracks.positions[:, tracks.indices(names)], _SAMPLE)
    expected = locate_expected(layout, names)
    fit = align_shapes(expected, compute_typical_shape(some))
    if fit is None:
        return np.nan
    size = fit.scale * np.linalg.norm(compute_spread(expected))
    return float(np.nanmedian(fit.distances) / size)
