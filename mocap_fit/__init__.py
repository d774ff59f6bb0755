"""mocap-fit: from facial motion capture to a talking head.

What the common path needs is here, imported when it is first used::

    import mocap_fit as mf

    recording = mf.read_tracks("take_01.tsv")
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from mocap_fit._version import __version__ as __version__

# Name → module. Imports wait until a name is used, so that `import mocap_fit` costs nothing.
_HOMES: dict[str, str] = {
    "read_sound": "mocap_fit.sound",
    "read_tracks": "mocap_fit.io",
    "read_phones": "mocap_fit.labels",
    "load_sample": "mocap_fit.io",
    "write_tracks": "mocap_fit.io",
    "open_corpus": "mocap_fit.corpus",
    "remove_head_motion": "mocap_fit.head",
    "load_face": "mocap_fit.face",
    "load_layout": "mocap_fit.fitting",
    "load_phone_set": "mocap_fit.phones",
    "bind_markers": "mocap_fit.fitting",
    "fit_orientation": "mocap_fit.fitting",
    "fit_shape": "mocap_fit.fitting",
    "fit_speaker": "mocap_fit.fitting",
    "evaluate": "mocap_fit.evaluation",
    "synthesise": "mocap_fit.synthesis",
    "render_movie": "mocap_fit.render",
}

if TYPE_CHECKING:
    from mocap_fit import control as control
    from mocap_fit.corpus import open_corpus as open_corpus
    from mocap_fit.evaluation import evaluate as evaluate
    from mocap_fit.face import load_face as load_face
    from mocap_fit.fitting import bind_markers as bind_markers
    from mocap_fit.fitting import fit_orientation as fit_orientation
    from mocap_fit.fitting import fit_shape as fit_shape
    from mocap_fit.fitting import fit_speaker as fit_speaker
    from mocap_fit.fitting import load_layout as load_layout
    from mocap_fit.head import remove_head_motion as remove_head_motion
    from mocap_fit.io import load_sample as load_sample
    from mocap_fit.io import read_tracks as read_tracks
    from mocap_fit.io import write_tracks as write_tracks
    from mocap_fit.labels import read_phones as read_phones
    from mocap_fit.phones import load_phone_set as load_phone_set
    from mocap_fit.render import render_movie as render_movie
    from mocap_fit.sound import read_sound as read_sound
    from mocap_fit.synthesis import synthesise as synthesise

__all__ = ["__version__", "control", *_HOMES]


def __getattr__(name: str) -> Any:
    if name == "control":
        return importlib.import_module("mocap_fit.control")
    try:
        home = _HOMES[name]
    except KeyError:
        raise AttributeError(f"module 'mocap_fit' has no attribute '{name}'") from None
    return getattr(importlib.import_module(home), name)


def __dir__() -> list[str]:
    return sorted(__all__)
