"""The networks frame by frame: one step an inner frame, for live use and for whole utterances."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mocap_fit.control.networks.features import INNER_RATE, PhoneInputs, lead
from mocap_fit.control.networks.recurrent import Weights
from mocap_fit.control.networks.stack import Network
from mocap_fit.control.streaming import Stream
from mocap_fit.phones import PhoneSegment
from mocap_fit.tracks import FloatArray

# A time that is this close to an inner frame, in frames, is on it.
_ON_FRAME = 1e-6
# Hidden units are kept in a row that is written on, and moved back to its beginning now and then.
_ROW = 64


class FrameNetworks:
    """Trained networks, ready to run frame by frame.

    Parameters
    ----------
    networks
        What each predicts.
    weights
        Of each, a stack of one, in the unit of the corpus.
    parameters
        Parameters of the corpus.
    behind, ahead
        Frames of context.
    members
        How many networks predict each parameter; what they say is averaged.
    """

    def __init__(
        self,
        networks: Sequence[Network],
        weights: Sequence[Weights],
        parameters: int,
        behind: int,
        ahead: int,
        members: int = 1,
    ) -> None:
        self.behind, self.ahead, self.parameters = behind, ahead, parameters
        self.delays = weights[0].delays
        self.hidden = [network.hidden for network in networks]
        ends = np.cumsum(self.hidden)
        self.parts = [
            slice(int(end) - size, int(end)) for end, size in zip(ends, self.hidden, strict=True)
        ]
        self.delayed = [np.ascontiguousarray(own.delayed[0], np.float64) for own in weights]
        self.bias = np.concatenate([own.hidden_bias[0, 0] for own in weights]).astype(np.float64)
        # One output layer for all: what a network does not predict it does not touch.
        self.outputs = np.zeros((len(self.bias), parameters))
        self.output_bias = np.zeros(parameters)
        for network, own, part in zip(networks, weights, self.parts, strict=True):
            self.outputs[part, list(network.columns)] = own.outputs[0] / members
            self.output_bias[list(network.columns)] += own.output_bias[0, 0] / members
        context = behind + 1 + ahead
        side_by_side = np.concatenate([own.inputs[0] for own in weights], axis=1)
        # `(inputs, context · hidden)`: what an input does at every place of the context.
        by_place = side_by_side.reshape(context, -1, len(self.bias)).transpose(1, 0, 2)
        self._by_place = np.ascontiguousarray(by_place, np.float64).reshape(by_place.shape[0], -1)

    def effects(self, inputs: FloatArray) -> FloatArray:
        """What a phone does to the hidden units at every place of the context.

        Parameters
        ----------
        inputs
            `(18,)`: of the phone.

        Returns
        -------
        FloatArray
            `(context, hidden)`: of all networks.
        """
        return (inputs @ self._by_place).reshape(-1, len(self.bias))


class RunningNetworks:
    """The networks in the middle of an utterance, whose phones may still be coming.

    Parameters
    ----------
    networks
        What runs.
    inputs
        The phones that are known; others may be added to it.
    """

    def __init__(self, networks: FrameNetworks, inputs: PhoneInputs) -> None:
        self._networks, self._inputs = networks, inputs
        context = networks.behind + 1 + networks.ahead
        # Effects of the phones, of which the first is silence, in a table that grows.
        self._effects = np.zeros((8, context, len(networks.bias)))
        self._known = 0
        self._places = np.arange(context)
        self._heard = np.zeros(context, dtype=np.intp)
        self._rows = [
            np.zeros((networks.delays + _ROW) * size, np.float64) for size in networks.hidden
        ]
        self._at = 0
        self._units = np.zeros(len(networks.bias))
        self._next = -lead(networks.ahead)
        self._output = np.zeros(networks.parameters)

    def _learn_phones(self) -> None:
        table = self._inputs.table
        while self._known < len(table):
            if self._known == len(self._effects):
                self._effects = np.concatenate([self._effects, np.zeros_like(self._effects)])
            self._effects[self._known] = self._networks.effects(table[self._known])
            self._known += 1

    def _drive(self, row: int) -> FloatArray:
        """What the hidden units of the next frame get, `(hidden,)`, if a phone is last in sight."""
        if row >= self._known or not self._known:
            self._learn_phones()
        self._heard[-1] = row
        driven: FloatArray = self._effects[self._heard, self._places].sum(axis=0)
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

    def _out(self, units: FloatArray) -> FloatArray:
        found: FloatArray = units @ self._networks.outputs
        found += self._networks.output_bias
        return found

    def _advance(self) -> None:
        """One inner frame on."""
        networks = self._networks
        row = self._inputs.row((self._next + networks.ahead) / INNER_RATE)
        units = self._drive(row)
        if self._at == _ROW:
            for past, size in zip(self._rows, networks.hidden, strict=True):
                past[: networks.delays * size] = past[-networks.delays * size :]
            self._at = 0
        for part, past, size in zip(networks.parts, self._rows, networks.hidden, strict=True):
            first = (self._at + networks.delays) * size
            past[first : first + size] = units[part]
        self._at += 1
        self._heard[:-1] = self._heard[1:]
        self._output = self._out(units)
        self._next += 1

    def at(self, time: float, last: float = math.inf) -> FloatArray:
        """The parameters at a time, `(parameters,)`, which is not before the last one asked for.

        On an inner frame it is the frame's. Between two it lies on the line to what the next
        would be if the phone that is last in sight now, ``ahead`` frames on, were so then. So no
        phone that lies further ahead is needed, whatever the time.

        Parameters
        ----------
        time
            Seconds from the start of the first phone.
        last
            A time from which on everything stays as it is, likewise.
        """
        place = max(min(time, last) * INNER_RATE, float(-lead(self._networks.ahead)))
        frame = math.floor(place + _ON_FRAME)
        while self._next <= frame:
            self._advance()
        share = place - frame
        if share <= _ON_FRAME:
            return self._output
        row = self._inputs.row((place + self._networks.ahead) / INNER_RATE)
        towards = self._out(self._drive(row))
        return self._output + share * (towards - self._output)


class NetworkStream(Stream):
    """A live utterance: a frame is given as soon as the phones in its look-ahead are known.

    Parameters
    ----------
    networks
        What runs.
    inputs
        Without a phone yet.
    rate
        Frames per second.
    """

    def __init__(self, networks: FrameNetworks, inputs: PhoneInputs, rate: float) -> None:
        super().__init__(rate)
        self._inputs = inputs
        self._running = RunningNetworks(networks, inputs)
        self._look_ahead = networks.ahead / INNER_RATE
        self._width, self._given = networks.parameters, 0

    def _push(self, segment: PhoneSegment) -> None:
        self._inputs.add(segment)

    def _pull(self, ended: bool) -> FloatArray:
        if self.start_time is None:
            return np.zeros((0, self._width))
        until = self._inputs.end - (0.0 if ended else self._look_ahead)
        last = max(self._given, math.ceil(until * self.rate - 1e-6))
        frames = [
            self._running.at((self.start_time + i / self.rate) - self.start_time)
            for i in range(self._given, last)
        ]
        self._given = last
        if frames:
            self._inputs.forget_before(self._given / self.rate - 1.0)
        return np.array(frames).reshape(-1, self._width)
