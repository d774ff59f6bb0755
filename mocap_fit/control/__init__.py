"""Control models: from phones to face parameters. Each is a plug-in; `create` makes one by name."""

from mocap_fit.control.base import CONTROL_MODELS, ControlModel, LogEntry, Progress
from mocap_fit.control.loading import create, load, names
from mocap_fit.control.streaming import Stream

__all__ = [
    "CONTROL_MODELS",
    "ControlModel",
    "LogEntry",
    "Progress",
    "Stream",
    "create",
    "load",
    "names",
]
