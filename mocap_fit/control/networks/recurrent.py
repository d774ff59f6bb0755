"""Recurrent three-layer networks of one size, side by side: outputs, error and gradient.

A hidden unit of a frame sees the input layer and all hidden units one to several frames earlier
(Beskow section 4.4); outputs are linear. Networks of one size are stacked, so that one product
serves all of them, and the input layer, which does not depend on the past, is one product for all
frames. The past is stored as ``(networks, sentences, delays + frames, hidden)``: the hidden
units of the last frames then lie side by side, and all delays are one product too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


class Weights(NamedTuple):
    """The connections of stacked networks, or the gradient by them.

    Parameters
    ----------
    inputs
        From the input layer, ``(networks, context · inputs, hidden)``.
    delayed
        From earlier hidden units, ``(networks, delays · hidden, hidden)``, the longest delay first.
    hidden_bias
        Biases of the hidden units, ``(networks, 1, hidden)``.
    outputs
        To the output layer, ``(networks, hidden, outputs)``.
    output_bias
        Biases of the output layer, ``(networks, 1, outputs)``.
    """

    inputs: Array
    delayed: Array
    hidden_bias: Array
    outputs: Array
    output_bias: Array

    @property
    def delays(self) -> int:
        """The longest delay, frames."""
        return int(self.delayed.shape[1] // self.delayed.shape[2])

    def map(self, change: Callable[[Array], Array]) -> Weights:
        """Return the weights with a change to each array.

        Parameters
        ----------
        change
            A function of an array.

        Returns
        -------
        Weights
            The changed weights.
        """
        return Weights(*map(change, self))


def count_connections(inputs: int, hidden: int, outputs: int, delays: int) -> int:
    """Return the number of connections of one network, biases included, as in Table 1.

    Parameters
    ----------
    inputs
        Number of inputs of the complete context.
    hidden
        Number of hidden units.
    outputs
        Number of outputs.
    delays
        The longest delay, frames.

    Returns
    -------
    int
        Number of weights and biases.
    """
    return inputs * hidden + delays * hidden * hidden + hidden * outputs + hidden + outputs


def draw_weights(
    inputs: int,
    hidden: int,
    outputs: int,
    delays: int,
    generator: np.random.Generator,
    networks: int = 1,
) -> Weights:
    """Return weights to start from: small random connections, biases 0.

    Parameters
    ----------
    inputs
        Number of inputs of the complete context.
    hidden
        Number of hidden units.
    outputs
        Number of outputs.
    delays
        The longest delay, frames.
    generator
        Generator of random numbers.
    networks
        Number of networks that are stacked.

    Returns
    -------
    Weights
        Connections of mean 0 and a variance of 1 over the number of units that they come from;
        0.49 over it for earlier hidden units.
    """

    def draw(*shape: int, scale: float = 1.0) -> Array:
        return generator.normal(0.0, scale * shape[1] ** -0.5, shape)

    return Weights(
        draw(networks, inputs, hidden),
        # Below 1 together, or the past would not fade.
        draw(networks, delays * hidden, hidden, scale=0.7),
        np.zeros((networks, 1, hidden)),
        draw(networks, hidden, outputs),
        np.zeros((networks, 1, outputs)),
    )


def _stack_delays(past: Array, frames: int, delays: int, first: int) -> Array:
    """Return ``delays`` rows of each frame, from ``first + frame`` on, side by side.

    It is a view of the past, ``(frames, networks, sentences, delays · hidden)``.
    """
    networks, sentences, _, hidden = past.shape
    by_network, by_sentence, by_frame, by_unit = past.strides
    return np.lib.stride_tricks.as_strided(
        past[:, :, first:],
        (frames, networks, sentences, delays * hidden),
        (by_frame, by_network, by_sentence, by_unit),
    )


def compute_hidden(weights: Weights, seen: Array, past: Array | None = None) -> Array:
    """Return the hidden units of networks that are run.

    Parameters
    ----------
    weights
        Weights of the networks.
    seen
        What the input layer sees, ``(sentences, frames, context · inputs)``.
    past
        The hidden units before the first frame, ``(networks, sentences, delays, hidden)``; 0 by
        default.

    Returns
    -------
    Array
        Hidden units, ``(networks, sentences, delays + frames, hidden)``, the past first.
    """
    sentences, frames, inputs = seen.shape
    networks, _, hidden = weights.inputs.shape
    delays = weights.delays
    # One product for all networks, frames and sentences.
    side_by_side = np.ascontiguousarray(weights.inputs.transpose(1, 0, 2)).reshape(inputs, -1)
    driven = seen.reshape(-1, inputs) @ side_by_side
    driven += weights.hidden_bias.reshape(-1)
    driven = driven.reshape(sentences, frames, networks, hidden).transpose(1, 2, 0, 3)
    driven = np.ascontiguousarray(driven)
    units = np.zeros((networks, sentences, delays + frames, hidden), driven.dtype)
    if past is not None:
        units[:, :, :delays] = past
    earlier = _stack_delays(units, frames, delays, 0)
    sums = np.empty((networks, sentences, hidden), driven.dtype)
    of_frame = units.transpose(2, 0, 1, 3)[delays:]
    for before, drive, now in zip(earlier, driven, of_frame, strict=True):
        np.matmul(before, weights.delayed, out=sums)
        np.add(sums, drive, out=sums)
        np.tanh(sums, out=now)
    return units


def compute_outputs(weights: Weights, units: Array) -> Array:
    """Return the output layer.

    Parameters
    ----------
    weights
        Weights of the networks.
    units
        Hidden units without past, ``(networks, sentences, frames, hidden)``.

    Returns
    -------
    Array
        Outputs, ``(networks, sentences, frames, outputs)``.
    """
    networks, sentences, frames, hidden = units.shape
    flat = np.ascontiguousarray(units).reshape(networks, sentences * frames, hidden)
    outputs = flat @ weights.outputs + weights.output_bias
    return np.asarray(outputs).reshape(networks, sentences, frames, -1)


def subtract_offsets(difference: Array, counted: Array, detrend: float) -> Array:
    """Return errors less a share of every sentence's mean error.

    Parameters
    ----------
    difference
        Errors, ``(networks, sentences, frames, outputs)``; 0 where a value does not count.
    counted
        Whether a value counts, ``(networks, sentences, frames, outputs)``: 1 or 0.
    detrend
        The share, 0 to 1. The products with `difference` add up to its squares, less that share
        of the squares of a sentence's mean.

    Returns
    -------
    Array
        Errors, ``(networks, sentences, frames, outputs)``.
    """
    if not detrend:
        return difference
    means = difference.sum(axis=2, keepdims=True)
    means /= np.maximum(counted.sum(axis=2, keepdims=True), 1)
    return np.asarray(difference - difference.dtype.type(detrend) * means * counted)


def compute_errors_and_gradient(
    weights: Weights, seen: Array, targets: Array, counted: Array, detrend: float = 0.0
) -> tuple[Array, Weights]:
    """Compute squared errors, and their gradient by back-propagation through time.

    Parameters
    ----------
    weights
        Weights of the networks.
    seen
        What the input layer sees, ``(sentences, frames, context · inputs)``.
    targets
        Targets, ``(networks, sentences, frames, outputs)``; any number where a value does not
        count.
    counted
        Whether a value counts, ``(networks, sentences, frames, outputs)``: 1 or 0.
    detrend
        Share of every sentence's mean error that does not count, 0 to 1.

    Returns
    -------
    squares
        Sums of the squared errors that count (eq. 5 of Beskow), ``(networks, outputs)``.
    gradient
        Gradient of each network's squared error over its number of counted values.
    """
    sentences, frames, inputs = seen.shape
    networks, _, hidden = weights.inputs.shape
    delays = weights.delays
    units = compute_hidden(weights, seen)
    flat_units = np.ascontiguousarray(units[:, :, delays:]).reshape(networks, -1, hidden)
    difference = flat_units @ weights.outputs + weights.output_bias
    difference = (difference.reshape(targets.shape) - targets) * counted
    detrended = subtract_offsets(difference, counted, detrend)
    squares = np.einsum("nbfo,nbfo->no", difference, detrended)
    difference = detrended.reshape(networks, sentences * frames, -1)
    count = counted.sum(axis=(1, 2, 3)).reshape(-1, 1, 1)
    difference = difference * (2.0 / np.maximum(count, 1)).astype(difference.dtype)

    of_outputs = flat_units.transpose(0, 2, 1) @ difference
    of_output_bias = difference.sum(axis=1, keepdims=True)
    shape = (networks, sentences, frames, hidden)
    arriving = (difference @ weights.outputs.transpose(0, 2, 1)).reshape(shape)
    slopes = (1.0 - flat_units * flat_units).reshape(shape)

    # Backwards, a unit receives the errors of one to `delays` frames later.
    blocks = weights.delayed.reshape(networks, delays, hidden, hidden)
    backwards = np.ascontiguousarray(blocks[:, ::-1].transpose(0, 1, 3, 2))
    backwards = backwards.reshape(networks, delays * hidden, hidden)
    sent = np.zeros((networks, sentences, frames + delays, hidden), units.dtype)
    later = _stack_delays(sent, frames, delays, 1)
    sums = np.empty((networks, sentences, hidden), units.dtype)
    arriving, slopes = (np.ascontiguousarray(a.transpose(2, 0, 1, 3)) for a in (arriving, slopes))
    of_frame = sent.transpose(2, 0, 1, 3)[:frames]
    for frame in range(frames - 1, -1, -1):
        np.matmul(later[frame], backwards, out=sums)
        np.add(sums, arriving[frame], out=sums)
        np.multiply(sums, slopes[frame], out=of_frame[frame])

    sent = np.ascontiguousarray(sent[:, :, :frames]).reshape(networks, -1, hidden)
    side_by_side = np.ascontiguousarray(sent.transpose(1, 0, 2)).reshape(-1, networks * hidden)
    of_inputs = (seen.reshape(-1, inputs).T @ side_by_side).reshape(inputs, networks, hidden)
    of_delayed = np.empty_like(weights.delayed)
    for delay in range(delays):
        before = np.ascontiguousarray(units[:, :, delay : delay + frames])
        before = before.reshape(networks, -1, hidden).transpose(0, 2, 1)
        of_delayed[:, delay * hidden : (delay + 1) * hidden] = before @ sent
    gradient = Weights(
        np.ascontiguousarray(of_inputs.transpose(1, 0, 2)),
        of_delayed,
        sent.sum(axis=1, keepdims=True),
        of_outputs,
        of_output_bias,
    )
    return squares, gradient
