"""Simulate recordings, labels and sound as a lab has them, with the truth beside them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from corpus_tools.json_file import write_json
from corpus_tools.simulation.session import Conditions, Session, Simulation
from corpus_tools.tasks import TaskProgress, count_steps
from mocap_fit.atomic_file import make_folder, write_text
from mocap_fit.errors import ConfigurationError, MocapFitError, add_path
from mocap_fit.face import load_face
from mocap_fit.fitting import load_layout
from mocap_fit.fitting.layout import list_layouts
from mocap_fit.io import write_qualisys_tsv
from mocap_fit.labels import to_labels, write_labels
from mocap_fit.phones import PhoneSequence
from mocap_fit.tracks import ParameterTracks, write_parquet

if TYPE_CHECKING:
    from mocap_fit.sound import Sound

DurationSource = Literal["model", "espeak"]
DURATIONS: tuple[DurationSource, ...] = ("model", "espeak")

SPEAKER, SESSION = "speaker", "1"
_LAYOUT = "layout.toml"
# Of 287 sentences, 87 are for the test, as in Beskow section 3.
_TEST, _OF = 87, 287
# Seconds of sound before the first frame and after the last.
_BEFORE, _AFTER = (0.05, 0.35), (0.05, 0.2)
# Of espeak-ng, from sentence to sentence.
_WORDS_PER_MINUTE, _HASTE = 150.0, 0.12
# Random numbers that do not depend on how many utterances there are.
_SENTENCES, _SPEAKER = 1, 2


@dataclass(frozen=True)
class Spoken:
    """The speech of a simulated corpus.

    Parameters
    ----------
    language
        A language that sentences can be simulated in, such as ``sv``.
    durations
        Where times and sound come from: our model, or espeak-ng.
    drift
        How much faster the frames are than they say, on the clock of the sound, millionths.
    """

    language: str = "sv"
    durations: DurationSource = "model"
    drift: float = 20.0


@dataclass(frozen=True)
class SimulatedCorpus:
    """A folder of simulated recordings.

    Parameters
    ----------
    folder
        The folder; ``truth`` in it holds the true parameters and poses.
    names
        Names of the recordings.
    manifest
        The manifest for `corpus_tools.convert`; None where nothing is spoken.
    """

    folder: Path
    names: tuple[str, ...]
    manifest: Path | None = None

    def __repr__(self) -> str:
        speech = "sentences" if self.manifest else "recordings of free gestures"
        return f"SimulatedCorpus({str(self.folder)!r}: {len(self.names)} {speech})"


def simulate(
    out: str | os.PathLike[str],
    *,
    utterances: int = 287,
    seed: int = 0,
    layout: str = "face30-head5",
    conditions: Conditions | None = None,
    head: Mapping[str, float] | None = None,
    spoken: Spoken | None = Spoken(),
    progress: TaskProgress | None = None,
) -> SimulatedCorpus:
    """Simulate a session: recordings, the reference pose, and the truth beside them.

    Parameters
    ----------
    out
        A folder that does not exist yet, or is empty.
    utterances
        Number of recordings.
    seed
        Seed of all that is random; the same seed gives the same files.
    layout
        Name or file of a marker layout.
    conditions
        The conditions of the session; the default ones where it is None. The duration counts for
        free gestures only.
    head
        Proportions of the speaker's head for `reshape_head`, no unit; the built-in head where it
        is None.
    spoken
        What is spoken, with labels, sound and a manifest. Where it is None, the face makes free
        gestures and says nothing.
    progress
        Called with the task, the number of recordings written, and of all.

    Returns
    -------
    SimulatedCorpus
        The folder and the names of its recordings.

    Raises
    ------
    MocapFitError
        If the folder is not empty, or layout, conditions or language cannot be used.
    """
    out = Path(out)
    conditions = Conditions() if conditions is None else conditions
    advance = count_steps(progress, "simulating recordings", utterances)
    session = _prepare_session(out, layout, conditions, head)
    takes = None if spoken is None else _Takes(session, spoken, utterances, seed)
    folders = [out / "recordings", out / "truth" / "tracks", out / "truth" / "head"]
    if takes is not None:
        folders += [out / "labels", out / "sound"]
    for folder in (out, *folders):
        make_folder(folder)
    generators = np.random.default_rng(seed).spawn(utterances + 1)
    write_qualisys_tsv(session.record_reference(generators[0]), out / "reference.tsv")
    width = max(3, len(str(utterances)))
    names = [f"sim{i + 1:0{width}d}" for i in range(utterances)]
    clocks: dict[str, Any] = {}
    for i, (name, rng) in enumerate(zip(names, generators[1:], strict=True)):
        if takes is None:
            simulation = session.record(rng, name)
        else:
            simulation, clocks[name] = takes.record(i, name, rng, out)
        write_parquet(simulation.parameters, folders[1] / f"{name}.parquet")
        write_parquet(simulation.pose.replace(name=name), folders[2] / f"{name}.parquet")
        # The recording comes last: where it is, its truth is too.
        write_qualisys_tsv(simulation.recording, folders[0] / f"{name}.tsv")
        advance()
    if takes is not None:
        write_json(out / "truth" / "sync.json", clocks)
        write_text(out / "sentences.tsv", takes.format_table(names))
        if layout not in list_layouts():
            # A manifest names files under its root alone.
            write_text(out / _LAYOUT, Path(layout).read_text(encoding="utf-8"))
            layout = _LAYOUT
        write_text(out / "manifest.toml", takes.format_manifest(layout))
    return SimulatedCorpus(out, tuple(names), None if takes is None else out / "manifest.toml")


def is_test(utterance: int) -> bool:
    """Return whether an utterance is for the test: 87 of 287, evenly spread.

    Parameters
    ----------
    utterance
        Its index, from 0.

    Returns
    -------
    bool
        True for the test, False for training.
    """
    return (utterance + 1) * _TEST // _OF > utterance * _TEST // _OF


class _Takes:
    """Sentences and the speaker who says them."""

    def __init__(self, session: Session, spoken: Spoken, utterances: int, seed: int) -> None:
        from corpus_tools.simulation.articulation import Articulator
        from corpus_tools.simulation.sentences import load_language

        self.session, self.spoken = session, spoken
        self.step = {
            "seed": seed,
            "language": spoken.language,
            "durations": spoken.durations,
            "drift_ppm": spoken.drift,
        }
        self.language = load_language(spoken.language)
        self.sentences = self.language.draw_sentences(
            utterances, np.random.default_rng([seed, _SENTENCES])
        )
        self.voice = None
        if spoken.durations == "espeak":
            from mocap_fit.synthesis import TextSpeaker

            self.voice = TextSpeaker(spoken.language, phone_set=self.language.phone_set)
        self.articulator = Articulator(
            session.face, self.language.phone_set, np.random.default_rng([seed, _SPEAKER])
        )

    def record(
        self, index: int, name: str, rng: np.random.Generator, out: Path
    ) -> tuple[Simulation, Mapping[str, Any]]:
        """Record a sentence, write its sound and labels, and return the state of the clocks."""
        from corpus_tools.simulation.speech_sound import create_sync_pulses, locate_pulses
        from mocap_fit.sound import Sound, write_sound

        timing, voice, face, cameras = rng.spawn(4)
        before, after = timing.uniform(*_BEFORE), timing.uniform(*_AFTER)
        phones, speech = self._speak(index, name, before, after, timing, voice)
        rate = self.session.conditions.rate
        real_rate = rate * (1.0 + self.spoken.drift * 1e-6)
        end = speech.duration - after
        times = before + np.arange(int(np.floor((end - before) * real_rate))) / real_rate
        truth = ParameterTracks(
            self.session.face.parameter_names,
            rate,
            self.articulator.say(phones, times, face),
            start_time=before,
            name=name,
        ).add_step("simulate", self.step)
        pulses = create_sync_pulses(times, len(speech), speech.rate)
        both = Sound(np.stack([speech.get_channel(1), pulses], axis=1), speech.rate)
        write_sound(both, out / "sound" / f"{name}.wav")
        labels = to_labels(phones, speech.duration, self.language.phone_set)
        write_labels(labels, out / "labels" / f"{name}.TextGrid")
        clock = {
            "start_time": before,
            "drift_ppm": self.spoken.drift,
            "frames": len(times),
            "frame_rate": real_rate,
            "first_pulse_sample": locate_pulses(times[:1], speech.rate)[0],
            "sound_rate": speech.rate,
        }
        return self.session.play(truth, cameras), clock

    def _speak(
        self,
        index: int,
        name: str,
        before: float,
        after: float,
        timing: np.random.Generator,
        voice: np.random.Generator,
    ) -> tuple[PhoneSequence, Sound]:
        from corpus_tools.simulation.durations import load_durations, time_words
        from corpus_tools.simulation.speech_sound import RATE, synthesise_sound
        from mocap_fit.sound import Sound

        phone_set, sentence = self.language.phone_set, self.sentences[index]
        if self.spoken.durations == "model":
            phones = time_words(
                sentence.words, phone_set, timing, name=name, start=before, end=after
            )
            return phones, Sound(synthesise_sound(phones, phone_set, voice), RATE, name=name)
        assert self.voice is not None
        result = self.voice.speak(
            sentence.text,
            name=name,
            words_per_minute=_WORDS_PER_MINUTE * np.exp(timing.uniform(-_HASTE, _HASTE)),
            silence=max(before, after) + timing.uniform(*load_durations().pauses.before),
        )
        return result.phones, result.sound

    def format_table(self, names: list[str]) -> str:
        """Return the text of ``sentences.tsv``."""
        rows = ["utterance\tsplit\ttext\tspeaker\tsession"]
        for i, (name, sentence) in enumerate(zip(names, self.sentences, strict=True)):
            split = "test" if is_test(i) else "train"
            rows.append(f"{name}\t{split}\t{sentence.text}\t{SPEAKER}\t{SESSION}")
        return "\n".join(rows) + "\n"

    def format_manifest(self, layout: str) -> str:
        """Return the text of ``manifest.toml``."""
        return f"""\
