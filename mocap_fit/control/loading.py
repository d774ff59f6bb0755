"""Control models by name, and from their files."""

from __future__ import annotations

import math
import os
from typing import Any

from mocap_fit.control.base import CONTROL_MODELS, ControlModel, LogEntry
from mocap_fit.control.model_file import read_model_file
from mocap_fit.control.settings import check_settings, to_settings
from mocap_fit.errors import ConfigurationError, DataError, FileFormatError, MocapFitError
from mocap_fit.phones import PhoneSet

# What the content of a damaged file raises.
_DAMAGE = (
    *(KeyError, TypeError, ValueError, AttributeError, IndexError),
    *(OverflowError, MemoryError, RecursionError),
)


def create(name: str, **settings: Any) -> ControlModel:
    """Return a control model that is not trained yet.

    Parameters
    ----------
    name
        Name of the model, one of `names`.
    **settings
        Settings of the model; the defaults are the paper's.

    Returns
    -------
    ControlModel
        The model.

    Raises
    ------
    RegistryError
        If there is no such model.
    ConfigurationError
        If it has no such setting, or a setting is of another type or out of range.

    See Also
    --------
    load : Read a trained model.

    Examples
    --------
    >>> from mocap_fit import control
    >>> control.create("ridge", context=6)
    Ridge(context=6)
    """
    kind: type[ControlModel] = CONTROL_MODELS.get(name)
    settings = to_settings(settings)
    with CONTROL_MODELS.guard(name):
        check_settings(kind, settings)
        return kind(**settings)


def names() -> tuple[str, ...]:
    """Return the names of all installed control models, sorted.

    Returns
    -------
    tuple[str, ...]
        Names for `create`.
    """
    return CONTROL_MODELS.names()


def list_live_models() -> tuple[str, ...]:
    """List the installed control models that are live: that do not wait for an utterance's end.

    Returns
    -------
    tuple[str, ...]
        Names for `create`, sorted.
    """
    # Some know how far they look ahead when they are trained; it is never without end.
    return tuple(
        name for name in names() if not math.isinf(getattr(create(name), "look_ahead", 0.0))
    )


def load(path: str | os.PathLike[str]) -> ControlModel:
    """Read a trained model that `ControlModel.save` wrote; no code in the file is run.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    ControlModel
        The trained model.

    Raises
    ------
    FileFormatError
        If the file is not a model, is damaged, or has a later format.
    RegistryError
        If its kind of model is not installed.
    """
    header, arrays = read_model_file(path)
    name = ""
    try:
        name = str(header["model"])
        model = create(name, **header["settings"])
        model.parameter_names_ = tuple(header["parameter_names"])
        model.phone_set_ = PhoneSet.from_dict(header["phone_set"])
        model.rate_ = float(header["rate"])
        _check_values(model)
        model.trained_on_ = dict(header["trained_on"])
        model.log_ = tuple(LogEntry(*entry) for entry in header["log"])
        model._restore(header["learned"], arrays)
    except (ConfigurationError, DataError) as error:
        raise FileFormatError(
            f"this model file cannot be used: {error.problem}", path=path, found=error.found
        ) from None
    except MocapFitError:
        raise
    except Exception as error:
        problem, source = "this model file is damaged", ""
        if name:
            source = CONTROL_MODELS.get_distribution(name)
        if source not in ("", "mocap-fit"):
            problem += f", or the control model '{name}' of {source} cannot read it"
        elif not isinstance(error, _DAMAGE):
            raise
        raise FileFormatError(
            problem, path=path, found=f"{type(error).__name__}: {error}"
        ) from None
    return model


def _check_values(model: ControlModel) -> None:
    if not all(isinstance(parameter, str) for parameter in model.parameter_names_):
        raise TypeError("the name of a parameter is no text")
    if not 0 < model.rate_ < math.inf:
        raise ValueError(f"a rate of {model.rate_} Hz")
