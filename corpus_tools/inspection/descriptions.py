"""Describe what people write and what is shipped: layouts, phone sets, manifests, folders."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from corpus_tools.conversion.entries import find_one_file, list_entries
from corpus_tools.conversion.manifest import SpeakerEntry, load_manifest
from corpus_tools.conversion.plan import find_files
from corpus_tools.validation.reading import group_files, list_files
from mocap_fit.edits import EDITS_ENDING, read_edits
from mocap_fit.errors import ConfigurationError, MocapFitError
from mocap_fit.fitting import list_layouts, load_layout, parse_reference
from mocap_fit.fitting.layout_search import is_layout
from mocap_fit.phones import list_phone_sets, load_phone_set
from mocap_fit.phones.phone import MANNERS, PLACES
from mocap_fit.settings_file import read_toml

_MANIFEST = "manifest.toml"
# Keys that only a manifest, a phone set or a rig file has.
_MANIFEST_KEYS = {"phone_set", "recordings", "speakers", "sessions"}
_SET_KEYS = {"silence", "vowels", "consonants"}
_RIG_KEYS = {"extends", "mesh", "transforms"}
# More than these are counted only.
_LISTED = 10


def describe_settings(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Describe a TOML file: a layout, a phone set, a manifest, a rig file or an edit list.

    Parameters
    ----------
    path
        The file, or the name of a shipped layout or phone set.

    Returns
    -------
    dict[str, Any]
        ``content`` (the kind) and what it says, as JSON can hold it.

    Raises
    ------
    MocapFitError
        If it is none of these, or wrong.
    """
    name = os.fspath(path)
    if not os.path.exists(name):
        if name in list_phone_sets():
            return _describe_phone_set(name)
        return _describe_layout(name)
    if name.endswith(EDITS_ENDING):
        return _describe_edits(name)
    keys = set(read_toml(name, noun="file"))
    if "edits" in keys and "sha256" in keys:
        return _describe_edits(name)
    if is_layout(Path(name)):
        return _describe_layout(name)
    if keys & _SET_KEYS:
        return _describe_phone_set(name)
    if keys & _MANIFEST_KEYS:
        return _describe_manifest(Path(name))
    if keys & _RIG_KEYS:
        return _describe_rig(name)
    raise ConfigurationError(
        "nothing says what this file is",
        path=path,
        found=sorted(keys),
        expected="a layout ([[markers]]), a phone set ([silence]), a manifest (phone_set), a rig "
        "file (mesh), or an edit list ([[edits]])",
    )


def is_shipped(name: str) -> bool:
    """Whether there is a shipped layout or phone set of that name.

    Parameters
    ----------
    name
        A name.

    Returns
    -------
    bool
        Whether there is one.
    """
    return name in (*list_layouts(), *list_phone_sets())


def _describe_layout(path: str) -> dict[str, Any]:
    layout = load_layout(path)
    return {
        "content": "layout",
        "name": layout.name,
        "description": layout.description,
        "face_markers": len(layout.face_markers),
        "head_markers": len(layout.head_markers),
        "marker_offset": layout.marker_offset,
        "size_varies": layout.size_varies,
        "reference_parameters": layout.reference_parameters,
        "used_as": f"--layout {path}; fit, convert and validate find it by themselves, shipped or "
        "beside the recordings",
        "markers": [
            {
                "name": marker.name,
                "role": marker.role,
                "feature_point": marker.feature_point,
                "region": list(marker.region),
                "orientation": marker.orientation,
            }
            | ({} if marker.weight == 1 else {"weight": marker.weight})
            for marker in layout.markers
        ],
    }


def _describe_phone_set(path: str) -> dict[str, Any]:
    phones = load_phone_set(path)
    groups: dict[str, list[str]] = {"silence": [], "vowel": []}
    groups |= {feature: [] for feature in (*PLACES, *MANNERS)}
    for phone in phones.phones:
        if phone.kind != "consonant":
            groups[phone.kind].append(phone.symbol)
            continue
        for feature in (*PLACES, *MANNERS):
            if phone.values[feature]:
                groups[feature].append(phone.symbol)
    kinds = Counter(phone.kind for phone in phones.phones)
    return {
        "content": "phone set",
        "name": phones.name,
        "language": phones.language,
        "description": phones.description,
        "vowels": kinds["vowel"],
        "consonants": kinds["consonant"],
        "any_symbol": phones.compute is not None,
        "used_as": f"phone_set in a manifest, --phone-set {path}",
        "phones": [
            {"class": name, "count": len(symbols), "symbols": " ".join(symbols)}
            for name, symbols in groups.items()
            if symbols
        ],
    }


def _describe_edits(path: str) -> dict[str, Any]:
    edits = read_edits(path)
    return {
        "content": "edit list",
        "recording": edits.recording,
        "sha256": edits.sha256,
        "edits": edits.to_dicts(),
    }


def _describe_rig(path: str) -> dict[str, Any]:
    from mocap_fit.face import load_face

    face = load_face(path)
    return {
        "content": "face",
        "vertices": len(face.mesh.vertices),
        "triangles": len(face.mesh.triangles),
        "parameters": list(face.parameter_names),
        "regions": sorted(face.mesh.regions),
        "feature_points": list(face.mesh.feature_points),
    }


