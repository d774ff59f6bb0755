"""``mocap-fit speak``: text, labels or tracks → a talking head."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from corpus_tools.talking import speak_models
from corpus_tools.talking.lips import list_events, measure_lips
from corpus_tools.talking.measured import (
    read_markers,
    read_parameters,
    read_phones_beside,
    read_pose,
)
from corpus_tools.tasks import TaskProgress, name_steps
from mocap_fit.atomic_file import check_existing, check_targets, make_folder
from mocap_fit.control import ControlModel
from mocap_fit.errors import ConfigurationError, DataError
from mocap_fit.face import load_face
from mocap_fit.face.contact import resolve_contact
from mocap_fit.face.lips import has_lip_line
from mocap_fit.face.rig import Rig
from mocap_fit.phones import PhoneSequence, PhoneSet, list_phone_sets, load_phone_set
from mocap_fit.processes import count_cores, limit_to_one_thread
from mocap_fit.sound import Sound, read_sound
from mocap_fit.tracks import ParameterTracks

if TYPE_CHECKING:
    from mocap_fit.evaluation import LipGaps
    from mocap_fit.render.framing import View

MEASURED = "measured"
# Frames a second of a page, hertz.
_PAGE_RATE = 60.0
# Number of frames that another process must draw to be worth its start.
_FRAMES_PER_PROCESS = 250


@dataclass(frozen=True)
class Source:
    """What is said: a text, a file of labels, measured tracks, or labels and tracks.

    Parameters
    ----------
    text
        A text, spoken by espeak-ng.
    labels
        A label file, or the phones of a corpus (Parquet).
    tracks
        Measured parameters (Parquet).
    sound
        The sound file of labels or tracks.
    language
        Language of the text, and of models that are named by their kind.
    phone_set
        Phone set of the labels; by default that of the first model.
    tier
        Tier of the phones in the label file.
    words_per_minute
        Speed of the text, words a minute.
    """

    text: str | None = None
    labels: Path | None = None
    tracks: Path | None = None
    sound: Path | None = None
    language: str = "en"
    phone_set: str | None = None
    tier: str | None = None
    words_per_minute: float = 160.0


@dataclass(frozen=True)
class Look:
    """What the movie looks like.

    Parameters
    ----------
    rate
        Frames per second, hertz.
    size
        Width and height of a head, pixels.
    views
        Where it is seen from: ``front``, ``three-quarter`` or ``side``, one picture each.
    zoom
        Magnification, no unit: 1 shows the head; above 1 comes closer to the mouth.
    subtitles
        Whether the phones are written under the heads.
    curves
        Whether curves of all parameters, or of those that are named, run along below.
    still
        Whether eyes do not blink and the head rests. With measured tracks that is always so.
    seed
        Seed of blinks and head motion: with the same one, all conditions of an experiment blink and
        nod alike.
    face
        ``built-in``, or a rig file.
    markers
        A recording whose markers are drawn.
    head
        The measured pose of the head (Parquet), as a corpus has it: the head moves so.
    reference
        The reference pose of the speaker, or ``FILE@START-END`` (seconds); with it markers and
        pose are brought to the face as `fit` does it, without it they must have its axes already.
    layout
        The marker layout of the recording; None for the one that fits.
    """

    rate: float = 25.0
    size: tuple[int, int] = (640, 640)
    views: tuple[View, ...] = ("front",)
    zoom: float = 1.0
    subtitles: bool = False
    curves: bool | tuple[str, ...] = False
    still: bool = False
    seed: int = 0
    face: str = "built-in"
    markers: Path | None = None
    head: Path | None = None
    reference: str | Path | None = None
    layout: str | None = None


@dataclass(frozen=True, eq=False)
class SpeakReport:
    """What a run of `speak` has made.

    Parameters
    ----------
    file
        The movie, the page, or the folder of pictures.
    frames
        Number of frames.
    rate
        Frames per second, hertz.
    duration
        Length, seconds.
    size
        Width and height, pixels; None for a page.
    sound
        Whether it has sound.
    phones
        What is said; empty where it is not known.
    heads
        One record per head: ``head`` and where its motion comes from.
    lips
        What the lips of each head do in the pictures, by label; empty where the phones are not
        known, or the face has no lip line. A bilabial whose gap is at most 0.5 mm is closed.
    """

    file: Path
    frames: int
    rate: float
    duration: float
    size: tuple[int, int] | None
    sound: bool
    phones: tuple[str, ...]
    heads: tuple[dict[str, Any], ...]
    lips: Mapping[str, LipGaps] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON can hold it.

        Returns
        -------
        dict[str, Any]
            The fields; the lips as lists of phones with times, ``gap`` in millimetres, and whether
            they are closed, or touch the teeth.
        """
        return {**vars(self), "lips": {name: list_events(each) for name, each in self.lips.items()}}

    def __repr__(self) -> str:
        return f"SpeakReport({self.frames} frames, {self.duration:.2f} s, file={self.file})"


