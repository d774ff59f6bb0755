"""Recurrent networks from phones to face parameters: ANN 1 and ANN 2 (Beskow 4.4 and 4.5)."""

from mocap_fit.control.networks.look_ahead_sweep import SweepPoint as SweepPoint
from mocap_fit.control.networks.look_ahead_sweep import sweep_look_ahead as sweep_look_ahead
from mocap_fit.control.networks.models import LowLatencyNetworks as LowLatencyNetworks
from mocap_fit.control.networks.models import NetworkEnsemble as NetworkEnsemble
from mocap_fit.control.networks.models import SymmetricNetworks as SymmetricNetworks
