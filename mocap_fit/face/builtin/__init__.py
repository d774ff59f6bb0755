"""The head that comes with mocap-fit, built by code."""

from mocap_fit.face.builtin.head import load_built_in_head as load_built_in_head
from mocap_fit.face.builtin.reshape import reshape_head as reshape_head
