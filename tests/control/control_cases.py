"""Sentences, their phones and movements, and small forms of the models, for the tests."""

import numpy as np

from mocap_fit import control
from mocap_fit.corpus import Corpus, Utterance
from mocap_fit.phones import PhoneSegment, PhoneSequence, load_phone_set
from mocap_fit.tracks import ParameterTracks

RATE = 50.0
NAMES = (
    "jaw_rotation",
    "lip_rounding",
    "upper_lip_retraction",
    "upper_lip_raise",
    "lower_lip_retraction",
    "lower_lip_depression",
    "left_corner_stretch",
    "right_corner_stretch",
    "jaw_thrust",
    "jaw_shift",
)

SENTENCES = (
    "sil M 'A: M A sil",
    "sil P 'I: L A B I: L sil",
    "sil F 'O: T O: S 'A T sil",
    "sil 'Y: V E0 N B 'U: K sil",
    "sil S T R 'Å: T A K 'A N sil",
    "sil D E0 M 'Ä: R B 'Ö: N sil",
    "sil B 'A: B A P 'A: P A sil",
    "sil L 'I: L A V 'O: V O: sil",
)

# Small forms of models whose own size would take long: what `create` is told for these tests.
SETTINGS: dict[str, dict] = {
    "ann": {"hidden_units": 6, "max_iter": 4},
    "ann-ensemble": {"hidden_units": 3, "max_iter": 2, "n_estimators": 2},
    "ann-low-latency": {"hidden_units": 6, "max_iter": 4},
    "cohen-massaro": {"max_iter": 3},
    "ridge": {"context": 2},
    "lab-levels": {"factor": 0.9},
}


def spoken(sentence: str, seed: int, phone_set="sv-sta", start: float = 0.0) -> PhoneSequence:
    """The phones of a sentence, with lengths that are drawn."""
    rng = np.random.default_rng(seed)
    chosen = load_phone_set(phone_set) if isinstance(phone_set, str) else phone_set
    time, segments = start, []
    for label in sentence.split():
        phone, stress = chosen.parse(label)
        # Lengths of whole milliseconds, which add up to what they are.
        length = round(rng.uniform(0.15, 0.25) if phone == "sil" else rng.uniform(0.05, 0.14), 3)
        if chosen.get_phone(phone).takes_stress and stress is None:
            stress = 0
        segments.append(PhoneSegment(round(time, 3), round(time + length, 3), phone, stress))
        time += length
    return PhoneSequence(tuple(segments), phone_set=chosen.name, name=f"s{seed}")


def moved(phones: PhoneSequence, names=NAMES, rate: float = RATE, phone_set=None):
    """Parameters that go with phones: targets by features, smoothed over 60 ms on both sides."""
    chosen = phone_set or load_phone_set(phones.phone_set)
    features = np.array([chosen.get_features(segment) for segment in phones])
    mix = np.random.default_rng(7).normal(0.0, 0.3, (features.shape[1], len(names)))
    frames = int(np.ceil(phones.duration * rate - 1e-6))
    times = phones[0].start + np.arange(frames) / rate
    offsets = np.linspace(-0.06, 0.06, 13)
    found = np.clip(phones.at(times[:, None] + offsets), 0, None)
    values = (features @ mix)[found].mean(axis=1)
    return ParameterTracks(names, rate, values, start_time=phones[0].start, name=phones.name)


def corpus_of(sentences, phone_set="sv-sta", names=NAMES, start: float = 0.0, rate=RATE):
    """A corpus in memory of these sentences."""
    chosen = load_phone_set(phone_set) if isinstance(phone_set, str) else phone_set
    utterances = []
    for seed, sentence in enumerate(sentences):
        phones = spoken(sentence, seed, chosen, start)
        utterances.append(Utterance.from_tracks(moved(phones, names, rate, chosen), phones))
    return Corpus.from_utterances(utterances, chosen)


def made(name: str) -> control.ControlModel:
    """An untrained model in its small form."""
    return control.create(name, **SETTINGS.get(name, {}))


def noisy(seed: int = 2) -> Corpus:
    """A corpus of four phones whose one parameter is noise, so that free parameters go far."""
    rng = np.random.default_rng(seed)
    chosen = load_phone_set("sv-sta").select(["sil", "S", "T", "A:"])
    utterances = []
    for number, sentence in enumerate(("sil S 'A: sil", "sil T 'A: S sil")):
        phones = spoken(sentence, number)
        values = rng.normal(size=(int(phones[-1].end * 60), 1))
        tracks = ParameterTracks(("noise",), 60.0, values, name=phones.name)
        utterances.append(Utterance.from_tracks(tracks, phones))
    return Corpus.from_utterances(utterances, chosen)
