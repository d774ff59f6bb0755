"""How far a training is, in a file: it resumes as if it had not been interrupted."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mocap_fit.control.model_file import read_model_file, write_model_file
from mocap_fit.control.training import TrainingUtterance
from mocap_fit.errors import FileFormatError


def read_checkpoint(
    path: Path, kind: str, fingerprint: str
) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]] | None:
    """Read a checkpoint, if there is one that fits.

    Parameters
    ----------
    path
        The file.
    kind
        Kind of model that is trained.
    fingerprint
        Digest of settings and data; a checkpoint with another one does not fit.

    Returns
    -------
    tuple[dict[str, Any], dict[str, ndarray]] | None
        Header and arrays ``(...)`` by name; None where there is no file, or it does not fit.

    Raises
    ------
    FileFormatError
        If the file is not a checkpoint of this kind.
    """
    if not path.is_file():
        return None
    header, arrays = read_model_file(path)
    if header.get("checkpoint") != kind:
        raise FileFormatError(
            f"this file is not a checkpoint of a training of {kind} and stays as it is",
            path=path,
            advice="Delete it, or name another file.",
        )
    return (header, arrays) if header.get("fingerprint") == fingerprint else None


class Checkpoint:
    """The finished parts of a training, in a file.

    Parameters
    ----------
    path
        The file; None stores nothing.
    model
        Name of the model.
    settings
        Settings of the model.
    data
        What it trains on. A checkpoint of other settings or other data does not fit and is
        replaced; a file of another kind is refused.
    """

    def __init__(
        self,
        path: Path | None,
        model: str,
        settings: Mapping[str, Any],
        data: Sequence[Sequence[TrainingUtterance]],
    ) -> None:
        self._path = path
        self._parts: dict[str, np.ndarray[Any, Any]] = {}
        if path is None:
            return
        digest = hashlib.sha256(json.dumps([model, dict(settings)]).encode())
        for array in _iterate_arrays(data):
            digest.update(np.ascontiguousarray(array).tobytes())
        self._header = {"checkpoint": model, "fingerprint": digest.hexdigest()}
        stored = read_checkpoint(path, model, self._header["fingerprint"])
        if stored is not None:
            self._parts = stored[1]

    def __contains__(self, part: str) -> bool:
        return part in self._parts

    def __getitem__(self, part: str) -> np.ndarray[Any, Any]:
        return self._parts[part]

    def store(self, parts: Mapping[str, np.ndarray[Any, Any]]) -> None:
        """Store parts that are finished.

        Parameters
        ----------
        parts
            Arrays of any shape ``(...)``, by name.
        """
        self._parts |= parts
        if self._path is not None:
            write_model_file(self._header, self._parts, self._path)


def _iterate_arrays(data: Sequence[Sequence[TrainingUtterance]]) -> Iterator[np.ndarray[Any, Any]]:
    for part in data:
        yield np.array([len(part)])
        for each in part:
            yield from (
                each.phones.starts,
                each.phones.ends,
                each.positions,
                each.times,
                each.values,
            )