def _describe_manifest(path: Path) -> dict[str, Any]:
    manifest, root = load_manifest(path), path.parent
    about: dict[str, Any] = {
        "content": "manifest",
        "language": manifest.language,
        "phone_set": manifest.phone_set,
        "layout": manifest.layout or "the one that fits the reference pose",
        "face": manifest.face,
        "synchronised": manifest.sync.kind,
        "start_time": manifest.start_time,
        "root": str(root),
    }
    references = [speaker.reference for speaker in manifest.speakers]
    references += [s.reference for s in manifest.sessions if s.reference is not None]
    lacking = [f"reference pose {r}" for r in references if not _has_file(root, r)]
    try:
        entries = list_entries(manifest, root)
    except MocapFitError as error:
        advice = "Convert it with --root, if its recordings are in another folder."
        return {**about, "utterances": 0, "lacking": [*lacking, f"{error}. {advice}"]}
    items, problems = find_files(manifest, entries, root)
    lacking += problems.values()
    return {
        **about,
        "utterances": len(entries),
        "convertible": len(items),
        "with_sound": sum(item.sound is not None for item in items),
        "with_edits": sum(item.edits is not None for item in items),
        "lacking": lacking[:_LISTED],
        "lacking_count": len(lacking),
        "used_as": f"mocap-fit convert {path} --out CORPUS",
        "speakers": [
            {"speaker": speaker, "session": session, "utterances": count}
            for (speaker, session), count in sorted(
                Counter((entry.speaker, entry.session) for entry in entries).items()
            )
        ],
        "splits": [
            {"split": split, "utterances": count}
            for split, count in sorted(Counter(entry.split for entry in entries).items())
        ],
    }


def _has_file(root: Path, pattern: str) -> bool:
    return find_one_file(root, str(parse_reference(pattern).path)) is not None


def describe_folder(folder: Path) -> dict[str, Any]:
    """Describe what a folder that is no corpus holds, and what can be done with it.

    Parameters
    ----------
    folder
        The folder.

    Returns
    -------
    dict[str, Any]
        ``content`` and counts.

    Raises
    ------
    ConfigurationError
        If it holds nothing that is known.
    """
    chosen, unknown = list_files(folder)
    groups, _ = group_files(chosen)
    settings = sorted(folder.glob("*.toml"))
    if not (groups or unknown or settings):
        raise ConfigurationError(
            "the folder holds nothing that is known",
            path=folder,
            expected="recordings, labels, sound, TOML files, or a corpus",
        )
    reference = find_one_file(folder, SpeakerEntry().reference)
    manifest = folder / _MANIFEST
    used = None
    if manifest.is_file():
        used = f"mocap-fit convert {folder} --out CORPUS"
    elif reference is not None and all((folder / n).is_dir() for n in ("recordings", "labels")):
        used = f"mocap-fit convert {folder} --phone-set NAME --out CORPUS"
    elif any(group.recordings for group in groups):
        used = f"mocap-fit fit {folder} --reference FILE --out FITS"
    return {
        "content": "folder",
        "recordings": sum(len(group.recordings) for group in groups),
        "labels": sum(len(group.labels) for group in groups),
        "sound": sum(len(group.sounds) for group in groups),
        "of_one_name": sum(bool(g.recordings and g.labels) for g in groups),
        "other_tables": len(unknown),
        "edit_lists": sum(1 for _ in folder.rglob(f"*{EDITS_ENDING}")),
        "reference": None if reference is None else reference.name,
        "manifest": manifest.name if manifest.is_file() else None,
        "layouts": [path.name for path in settings if is_layout(path)],
        "used_as": used,
    }


def describe_shipped() -> Mapping[str, Any]:
    """Describe what comes with the program, by the names that commands take.

    Returns
    -------
    Mapping[str, Any]
        ``content`` and records of layouts, phone sets, models, and the regions and feature points
        of the built-in face.
    """
    from mocap_fit.control import CONTROL_MODELS, list_live_models
    from mocap_fit.face import load_face

    live = list_live_models()
    mesh = load_face().mesh
    points: dict[str, list[str]] = {}
    for point in sorted(mesh.feature_points, key=lambda name: tuple(map(int, name.split(".")))):
        points.setdefault(point.partition(".")[0], []).append(point)
    return {
        "file": "shipped",
        "content": "what comes with mocap-fit",
        "regions": sorted(mesh.regions),
        "feature_points": [" ".join(group) for group in points.values()],
        "layouts": [
            {"name": name, "markers": len(layout.markers), "description": layout.description}
            for name in list_layouts()
            for layout in [load_layout(name)]
        ],
        "phone_sets": [
            {"name": name, "language": phones.language, "description": phones.description}
            for name in list_phone_sets()
            for phones in [load_phone_set(name)]
        ],
        "models": [_describe_model(name, name in live) for name in CONTROL_MODELS.names()],
    }


def _describe_model(name: str, live: bool) -> dict[str, Any]:
    from mocap_fit.control import create

    model = create(name)
    # Some know it when they are trained.
    ahead = getattr(model, "look_ahead", math.nan)
    return {
        "name": name,
        "live": live,
        "look_ahead": ahead if math.isfinite(ahead) else None,
        "description": (type(model).__doc__ or "").partition("\n")[0],
    }