# A corpus that `mocap-fit simulate` made; its truth is in truth/.
# mocap-fit convert manifest.toml --root . --out CORPUS
format_version = 1
language = "{self.spoken.language}"
phone_set = "{self.language.phone_set.name}"
layout = "{layout}"
rate = {self.session.conditions.rate!r}

[recordings]
pattern = "recordings/{{id}}.tsv"
[labels]
pattern = "labels/{{id}}.TextGrid"
phones = "phones"
words = "words"
[sound]
pattern = "sound/{{id}}.wav"
required = true
[sync]
kind = "pulses"
channel = 2
[sentences]
file = "sentences.tsv"

[[speakers]]
id = "{SPEAKER}"
reference = "reference.tsv"
[[sessions]]
id = "{SESSION}"
speaker = "{SPEAKER}"
"""


def _prepare_session(
    out: Path, layout: str, conditions: Conditions, head: Mapping[str, float] | None
) -> Session:
    from mocap_fit.face.builtin import load_built_in_head, reshape_head

    if out.is_dir() and any(out.iterdir()):
        raise ConfigurationError(
            "the folder for the simulation is not empty",
            path=str(out),
            advice="Give a new folder, or empty this one.",
        )
    face = load_face()
    if head:
        face = load_face(mesh=reshape_head(load_built_in_head(), **head))
    try:
        return Session(load_layout(layout), face, conditions)
    except MocapFitError as error:
        raise add_path(error, layout) from None
