"""``mocap-fit speak``: text, labels or tracks → a talking head."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from corpus_tools.cli import console
from corpus_tools.cli.console import Status
from corpus_tools.talking import speak_models
from mocap_fit.atomic_file import make_folder
from mocap_fit.control import ControlModel
from mocap_fit.errors import ConfigurationError, FileFormatError
from mocap_fit.face import load_face
from mocap_fit.face.rig import Rig
from mocap_fit.phones import PhoneSequence, PhoneSet, list_phone_sets, load_phone_set
from mocap_fit.processes import count_cores
from mocap_fit.sound import Sound, read_sound
from mocap_fit.tracks import MarkerTracks, ParameterTracks

if TYPE_CHECKING:
    from mocap_fit.evaluation import Evaluation

DEFAULT_MODEL = "cohen-massaro"
MEASURED = "measured"
# So many frames are drawn before another process pays.
_FRAMES_A_PROCESS = 250


@dataclass(frozen=True)
class Source:
    """What is said: a text, a file of labels, measured tracks, or labels and tracks.

    Parameters
    ----------
    text
        Spoken by espeak-ng.
    labels
        A label file, or the phones of a corpus (Parquet).
    tracks
        Measured parameters (Parquet).
    sound
        The wav file that goes with labels or tracks.
    language
        Of the text, and of the models that are kept.
    phone_set
        What the labels are written in; the first model's where not given.
    tier
        Of the phones in the label file.
    words_per_minute
        How fast the text is spoken.
    """

    text: str | None = None
    labels: Path | None = None
    tracks: Path | None = None
    sound: Path | None = None
    language: str = ""
    phone_set: str | None = None
    tier: str | None = None
    words_per_minute: float = 160.0


@dataclass(frozen=True)
class Look:
    """What the movie looks like; see `mocap_fit.render.render_movie`.

    `markers` is a recording. With `reference`, the reference pose of its speaker, and the `layout`
    it is brought onto the face as `mocap-fit fit` does it; without, it must lie there already.
    """

    rate: float = 25.0
    size: tuple[int, int] = (640, 640)
    views: tuple[str, ...] = ("front",)
    zoom: float = 1.3
    subtitles: bool = False
    curves: bool | tuple[str, ...] = False
    blinks: bool = False
    head_motion: bool = False
    seed: int = 0
    face: str = "built-in"
    markers: Path | None = None
    reference: Path | None = None
    layout: str | None = None


@dataclass
class _Said:
    """What there is to hear and to move."""

    phones: PhoneSequence | None = None
    sound: Sound | None = None
    heads: dict[str, ParameterTracks] = field(default_factory=dict)
    about: list[dict[str, Any]] = field(default_factory=list)


def run(
    source: Source,
    out: Path,
    *,
    models: Sequence[str] = (),
    look: Look | None = None,
    nearest: bool = False,
    keep: Path | None = None,
    jobs: int = 1,
    as_json: bool = False,
) -> Status:
    """Make a talking head say something.

    Parameters
    ----------
    source
        What.
    out
        ``.mp4``, ``.gif``, or a name without an ending for a folder of PNG pictures.
    models
        Files or kinds of control models, a head each. None: the default one for a text or for
        labels without tracks; no model for tracks.
    look
        What the movie looks like.
    nearest
        Let models speak phones of another set, by the nearest sounds that they know.
    keep
        A folder for what was synthesised: tracks, labels, sound.
    jobs
        How many processes draw; 0 takes as many as are worth it.
    as_json
        Print what came of it as JSON.

    Raises
    ------
    MocapFitError
        If something is wrong; no movie is written then.
    """
    from mocap_fit.render import render_movie
    from mocap_fit.render.movie_file import find_ffmpeg, get_movie_kind

    look = Look() if look is None else look
    # What is missing is said before anything long begins.
    if get_movie_kind(out) != "png":
        find_ffmpeg()
    rig = load_face(look.face)
    said = _said(source, list(models), rig, nearest)
    markers = None if look.markers is None else _markers(look, said.heads.get(MEASURED))
    if keep is not None:
        _keep(said, keep)
    heads = said.heads if len(said.heads) > 1 else next(iter(said.heads.values()))
    longest = max(head.start_time + head.duration for head in said.heads.values())
    frames = round(max(longest, said.sound.duration if said.sound else 0.0) * look.rate)
    pictures = frames * len(said.heads) * len(look.views)
    make_folder(out.parent)
    with console.progress("drawing frames", max(frames, 1)) as advance:
        movie = render_movie(
            heads,
            out,
            face=rig,
            sound=said.sound,
            rate=look.rate,
            size=look.size,
            view=look.views,  # type: ignore[arg-type]
            zoom=look.zoom,
            phones=said.phones,
            subtitles=look.subtitles,
            curves=look.curves,
            markers=markers,
            blinks=look.blinks,
            head_motion=look.head_motion,
            seed=look.seed,
            jobs=jobs or min(count_cores(), 1 + pictures // _FRAMES_A_PROCESS),
            progress=lambda done, of: advance(),
        )
    report = {
        "file": movie.path,
        "frames": movie.frames,
        "rate": movie.rate,
        "duration": movie.duration,
        "size": movie.size,
        "sound": movie.with_sound,
        "phones": [] if said.phones is None else said.phones.phones,
        "heads": said.about,
    }
    if as_json:
        console.print_json(report)
    else:
        _show(report)
    return Status.DONE


def prepare(
    languages: Sequence[str],
    names: Sequence[str],
    *,
    fresh: bool = False,
    check: bool = False,
    utterances: int = speak_models.UTTERANCES,
    as_json: bool = False,
) -> Status:
    """Train and keep the models of all kinds for some languages.

    Parameters
    ----------
    languages
        All that there are sentences of where none are given.
    names
        Kinds of models; all that learn something where none are given.
    fresh
        Train also those that are kept already.
    check
        Score them on the test sentences: error, and on how many of p, b and m the lips close.
    utterances
        As for `speak_models.prepared`; `speak` takes what was made with the default.
    as_json
        Print what is kept as JSON.

    Raises
    ------
    MocapFitError
        If there is no such language or model.
    """
    from mocap_fit import control

    rows: list[dict[str, Any]] = []
    for language in languages or speak_models.languages():
        corpora: dict[str, Any] = {}
        models: dict[str, ControlModel] = {}
        for name in names or [n for n in control.names() if n != speak_models.RULE_BASED]:
            models[name] = speak_models.prepared(
                name, language, fresh=fresh, utterances=utterances, corpora=corpora
            )
            if not as_json:
                said = speak_models.described(models[name])
                console.screen().print(f"{language}: {said}", soft_wrap=True)
        scores: dict[str, dict[str, float]] = {}
        if check:
            corpus = corpora.get(language) or speak_models.simulated_corpus(language, utterances)
            scores = _scores(speak_models.scored(corpus, models), language, quiet=as_json)
        for name, model in models.items():
            kept = speak_models.cached_file(name, language, utterances)
            rows.append(
                {
                    "model": name,
                    "language": language,
                    "file": kept if kept.is_file() else None,
                    "free_parameters": model.parameter_count,
                    "trained_on": model.trained_on_,
                    **scores.get(name, {}),
                }
            )
        if speak_models.RULE_BASED in scores:
            own = {"model": speak_models.RULE_BASED, "language": language}
            rows.append(own | scores[speak_models.RULE_BASED])
    if as_json:
        console.print_json({"models": rows, "folder": speak_models.folder()})
    else:
        console.screen().print(f"Kept in {speak_models.folder()}", soft_wrap=True)
    return Status.DONE


def _scores(result: Evaluation, language: str, *, quiet: bool) -> dict[str, dict[str, float]]:
    averages = result.averages("rmse")[0][:, 0]
    found = {
        name: {"rmse_percent": float(average), "bilabials_closed": result.closed[name]}
        for name, average in zip(result.models, averages, strict=True)
    }
    if not quiet:
        screen = console.screen()
        for name, score in found.items():
            screen.print(
                f"{language}: {name}: error {score['rmse_percent']:.1f} % of the range, lips close "
                f"on {100 * score['bilabials_closed']:.1f} % of {result.bilabials} p, b, m "
                f"in {result.utterances} test sentences",
                soft_wrap=True,
            )
    return found


def _said(source: Source, models: list[str], rig: Rig, nearest: bool) -> _Said:
    said = _Said()
    if source.tracks is not None:
        said.heads[MEASURED] = measured(source.tracks)
        said.about.append({"head": MEASURED, "tracks": source.tracks})
    if source.sound is not None:
        said.sound = read_sound(source.sound)
    if source.text is None and source.labels is None:
        if models:
            raise ConfigurationError(
                "a model needs to know what is said", advice="Give the labels too (--labels)."
            )
        return said
    if not models and source.tracks is None:
        models = [_default(source)]
    chosen = [_model(name, source, rig) for name in models]
    if source.text is not None:
        said.phones, said.sound = _spoken(source, chosen)
    else:
        said.phones = _labelled(source, chosen)
    _predict(said, chosen, nearest)
    return said


def _default(source: Source) -> str:
    """The model that speaks when none is named."""
    if source.language in speak_models.languages():
        return DEFAULT_MODEL
    return speak_models.RULE_BASED


def _model(name: str, source: Source, rig: Rig) -> ControlModel:
    return speak_models.model_for(name, source.language, _phone_set_of(source), rig.parameter_names)


def _phone_set_of(source: Source) -> PhoneSet:
    """What the phones will be written in, as far as it is known before they are."""
    from mocap_fit.synthesis.text_to_phones import LANGUAGES

    if source.phone_set is not None:
        return load_phone_set(
            source.phone_set if source.phone_set in list_phone_sets() else Path(source.phone_set)
        )
    voice = LANGUAGES.get(source.language)
    return load_phone_set("ipa" if voice is None else voice.phone_set)


def _spoken(source: Source, models: Sequence[ControlModel]) -> tuple[PhoneSequence, Sound]:
    """The text's phones, in the set of the models where that is of its language."""
    from mocap_fit.synthesis import speak_text

    own = _phone_set_of(source)
    first = models[0].phone_set_ if models else own
    if first.language and first.language == own.language:
        own = first
    spoken = speak_text(
        source.text or "",
        source.language,
        phone_set=own,
        words_per_minute=source.words_per_minute,
    )
    return spoken.phones.replace(phone_set=own.name), spoken.sound


