"""The one registry that readers, rigs and control models share.

Plug-ins are Python entry points, so that a lab adds its own by installing a package. Names are
listed without importing anything; a plug-in is imported when it is first used. Two distributions
that claim one name are an error that names both, never a silent choice, and a plug-in that fails
is named with its distribution.
"""

from __future__ import annotations

import contextlib
import os
import warnings
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

from mocap_fit.errors import FileFormatError, MocapFitError, MocapFitWarning, RegistryError

_DISTRIBUTION = "mocap-fit"


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

    def names(self) -> tuple[str, ...]:
        """Return the names of all plug-ins, sorted.

        Returns
        -------
        tuple of str
            The names.

        Raises
        ------
        RegistryError
            If two distributions claim one name.
        """
        return tuple(sorted(self._list_entries()))

    def get_distribution(self, name: str) -> str:
        """Return the distribution that a plug-in comes from.

        Parameters
        ----------
        name
            The plug-in.

        Returns
        -------
        str
            The distribution's name, such as ``mocap-fit``.

        Raises
        ------
        RegistryError
            If there is no plug-in of that name.
        """
        return _name_distribution(self._get_entry(name))

    def get(self, name: str) -> Any:
        """Import a plug-in, once, and return it.

        Parameters
        ----------
        name
            The plug-in.

        Returns
        -------
        object
            What the entry point names: a module, a class or a function.

        Raises
        ------
        RegistryError
            If there is no plug-in of that name, or it cannot be imported.
        """
        if name not in self._loaded:
            entry = self._get_entry(name)
            try:
                self._loaded[name] = entry.load()
            except Exception as error:
                raise RegistryError(
                    f"the {self.noun} '{name}' of {_name_distribution(entry)} cannot be loaded",
                    found=f"{type(error).__name__}: {error}",
                    advice="Reinstall that distribution, or uninstall it.",
                ) from error
        return self._loaded[name]

    def load_all(self) -> dict[str, Any]:
        """Import all plug-ins.

        Returns
        -------
        dict of str to object
            Those that can be imported, by their names in order.

        Raises
        ------
        RegistryError
            If two distributions claim one name.

        Warns
        -----
        MocapFitWarning
            If one cannot be imported; it is passed over.
        """
        loaded: dict[str, Any] = {}
        for name in self.names():
            try:
                loaded[name] = self.get(name)
            except RegistryError as error:
                # One laboratory's broken plug-in must not stop the others.
                warnings.warn(str(error), MocapFitWarning, stacklevel=3)
        return loaded

    def list_extensions(self) -> set[str]:
        """List the endings of files that readers take.

        Returns
        -------
        set of str
            Such as ``.tsv``, in lower case.

        Warns
        -----
        MocapFitWarning
            If a reader cannot be imported; it is passed over.
        """
        return {ending for reader in self.load_all().values() for ending in reader.extensions}

    @contextlib.contextmanager
    def guard(self, name: str, path: str | os.PathLike[str] | None = None) -> Iterator[None]:
        """Name the distribution whose plug-in raises anything but an error about the data.

        Parameters
        ----------
        name
            The plug-in that the body of the ``with`` statement calls.
        path
            The file that it works on.

        Yields
        ------
        None
            Control, to the calls of the plug-in.

        Raises
        ------
        RegistryError
            In place of any exception of another distribution's plug-in that is neither a
            `MocapFitError` nor an `OSError` nor a `MemoryError`. Exceptions of our own plug-ins
            pass.
        """
        try:
            yield
        except (MocapFitError, OSError, MemoryError):
            raise
        # A plug-in that ends the program must not end ours.
        except (Exception, SystemExit) as error:
            source = self.get_distribution(name)
            if source == _DISTRIBUTION:
                raise
            raise RegistryError(
                f"the {self.noun} '{name}' of {source} failed",
                path=path,
                found=f"{type(error).__name__}: {error}",
                advice=f"Choose another {self.noun}, or report it to the authors of {source}.",
            ) from error

    def find(self, path: Path, *, ambiguous_extensions: bool = True) -> str:
        """Return the name of the reader for a file.

        A reader takes a file by its content (its ``sniff``). Where several do, one with the file's
        extension comes first, then the first by name. Where none does, the extension decides, so
        that a damaged file or one without a header still gets to its reader.

        Parameters
        ----------
        path
            The file, which exists.
        ambiguous_extensions
            Whether an extension decides that several readers have; the first by name takes it.

        Returns
        -------
        str
            The reader's name.

        Raises
        ------
        FileFormatError
            If no reader takes the file.
        RegistryError
            If a reader of another distribution fails.

        Warns
        -----
        MocapFitWarning
            If a reader cannot be loaded; it is passed over.
        """
        loaded = self.load_all()
        extension = path.suffix.lower()
        by_extension = [name for name, reader in loaded.items() if extension in reader.extensions]
        for name in sorted(loaded, key=lambda name: (name not in by_extension, name)):
            with self.guard(name, path):
                if loaded[name].sniff(path):
                    return name
        if len(by_extension) == 1 or (by_extension and ambiguous_extensions):
            return by_extension[0]
        raise FileFormatError(
            f"no {self.noun} takes this file",
            path=path,
            expected=", ".join(
                f"{name} ({' '.join(reader.extensions)})" for name, reader in loaded.items()
            ),
            advice="Export it in one of these formats, or name the reader (reader=...).",
        )

    def _list_entries(self) -> dict[str, metadata.EntryPoint]:
        if self._entries is None:
            entries: dict[str, metadata.EntryPoint] = {}
            for entry in metadata.entry_points(group=self.group):
                earlier = entries.get(entry.name)
                # An editable install can list the same entry twice; that is not a collision.
                if earlier is not None and earlier.value != entry.value:
                    raise RegistryError(
                        f"two distributions register the {self.noun} '{entry.name}'",
                        found=f"{_name_distribution(earlier)} ({earlier.value}) and "
                        f"{_name_distribution(entry)} ({entry.value})",
                        expected="one",
                        advice="Uninstall one of them.",
                    )
                entries[entry.name] = entry
            self._entries = entries
        return self._entries

    def _get_entry(self, name: str) -> metadata.EntryPoint:
        try:
            return self._list_entries()[name]
        except KeyError:
            raise RegistryError(
                f"there is no {self.noun} '{name}'",
                expected=f"one of {', '.join(self.names()) or 'none installed'}",
                advice="Check the spelling, or install the package that provides it.",
            ) from None


def _name_distribution(entry: metadata.EntryPoint) -> str:
    return entry.dist.name if entry.dist is not None else "an unknown distribution"
