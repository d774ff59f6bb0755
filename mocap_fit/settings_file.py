"""Settings in TOML files: shipped with the package by name, or the user's by path."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from mocap_fit.errors import ConfigurationError, from_os_error, shorten
from mocap_fit.parsing import parse_toml

Settings = TypeVar("Settings", bound="StrictModel")

# Bytes; a layout of 10,000 markers has two million.
_LARGEST = 16_000_000

_PLAINER = {
    "Field required": "this is missing",
    "Extra inputs are not permitted": "there is no such setting",
    "Input should be a valid tuple": "give a list, in square brackets",
}


class StrictModel(BaseModel):
    """Read-only settings without unknown keys, infinite numbers or NaN."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def list_shipped(package: str, folder: str = "") -> tuple[str, ...]:
    """Return the names of the TOML files that come with a package.

    Parameters
    ----------
    package
        The package, such as ``mocap_fit.fitting``.
    folder
        Its folder of TOML files; the package's own folder where empty.

    Returns
    -------
    tuple of str
        The names without ``.toml``, sorted.
    """
    files = _locate(package, folder).iterdir()
    return tuple(sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml")))


def read_toml(
    source: str | os.PathLike[str], *, package: str | None = None, folder: str = "", noun: str
) -> dict[str, Any]:
    """Read a TOML file by its shipped name or its path.

    Parameters
    ----------
    source
        The name of a shipped file, or the path of a file.
    package
        The package whose shipped files may be named; None for paths only.
    folder
        The folder of the package that holds them.
    noun
        What the file is called in messages, such as ``layout``.

    Returns
    -------
    dict
        The tables and values.

    Raises
    ------
    MissingFileError
        If there is no such file, shipped or not.
    FileFormatError
        If it cannot be read.
    ConfigurationError
        If it is not TOML.
    """
    name = os.fspath(source)
    shipped = () if package is None else list_shipped(package, folder)
    if package is not None and name in shipped:
        text = _locate(package, folder).joinpath(f"{name}.toml").read_text("utf-8")
    else:
        choice = f", or the name of a shipped one: {', '.join(shipped)}" if shipped else ""
        text = read_settings_text(name, noun, f"Give a TOML file{choice}.")
    try:
        return parse_toml(text)
    except ValueError as error:
        raise ConfigurationError(f"the {noun} is not TOML", path=name, found=error) from None


def read_settings_text(path: str | os.PathLike[str], noun: str, advice: str | None = None) -> str:
    """Read the text of a file that a person wrote.

    Parameters
    ----------
    path
        The file; it is read once, and may be a pipe.
    noun
        What it is called in messages.
    advice
        What to do where it cannot be read; a general hint where left out.

    Returns
    -------
    str
        The text.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it cannot be read, or is not UTF-8.
    ConfigurationError
        If it is too large to be written by a person.
    """
    try:
        with open(path, "rb") as stream:
            data = stream.read(_LARGEST + 1)
        text = data.decode("utf-8-sig")
    except (OSError, ValueError) as error:
        raise from_os_error(error, path, noun, advice) from None
    if len(data) > _LARGEST:
        raise ConfigurationError(
            f"the {noun} is too large", path=path, expected=f"at most {_LARGEST:,} bytes"
        )
    return text


def validate_settings(
    model: type[Settings], content: Mapping[str, Any], path: str | os.PathLike[str], noun: str
) -> Settings:
    """Make settings of the content of a TOML file.

    Parameters
    ----------
    model
        The class of the settings.
    content
        The tables and values of the file.
    path
        The file, for messages.
    noun
        What the file is called in messages.

    Returns
    -------
    StrictModel
        An instance of ``model``.

    Raises
    ------
    ConfigurationError
        If a key is unknown or missing, or a value is impossible; the message names the key.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        location, problem = _find_first_fault(content, error.errors())
        at = f" at {location}" if location else ""
        raise ConfigurationError(f"the {noun} is wrong{at}: {problem}", path=path) from None


def load_settings(
    model: type[Settings],
    source: str | os.PathLike[str],
    *,
    package: str | None = None,
    folder: str = "",
    noun: str,
) -> Settings:
    """Load settings from a TOML file by its shipped name or its path.

    Parameters
    ----------
    model
        The class of the settings.
    source
        The name of a shipped file, or the path of a file.
    package
        The package whose shipped files may be named; None for paths only.
    folder
        The folder of the package that holds them.
    noun
        What the file is called in messages, such as ``layout``.

    Returns
    -------
    StrictModel
        An instance of ``model``.

    Raises
    ------
    MissingFileError
        If there is no such file, shipped or not.
    FileFormatError
        If it cannot be read.
    ConfigurationError
        If it is not TOML, a key is unknown or missing, or a value is impossible.
    """
    content = read_toml(source, package=package, folder=folder, noun=noun)
    return validate_settings(model, content, source, noun)


def _locate(package: str, folder: str) -> Traversable:
    root = resources.files(package)
    return root.joinpath(folder) if folder else root


def _find_first_fault(content: object, faults: Sequence[Any]) -> tuple[str, str]:
    """Return the location of pydantic's first error in a file, and what is wrong there.

    The location lists the keys that lead to it, such as ``markers.3 'chin'.weight``; it is empty
    for the complete file. Entries of a list count from 0; one that has a name is shown with it.
    """
    fault = faults[0]
    location = []
    last = len(fault["loc"]) - 1
    for number, item in enumerate(fault["loc"]):
        # Other items of the location are pydantic's, such as the type that it tried.
        if isinstance(content, Mapping) and (item in content or number == last):
            location.append(shorten(item, 60))
            content = content.get(str(item))
        elif isinstance(content, list) and isinstance(item, int):
            content = content[item] if item < len(content) else None
            name = content.get("name") if isinstance(content, Mapping) else None
            location.append(
                f"{item} '{shorten(name, 60)}'" if name and isinstance(name, str) else str(item)
            )
    message = str(fault["msg"]).removeprefix("Value error, ")
    problem = _PLAINER.get(message, message[:1].lower() + message[1:])
    return ".".join(location), problem
