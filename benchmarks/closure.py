"""How many p, b and m of typed text close the lips, model by model, and what else the lips do.

    python benchmarks/closure.py [--lang sv cs en] [--model NAME ...] [--sentences FILE] [--json]

Each sentence is spoken by espeak-ng, and its phones by every model of `speak`, with lips that
close. They are judged on tracks at 200 Hz, on the pictures of a movie at 25, 30 and 60 a second,
and on the frames of `stream` at 60 a second. A bilabial is closed when the largest opening along
the lip line is at most 0.5 mm in a frame of it. An open vowel is flattened when the lips open less
than 90 % as far as with the same model as it is; vowels under 80 ms between two bilabials do not
count. On f and v the lower lip is at the teeth within 2 mm. Sentences are in
`benchmarks/closure.toml`; another such file, or a text file with a sentence a line for a single
language, can be named. What is wrong is listed below the table.
"""

import argparse
import json
import sys
import tomllib
import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from corpus_tools.talking.speak_models import RULE_BASED, choose_default, find_model
from mocap_fit import control
from mocap_fit.control import ControlModel
from mocap_fit.errors import MocapFitWarning
from mocap_fit.evaluation.closure import CLOSED, CONTACT, LipEvent, LipGaps, measure_gaps
from mocap_fit.face import Rig, load_face
from mocap_fit.phones import PhoneSequence, PhoneSet
from mocap_fit.render.sampling import sample_parameters
from mocap_fit.synthesis import speak_text, stream_frames, synthesise
from mocap_fit.synthesis.espeak_voices import find_language, find_voice
from mocap_fit.tracks import FloatArray

SENTENCES = Path(__file__).with_suffix(".toml")
TRACKS = 200.0
PICTURES = (25.0, 30.0, 60.0)
STREAM = 60.0
KEPT_PART = 0.9
SHORT = 0.08


@dataclass
class Count:
    """What lips did on the phones of many sentences."""

    closed: int = 0
    bilabials: int = 0
    touching: int = 0
    labiodentals: int = 0
    flattened: int = 0
    open_vowels: int = 0
    speed: float = 0.0
    faults: list[str] = field(default_factory=list)

    @property
    def share(self) -> float:
        """Per cent of the bilabials that are closed."""
        return 100 * self.closed / max(self.bilabials, 1)

    def add(self, text: str, phones: PhoneSequence, lips: LipGaps, free: LipGaps) -> None:
        """Count the phones of a sentence, spoken with lips that close and without."""
        self.speed = max(self.speed, lips.speed)
        for event in lips.bilabials:
            self.bilabials += 1
            self.closed += event.gap <= CLOSED
            if event.gap > CLOSED:
                self.faults.append(f"{describe(event)} is open, {event.gap:.2f} mm: {text}")
        self.labiodentals += len(lips.labiodentals)
        self.touching += sum(event.gap <= CONTACT for event in lips.labiodentals)
        squeezed = find_squeezed(phones, lips)
        for event, other in zip(lips.open_vowels, free.open_vowels, strict=True):
            if (event.start, event.end) in squeezed:
                continue
            self.open_vowels += 1
            if other.gap > CLOSED and event.gap < KEPT_PART * other.gap:
                self.flattened += 1
                gaps = f"{event.gap:.1f} of {other.gap:.1f} mm"
                self.faults.append(f"{describe(event)} is flattened, {gaps}: {text}")


def describe(event: LipEvent) -> str:
    """Return a phone and its times."""
    return f"{event.phone} at {event.start:.3f}-{event.end:.3f} s"


def find_squeezed(phones: PhoneSequence, lips: LipGaps) -> set[tuple[float, float]]:
    """Return the times of short vowels between two bilabials."""
    closed = {(event.start, event.end) for event in lips.bilabials}
    spans = [(phone.start, phone.end) for phone in phones]
    return {
        span
        for before, span, after in zip(spans, spans[1:], spans[2:], strict=False)
        if before in closed and after in closed and span[1] - span[0] < SHORT
    }


def judge_models(
    texts: list[str], language: str, models: list[str], rates: tuple[float, ...] = PICTURES
) -> dict[tuple[str, str], Count]:
    """Return what lips do by model and by how it is judged."""
    rig, phone_set = load_face(), find_voice(language).phone_set
    spoken: dict[str, list[PhoneSequence]] = {}
    counts: dict[tuple[str, str], Count] = {}
    for name in models:
        model = find_model(name, language, load(phone_set), rig.parameter_names, progress=report)
        known = model.phone_set_
        if known.name not in spoken:
            spoken[known.name] = [
                speak_text(text, language, phone_set=known).phones.replace(phone_set=known.name)
                for text in texts
            ]
        report(f"{name} says {len(texts)} sentences of {language}", 0, None)
        for text, phones in zip(texts, spoken[known.name], strict=True):
            for way, (lips, free) in judge_sentence(phones, model, rig, rates).items():
                counts.setdefault((name, way), Count()).add(text, phones, lips, free)
    return counts


