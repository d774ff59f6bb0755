"""An item on its way to a worker of a cluster and back, which may share a disk with us or not."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from corpus_tools.batch.cluster import ContentNeeded, Done
from corpus_tools.batch.item import Context, Item, ItemResult, Job, try_item
from mocap_fit.errors import FileFormatError
from mocap_fit.size_limit import VARIABLE, sum_file


@dataclass(frozen=True, eq=False)
class Parcel:
    """An item as it is sent to a worker.

    Parameters
    ----------
    item
        The item.
    fingerprint
        Sum over everything that the result depends on.
    sums
        SHA-256 of each source, by its path.
    max_size
        What a file may unpack to, bytes; the worker does not inherit it.
    contents
        Content of each source, by its path; None where the worker opens the files.
    """

    item: Item
    fingerprint: str
    sums: Mapping[str, str]
    max_size: int
    contents: Mapping[str, bytes] | None = None

    def load(self) -> Parcel | Done:
        """Return the parcel with the content of the files, for a worker that cannot open them.

        Returns
        -------
        Parcel or Done
            The result with the error where they cannot be read any more, or have changed.
        """
        contents: dict[str, bytes] = {}

        def read_sources() -> Mapping[str, Any]:
            for path, expected in self.sums.items():
                contents[path] = (self.item.folder / path).read_bytes()
                if hashlib.sha256(contents[path]).hexdigest() != expected:
                    raise FileFormatError(
                        "the file has changed since the run began",
                        path=self.item.folder / path,
                        advice="Run this again.",
                    )
            return {}

        context = Context(self.item, self.item.folder, self.item.folder, lambda done, of: None)
        result = try_item(context, read_sources)
        return Done(result) if result.error else replace(self, contents=contents)

    def is_here(self) -> bool:
        """Whether all files can be opened under their paths on this machine.

        Returns
        -------
        bool
            False also where a file of that name has another content.
        """
        try:
            return all(
                sum_file(self.item.folder / path) == expected
                for path, expected in self.sums.items()
            )
        except OSError:
            return False


def process_parcel(
    job: Job[Any], parcel: Parcel, progress: Callable[[int, int], object]
) -> ItemResult | ContentNeeded:
    """Process an item on a worker.

    Parameters
    ----------
    job
        What is done with the item.
    parcel
        The item.
    progress
        Called with the number of frames done, and of all.

    Returns
    -------
    ItemResult or ContentNeeded
        The result holds the files that were written, since we may not see the worker's disk.
    """
    item = parcel.item
    if parcel.contents is None and not parcel.is_here():
        return ContentNeeded()
    os.environ[VARIABLE] = str(parcel.max_size)
    files: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory() as name:
        folder, out = Path(name) / "in", Path(name) / "out"
        context = Context(
            item,
            item.folder if parcel.contents is None else folder,
            out,
            progress,
            parcel.fingerprint,
        )

        def process_item() -> Mapping[str, Any]:
            # Readers take files.
            for path, content in (parcel.contents or {}).items():
                (folder / path).parent.mkdir(parents=True, exist_ok=True)
                (folder / path).write_bytes(content)
            for target in item.targets:
                (out / target).parent.mkdir(parents=True, exist_ok=True)
            figures = job.process(item, context)
            files.update({t: (out / t).read_bytes() for t in item.targets if (out / t).is_file()})
            return figures

        result = try_item(context, process_item)
    return replace(result, files=files)
