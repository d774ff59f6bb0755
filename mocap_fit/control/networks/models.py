"""ANN 1 and ANN 2: four recurrent networks from phones to parameters (Beskow sections 4.4, 4.5)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from mocap_fit.control.base import ControlModel, Progress
from mocap_fit.control.networks.examples import examples, scale_of
from mocap_fit.control.networks.features import INNER_RATE, INPUT_NAMES, PhoneInputs
from mocap_fit.control.networks.frames import FrameNetworks, NetworkStream, RunningNetworks
from mocap_fit.control.networks.recurrent import Weights, connections
from mocap_fit.control.networks.stack import Network
from mocap_fit.control.networks.training import Plan, Training
from mocap_fit.control.streaming import Stream
from mocap_fit.control.training import check_finite, check_phone_set, check_settings
from mocap_fit.corpus import Corpus
from mocap_fit.errors import ConfigurationError
from mocap_fit.phones import ARTICULATORY_PARAMETERS, PhoneSequence
from mocap_fit.tracks import FloatArray

#: The groups of Table 1, for the ten articulatory parameters.
TABLE_1: Mapping[str, tuple[str, ...]] = {
    "occlusion": ("jaw_rotation", "upper_lip_raise", "lower_lip_depression"),
    "rounding": ("lip_rounding", "left_corner_stretch", "right_corner_stretch"),
    "protrusion": ("upper_lip_retraction", "lower_lip_retraction"),
    "jaw": ("jaw_thrust", "jaw_shift"),
}

# Hidden units of Table 1: 50 for three parameters, 30 for two.
_LARGE, _SMALL = 50, 30
# Inner frames after which a network has forgotten what it no longer sees.
_FORGOTTEN = 60


@dataclass(eq=False)
class SymmetricNetworks(ControlModel):
    """ANN 1: recurrent networks that see 15 frames behind and 15 ahead (section 4.4).

    Each of four three-layer networks predicts one group of parameters. Inside they run at 60 frames
    a second, whatever the rate of the corpus or of what is asked for; the hidden layer sees itself
    one to five frames earlier, and outputs are linear. Training is back-propagation through time
    over whole utterances, by Adam on small batches, with targets in units of their deviation.

    The paper lists 17 features a frame, but the connections of Table 1 imply 18. The eighteenth
    here is 1 while a phone is spoken, and 0 in silence and where nothing is labelled.

    With a validation part, every network keeps the weights of its least validation error, and
    stops when that falls no more; without one, the training error serves. The log has a line for
    every network and epoch. Its training error is that met during the epoch, before the weights
    had learned from each sentence; its validation error is that of the averaged weights, which
    are the ones that are kept.

    Parameters
    ----------
    groups
        By name of a network, the parameters that it predicts. Where not given, those of Table 1
        for its ten parameters, and one network named ``all`` for others.
    hidden_units
        Of the networks, in the order of the groups, or one number for all. Where not given, those
        of Table 1: 50, or 30 for a network with fewer than three parameters.
    members
        How many networks are trained for each group, each from weights of its own; what they say is
        averaged.
    frames_behind, frames_ahead
        Context before and after a frame, in frames of 1/60 s.
    delays
        The hidden layer sees itself from one to so many frames earlier.
    stress
        Whether stress is told to the networks.
    epochs
        Passes through the training part, at most. The step falls towards the last of them.
    patience
        A network stops after so many epochs without a better error.
    batch_size
        Sentences of a step.
    learning_rate
        Of the first step.
    averaging
        Share of the old weights in the running average of them, a step.
    forgiven_offset
        Share of an utterance's mean error that does not count, from 0 to below 1. For recordings
        whose rest drifts from one utterance to the next, as with faces that are found in video:
        the networks then learn the movements and leave the drift alone. 0 is the paper's error.
    seed
        Of the weights before training and of the order of sentences. The same seed gives the same
        model.
    phone_set
        What the phones of a corpus must be written in; any where empty. The number of
        connections does not depend on it.
    """

    groups: Mapping[str, Sequence[str]] | None = None
    hidden_units: int | tuple[int, ...] | None = None
    members: int = 1
    frames_behind: int = 15
    frames_ahead: int = 15
    delays: int = 5
    stress: bool = True
    epochs: int = 30
    patience: int = 8
    batch_size: int = 2
    learning_rate: float = 2e-3
    averaging: float = 0.98
    forgiven_offset: float = 0.0
    seed: int = 0
    phone_set: str = ""

    name: ClassVar[str] = "ann"
    title: ClassVar[str] = "ANN 1"

    @property
    def networks(self) -> tuple[Network, ...]:
        """The networks: of the parameters it was trained on, or else of the paper's ten.

        Raises
        ------
        ConfigurationError
            If the groups do not hold every parameter once, or do not go with the hidden units.
        """
        names = getattr(self, "parameter_names_", ARTICULATORY_PARAMETERS)
        groups = self.groups
        if groups is None:
            ten = set(names) == set(ARTICULATORY_PARAMETERS)
            groups = TABLE_1 if ten else {"all": tuple(names)}
        grouped = [name for group in groups.values() for name in group]
        if sorted(grouped) != sorted(names):
            raise ConfigurationError(
                f"the groups of the model '{self.name}' do not hold every parameter once",
                found=", ".join(grouped) or "none",
                expected=", ".join(names),
            )
        if any(not group for group in groups.values()):
            raise ConfigurationError(f"a group of the model '{self.name}' has no parameter")
        hidden = self.hidden_units
        if hidden is None:
            hidden = tuple(_LARGE if len(g) > 2 else _SMALL for g in groups.values())
        elif isinstance(hidden, int):
            hidden = (hidden,) * len(groups)
        if len(hidden) != len(groups) or not all(isinstance(h, int) and h > 0 for h in hidden):
            raise ConfigurationError(
                f"the hidden units of the model '{self.name}' do not go with its groups",
                found=", ".join(map(str, hidden)),
                expected=f"{len(groups)} numbers, 1 at least",
            )
        return tuple(
            Network(
                name if member == 1 else f"{name} {member}",
                tuple(names.index(parameter) for parameter in group),
                size,
            )
            for member in range(1, self.members + 1)
            for (name, group), size in zip(groups.items(), hidden, strict=True)
        )

    @property
    def is_fitted(self) -> bool:
        """Whether it has learned; a training that was broken off leaves a model that has not."""
        return hasattr(self, "running_")

    @property
    def _inputs(self) -> int:
        return (self.frames_behind + 1 + self.frames_ahead) * len(INPUT_NAMES)

    @property
    def connection_counts(self) -> dict[str, int]:
        """Connections of every network, biases included, as in Table 1."""
        return {
            network.name: connections(
                self._inputs, network.hidden, len(network.columns), self.delays
            )
            for network in self.networks
        }

    @property
    def parameter_count(self) -> int:
        """How many connections there are; 123870 with the paper's parameters and settings."""
        return sum(self.connection_counts.values())

    @property
    def look_ahead(self) -> float:
        """How far beyond a frame phones must be known, seconds; exact at every rate."""
        return self.frames_ahead / INNER_RATE

    @property
    def plan(self) -> Plan:
        """How it trains."""
        return Plan(
            self.epochs,
            self.patience,
            self.batch_size,
            self.learning_rate,
            self.averaging,
            self.forgiven_offset,
            self.seed,
        )

    def check(self) -> None:
        """See that the settings are possible.

        Raises
        ------
        ConfigurationError
            If one is not.
        """
        check_settings(
            self,
            members=1,
            frames_behind=0,
            frames_ahead=0,
            delays=1,
            epochs=0,
            patience=1,
            batch_size=1,
            learning_rate=0,
            averaging=0,
            forgiven_offset=0,
            seed=0,
        )
        whole = (
            "members",
            "frames_behind",
            "frames_ahead",
            "delays",
            "epochs",
            "batch_size",
            "seed",
        )
        for setting in whole:
            if not isinstance(getattr(self, setting), int):
                raise ConfigurationError(
                    f"the setting '{setting}' of the model '{self.name}' is not possible",
                    found=getattr(self, setting),
                    expected="a whole number",
                )
        for setting, value in (
            ("averaging", self.averaging),
            ("forgiven_offset", self.forgiven_offset),
        ):
            if value >= 1:
                raise ConfigurationError(
                    f"the setting '{setting}' of the model '{self.name}' is not possible",
                    found=value,
                    expected="below 1",
                )

    def _fit(
        self,
        corpus: Corpus,
        validation: Corpus | None,
        progress: Progress,
        checkpoint: Path | None,
    ) -> None:
        self.check()
        check_phone_set(corpus, self.phone_set)
        networks = self.networks
        context = self.frames_behind, self.frames_ahead
        data = examples(corpus, *context, self.stress)
        held_out = () if validation is None else examples(validation, *context, self.stress)
        training = Training(networks, self.plan, self.delays, data, held_out, scale_of(data))
        training.run(progress, checkpoint)
        self.log_ = tuple(training.log[: training.resumed])
        self._take(training.found())

    def _take(self, weights: Sequence[Weights]) -> None:
        #: Of every network, a stack of one, in the unit of the corpus.
        self.weights_: tuple[Weights, ...] = tuple(weights)
        #: The same, ready to run.
        self.running_: FrameNetworks = FrameNetworks(
            self.networks,
            self.weights_,
            len(self.parameter_names_),
            self.frames_behind,
            self.frames_ahead,
            self.members,
        )

    def _predict(self, phones: PhoneSequence, times: FloatArray) -> FloatArray:
        inputs = PhoneInputs(self.phone_set_, self.stress, phones)
        running = RunningNetworks(self.running_, inputs)
        last = inputs.end + (self.frames_behind + _FORGOTTEN) / INNER_RATE
        values = np.empty((len(times), len(self.parameter_names_)))
        for i, time in enumerate(times):
            values[i] = running.at(float(time) - inputs.start_time, last)
        return values

    def stream(self, rate: float | None = None) -> Stream:
        """Begin a live utterance: phones are pushed, frames are pulled as they come.

        The networks take one step an inner frame; the frames are those of `predict`, at any rate.

        Parameters
        ----------
        rate
            Frames per second; those of the training corpus where not given.
        """
        self._check_fitted()
        inputs = PhoneInputs(self.phone_set_, self.stress)
        return NetworkStream(self.running_, inputs, self.rate_ if rate is None else rate)

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        values = {"networks": [dataclasses.asdict(network) for network in self.networks]}
        arrays = {
            f"{i}.{name}": array[0]
            for i, own in enumerate(self.weights_)
            for name, array in own._asdict().items()
        }
        return values, arrays

    def _restore(
        self, values: Mapping[str, Any], arrays: Mapping[str, np.ndarray[Any, Any]]
    ) -> None:
        self.check()
        weights = []
        for i, network in enumerate(self.networks):
            outputs = len(network.columns)
            shapes = {
                "inputs": (self._inputs, network.hidden),
                "delayed": (self.delays * network.hidden, network.hidden),
                "hidden_bias": (1, network.hidden),
                "outputs": (network.hidden, outputs),
                "output_bias": (1, outputs),
            }
            check_finite(arrays, {f"{i}.{name}": shape for name, shape in shapes.items()})
            weights.append(
                Weights(*(np.array(arrays[f"{i}.{name}"])[None] for name in Weights._fields))
            )
        self._take(weights)


@dataclass(eq=False)
class LowLatencyNetworks(SymmetricNetworks):
    """ANN 2: the networks of ANN 1 with 2 frames ahead (33 ms) and 28 behind (section 4.5).

    Its live form takes one step a frame and gives the same numbers as `predict`. A frame needs no
    phone that lies further ahead than 1/30 s, whatever the rate of what is asked for.
    """

    frames_behind: int = 28
    frames_ahead: int = 2

    name: ClassVar[str] = "ann-low-latency"
    title: ClassVar[str] = "ANN 2"


@dataclass(eq=False)
class NetworkEnsemble(SymmetricNetworks):
    """Four times the networks of ANN 1, each from weights of its own, whose outputs are averaged.

    It is none of the paper's models. What the networks have by chance differs between them and
    mostly cancels; what the corpus has taught them remains.
    """

    members: int = 4

    name: ClassVar[str] = "ann-ensemble"
    title: ClassVar[str] = "ANN ensemble"
