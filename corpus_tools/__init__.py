"""The commands of ``mocap-fit`` as functions: quiet, with progress callbacks, returning objects.

What they need is imported when they are first used::

    import corpus_tools

    report = corpus_tools.convert("recordings/manifest.toml", out="corpus")
    report.errors
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

# Function → its module.
_HOMES: dict[str, str] = {
    "align": "corpus_tools.conversion.align",
    "calibrate": "corpus_tools.cameras.calibrate",
    "convert": "corpus_tools.conversion.convert",
    "demo": "corpus_tools.demonstration.demo",
    "evaluate": "corpus_tools.training.evaluate",
    "export": "corpus_tools.talking.export",
    "fit": "corpus_tools.conversion.fit",
    "info": "corpus_tools.inspection.info",
    "inspect": "corpus_tools.inspection.inspect",
    "prepare_voices": "corpus_tools.talking.prepare_voices",
    "select_sentences": "corpus_tools.conversion.select_sentences",
    "simulate": "corpus_tools.simulation.simulate",
    "speak": "corpus_tools.talking.speak",
    "stream": "corpus_tools.talking.stream",
    "sweep_look_ahead": "corpus_tools.training.train",
    "train": "corpus_tools.training.train",
    "validate": "corpus_tools.validation.validate",
}

if TYPE_CHECKING:
    from corpus_tools.cameras.calibrate import calibrate as calibrate
    from corpus_tools.conversion.align import align as align
    from corpus_tools.conversion.convert import convert as convert
    from corpus_tools.conversion.fit import fit as fit
    from corpus_tools.conversion.select_sentences import select_sentences as select_sentences
    from corpus_tools.demonstration.demo import demo as demo
    from corpus_tools.inspection.info import info as info
    from corpus_tools.inspection.inspect import inspect as inspect
    from corpus_tools.simulation.simulate import simulate as simulate
    from corpus_tools.talking.export import export as export
    from corpus_tools.talking.prepare_voices import prepare_voices as prepare_voices
    from corpus_tools.talking.speak import speak as speak
    from corpus_tools.talking.stream import stream as stream
    from corpus_tools.training.evaluate import evaluate as evaluate
    from corpus_tools.training.train import sweep_look_ahead as sweep_look_ahead
    from corpus_tools.training.train import train as train
    from corpus_tools.validation.validate import validate as validate

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    try:
        home = _HOMES[name]
    except KeyError:
        raise AttributeError(f"module 'corpus_tools' has no attribute '{name}'") from None
    return getattr(importlib.import_module(home), name)


def __dir__() -> list[str]:
    return sorted(__all__)
