"""The control models of `speak` and `stream`: files, rules, shipped ones, trained ones in a cache.

A kind of model is trained for a language on sentences that are simulated in memory (200 to learn
from, 87 to score on, as many as Beskow had). The default of each language is shipped in the folder
``voices``, where `fixtures/make_voices.py` writes it; others are trained when they are first asked
for, and kept in the user's cache folder. What a model was trained on is in it and is said when it
is used. Its name in the cache depends on the code and the tables that it was made with, so that a
newer version makes its own.
"""

from __future__ import annotations

import hashlib
import sys
import warnings
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import numpy as np

from corpus_tools.talking.voice_training import (
    MODEL_SETTINGS,
    UTTERANCES,
    estimate_training,
    list_languages,
    simulate_corpus,
    train_model,
)
from corpus_tools.tasks import TaskProgress
from mocap_fit import control
from mocap_fit._version import __version__
from mocap_fit.control import CONTROL_MODELS, ControlModel
from mocap_fit.corpus import Corpus
from mocap_fit.errors import ConfigurationError, FileFormatError, MocapFitWarning
from mocap_fit.face.builtin.cache import get_cache_folder
from mocap_fit.phones import PhoneSet

RULE_BASED = "rule-based"
# All close the lips when they are made to; this one comes nearest to the simulated speakers. Its
# correlation on their test sentences is 0.904, 0.898 and 0.899 in sv, cs and en, and those of ann
# are 0.899, 0.896 and 0.900. Four networks as one reach 0.904 in sv with 4 MB a language. What a
# network learns also depends on the processor, here only in the thirteenth digit.
DEFAULT_MODEL = "cohen-massaro"
SHIPPED = Path(str(resources.files("corpus_tools.talking"))) / "voices"


def choose_default(language: str) -> str:
    """Return the name of the model that speaks when none is named.

    Parameters
    ----------
    language
        The language.

    Returns
    -------
    str
        A model that learns, or the rules where there are no sentences of the language.
    """
    return DEFAULT_MODEL if language in list_languages() else RULE_BASED


def get_folder() -> Path:
    """Return the folder of the trained models.

    Returns
    -------
    Path
        In the user's cache.
    """
    return get_cache_folder() / "models"


def locate_model(name: str, language: str, utterances: int = UTTERANCES) -> Path:
    """Return the file of the trained model of a kind and a language, also where there is none.

    Parameters
    ----------
    name
        Name of a control model.
    language
        The language.
    utterances
        Number of sentences that it is trained and tested on.

    Returns
    -------
    Path
        The file.
    """
    settings = MODEL_SETTINGS.get(name, {})
    origin = f"{__version__} {np.__version__} {utterances} {settings}"
    digest = hashlib.sha256(origin.encode())
    for path in _list_sources(name):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return get_folder() / f"{name}-{language}-{digest.hexdigest()[:12]}.model"


def find_saved(name: str, language: str, utterances: int = UTTERANCES) -> Path | None:
    """Find the file of a trained model: shipped, or in the cache.

    Parameters
    ----------
    name
        Name of a control model.
    language
        The language.
    utterances
        Number of sentences that it is trained and tested on.

    Returns
    -------
    Path or None
        The file; None where the model is to be trained.
    """
    shipped = SHIPPED / f"{name}-{language}.model"
    if utterances == UTTERANCES and shipped.is_file():
        return shipped
    path = locate_model(name, language, utterances)
    return path if path.is_file() else None


