"""The one registry that readers, rigs and control models share.

Plug-ins are Python entry points, so that a lab adds its own by installing a package. Names are
found without importing anything; a plug-in is imported when it is first asked for. Two
distributions that claim one name are an error that names both, never a silent choice.
"""

from __future__ import annotations

from importlib import metadata
from typing import Any

from mocap_fit.errors import RegistryError


class Registry:
    """Plug-ins of one kind, by name.

    Parameters
    ----------
    group
        The entry-point group, such as ``mocap_fit.readers``.
    noun
        What an entry is called in messages, such as ``reader``.
    """

    def __init__(self, group: str, noun: str) -> None:
        self.group = group
        self.noun = noun
        self._entries: dict[str, metadata.EntryPoint] | None = None
        self._loaded: dict[str, Any] = {}

    def _found(self) -> dict[str, metadata.EntryPoint]:
        if self._entries is None:
            entries: dict[str, metadata.EntryPoint] = {}
            for entry in metadata.entry_points(group=self.group):
                earlier = entries.get(entry.name)
                # An editable install can list the same entry twice; that is not a collision.
                if earlier is not None and earlier.value != entry.value:
                    raise RegistryError(
                        f"two distributions register the {self.noun} '{entry.name}'",
                        found=f"{_source(earlier)} ({earlier.value}) and "
                        f"{_source(entry)} ({entry.value})",
                        expected="one",
                        advice="Uninstall one of them.",
                    )
                entries[entry.name] = entry
            self._entries = entries
        return self._entries

    def names(self) -> tuple[str, ...]:
        """Names of all plug-ins, sorted."""
        return tuple(sorted(self._found()))

    def source(self, name: str) -> str:
        """The distribution that a plug-in comes from."""
        return _source(self._entry(name))

    def get(self, name: str) -> Any:
        """Import a plug-in, once, and return it.

        Raises
        ------
        RegistryError
            If there is no plug-in of that name, or it cannot be imported.
        """
        if name not in self._loaded:
            entry = self._entry(name)
            try:
                self._loaded[name] = entry.load()
            except Exception as error:
                raise RegistryError(
                    f"the {self.noun} '{name}' of {_source(entry)} cannot be loaded",
                    found=f"{type(error).__name__}: {error}",
                    advice="Reinstall that distribution, or uninstall it.",
                ) from error
        return self._loaded[name]

    def _entry(self, name: str) -> metadata.EntryPoint:
        try:
            return self._found()[name]
        except KeyError:
            raise RegistryError(
                f"there is no {self.noun} '{name}'",
                expected=f"one of {', '.join(self.names()) or 'none installed'}",
                advice="Check the spelling, or install the package that provides it.",
            ) from None


def _source(entry: metadata.EntryPoint) -> str:
    return entry.dist.name if entry.dist is not None else "an unknown distribution"
