"""A talking head as one web page, with sound, curves and labels: no network, no server.

The page is one file. The head is drawn in it by WebGL 2, from main shapes in 16 bits and a weight
for each in every frame; the light is that of the movie. Arrays are compressed and written as text
(base64) into one JSON record, which the scripts in ``page_files`` unpack.
"""

from __future__ import annotations

import base64
import html
import io
import json
import os
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocap_fit.atomic_file import write_text
from mocap_fit.drawing import CYCLE
from mocap_fit.errors import DataError, FileFormatError
from mocap_fit.face.mesh import IndexArray, Mesh
from mocap_fit.face.rig import Rig
from mocap_fit.phones import PhoneSequence
from mocap_fit.render.framing import DIRECTIONS, frame_face
from mocap_fit.render.lighting import Lighting
from mocap_fit.render.liveliness import LivelyFace, plan_liveliness
from mocap_fit.render.main_shapes import (
    MainShapes,
    MainShapesBuilder,
    Quantised,
    Single,
    quantise,
)
from mocap_fit.render.movie_file import cut_sound
from mocap_fit.render.running_strip import select_moving
from mocap_fit.render.sampling import sample_parameters
from mocap_fit.render.scene import find_fading, list_outside_triangles
from mocap_fit.render.talking import deform_face
from mocap_fit.sound import Sound, resample
from mocap_fit.tracks import FloatArray, MarkerTracks, ParameterTracks, PoseTracks

# Frames a second that the head is drawn for at most, and curves that are shown at first.
_MAX_RATE = 60.0
_CURVES = 6
# Frames that the first shapes are computed from, and frames that are worked on at once; how far a
# vertex may be from where it should be, millimetres, and its light, 0 to 1.
_SAMPLED, _AT_ONCE = 160, 32
_MOVEMENT_TOLERANCE, _LIGHT_TOLERANCE = 0.04, 0.05
# Millimetres: what contact moves is rounded to these.
_CONTACT_STEP = 0.04
# Seconds: what is longer is more than a browser holds.
_MAX_DURATION = 300.0
# Rates that browsers play, and the step of the waveform, seconds.
_SOUND_RATES = (8000.0, 48000.0)
_WAVEFORM_STEP = 0.002
_SCRIPTS = ("unpack.js", "head.js", "strip.js", "page.js")
# Codes in 16 bits: the largest negative number is a gap.
_GAP = -32768


@dataclass(frozen=True)
class Mark:
    """Something that is marked in time, such as a finding.

    Parameters
    ----------
    text
        What it is.
    start
        Start, seconds.
    end
        End, seconds; that of the start where it is a moment.
    severity
        ``error``, ``warning`` or ``note``.
    """

    text: str
    start: float
    end: float
    severity: str = "note"


@dataclass(frozen=True)
class Page:
    """A page that has been written.

    Parameters
    ----------
    path
        The file.
    size
        Its size, bytes.
    duration
        How long it plays, seconds.
    rate
        Frames a second, hertz.
    frames
        Number of frames.
    shapes
        Number of shapes that the heads are blended of.
    largest_error
        What the distance of any vertex from the rig is at most in any frame, millimetres.
    with_sound
        Whether it has sound.
    """

    path: Path
    size: int
    duration: float
    rate: float
    frames: int
    shapes: int
    largest_error: float
    with_sound: bool


