"""Control models: from phones to face parameters. Each is a plug-in; `create` makes one by name."""

from mocap_fit.control.base import CONTROL_MODELS as CONTROL_MODELS
from mocap_fit.control.base import ControlModel as ControlModel
from mocap_fit.control.base import LogEntry as LogEntry
from mocap_fit.control.base import Progress as Progress
from mocap_fit.control.loading import create as create
from mocap_fit.control.loading import list_live_models as list_live_models
from mocap_fit.control.loading import load as load
from mocap_fit.control.loading import names as names
from mocap_fit.control.streaming import Stream as Stream
