"""What the lips of talking heads do in the pictures of a movie."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mocap_fit.evaluation.closure import CLOSED, CONTACT, LipGaps, measure_gaps
from mocap_fit.face.lips import has_lip_line
from mocap_fit.face.rig import Rig
from mocap_fit.phones import PhoneSequence, list_phone_sets, load_phone_set
from mocap_fit.render.sampling import sample_parameters
from mocap_fit.tracks import ParameterTracks


def measure_lips(
    heads: Mapping[str, ParameterTracks],
    phones: PhoneSequence | None,
    rig: Rig,
    start_time: float,
    frames: int,
    rate: float,
) -> dict[str, LipGaps]:
    """Measure the lips of every head in the pictures of a movie.

    Parameters
    ----------
    heads
        The movements, by label.
    phones
        What is said; None where it is not known.
    rig
        The face of all heads.
    start_time
        Time that the first picture shows, seconds.
    frames
        Number of pictures.
    rate
        Pictures a second, hertz.

    Returns
    -------
    dict[str, LipGaps]
        By label; empty where the phones are not known, or not of a shipped set, or the face has no
        lip line.
    """
    known = phones is not None and phones.phone_set in list_phone_sets()
    if phones is None or not known or not has_lip_line(rig.mesh):
        return {}
    times = np.asarray(start_time + np.arange(frames) / rate)
    phone_set = load_phone_set(phones.phone_set)
    return {
        label: measure_gaps(rig, sample_parameters(head, times, rig), times, phones, phone_set)
        for label, head in heads.items()
    }


def list_events(lips: LipGaps) -> dict[str, Any]:
    """Return what lips do as JSON can hold it.

    Parameters
    ----------
    lips
        Of one head.

    Returns
    -------
    dict[str, Any]
        ``bilabials`` with ``closed``, ``labiodentals`` with ``touches``, and ``largest_speed`` in
        millimetres a second.
    """
    closed, touching = (
        [{**vars(event), name: event.gap <= limit} for event in events]
        for events, name, limit in (
            (lips.bilabials, "closed", CLOSED),
            (lips.labiodentals, "touches", CONTACT),
        )
    )
    return {"bilabials": closed, "labiodentals": touching, "largest_speed": lips.speed}