@dataclass
class _Speech:
    """What there is to hear and to move."""

    phones: PhoneSequence | None = None
    sound: Sound | None = None
    heads: dict[str, ParameterTracks] = field(default_factory=dict)
    about: list[dict[str, Any]] = field(default_factory=list)


@limit_to_one_thread()
def speak(
    source: str | Source,
    out: str | os.PathLike[str],
    *,
    models: Sequence[str] = (),
    look: Look | None = None,
    nearest: bool = False,
    articulation: float = 1.0,
    keep: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    jobs: int = 1,
    progress: TaskProgress | None = None,
) -> SpeakReport:
    """Make a movie of a talking head, or a web page with it.

    Parameters
    ----------
    source
        What is said: an English text, or a `Source`.
    out
        ``.mp4``, ``.gif``, ``.html``, or a name without an ending for a folder of PNG pictures.
    models
        Files or names of control models, one head each. By default a text, or labels without
        tracks, are spoken by the default model, and tracks by themselves.
    look
        What the movie looks like.
    nearest
        Whether models speak phones of another set by the nearest sounds that they know.
    articulation
        Factor of the movements about rest, no unit: 1.3 is clear speech. Lips close anyway.
    keep
        A folder for what was synthesised: tracks, labels, sound.
    overwrite
        Whether labels and Parquet files of other programs are replaced in that folder.
    jobs
        Number of processes that draw; 0 for as many as are worth it.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    SpeakReport
        The movie, or the page.

    Raises
    ------
    MocapFitError
        If something is wrong; nothing is written then.
    """
    from mocap_fit.render import render_movie, write_page
    from mocap_fit.render.movie_file import find_ffmpeg, get_movie_kind
    from mocap_fit.synthesis.espeak_voices import find_language

    look = Look() if look is None else look
    file = Path(out)
    # What is missing is reported before long work begins.
    is_page = file.suffix.lower() == ".html"
    if is_page:
        look = dataclasses.replace(look, rate=_PAGE_RATE)
    elif get_movie_kind(file) != "png":
        find_ffmpeg()
    rig = load_face(look.face, tongue=None)
    wanted = Source(source) if isinstance(source, str) else source
    wanted = dataclasses.replace(wanted, language=find_language(wanted.language))
    read = [wanted.labels, wanted.tracks, wanted.sound, wanted.phone_set, *models]
    read += [look.markers, look.head, look.reference, look.layout, look.face]
    check_targets([file], read)
    with ThreadPoolExecutor(1) as beside:
        # What drawing needs once, and compiles when it is the first time on a machine.
        beside.submit(resolve_contact, rig.mesh.vertices, rig.mesh)
        speech, chosen = _collect(wanted, list(models), rig, progress)
    start, end = _find_extent(speech, with_phones=bool(chosen))
    frames = max(math.ceil((end - start) * look.rate - 1e-6), 1)
    # Models are predicted for the middle of the time that a picture is seen.
    first = start + 0.5 / look.rate
    # A face that does not say where its lips are moves as the model says.
    face = rig if has_lip_line(rig.mesh) else None
    how = {"nearest": nearest, "face": face, "articulation": articulation}
    _predict(speech, chosen, look.rate, {**how, "start_time": first, "frames": frames})
    markers = None if look.markers is None else read_markers(look, speech.heads.get(MEASURED))
    # Beside what was measured nothing is drawn at random.
    is_alive = not look.still and wanted.tracks is None
    if keep is not None:
        _save(speech, Path(keep), read, overwrite=overwrite)
    make_folder(file.parent)
    life: dict[str, Any] = {
        "blinks": is_alive,
        "head_motion": is_alive if look.head is None else read_pose(look),
        "seed": look.seed,
        "extent": (start, end),
        "progress": name_steps(progress, "drawing frames"),
    }
    size: tuple[int, int] | None = None
    if is_page:
        page = write_page(
            file,
            rig,
            speech.heads,
            title=wanted.text or file.stem,
            notes=[str(about.get("about") or about["head"]) for about in speech.about],
            sound=speech.sound,
            phones=speech.phones,
            markers={} if markers is None else {"markers": markers},
            **life,
        )
        frames, sound = page.frames, page.with_sound
    else:
        pictures = frames * len(speech.heads) * len(look.views)
        movie = render_movie(
            speech.heads if len(speech.heads) > 1 else next(iter(speech.heads.values())),
            file,
            face=rig,
            sound=speech.sound,
            rate=look.rate,
            size=look.size,
            view=look.views,
            zoom=look.zoom,
            phones=speech.phones,
            subtitles=look.subtitles,
            curves=look.curves,
            markers=markers,
            jobs=jobs or min(count_cores(), 1 + pictures // _FRAMES_PER_PROCESS),
            **life,
        )
        frames, size, sound = movie.frames, movie.size, movie.with_sound
    return SpeakReport(
        file,
        frames,
        look.rate,
        frames / look.rate,
        size,
        sound,
        () if speech.phones is None else tuple(speech.phones.phones),
        tuple(speech.about),
        measure_lips(speech.heads, speech.phones, rig, first, frames, look.rate),
    )


def _collect(
    source: Source, models: list[str], rig: Rig, progress: TaskProgress | None
) -> tuple[_Speech, list[ControlModel]]:
    """Return what there is to hear and to move, and the models that are to move it."""
    from mocap_fit.render.movie import MAX_DURATION

    speech = _Speech()
    if source.tracks is not None:
        speech.heads[MEASURED] = read_parameters(source.tracks)
        speech.about.append({"head": MEASURED, "tracks": source.tracks})
    if source.sound is not None:
        speech.sound = read_sound(source.sound)
    if source.text is None and source.labels is None:
        if models:
            raise ConfigurationError(
                "a model needs to know what is said", advice="Give the labels too (--labels)."
            )
        if source.tracks is not None:
            speech.phones = read_phones_beside(source.tracks)
        return speech, []
    if not models and source.tracks is None:
        models = [speak_models.choose_default(source.language)]
    names, phone_set = rig.parameter_names, _choose_phone_set(source)
    chosen = [
        speak_models.find_model(name, source.language, phone_set, names, progress=progress)
        for name in models
    ]
    if source.text is not None:
        speech.phones, speech.sound = _speak_text(source, chosen)
    else:
        speech.phones = _read_labels(source, chosen)
        # Before the frames of a wrong time fill the memory.
        if speech.phones and speech.phones[-1].end > MAX_DURATION:
            raise DataError(
                "the labels last longer than a movie may",
                path=source.labels,
                found=f"{speech.phones[-1].end:g} s",
                expected=f"at most {MAX_DURATION:g} s",
                advice="Check their times, or give a part of them.",
            )
    return speech, chosen


def _find_extent(speech: _Speech, *, with_phones: bool) -> tuple[float, float]:
    """Return start and end of all that is heard and moves, seconds."""
    starts = [head.start_time for head in speech.heads.values()]
    ends = [head.start_time + head.duration for head in speech.heads.values()]
    if with_phones and speech.phones:
        starts.append(speech.phones[0].start)
        ends.append(speech.phones[-1].end)
    if speech.sound is None:
        return min(starts), max(ends)
    return 0.0, max(*ends, speech.sound.duration)


def _choose_phone_set(source: Source) -> PhoneSet:
    """Return the phone set of what is said, as far as it is known beforehand."""
    from mocap_fit.synthesis.espeak_voices import find_voice

    if source.phone_set is not None:
        is_shipped = source.phone_set in list_phone_sets()
        return load_phone_set(source.phone_set if is_shipped else Path(source.phone_set))
    return load_phone_set(find_voice(source.language).phone_set)


def _speak_text(source: Source, models: Sequence[ControlModel]) -> tuple[PhoneSequence, Sound]:
    """Speak a text, in the phone set of the models where that is of its language."""
    from mocap_fit.synthesis import speak_text

    phone_set = _choose_phone_set(source)
    first = models[0].phone_set_ if models else phone_set
    if first.language and first.language == phone_set.language:
        phone_set = first
    speed = source.words_per_minute
    spoken = speak_text(
        source.text or "", source.language, phone_set=phone_set, words_per_minute=speed
    )
    return spoken.phones.replace(phone_set=phone_set.name), spoken.sound


def _read_labels(source: Source, models: Sequence[ControlModel]) -> PhoneSequence:
    from mocap_fit.labels import read_phones
    from mocap_fit.phones import read_stored_phones

    assert source.labels is not None
    if source.labels.suffix == ".parquet":
        return read_stored_phones(source.labels)
    known = source.phone_set is not None or not models
    chosen = _choose_phone_set(source) if known else models[0].phone_set_
    phones = read_phones(source.labels, tier=source.tier, phone_set=chosen)
    return phones.replace(phone_set=chosen.name)


def _predict(
    speech: _Speech, models: Sequence[ControlModel], rate: float, how: dict[str, Any]
) -> None:
    """Add a head for every model."""
    from mocap_fit.synthesis import synthesise

    titles = [model.title for model in models]
    for model in models:
        # Two of a kind are distinguished by what they were trained on.
        label = model.title
        if titles.count(label) > 1:
            label += f" ({model.trained_on_.get('corpus') or model.phone_set_.name})"
        while label in speech.heads:
            label += " again"
        assert speech.phones is not None
        speech.heads[label] = synthesise(speech.phones, model, rate, **how)
        about = {"about": speak_models.describe_model(model), "trained_on": model.trained_on_}
        speech.about.append({"head": label, "model": model.name, **about})


def _save(
    speech: _Speech, folder: Path, read: Sequence[str | Path | None], *, overwrite: bool
) -> None:
    """Write what was synthesised, but not over what was read or is not ours."""
    from mocap_fit.labels import to_labels, write_labels
    from mocap_fit.sound import write_sound
    from mocap_fit.tracks import write_parquet
    from mocap_fit.tracks.parquet_file import is_foreign_table

    heads = {
        "".join(c if c.isalnum() else "-" for c in label.casefold()).strip("-"): head
        for label, head in speech.heads.items()
    }
    labels, sound = folder / "phones.TextGrid", folder / "sound.wav"
    tables = [folder / f"{name}.parquet" for name in heads]
    check_targets([*tables, labels, sound], read)
    check_existing(filter(is_foreign_table, tables), "tables", overwrite=overwrite)
    if speech.phones is not None:
        check_existing([labels], "labels", overwrite=overwrite)
    make_folder(folder)
    for name, head in heads.items():
        write_parquet(head.replace(name=name), folder / f"{name}.parquet")
    if speech.phones is not None:
        write_labels(to_labels(speech.phones), labels)
    if speech.sound is not None:
        write_sound(speech.sound, sound)