def prepare_model(
    name: str,
    language: str,
    *,
    utterances: int = UTTERANCES,
    fresh: bool = False,
    corpora: dict[str, Corpus] | None = None,
    progress: TaskProgress | None = None,
) -> ControlModel:
    """Return the model of a kind for a language: shipped, from the cache, or trained now.

    Parameters
    ----------
    name
        Name of a control model.
    language
        A language that there are sentences of.
    utterances
        Number of sentences that it is trained and tested on.
    fresh
        Whether it is trained again where one is shipped, or in the cache.
    corpora
        Simulated corpora by language, to which a new one is added.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    ControlModel
        A trained model.

    Raises
    ------
    RegistryError
        If there is no such model.
    ConfigurationError
        If there are no sentences of the language.
    """
    CONTROL_MODELS.get(name)
    if language not in list_languages():
        raise ConfigurationError(
            f"the model '{name}' cannot be trained for the language '{language}': there are no "
            "sentences to simulate",
            expected=f"one of {', '.join(list_languages())}",
            advice=f"Give the file of a trained model, or take the model '{RULE_BASED}'.",
        )
    saved = None if fresh else find_saved(name, language, utterances)
    if saved is not None:
        try:
            return control.load(saved)
        except FileFormatError as error:
            warnings.warn(f"{error} It is made again.", MocapFitWarning, stacklevel=2)
    if progress is not None and corpora is None:
        time = estimate_training({language: [name]})
        progress(f"training {name} for {language}, for this time and later ones: {time}", 0, None)
    corpora = {} if corpora is None else corpora
    if language not in corpora:
        corpora[language] = simulate_corpus(language, utterances, progress=progress)
    model = train_model(name, corpora[language], progress=progress)
    path = locate_model(name, language, utterances)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        model.save(path)
    except (OSError, FileFormatError) as error:
        message = f"the model could not be saved for the next time: {error}"
        warnings.warn(message, MocapFitWarning, stacklevel=2)
    return model


def find_model(
    name: str,
    language: str,
    phone_set: PhoneSet,
    parameter_names: Sequence[str],
    *,
    progress: TaskProgress | None = None,
) -> ControlModel:
    """Return the model that a user names: from a file, or of a kind.

    Parameters
    ----------
    name
        A file that `ControlModel.save` wrote, or the name of a control model.
    language
        The language that it will speak.
    phone_set
        The phone set of what it will speak.
    parameter_names
        Parameters of the face that it will move.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    ControlModel
        The model, trained.

    Raises
    ------
    MocapFitError
        If there is no such model or file, or it cannot be made for the language.
    """
    if name == RULE_BASED:
        from mocap_fit.control.rule_based import RuleBased
        from mocap_fit.phones import ARTICULATORY_PARAMETERS

        names = [p for p in ARTICULATORY_PARAMETERS if p in parameter_names]
        return RuleBased().prepare(phone_set, names or parameter_names)
    path = Path(name)
    if name in control.names() and not path.is_file():
        return prepare_model(name, language, progress=progress)
    if path.exists() or path.suffix or len(path.parts) > 1:
        return control.load(path)
    raise ConfigurationError(
        f"there is no model '{name}'", expected=f"a file, or one of {', '.join(control.names())}"
    )


def describe_model(model: ControlModel) -> str:
    """Return what a model is and was trained on, in a few words.

    Parameters
    ----------
    model
        The model.

    Returns
    -------
    str
        Such as ``Rule-based, for phones of sv-sta``.
    """
    about = model.trained_on_
    count = int(about.get("utterances") or 0)
    if not count:
        return f"{model.title}, for phones of {model.phone_set_.name}"
    corpus = about.get("corpus") or "a corpus"
    return f"{model.title}, trained on {count} utterances of {corpus} ({model.phone_set_.name})"


def _list_sources(name: str) -> list[Path]:
    """Return the files of code and tables that a model of that kind depends on."""
    files: set[Path] = set()
    for package in ("mocap_fit.control", "mocap_fit.phones", "corpus_tools.simulation"):
        folder = Path(str(resources.files(package)))
        files |= {path for path in folder.rglob("*") if path.suffix in (".py", ".toml")}
    plug_in = sys.modules[CONTROL_MODELS.get(name).__module__].__file__
    if plug_in is not None:
        files.add(Path(plug_in))
    return sorted(files)