def write_page(
    path: str | os.PathLike[str],
    rig: Rig | None,
    heads: Mapping[str, ParameterTracks],
    *,
    title: str = "",
    notes: Sequence[str] = (),
    sound: Sound | None = None,
    phones: PhoneSequence | None = None,
    markers: Mapping[str, MarkerTracks] | None = None,
    virtual: Mapping[str, MarkerTracks] | None = None,
    marks: Sequence[Mark] = (),
    extent: tuple[float, float] | None = None,
    blinks: bool = False,
    head_motion: bool | PoseTracks = False,
    seed: int = 0,
    progress: Callable[[int, int], object] | None = None,
) -> Page:
    """Write a page on which a face moves as tracks say, with all that belongs to them.

    Parameters
    ----------
    path
        A name in ``.html``; an existing file is replaced.
    rig
        The face of all heads; None where only markers are shown.
    heads
        Face parameters by their labels, such as ``measured`` and the names of models; where there
        are none the face is at rest.
    title
        Title of the page.
    notes
        Lines below the title.
    sound
        Sound on the clock of the tracks: it begins at 0 s.
    phones
        The phones of what is said; where the face has parameters of the tongue that the tracks
        lack, it moves by them.
    markers
        Markers in the coordinates of the face by their labels, such as ``measured``.
    virtual
        Markers as each head has them, by the labels of the heads; a line joins each with the first
        of the markers that has its name.
    marks
        What is marked in time.
    extent
        Start and end of the page, seconds; by default all of tracks, markers and sound.
    blinks
        Whether blinks are added, drawn at random from the seed.
    head_motion
        Whether head motion is added, drawn at random from the seed; or the pose of a head that was
        measured, in the axes of the face, whose motion about its mean is added.
    seed
        Another seed draws other blinks and head motion.
    progress
        Called now and then with the number of frames of all heads that are done, and of all.

    Returns
    -------
    Page
        The page that was written.

    Raises
    ------
    ConfigurationError
        If the face cannot blink.
    DataError
        If a track does not belong to the face, the page would last longer than five minutes, or
        there is nothing to show.
    FileFormatError
        If the name does not end in ``.html``, or the file cannot be written.
    """
    if Path(path).suffix.lower() != ".html":
        raise FileFormatError("pages are written as HTML", path=path, expected="a name in .html")
    # What every head has, and what is of one head alone.
    labels = list(heads)
    points: list[tuple[str, int | None, MarkerTracks]]
    points = [(label, None, each) for label, each in (markers or {}).items()]
    points += [("virtual", labels.index(label), each) for label, each in (virtual or {}).items()]
    if rig is None and not points:
        raise DataError("there is neither a face nor a marker to show")
    tracks: list[ParameterTracks | MarkerTracks]
    tracks = [*heads.values(), *(each for *_, each in points)]
    start, end = _find_extent(tracks, sound, extent)
    rate = min(max((each.rate for each in tracks), default=_MAX_RATE), _MAX_RATE)
    # Frames of the page are those of the first track where they have one rate.
    first = start
    if tracks:
        first += (tracks[0].start_time - start) % (1.0 / rate)
    count = max(int((end - first) * rate + 1e-6) + (end == start), 1)
    times: FloatArray = first + np.arange(count, dtype=np.float64) / rate
    if sound is not None:
        sound = cut_sound(sound, start, max(end, start + 1.0 / rate))
    record: dict[str, Any] = {
        "title": title or "Talking head",
        "notes": list(notes),
        "start": start,
        "end": end,
        "first": first,
        "rate": rate,
        "frames": count,
        "colours": CYCLE,
        "views": DIRECTIONS,
        "curves": list(select_moving(list(heads.values()), _CURVES)),
        "phones": [
            [p.start, p.end, p.phone, p.word]
            for p in phones or ()
            if p.end > start and p.start < end
        ],
        "marks": [vars(mark) for mark in marks if mark.end >= start and mark.start <= end],
        "tracks": [_to_track(label, head, start, end) for label, head in heads.items()],
        "sound": None if sound is None else _to_sound(sound),
    }
    positions = [np.asarray(each.at(times)) for *_, each in points]
    movement: MainShapes | None = None
    largest_error = 0.0
    if rig is not None:
        values = [sample_parameters(head, times, rig, phones) for head in heads.values()]
        values = values or [np.zeros((count, len(rig.parameter_names)))]
        life = plan_liveliness(times, rig.mesh, blinks=blinks, head_motion=head_motion, seed=seed)
        lively = LivelyFace(rig.mesh, blinks=blinks)
        # The page moves the head itself: turning every vertex would take many shapes.
        still = replace(life, turns=np.zeros_like(life.turns), shifts=np.zeros_like(life.shifts))

        def get_vertices(number: int, contact: bool) -> FloatArray:
            head, frame = divmod(number, count)
            parameters = values[head][frame]
            return deform_face(rig, lively, parameters, still, frame, contact=contact)

        lighting = Lighting(rig.mesh)
        total = count * len(values)
        movement, light, contact = _compute_shapes(get_vertices, lighting, total, progress)
        record["mesh"] = _to_mesh(rig.mesh, lighting, movement, light) | {"contact": contact}
        largest_error = movement.largest_error + 0.5 * float(np.sqrt(3.0)) * _CONTACT_STEP
        record["mesh"]["neck"] = {
            **lively.describe(),
            "turns": _pack(life.turns, "float32"),
            "shifts": _pack(life.shifts, "float32"),
        }
        for index, each in enumerate(positions):
            moves = zip(each, life.turns, life.shifts, strict=True)
            positions[index] = np.stack([lively.carry(*move) for move in moves])
    record["markers"] = [
        {"label": label, "head": head, "names": marked.names, "positions": _pack_positions(each)}
        for (label, head, marked), each in zip(points, positions, strict=True)
    ]
    write_text(path, _format_page(record), "page")
    return Page(
        Path(path),
        Path(path).stat().st_size,
        end - start,
        rate,
        count,
        0 if movement is None else len(movement.shapes.steps),
        largest_error,
        sound is not None,
    )


