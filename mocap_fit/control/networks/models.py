"""ANN 1 and ANN 2: four recurrent networks from phones to parameters (Beskow sections 4.4, 4.5)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field, NonNegativeFloat, NonNegativeInt, PositiveInt

from mocap_fit.control.base import Arrays, ControlModel, Progress
from mocap_fit.control.networks.examples import Scale, load_examples
from mocap_fit.control.networks.features import INNER_RATE, INPUT_NAMES, PhoneInputs
from mocap_fit.control.networks.frames import FrameNetworks, NetworkStream, RunningNetworks
from mocap_fit.control.networks.recurrent import Weights, count_connections
from mocap_fit.control.networks.stack import Network
from mocap_fit.control.networks.training import Plan, Training
from mocap_fit.control.streaming import Stream
from mocap_fit.control.symbols import check_phone_set
from mocap_fit.control.training import check_arrays
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

_Share = Annotated[float, Field(ge=0, lt=1)]


@dataclass(eq=False, repr=False)
class SymmetricNetworks(ControlModel):
    """ANN 1: recurrent networks that see 15 frames behind and 15 ahead (section 4.4).

    Each of four three-layer networks predicts one group of parameters. Inside they run at 60 frames
    a second, whatever the rate of the corpus or of the prediction; the hidden layer sees itself
    one to five frames earlier, and outputs are linear. Training is back-propagation through time
    over complete utterances, by Adam on small batches, with targets in units of their deviation.

    The paper lists 17 features a frame, but the connections of Table 1 imply 18. The eighteenth
    here is 1 while a phone is spoken, and 0 in silence and where nothing is labelled.

    With a validation part, every network uses the weights of its least validation error, and
    stops when that falls no more; without one, the training error serves. The log has a line for
    every network and epoch. Its training error is that met during the epoch, before the weights
    had learned from each sentence; its validation error is that of the averaged weights, which
    are the ones that are used.

    Parameters
    ----------
    groups
        By name of a network, the parameters that it predicts. By default those of Table 1 for its
        ten parameters, and one network named ``all`` for others.
    hidden_units
        Number of hidden units of each network, in the order of the groups, or one number for all.
        By default those of Table 1: 50, or 30 for a network with fewer than three parameters.
    n_estimators
        Number of networks that are trained for each group, each from its own random weights; their
        outputs are averaged.
    frames_behind
        Context before a frame, frames of 1/60 s.
    frames_ahead
        Context after a frame, frames of 1/60 s.
    delays
        The hidden layer sees itself from one to so many frames earlier.
    stress
        Whether stress is an input of the networks.
    max_iter
        Largest number of epochs, passes through the training part. The step falls towards the last
        of them.
    patience
        A network stops after so many epochs without a smaller error.
    batch_size
        Number of sentences for one step.
    learning_rate
        Learning rate of the first step, 0 or more; it falls along a half cosine to a hundredth.
    averaging
        Share of the old weights in their exponential moving average, a step; 0 to below 1.
    detrend
        Share of an utterance's mean error that does not count, 0 to below 1. For recordings whose
        rest drifts from one utterance to the next, as with faces that are tracked in video: the
        networks then learn the movements and ignore the drift. 0 is the paper's error.
    random_state
        Seed of the weights before training and of the order of sentences. The same seed gives the
        same model.
    phone_set
        The phone set that a corpus must be written in; empty for any. The number of connections
        does not depend on it.
    """

    groups: Mapping[str, Sequence[str]] | None = None
    hidden_units: PositiveInt | tuple[PositiveInt, ...] | None = None
    n_estimators: PositiveInt = 1
    frames_behind: NonNegativeInt = 15
    frames_ahead: NonNegativeInt = 15
    delays: PositiveInt = 5
    stress: bool = True
    max_iter: NonNegativeInt = 30
    patience: PositiveInt = 8
    batch_size: PositiveInt = 2
    learning_rate: NonNegativeFloat = 2e-3
    averaging: _Share = 0.98
    detrend: _Share = 0.0
    random_state: NonNegativeInt = 0
    phone_set: str = ""

    name: ClassVar[str] = "ann"
    title: ClassVar[str] = "ANN 1"

    @property
    def networks(self) -> tuple[Network, ...]:
        """The networks: of the parameters it was trained on, or else of the paper's ten.

        Raises
        ------
        ConfigurationError
            If the groups do not hold every parameter once, or do not fit the hidden units.
        """
        names = getattr(self, "parameter_names_", ARTICULATORY_PARAMETERS)
        groups = self.groups
        if groups is None:
            is_table_1 = set(names) == set(ARTICULATORY_PARAMETERS)
            groups = TABLE_1 if is_table_1 else {"all": tuple(names)}
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
        if len(hidden) != len(groups):
            raise ConfigurationError(
                f"the hidden units of the model '{self.name}' do not fit its groups",
                found=", ".join(map(str, hidden)),
                expected=f"{len(groups)} numbers",
            )
        return tuple(
            Network(
                name if number == 1 else f"{name} {number}",
                tuple(names.index(parameter) for parameter in group),
                size,
            )
            for number in range(1, self.n_estimators + 1)
            for (name, group), size in zip(groups.items(), hidden, strict=True)
        )

    @property
    def _inputs(self) -> int:
        return (self.frames_behind + 1 + self.frames_ahead) * len(INPUT_NAMES)

    @property
    def connection_counts(self) -> dict[str, int]:
        """Number of connections of every network, biases included, as in Table 1."""
        return {
            network.name: count_connections(
                self._inputs, network.hidden, len(network.columns), self.delays
            )
            for network in self.networks
        }

    @property
    def parameter_count(self) -> int:
        """Number of connections; 123870 with the paper's parameters and settings."""
        return sum(self.connection_counts.values())

    @property
    def look_ahead(self) -> float:
        """How far beyond a frame phones must be known, seconds; exact at every rate."""
        return self.frames_ahead / INNER_RATE

    @property
    def plan(self) -> Plan:
        """How it trains."""
        names = [field.name for field in dataclasses.fields(Plan)]
        return Plan(**{name: getattr(self, name) for name in names})

    def _fit(
        self, corpus: Corpus, validation: Corpus | None, progress: Progress, checkpoint: Path | None
    ) -> None:
        check_phone_set(corpus, self.phone_set)
        networks = self.networks
        context = self.frames_behind, self.frames_ahead, self.stress
        data = load_examples(corpus, *context)
        held_out = () if validation is None else load_examples(validation, *context)
        scale = Scale.from_examples(data)
        training = Training(networks, self.plan, self.delays, data, held_out, scale)
        training.run(progress, checkpoint)
        self.log_ = tuple(training.log[: training.resumed])
        self._set_weights(training.get_weights())

    def _set_weights(self, weights: Sequence[Weights]) -> None:
        #: Weights of every network, a stack of one, in the unit of the corpus.
        self.weights_: tuple[Weights, ...] = tuple(weights)
        #: The same, ready to run.
        self.running_: FrameNetworks = FrameNetworks(
            self.networks,
            self.weights_,
            len(self.parameter_names_),
            self.frames_behind,
            self.frames_ahead,
            self.n_estimators,
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
        """Begin a live utterance: phones are pushed, frames are pulled as they become known.

        The networks take one step an inner frame; the frames are those of `predict`, at any rate.

        Parameters
        ----------
        rate
            Frames per second, hertz; that of the training corpus by default.

        Returns
        -------
        Stream
            A new stream without phones.

        Raises
        ------
        DataError
            If the model is not trained, or the rate is not positive.
        """
        self._check_fitted()
        inputs = PhoneInputs(self.phone_set_, self.stress)
        return NetworkStream(self.running_, inputs, self.rate_ if rate is None else rate)

    def _state(self) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        values = {"networks": [dataclasses.asdict(network) for network in self.networks]}
        arrays = {
            f"{i}.{name}": array[0]
            for i, weights in enumerate(self.weights_)
            for name, array in weights._asdict().items()
        }
        return values, arrays

    def _restore(self, values: Mapping[str, Any], arrays: Arrays) -> None:
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
            check_arrays(arrays, {f"{i}.{name}": shape for name, shape in shapes.items()})
            weights.append(
                Weights(*(np.array(arrays[f"{i}.{name}"])[None] for name in Weights._fields))
            )
        self._set_weights(weights)


@dataclass(eq=False, repr=False)
class LowLatencyNetworks(SymmetricNetworks):
    """ANN 2: the networks of ANN 1 with 2 frames ahead (33 ms) and 28 behind (section 4.5).

    Its live form takes one step a frame and gives the same numbers as `predict`. A frame needs no
    phone that lies further ahead than 1/30 s, whatever the rate of the prediction. Further settings
    are those of `SymmetricNetworks`.

    Parameters
    ----------
    frames_behind
        Context before a frame, frames of 1/60 s.
    frames_ahead
        Context after a frame, frames of 1/60 s.
    """

    frames_behind: NonNegativeInt = 28
    frames_ahead: NonNegativeInt = 2

    name: ClassVar[str] = "ann-low-latency"
    title: ClassVar[str] = "ANN 2"


@dataclass(eq=False, repr=False)
class NetworkEnsemble(SymmetricNetworks):
    """Four times the networks of ANN 1, each from its own random weights, with averaged outputs.

    It is none of the paper's models. What the networks have by chance differs between them and
    mostly cancels; what the corpus has taught them remains. Further settings are those of
    `SymmetricNetworks`.

    Parameters
    ----------
    n_estimators
        Number of networks that are trained for each group.
    """

    n_estimators: PositiveInt = 4

    name: ClassVar[str] = "ann-ensemble"
    title: ClassVar[str] = "ANN ensemble"
