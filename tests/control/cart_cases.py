"""Examples whose trees are known, and corpora of random sentences, for the tests of CART."""

import numpy as np

from mocap_fit.control.cart.arrays import QuestionTable, Sample
from mocap_fit.control.cart.kernel import FIXED, ORDERED, SUBSET
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set
from mocap_fit.tracks import ParameterTracks

NAMES = ("jaw_rotation", "lip_rounding", "lower_lip_depression")
RATE = 100.0
SWEDISH = load_phone_set("sv-sta")


def question_table(phone_levels=12, bins=8):
    """A class, an open question about the same phone, one about another, and a number."""
    members = np.zeros((4, max(phone_levels, bins + 2)), dtype=np.uint8)
    members[0, :4] = 1
    return QuestionTable(
        np.array([0, 0, 1, 2]),
        np.array([FIXED, SUBSET, SUBSET, ORDERED]),
        members,
        np.array([phone_levels, phone_levels, bins + 2]),
    )


def examples(count, seed=0, phone_levels=12, bins=8, folds=10):
    """Levels, noise as targets, and folds."""
    rng = np.random.default_rng(seed)
    levels = np.stack(
        [
            rng.integers(0, phone_levels, count),
            rng.integers(0, phone_levels, count),
            rng.integers(0, bins, count),
        ]
    ).astype(np.uint8)
    return Sample(levels, rng.normal(0.0, 1.0, count), rng.permutation(np.arange(count) % folds))


def sentence(symbols, rng, name, phone_set, loud=None):
    """Phones of random lengths, in whole milliseconds."""
    segments, time = [], 0.0
    for symbol in symbols:
        phone, stress = phone_set.parse(symbol)
        if stress is None and phone_set.get_phone(phone).takes_stress:
            stress = 0
        length = round(rng.uniform(0.05, 0.15), 3)
        energy = None if loud is None else float(loud(rng))
        start, end = round(time, 3), round(time + length, 3)
        segments.append(PhoneSegment(start, end, phone, stress, energy_db=energy))
        time = end
    return PhoneSequence(tuple(segments), phone_set=phone_set.name, name=name)


def corpus(
    rule, *, count=40, length=25, seed=0, noise=0.0, vocabulary=None, loud=None, names=NAMES
):
    """Random sentences whose targets a rule gives.

    The rule takes the phones and the number of a segment, and gives the parameters of its centre.
    """
    phone_set = load_phone_set("sv-sta")
    vocabulary = vocabulary or ["A", "'A:", "I:", "O:", "P", "B", "M", "F", "S", "T", "L"]
    rng = np.random.default_rng(seed)
    utterances = []
    for number in range(count):
        symbols = ["sil", *rng.choice(vocabulary, length).tolist(), "sil"]
        phones = sentence(symbols, rng, f"u{number:03d}", phone_set, loud)
        values = np.array([rule(phones, i) for i in range(len(phones))], dtype=float)
        values += rng.normal(0.0, noise, values.shape)
        # Steps, so that the value at a centre is exactly what the rule gives.
        frames = round(phones[-1].end * RATE * 10)
        times = np.arange(frames) / (RATE * 10)
        found = np.clip(phones.at(times + 1e-9), 0, None)
        tracks = ParameterTracks(names, RATE * 10, values[found], name=phones.name)
        utterances.append(Utterance.from_tracks(tracks, phones))
    return Corpus.from_utterances(utterances, phone_set)


def neighbour(phones, i, at):
    return phones[i + at].phone if 0 <= i + at < len(phones) else "sil"


def rounded_ahead(phones, i):
    """Jaw by the phone; rounding before O:; the lip opens with a long segment."""
    own = phones[i]
    jaw = 0.8 if SWEDISH.is_vowel(own) else 0.1
    rounding = 0.7 if neighbour(phones, i, 1) == "O:" else 0.1
    lip = 0.6 if own.duration > 0.1 else 0.2
    return jaw, rounding, lip


def phones_of(text, seed=0, loud=None):
    return sentence(text.split(), np.random.default_rng(seed), "new", SWEDISH, loud)