def _compute_shapes(
    get_vertices: Callable[[int, bool], FloatArray],
    lighting: Lighting,
    frames: int,
    progress: Callable[[int, int], object] | None,
) -> tuple[MainShapes, MainShapes, dict[str, Any]]:
    """Return the main shapes of a movement and of its light, and what contact moves besides.

    Contact moves few vertices, suddenly, each in its way: no few shapes would do for it.
    """

    def list_frames(numbers: Sequence[int]) -> tuple[FloatArray, Single, FloatArray]:
        smooth = np.stack([get_vertices(number, False) for number in numbers])
        drawn = np.stack([get_vertices(number, True) for number in numbers])
        reaching = np.stack([lighting.compute_reaching(each) for each in drawn])
        return smooth, reaching, drawn - smooth

    sampled = np.unique(np.linspace(0, frames - 1, min(frames, _SAMPLED)).round().astype(int))
    smooth, reaching, _ = list_frames(sampled.tolist())
    movement = MainShapesBuilder(smooth, _MOVEMENT_TOLERANCE)
    light = MainShapesBuilder(reaching, _LIGHT_TOLERANCE, bits=8)
    touching: list[tuple[IndexArray, NDArray[np.int16]]] = []
    for first in range(0, frames, _AT_ONCE):
        numbers = range(first, min(first + _AT_ONCE, frames))
        smooth, reaching, moved = list_frames(numbers)
        movement.add(smooth)
        light.add(reaching)
        steps = np.rint(moved / _CONTACT_STEP).astype(np.int16)
        ids = np.flatnonzero(steps.any(axis=(0, 2)))
        touching.append((ids, steps[:, ids]))
        if progress is not None:
            progress(numbers.stop, frames)
    every = np.unique(np.concatenate([ids for ids, _ in touching]))
    contact = np.zeros((frames, len(every), 3), dtype=np.int16)
    for number, (ids, steps) in enumerate(touching):
        rows = slice(number * _AT_ONCE, number * _AT_ONCE + len(steps))
        contact[rows, np.searchsorted(every, ids)] = steps
    # From frame to frame there are fewer different numbers.
    changes = np.diff(contact, axis=0, prepend=np.int16(0))
    packed = {"vertices": _pack(every, "int32"), "moves": _pack(changes, "int16", _CONTACT_STEP)}
    return movement.build(), light.build(), packed


def _find_extent(
    tracks: Sequence[ParameterTracks | MarkerTracks],
    sound: Sound | None,
    extent: tuple[float, float] | None,
) -> tuple[float, float]:
    starts = [each.start_time for each in tracks]
    ends = [each.start_time + each.duration for each in tracks]
    if sound is not None:
        starts, ends = [0.0], [*ends, sound.duration]
    start, end = extent or (min(starts, default=0.0), max(ends, default=0.0))
    if end - start > _MAX_DURATION:
        raise DataError(
            "the page would last longer than a browser can hold",
            found=f"{end - start:.0f} s",
            expected=f"at most {_MAX_DURATION:g} s",
            advice="Take a part of it (--between, extent).",
        )
    return start, end


def _pack(values: Any, kind: str, scale: float | None = None) -> dict[str, Any]:
    """Return an array as JSON has it: little-endian, compressed, as text."""
    array = np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<"))
    packed = base64.b64encode(zlib.compress(array.tobytes(), 9)).decode()
    return {"packed": packed, "kind": kind, "shape": array.shape, "scale": scale}


def _pack_quantised(values: Quantised) -> dict[str, Any]:
    return _pack(values.steps, str(values.steps.dtype), values.scale)


