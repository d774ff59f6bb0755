"""How deep lips, teeth, tongue and palate are in each other, before and after contact.

Run ``python benchmarks/contact.py [--corpus CORPUS] [--every N]``. Depths are measured on the
triangles themselves, with winding numbers, and not with the fields that contact is resolved with:
the poses and transitions of every phone of three languages, and the fitted frames of a corpus,
with the tongue that its phones move. Times are of the same frames.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mocap_fit.control.rule_based import RuleBased
from mocap_fit.corpus import open_corpus
from mocap_fit.evaluation.depths import Depths
from mocap_fit.face import load_face
from mocap_fit.face.contact import resolve_contact
from mocap_fit.face.rig import Rig
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set
from mocap_fit.render.sampling import sample_parameters
from mocap_fit.tracks import FloatArray


def pose_phones(rig: Rig, name: str, rate: float = 50.0) -> Iterator[tuple[str, FloatArray]]:
    """Yield the rule-based poses of every phone of a language, and the way between.

    Parameters
    ----------
    rig
        A face with a tongue.
    name
        The phone set.
    rate
        Frames a second, hertz.

    Yields
    ------
    tuple
        The phone that is heard, and the parameters, ``(parameters,)``.
    """
    phone_set = load_phone_set(name)
    vowels = [p.symbol for p in phone_set.phones if p.kind == "vowel"]
    # Every phone after and before vowels of all kinds, and every vowel.
    labels = ["sil"]
    for number, phone in enumerate(phone_set.phones):
        labels += [
            vowels[number % len(vowels)],
            phone.symbol,
            vowels[(7 * number + 3) % len(vowels)],
        ]
    phones = PhoneSequence(
        tuple(PhoneSegment(0.1 * i, 0.1 * (i + 1), label) for i, label in enumerate(labels)),
        phone_set=name,
    )
    model = RuleBased().prepare(name)
    tracks = model.predict(phones, rate)
    values = sample_parameters(tracks, tracks.times, rig, phones)
    heard = phones.at(tracks.times)
    for i, row in zip(heard, values, strict=True):
        yield labels[i], row


def read_frames(rig: Rig, folder: Path, every: int, limit: int) -> Iterator[tuple[str, FloatArray]]:
    """Yield fitted frames of a corpus, with a tongue.

    Parameters
    ----------
    rig
        A face with a tongue.
    folder
        The corpus.
    every
        Take one of so many frames.
    limit
        Take so many utterances at most, spread over the corpus.

    Yields
    ------
    tuple
        The utterance, and the parameters, ``(parameters,)``.
    """
    corpus = open_corpus(folder)
    step = max(1, len(corpus) // limit)
    for utterance in corpus.utterances[::step][:limit]:
        tracks, phones = utterance.read_tracks(), utterance.read_phones()
        times = tracks.times[::every]
        for row in sample_parameters(tracks, times, rig, phones):
            yield utterance.id, row


def report(rig: Rig, title: str, poses: list[tuple[str, FloatArray]]) -> None:
    """Print the depths of poses, before and after contact.

    Parameters
    ----------
    rig
        A face with a tongue.
    title
        What the poses are.
    poses
        Name and parameters of each.
    """
    depths = Depths(rig.mesh)
    resolve_contact(rig.mesh.vertices, rig.mesh)
    before, after, names, took = [], [], [], 0.0
    for name, values in poses:
        vertices = rig.deform(values)
        start = time.process_time()
        resolved = resolve_contact(vertices, rig.mesh)
        took += time.process_time() - start
        before.append(list(depths.measure(vertices).values()))
        after.append(list(depths.measure(resolved).values()))
        names.append(name)
    pairs = list(depths.measure(rig.mesh.vertices))
    old, new = np.array(before), np.array(after)
    worst = new.max(axis=1)
    print(f"\n{title}: {len(poses)} frames, contact {1000 * took / len(poses):.2f} ms a frame")
    shares = [f"{(depths.max(axis=1) < 0.5).mean():.1%}" for depths in (old, new)]
    print(f"  frames under 0.5 mm: before {shares[0]}, after {shares[1]}")
    print(f"  99 % of the frames are under {np.percentile(worst, 99):.2f} mm,", end=" ")
    print(f"the worst is {worst.max():.2f} mm ({names[worst.argmax()]})")
    for i, pair in enumerate(pairs):
        print(
            f"    {pair:28s} before {old[:, i].max():5.2f}  after {new[:, i].max():5.2f} mm "
            f"({names[new[:, i].argmax()]})  frames over 0.5: {(new[:, i] >= 0.5).mean():.1%}"
        )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--corpus", type=Path, help="a converted corpus, such as of grid_s1.toml")
    parser.add_argument("--every", type=int, default=5, help="one of so many frames of the corpus")
    parser.add_argument("--utterances", type=int, default=20)
    parser.add_argument("--languages", nargs="*", default=["sv-sta", "cs-ipa", "en-arpabet"])
    options = parser.parse_args()
    rig = load_face(tongue=True)
    for name in options.languages:
        report(rig, name, list(pose_phones(rig, name, 25.0)))
    if options.corpus is not None:
        report(
            rig,
            str(options.corpus.name),
            list(read_frames(rig, options.corpus, options.every, options.utterances)),
        )


if __name__ == "__main__":
    main()
