"""What was gathered as one web page, alone or with something that it is compared with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from corpus_tools.inspection.material import Material, Path_, list_marks
from corpus_tools.talking.speak_models import find_model
from corpus_tools.tasks import TaskProgress, name_steps
from corpus_tools.validation.findings import Finding
from mocap_fit.errors import ConfigurationError
from mocap_fit.phones import load_phone_set
from mocap_fit.render.page import Mark, Page, write_page
from mocap_fit.tracks import MarkerTracks, ParameterTracks


def predict_beside(
    material: Material, models: Sequence[str], progress: TaskProgress | None = None
) -> Material:
    """Add what control models say of the phones.

    Parameters
    ----------
    material
        What is shown; its phones are needed.
    models
        Files or names of control models.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    Material
        With a head for each model, by its title.

    Raises
    ------
    ConfigurationError
        If the phones are not known.
    MocapFitError
        If a model cannot be read, or does not know the phones.
    """
    phones = material.phones
    if not models:
        return material
    if not phones:
        raise ConfigurationError(
            "a model needs to know what is said",
            path=material.path,
            advice="Give the labels too (--labels).",
        )
    phone_set = load_phone_set(phones.phone_set)
    heads = dict(material.heads)
    first = next(iter(heads.values()), None)
    names = () if material.rig is None else material.rig.parameter_names
    for name in models:
        model = find_model(name, phone_set.language, phone_set, names, progress=progress)
        if first is None:
            tracks = model.predict(phones)
        else:
            tracks = model.predict(
                phones, first.rate, start_time=first.start_time, frames=first.frames
            )
        label = model.title
        while label in heads:
            label += " again"
        heads[label] = tracks
    return material.replace(heads=heads)


def write_material(
    material: Material,
    path: Path_,
    other: Material | None = None,
    between: tuple[float, float] | None = None,
    progress: TaskProgress | None = None,
) -> Page:
    """Write a page with all that was gathered.

    Parameters
    ----------
    material
        What is shown.
    path
        A name in ``.html``; an existing file is replaced.
    other
        What is shown beside it: its heads, and its markers.
    between
        Start and end of the part that is shown, seconds; all by default.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    Page
        The page that was written.

    Raises
    ------
    MocapFitError
        If there is nothing to show, the two do not have one face, or the file cannot be written.
    """
    shown = [material] if other is None else [material, other]
    rig = next((each.rig for each in shown if each.rig is not None), None)
    names = _name_each(shown)
    heads: dict[str, ParameterTracks] = {}
    for each, name in zip(shown, names, strict=True):
        for label, tracks in each.heads.items():
            if other is not None:
                label = name if len(each.heads) == 1 else f"{name}: {label}"
            heads[label] = tracks
    part = "recording" if rig is None else "measured"
    tracks_of = {name: getattr(each, part) for each, name in zip(shown, names, strict=True)}
    markers = {name: tracks for name, tracks in tracks_of.items() if tracks is not None}
    if not markers:
        markers = _place_layout(material)
    # Two recordings are compared with each other, all heads of one with it.
    virtual = {}
    if rig is not None and len({id(tracks) for tracks in tracks_of.values()}) == 1:
        virtual = _compute_virtual(material.replace(rig=rig, heads=heads))
    if virtual and material.measured is not None:
        markers = {"measured": material.measured}
    moves = bool(heads) or any(each.tracks for each in shown)
    sound, phones = (
        next((value for each in shown if (value := getattr(each, part)) is not None), None)
        for part in ("sound", "phones")
    )
    start = min(each.extent[0] for each in shown)
    end = max(each.extent[1] for each in shown)
    return write_page(
        path,
        rig,
        heads,
        title=" and ".join(each.title for each in shown),
        notes=[*material.notes, *_describe(material)],
        sound=sound,
        phones=phones,
        markers=markers,
        virtual=virtual,
        marks=[_to_mark(*mark) for mark in list_marks(material.findings, material.rate)],
        extent=between or ((start, end) if moves else (0.0, 0.0)),
        progress=name_steps(progress, "drawing frames"),
    )


def _name_each(shown: Sequence[Material]) -> list[str]:
    """Return the titles, with the folders where two are the same."""
    titles = [each.title for each in shown]
    if len(set(titles)) == len(titles):
        return titles
    return [f"{each.path.absolute().parent.name}/{each.title}" for each in shown]


def _compute_virtual(material: Material) -> dict[str, MarkerTracks]:
    """Return the markers as each head has them, at the times of the measured ones."""
    measured, speaker = material.measured, material.speaker
    if measured is None or speaker is None:
        return {}
    virtual = {}
    for label in material.heads:
        positions = material.compute_virtual(label, measured.times)
        if positions is not None:
            names = speaker.binding.names
            virtual[label] = measured.replace(names=names, positions=positions, origin=None)
    return virtual


def _place_layout(material: Material) -> dict[str, MarkerTracks]:
    """Return the markers of a layout on the face at rest."""
    if material.layout is None or material.rig is None or material.heads:
        return {}
    mesh, offset = material.rig.mesh, material.layout.marker_offset
    normals = mesh.compute_normals()
    positions = {}
    for marker in material.layout.markers:
        if marker.position is not None:
            positions[marker.name] = np.array(marker.position)
        elif marker.feature_point is not None:
            vertex = mesh.get_feature_point(marker.feature_point)
            positions[marker.name] = mesh.vertices[vertex] + offset * normals[vertex]
    if not positions:
        return {}
    return {"layout": MarkerTracks(tuple(positions), 1.0, np.array([list(positions.values())]))}


def _describe(material: Material) -> list[str]:
    facts = []
    tracks = material.tracks
    if tracks:
        start, end = material.extent
        facts.append(f"{end - start:.2f} s at {material.rate:.4g} Hz")
    if material.layout is not None:
        facts.append(f"layout {material.layout.name}, {len(material.layout.markers)} markers")
    if material.heads:
        residuals = next(iter(material.heads.values())).residuals
        if np.isfinite(residuals).any():
            facts.append(f"residual {np.nanmedian(residuals):.2f} mm (median)")
    return facts


def _to_mark(start: float, end: float, finding: Finding) -> Mark:
    item = f" {finding.location.item}" if finding.location.item else ""
    text = f"{finding.code} {finding.title}:{item} ({finding.found})"
    return Mark(text, start, end, finding.severity.value)