def _to_track(label: str, tracks: ParameterTracks, start: float, end: float) -> dict[str, Any]:
    times = tracks.times
    part = slice(*np.searchsorted(times, [start - 1 / tracks.rate, end + 1 / tracks.rate]))
    deviations, residuals = tracks.standard_deviations[part], tracks.residuals[part]
    return {
        "label": label,
        "names": tracks.names,
        "rate": tracks.rate,
        "start": float(times[part.start]) if part.stop > part.start else start,
        "values": _pack(tracks.values[part], "float32"),
        "deviations": _pack(deviations, "float32") if np.isfinite(deviations).any() else None,
        "residuals": _pack(residuals, "float32") if np.isfinite(residuals).any() else None,
    }


def _pack_positions(positions: FloatArray) -> dict[str, Any]:
    missing = np.isnan(positions)
    rounded = quantise(np.where(missing, 0.0, positions))
    return _pack(np.where(missing, _GAP, rounded.steps), "int16", rounded.scale)


def _to_sound(sound: Sound) -> dict[str, Any]:
    """Return the sound as FLAC, which all browsers play, and its waveform."""
    import soundfile

    samples, rate = sound.samples.mean(axis=1), sound.rate
    chosen = min(max(round(rate), _SOUND_RATES[0]), _SOUND_RATES[1])
    if chosen != rate:
        samples = resample(samples[:, None], rate, chosen)[:, 0]
    file = io.BytesIO()
    soundfile.write(file, np.clip(samples, -1.0, 1.0), int(chosen), "PCM_16", format="FLAC")
    step = max(round(_WAVEFORM_STEP * chosen), 1)
    padded = np.pad(samples, (0, -len(samples) % step)).reshape(-1, step)
    peaks = np.stack([padded.min(axis=1), padded.max(axis=1)], axis=1)
    largest = float(np.abs(peaks).max(initial=0.0)) or 1.0
    return {
        "type": "audio/flac",
        "content": base64.b64encode(file.getvalue()).decode(),
        "step": step / chosen,
        "peaks": _pack(np.rint(127 * peaks / largest), "int8"),
    }


def _to_mesh(
    mesh: Mesh, lighting: Lighting, movement: MainShapes, light: MainShapes
) -> dict[str, Any]:
    looks = {
        name: _pack(values, str(values.dtype)) if isinstance(values, np.ndarray) else values
        for name, values in lighting.describe().items()
    }
    camera = frame_face(mesh)
    across = mesh.vertices[mesh.vertices[:, 1] > camera.target[1], 0]
    triangles, count = list_outside_triangles(mesh)
    faded, share = find_fading(mesh)
    fading = np.zeros(len(mesh.vertices))
    fading[faded] = 255 * share[:, 0]
    return {
        "looks": {**looks, "fading": _pack(np.rint(fading), "uint8")},
        # Those that are doubled, with the other side in front, come last.
        "surface": count,
        "triangles": _pack(triangles, "uint16" if len(mesh.vertices) < 65536 else "uint32"),
        "centre": camera.target.tolist(),
        "distance": float(np.linalg.norm(camera.position - camera.target)),
        "width": float(np.ptp(across)),
        "lip": mesh.feature_points.get("2.2"),
        "movement": _to_shapes(movement),
        "light": _to_shapes(light),
    }


def _to_shapes(shapes: MainShapes) -> dict[str, Any]:
    return {
        "middle": _pack_quantised(shapes.middle),
        "shapes": _pack_quantised(shapes.shapes),
        "weights": _pack(shapes.weights, "float32"),
    }


def _format_page(record: Mapping[str, Any]) -> str:
    folder = resources.files(__package__).joinpath("page_files")

    def read(name: str) -> str:
        return folder.joinpath(name).read_text("utf-8")

    # No text of a label can end the script.
    data = json.dumps(record, separators=(",", ":")).replace("<", "\\u003c")
    parts = {
        "TITLE": html.escape(str(record["title"])),
        "STYLE": read("page.css"),
        "SCRIPT": "\n".join(read(name) for name in _SCRIPTS),
        "DATA": data,
    }
    page = read("page.html")
    before, *rest = page.split("{{")
    pieces = [before]
    for piece in rest:
        name, _, after = piece.partition("}}")
        pieces += [parts[name], after]
    return "".join(pieces)
