"""Recurrent networks from phones to face parameters: ANN 1 and ANN 2 (Beskow 4.4 and 4.5)."""

from mocap_fit.control.networks.look_ahead_sweep import SweepPoint, sweep_look_ahead
from mocap_fit.control.networks.models import LowLatencyNetworks, NetworkEnsemble, SymmetricNetworks

__all__ = [
    "LowLatencyNetworks",
    "NetworkEnsemble",
    "SweepPoint",
    "SymmetricNetworks",
    "sweep_look_ahead",
]
