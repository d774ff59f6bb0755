"""The settings of control models: read from the fields of a dataclass and checked by their types.

A range is part of the type, as pydantic writes it: ``PositiveInt``, ``NonNegativeFloat`` or
``Annotated[float, Field(ge=0, lt=1)]``.
"""

from __future__ import annotations

import dataclasses
import functools
import typing
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError

from mocap_fit.errors import ConfigurationError

_STRICT = ConfigDict(strict=True, allow_inf_nan=False, arbitrary_types_allowed=True)


@functools.cache
def _build_validators(kind: type) -> dict[str, TypeAdapter[Any]]:
    """Return a validator for each setting of a model's class, in the order of its fields."""
    types = typing.get_type_hints(kind, include_extras=True)
    return {
        field.name: TypeAdapter(types[field.name], config=_STRICT)
        for field in dataclasses.fields(kind)
    }


def check_settings(kind: Any, settings: Mapping[str, Any]) -> None:
    """Check settings against the fields of a model's class.

    Parameters
    ----------
    kind
        The dataclass, with the model's ``name``.
    settings
        Values by name; settings that are missing are not checked.

    Raises
    ------
    ConfigurationError
        If there is no such setting, or a value is of another type or out of range.
    """
    validators = _build_validators(kind)
    for key, value in settings.items():
        if key not in validators:
            raise ConfigurationError(
                f"the control model '{kind.name}' has no setting '{key}'",
                expected=f"some of {', '.join(validators)}" if validators else "none",
            )
        try:
            validators[key].validate_python(value)
        except ValidationError as error:
            faults = dict.fromkeys(fault["msg"] for fault in error.errors(include_url=False))
            raise ConfigurationError(
                f"the setting '{key}' of the control model '{kind.name}' is not valid",
                found=repr(value),
                expected=" or ".join(fault.removeprefix("Input should be ") for fault in faults),
            ) from None


def get_settings(model: Any) -> dict[str, Any]:
    """Return the settings of a model by name.

    Parameters
    ----------
    model
        An instance of a dataclass.

    Returns
    -------
    dict[str, Any]
        In the order of the fields.
    """
    return {field.name: getattr(model, field.name) for field in dataclasses.fields(model)}


def describe_settings(model: Any) -> str:
    """Return the class of a model and the settings that differ from their defaults.

    Parameters
    ----------
    model
        An instance of a dataclass.

    Returns
    -------
    str
        Such as ``Ridge(context=3)``.
    """
    changed = []
    for field in dataclasses.fields(model):
        value, factory = getattr(model, field.name), field.default_factory
        if value != (field.default if factory is dataclasses.MISSING else factory()):
            changed.append(f"{field.name}={value!r}")
    return f"{type(model).__name__}({', '.join(changed)})"


def to_settings(values: Mapping[str, Any]) -> dict[str, Any]:
    """Convert values that were read from TOML, JSON or arrays to those that settings have.

    Parameters
    ----------
    values
        Values by name.

    Returns
    -------
    dict[str, Any]
        The same with tuples for lists, and numbers of Python for those of numpy.
    """

    def convert(value: Any) -> Any:
        if isinstance(value, list):
            return tuple(value)
        return value.item() if isinstance(value, np.generic) else value

    return {key: convert(value) for key, value in values.items()}


def to_json(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Convert settings to values that JSON has.

    Parameters
    ----------
    settings
        Values by name.

    Returns
    -------
    dict[str, Any]
        The same with lists for tuples.
    """
    return {key: list(v) if isinstance(v, tuple) else v for key, v in settings.items()}