def judge_sentence(
    phones: PhoneSequence, model: ControlModel, rig: Rig, rates: tuple[float, ...]
) -> dict[str, tuple[LipGaps, LipGaps]]:
    """Return what lips do that close, and those of the model as it is, by how it is judged."""
    results = {}
    ways = {"tracks": (TRACKS, {})}
    for rate in rates:
        # As `speak` draws them: the middle of the time in which a picture is seen.
        frames = int(np.ceil(phones[-1].end * rate - 1e-6))
        ways[f"{rate:g} pictures"] = rate, {"start_time": 0.5 / rate, "frames": frames}
    for way, (rate, times) in ways.items():
        heads = [synthesise(phones, model, rate, face=face, **times) for face in (rig, None)]
        lips, free = (
            measure_gaps(
                rig, sample_parameters(head, head.times, rig), head.times, phones, model.phone_set_
            )
            for head in heads
        )
        results[way] = lips, free
    results["stream"] = judge_stream(phones, model, rig)
    return results


def judge_stream(phones: PhoneSequence, model: ControlModel, rig: Rig) -> tuple[LipGaps, LipGaps]:
    """Return what the lips of live frames do, and those of the model as it is."""
    index = [rig.parameter_names.index(name) for name in model.parameter_names_]

    def measure(face: Rig | None) -> LipGaps:
        frames = list(stream_frames(phones, model, STREAM, face=face))
        values: FloatArray = np.zeros((len(frames), len(rig.parameter_names)))
        values[:, index] = [frame.values for frame in frames]
        times = np.array([frame.time for frame in frames])
        values = np.clip(values, *rig.bounds.T)
        return measure_gaps(rig, values, times, phones, model.phone_set_)

    return measure(rig), measure(None)


def load(name: str) -> PhoneSet:
    """Return a phone set by its name."""
    from mocap_fit.phones import load_phone_set

    return load_phone_set(name)


def report(task: str, done: int, total: int | None) -> None:
    """Print a task when it begins."""
    if not done:
        print(f"closure: {task}", file=sys.stderr, flush=True)


def read_sentences(path: Path, languages: list[str]) -> dict[str, list[str]]:
    """Return the sentences of each language."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".toml":
        known = tomllib.loads(text)
        return {language: known[language] for language in languages or list(known)}
    if len(languages) != 1:
        raise SystemExit(f"{path} is of one language: name it with --lang")
    return {languages[0]: [line.strip() for line in text.splitlines() if line.strip()]}


def main() -> None:
    """Judge and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lang", nargs="+", default=[], help="by default all of the file")
    parser.add_argument("--model", nargs="+", default=[], help="by default all of `speak`")
    parser.add_argument("--sentences", type=Path, default=SENTENCES)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    warnings.simplefilter("ignore", MocapFitWarning)
    languages = [find_language(language) for language in options.lang]
    models = options.model or [RULE_BASED, *(n for n in control.names() if n != RULE_BASED)]
    results = {
        language: judge_models(texts, language, models)
        for language, texts in read_sentences(options.sentences, languages).items()
    }
    rows = [
        {"language": language, "model": name, "judged_on": way, "share": count.share, **vars(count)}
        for language, counts in results.items()
        for (name, way), count in counts.items()
    ]
    if options.json:
        print(json.dumps(rows, ensure_ascii=False))
        return
    print(
        "| language | model | judged on | bilabials | closed, % | f and v | at teeth, % "
        "| open vowels | flattened | mm/s |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for row in rows:
        default = "*" if row["model"] == choose_default(row["language"]) else ""
        print(
            f"| {row['language']} | {row['model']}{default} | {row['judged_on']} "
            f"| {row['bilabials']} | {row['share']:.1f} | {row['labiodentals']} "
            f"| {100 * row['touching'] / max(row['labiodentals'], 1):.1f} | {row['open_vowels']} "
            f"| {row['flattened']} | {row['speed']:.0f} |"
        )
    print("\n* speaks by default")
    for row in rows:
        for fault in row["faults"]:
            print(f"{row['language']}, {row['model']}, {row['judged_on']}: {fault}")


if __name__ == "__main__":
    main()