def _labelled(source: Source, models: Sequence[ControlModel]) -> PhoneSequence:
    from mocap_fit.labels import read_phones
    from mocap_fit.phones import read_stored_phones

    assert source.labels is not None
    if source.labels.suffix == ".parquet":
        return read_stored_phones(source.labels)
    known = source.phone_set is not None or not models
    chosen = _phone_set_of(source) if known else models[0].phone_set_
    phones = read_phones(source.labels, tier=source.tier, phone_set=chosen)
    return phones.replace(phone_set=chosen.name)


def _predict(said: _Said, models: Sequence[ControlModel], nearest: bool) -> None:
    from mocap_fit.synthesis import phones_for

    assert said.phones is not None
    titles = [model.title for model in models]
    for model in models:
        # Two of a kind are told apart by what they were trained on.
        label = model.title
        if titles.count(label) > 1:
            label += f" ({model.trained_on_.get('corpus') or model.phone_set_.name})"
        while label in said.heads:
            label += " again"
        phones = phones_for(said.phones, model, nearest=nearest)
        said.heads[label] = model.predict(phones)
        said.about.append(
            {
                "head": label,
                "model": model.name,
                "about": speak_models.described(model),
                "trained_on": model.trained_on_,
            }
        )


def measured(path: Path) -> ParameterTracks:
    """Face parameters from a file that `mocap-fit fit` or `convert` wrote.

    Raises
    ------
    FileFormatError
        If it holds something else.
    """
    from mocap_fit.tracks import read_parquet

    tracks = read_parquet(path)
    if not isinstance(tracks, ParameterTracks):
        raise FileFormatError(
            "the file does not hold face parameters",
            path=path,
            found=type(tracks).__name__,
            expected="what mocap-fit fit or convert wrote",
        )
    return tracks


