"""The networks frame by frame: one step an inner frame, live and for complete utterances."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mocap_fit.control.networks.features import INNER_RATE, PhoneInputs, count_lead
from mocap_fit.control.networks.recurrent import Weights
from mocap_fit.control.networks.stack import Network
from mocap_fit.control.streaming import Stream
from mocap_fit.phones import PhoneSegment
from mocap_fit.tracks import FloatArray

# A time that is this close to an inner frame, in frames, is on it.
_ON_FRAME = 1e-6
# Hidden units are stored in a row that grows; at this length it moves back to its beginning.
_ROW = 64


class FrameNetworks:
    """Trained networks, ready to run frame by frame.

    Parameters
    ----------
    networks
        The networks.
    weights
        Weights of each, a stack of one, in the unit of the corpus.
    parameters
        Number of parameters of the corpus.
    behind
        Frames of context before a frame.
    ahead
        Frames of context after a frame.
    estimators
        Number of networks that predict each parameter; their outputs are averaged.
    """

    def __init__(
        self,
        networks: Sequence[Network],
        weights: Sequence[Weights],
        parameters: int,
        behind: int,
        ahead: int,
        estimators: int = 1,
    ) -> None:
        self.behind, self.ahead, self.parameters = behind, ahead, parameters
        self.delays = weights[0].delays
        self.hidden = [network.hidden for network in networks]
        ends = np.cumsum(self.hidden)
        self.parts = [
            slice(int(end) - size, int(end)) for end, size in zip(ends, self.hidden, strict=True)
        ]
        self.delayed = [np.ascontiguousarray(each.delayed[0], np.float64) for each in weights]
        self.bias = np.concatenate([each.hidden_bias[0, 0] for each in weights]).astype(np.float64)
        # One output layer for all: 0 from a network to what it does not predict.
        self.outputs = np.zeros((len(self.bias), parameters))
        self.output_bias = np.zeros(parameters)
        for network, each, part in zip(networks, weights, self.parts, strict=True):
            self.outputs[part, list(network.columns)] = each.outputs[0] / estimators
            self.output_bias[list(network.columns)] += each.output_bias[0, 0] / estimators
        context = behind + 1 + ahead
        side_by_side = np.concatenate([each.inputs[0] for each in weights], axis=1)
        # Weights of an input at every position of the context, (inputs, context · hidden).
        weights_of = side_by_side.reshape(context, -1, len(self.bias)).transpose(1, 0, 2)
        self._inputs = np.ascontiguousarray(weights_of, np.float64).reshape(len(weights_of), -1)

    def compute_effects(self, inputs: FloatArray) -> FloatArray:
        """Return what a phone adds to the hidden units at every position of the context.

        Parameters
        ----------
        inputs
            Inputs of the phone, ``(18,)``.

        Returns
        -------
        FloatArray
            Sums for all networks, ``(context, hidden)``.
        """
        return (inputs @ self._inputs).reshape(-1, len(self.bias))


class RunningNetworks:
    """The networks in the middle of an utterance, whose phones may still be coming.

    Parameters
    ----------
    networks
        The trained networks.
    inputs
        The phones that are known; others may be added to it.
    """

    def __init__(self, networks: FrameNetworks, inputs: PhoneInputs) -> None:
        self._networks, self._inputs = networks, inputs
        context = networks.behind + 1 + networks.ahead
        # Effects of the phones, of which the first is silence, in a table that grows.
        self._effects = np.zeros((8, context, len(networks.bias)))
        self._known = 0
        self._positions = np.arange(context)
        self._phones = np.zeros(context, dtype=np.intp)
        self._rows = [
            np.zeros((networks.delays + _ROW) * size, np.float64) for size in networks.hidden
        ]
        self._at = 0
        self._next = -count_lead(networks.ahead)
        self._output = np.zeros(networks.parameters)

    def _update_effects(self) -> None:
        table = self._inputs.table
        while self._known < len(table):
            if self._known == len(self._effects):
                self._effects = np.concatenate([self._effects, np.zeros_like(self._effects)])
            self._effects[self._known] = self._networks.compute_effects(table[self._known])
            self._known += 1

    def _drive(self, row: int) -> FloatArray:
        """Return the hidden units of the next frame, ``(hidden,)``, if a phone is last in sight."""
        if row >= self._known:
            self._update_effects()
        self._phones[-1] = row
        driven: FloatArray = self._effects[self._phones, self._positions].sum(axis=0)
        driven += self._networks.bias
        for part, size, delayed, past in zip(
            self._networks.parts,
            self._networks.hidden,
            self._networks.delayed,
            self._rows,
            strict=True,
        ):
            first = self._at * size
            driven[part] += past[first : first + self._networks.delays * size] @ delayed
        return np.tanh(driven, out=driven)

    def _compute_output(self, units: FloatArray) -> FloatArray:
        output: FloatArray = units @ self._networks.outputs
        output += self._networks.output_bias
        return output

    def _advance(self) -> None:
        """Advance by one inner frame."""
        networks = self._networks
        row = self._inputs.index((self._next + networks.ahead) / INNER_RATE)
        units = self._drive(row)
        if self._at == _ROW:
            for past, size in zip(self._rows, networks.hidden, strict=True):
                past[: networks.delays * size] = past[-networks.delays * size :]
            self._at = 0
        for part, past, size in zip(networks.parts, self._rows, networks.hidden, strict=True):
            first = (self._at + networks.delays) * size
            past[first : first + size] = units[part]
        self._at += 1
        self._phones[:-1] = self._phones[1:]
        self._output = self._compute_output(units)
        self._next += 1

    def at(self, time: float, last: float = math.inf) -> FloatArray:
        """Return the parameters at a time, which is not before that of the last call.

        On an inner frame they are the frame's. Between two they lie on the line to what the next
        would be if the phone that is last in sight now, ``ahead`` frames on, were so then. So no
        phone that lies further ahead is needed, whatever the time.

        Parameters
        ----------
        time
            Time from the start of the first phone, seconds.
        last
            Time from which on everything stays as it is, seconds from the start of the first phone.

        Returns
        -------
        FloatArray
            Parameters, ``(parameters,)``, no unit.
        """
        position = max(min(time, last) * INNER_RATE, float(-count_lead(self._networks.ahead)))
        frame = math.floor(position + _ON_FRAME)
        while self._next <= frame:
            self._advance()
        share = position - frame
        if share <= _ON_FRAME:
            return self._output
        row = self._inputs.index((position + self._networks.ahead) / INNER_RATE)
        towards = self._compute_output(self._drive(row))
        return self._output + share * (towards - self._output)


class NetworkStream(Stream):
    """A live utterance: a frame is returned as soon as the phones in its look-ahead are known.

    Parameters
    ----------
    networks
        The trained networks.
    inputs
        The inputs, without a phone yet.
    rate
        Frames per second, hertz.
    """

    def __init__(self, networks: FrameNetworks, inputs: PhoneInputs, rate: float) -> None:
        super().__init__(rate, networks.parameters)
        self._inputs = inputs
        self._running = RunningNetworks(networks, inputs)
        self._look_ahead = networks.ahead / INNER_RATE

    def _add(self, segment: PhoneSegment) -> None:
        self._inputs.add(segment)

    def _find_known_end(self) -> float:
        return self._inputs.start_time + self._inputs.end - self._look_ahead

    def _compute(self, times: FloatArray) -> FloatArray:
        frames = [self._running.at(float(time) - self._inputs.start_time) for time in times]
        self._inputs.forget_before(float(times[-1]) - self._inputs.start_time - 1.0)
        return np.array(frames)
