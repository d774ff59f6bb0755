"""The file of a trained model: arrays and JSON in one numpy archive, which runs nothing."""

from __future__ import annotations

import io
import json
import math
import os
import warnings
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import FileFormatError, MocapFitError, from_os_error
from mocap_fit.parsing import parse_json
from mocap_fit.plain_text import to_unicode
from mocap_fit.size_limit import check_size, measure_file

FORMAT_VERSION = 2
_HEADER = "header"


def write_model_file(
    header: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray[Any, Any]],
    path: str | os.PathLike[str],
) -> None:
    """Write a header and arrays, completely or not at all; equal content gives equal bytes.

    Parameters
    ----------
    header
        Values that JSON can hold; ``format_version`` is added.
    arrays
        Arrays of numbers of any shape ``(...)``, by name.
    path
        The file; an existing one is replaced.

    Raises
    ------
    FileFormatError
        If the file cannot be written.
    """
    text = json.dumps({"format_version": FORMAT_VERSION, **header}, ensure_ascii=False)
    content = np.frombuffer(to_unicode(text).encode(), dtype=np.uint8)
    with write_atomically(path, "model") as partial, open(partial, "wb") as stream:
        np.savez(stream, allow_pickle=False, **{_HEADER: content}, **arrays)


def read_model_file(
    path: str | os.PathLike[str],
) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
    """Read what `write_model_file` wrote.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    header
        The values.
    arrays
        Arrays of numbers of any shape ``(...)``, by name.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file is something else, is damaged, or has another version of the format.
    """
    length = measure_file(path)
    try:
        with (
            open(path, "rb") as stream,
            zipfile.ZipFile(stream) as archive,
            warnings.catch_warnings(),
        ):
            # Of damaged headers, which numpy takes for those of Python 2.
            warnings.simplefilter("ignore", UserWarning)
            members = archive.infolist()
            # They are stored as they are: what is unpacked is no longer than the file.
            size = sum(member.file_size for member in members)
            check_size(size, path=path, available_bytes=length, noun="model")
            arrays = {
                member.filename.removesuffix(".npy"): _parse_array(archive.read(member))
                for member in members
            }
        header = parse_json(arrays.pop(_HEADER).tobytes())
        version = header["format_version"]
    except MocapFitError:
        raise
    except OSError as error:
        raise from_os_error(error, path, "model") from None
    # A changed byte makes zip files, numpy and JSON raise almost anything.
    except Exception as error:
        raise FileFormatError(
            "this is not a trained model of mocap-fit, or it is damaged",
            path=path,
            found=error,
            expected="a file that mocap-fit train wrote",
        ) from None
    if version != FORMAT_VERSION:
        raise FileFormatError(
            "this model has a format that this version of mocap-fit does not read",
            path=path,
            found=f"format_version {version}",
            expected=FORMAT_VERSION,
            advice="Update mocap-fit, or train the model again.",
        )
    return header, arrays


def _parse_array(data: bytes) -> np.ndarray[Any, Any]:
    """Return the numbers in an .npy file; anything else, such as objects, is a ValueError."""
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_2_0
    if version == (1, 0):
        read_header = np.lib.format.read_array_header_1_0
    shape, is_fortran, dtype = read_header(stream)
    if dtype.kind not in "biuf":
        raise ValueError(f"an array of {dtype}")
    if math.prod(shape) * dtype.itemsize != len(data) - stream.tell():
        raise ValueError(f"an array of {shape} in {len(data)} bytes")
    values = np.frombuffer(bytearray(data), dtype, math.prod(shape), stream.tell())
    return values.reshape(shape, order="F" if is_fortran else "C")