def _markers(look: Look, tracks: ParameterTracks | None) -> MarkerTracks:
    """Recorded markers where they are on the face, on the clock of the measured tracks."""
    from mocap_fit.io import read_tracks

    assert look.markers is not None
    markers = read_tracks(look.markers)
    if look.reference is not None and look.layout is not None:
        from mocap_fit.fitting import fit_speaker

        speaker = fit_speaker(look.face, look.layout, look.reference)
        still, _ = speaker.remove_head_motion(markers)
        still = still.select(speaker.binding.names)
        markers = still.replace(positions=speaker.binding.orientation.apply(still.positions))
    if tracks is not None and tracks.frames == markers.frames:
        # A corpus puts a recording on the clock of its sound; the recording itself is not.
        markers = markers.replace(start_time=tracks.start_time)
    return markers


def _keep(said: _Said, folder: Path) -> None:
    """Write what was synthesised: for Blender, for `export`, or to look at."""
    from mocap_fit.labels import to_labels, write_labels
    from mocap_fit.sound import write_sound
    from mocap_fit.tracks import write_parquet

    make_folder(folder)
    for label, head in said.heads.items():
        name = "".join(c if c.isalnum() else "-" for c in label.casefold()).strip("-")
        write_parquet(head.replace(name=name), folder / f"{name}.parquet")
    if said.phones is not None:
        write_labels(to_labels(said.phones), folder / "phones.TextGrid")
    if said.sound is not None:
        write_sound(said.sound, folder / "sound.wav")


def _show(report: dict[str, Any]) -> None:
    screen = console.screen()
    for head in report["heads"]:
        about = head.get("about") or f"measured tracks of {head['tracks']}"
        screen.print(about, soft_wrap=True)
    if report["phones"]:
        screen.print("Phones: " + " ".join(report["phones"]))
    heard = "with sound" if report["sound"] else "silent"
    screen.print(
        f"{report['frames']} frames, {report['duration']:.2f} s at {report['rate']:g} frames/s, "
        f"{heard}: {report['file']}",
        soft_wrap=True,
    )
