"""The tongue by rule: its movement from the phones, for tracks of faces whose tongue none saw.

Markers on a face do not see the tongue, so no corpus of them has its parameters, and no control
model learns them. Its targets stand in a table (``rules/tongue.toml``), and the rule-based model
makes movements of them. The tongue rides on the jaw; what has to reach the palate is raised by as
much as the jaw has fallen.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from mocap_fit.control.rule_based import RuleBased
from mocap_fit.phones import PhoneSequence, PhoneSet, load_phone_set, normalise_phones
from mocap_fit.tracks import FloatArray

TONGUE_PARAMETERS = (
    "tongue_tip_raise",
    "tongue_tip_advance",
    "tongue_body_raise",
    "tongue_body_advance",
    "tongue_width",
)
"""The parameters of the tongue, in the order of `compute_tongue` and of the shipped rig."""

_TABLE = Path(__file__).with_name("rules") / "tongue.toml"
_COLUMNS = (*TONGUE_PARAMETERS, "tip_from_palate", "body_from_palate")
# By how many full gestures the shipped rig's jaw lowers tip and body when it opens fully.
_TIP_FALL, _BODY_FALL = 1.3, 1.0
# How far the tip can come forwards behind teeth that are shut, and at which openings of the jaw
# they are, and are no longer, in its way.
_BEHIND_TEETH, _SHUT, _APART = 0.25, 0.02, 0.18


def compute_tongue(
    phones: PhoneSequence,
    times: ArrayLike,
    *,
    jaw: ArrayLike | None = None,
    phone_set: PhoneSet | None = None,
) -> FloatArray:
    """Compute the movement of the tongue by rule.

    Parameters
    ----------
    phones
        The phones of an utterance.
    times
        Times on the clock of the phones, ``(frames,)``, seconds, ascending.
    jaw
        The parameter ``jaw_rotation`` at these times, ``(frames,)``, full gestures; closed if None.
    phone_set
        The phone set of the phones; the one that they name if None.

    Returns
    -------
    ndarray
        The five `TONGUE_PARAMETERS`, ``(frames, 5)``, full gestures: 0 is rest.

    Raises
    ------
    MissingFileError
        If the phones name no phone set that there is.
    DataError
        If there are no phones, or one is not of the set.

    Examples
    --------
    >>> import mocap_fit as mf
    >>> phones = mf.read_phones(mf.load_sample("take_01.TextGrid"), phone_set="sv-sta")
    >>> tongue = compute_tongue(phones, [0.5, 0.75, 1.0])
    >>> tongue.shape
    (3, 5)
    """
    chosen = load_phone_set(phones.phone_set) if phone_set is None else phone_set
    at = np.asarray(times, dtype=np.float64)
    model = RuleBased(rules=str(_TABLE)).prepare(chosen, _COLUMNS)
    values = model.predict_at(normalise_phones(phones, chosen), at)
    opened = np.zeros(len(at)) if jaw is None else np.maximum(np.asarray(jaw, np.float64), 0.0)
    # A tongue fits between the teeth only where they are apart.
    apart = 1.0 if jaw is None else np.clip((np.asarray(jaw) - _SHUT) / (_APART - _SHUT), 0.0, 1.0)
    values[:, 1] = np.minimum(values[:, 1], _BEHIND_TEETH + (2.0 - _BEHIND_TEETH) * apart)
    values[:, 0] += _TIP_FALL * opened * values[:, 5]
    values[:, 2] += _BODY_FALL * opened * values[:, 6]
    return values[:, :5]
