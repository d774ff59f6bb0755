"""Thresholds: what counts as wrong. The defaults are ``thresholds.toml`` beside this module."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from corpus_tools.validation.findings import Finding, Severity, load_codes
from mocap_fit.errors import ConfigurationError
from mocap_fit.settings_file import read_toml

OFF = "off"


@dataclass(frozen=True, eq=False)
class Thresholds:
    """All thresholds; ``thresholds.toml`` says what each is.

    Parameters
    ----------
    markers, shape, time, labels, parameters, sound, corpus, report
        The sections.
    severity
        Codes whose severity is another than their own; ``off`` leaves them out.
    """

    markers: SimpleNamespace
    shape: SimpleNamespace
    time: SimpleNamespace
    labels: SimpleNamespace
    parameters: SimpleNamespace
    sound: SimpleNamespace
    corpus: SimpleNamespace
    report: SimpleNamespace
    severity: Mapping[str, str]

    def grade(self, finding: Finding) -> Finding | None:
        """Give a finding the severity that the user wants.

        Parameters
        ----------
        finding
            The finding.

        Returns
        -------
        Finding or None
            The finding; None where the user has switched it off.
        """
        wanted = self.severity.get(finding.code)
        if wanted is None:
            return finding
        return None if wanted == OFF else finding.replace(severity=Severity(wanted))

    def to_record(self) -> dict[str, Any]:
        """Return all thresholds as plain values.

        Returns
        -------
        dict
            Thresholds by section and name.
        """
        sections = {name: value for name, value in vars(self).items() if name != "severity"}
        return {
            **{name: dict(vars(section)) for name, section in sections.items()},
            "severity": dict(self.severity),
        }


def load_thresholds(path: Path | None = None) -> Thresholds:
    """Load the default thresholds, and over them those of a user's file.

    Parameters
    ----------
    path
        A TOML file with some of the lines of the defaults.

    Returns
    -------
    Thresholds
        The thresholds.

    Raises
    ------
    ConfigurationError
        If it cannot be read, names a threshold that there is not, or a value is of another kind
        than the default.
    """
    text = resources.files(__package__).joinpath("thresholds.toml").read_text("utf-8")
    content = tomllib.loads(text)
    changes = {} if path is None else read_toml(path, noun="file of thresholds")
    for section, values in changes.items():
        if section not in content or not isinstance(values, dict):
            raise ConfigurationError(
                f"there is no section '{section}' of thresholds",
                path=path,
                expected=f"one of {', '.join(content)}",
            )
        for name, value in values.items():
            _check(path, section, name, value, content[section])
            content[section][name] = value
    severity = content.pop("severity")
    return Thresholds(**{k: SimpleNamespace(**v) for k, v in content.items()}, severity=severity)


def _check(
    path: Path | None, section: str, name: str, value: object, defaults: Mapping[str, Any]
) -> None:
    location = f"{section}.{name}"
    if section == "severity":
        allowed = [*Severity, OFF]
        if name not in load_codes():
            advice = "mocap-fit validate --codes lists them all."
            raise ConfigurationError(f"there is no code '{name}'", path=path, advice=advice)
        if value not in allowed:
            raise ConfigurationError(
                f"{location} is no severity", path=path, found=value, expected=", ".join(allowed)
            )
        return
    if name not in defaults:
        raise ConfigurationError(
            f"there is no threshold '{location}'",
            path=path,
            expected=f"one of {', '.join(defaults)}",
        )
    default = defaults[name]
    if isinstance(default, list):
        fine = isinstance(value, list) and all(isinstance(item, str) for item in value)
        expected = "a list of names"
    elif isinstance(default, int):
        is_integer = section == "report" or name.endswith(("frames", "run", "utterances", "text"))
        fine = _is_number(value) and (not is_integer or (isinstance(value, int) and value >= 1))
        expected = "a whole number from 1" if is_integer else "a number"
    else:
        fine = _is_number(value) and value == value
        expected = "a number"
    if not fine:
        raise ConfigurationError(
            f"{location} has a wrong value", path=path, found=repr(value), expected=expected
        )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
