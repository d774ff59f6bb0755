"""``mocap-fit export``: face parameters for other programs."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from corpus_tools.talking.measured import read_parameters
from mocap_fit.atomic_file import check_targets, remove_partials, write_text
from mocap_fit.errors import ConfigurationError
from mocap_fit.face import load_face
from mocap_fit.phones import PhoneSequence, read_stored_phones
from mocap_fit.size_limit import check_size
from mocap_fit.tracks import ParameterTracks

Format = Literal["gltf", "fap", "csv"]
FORMATS: tuple[Format, ...] = ("gltf", "fap", "csv")
_ENDINGS = {"gltf": (".glb", ".gltf"), "fap": (".fap",), "csv": (".csv",)}


@dataclass(frozen=True, eq=False)
class ExportReport:
    """What a run of `export` has written.

    Parameters
    ----------
    file
        The file.
    format
        Its format.
    rate
        Frames per second, hertz.
    frames
        Number of frames.
    morph_targets
        Names of the morph targets of a glTF file; else None.
    largest_error
        Largest distance of its vertices from those of the face, millimetres; None for other
        formats.
    """

    file: Path
    format: Format
    rate: float
    frames: int
    morph_targets: tuple[str, ...] | None = None
    largest_error: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON can hold it.

        Returns
        -------
        dict[str, Any]
            The fields that have a value.
        """
        content = dict(vars(self))
        targets, error = content.pop("morph_targets"), content.pop("largest_error")
        if targets is not None:
            content |= {"morph_targets": list(targets), "largest_error_mm": round(error, 4)}
        return content

    def __repr__(self) -> str:
        return f"ExportReport({self.frames} frames, file={self.file})"


def export(
    tracks: str | os.PathLike[str],
    to: Format,
    out: str | os.PathLike[str],
    *,
    face: str = "built-in",
    rate: float | None = None,
) -> ExportReport:
    """Write face parameters for other programs.

    Parameters
    ----------
    tracks
        Face parameters (Parquet).
    to
        ``gltf``: the head with morph targets and their animation, and with a tongue that moves by
        the phones where the tracks are those of a corpus; ``fap``: MPEG-4 facial
        animation parameters; ``csv``: one column per parameter.
    out
        The file.
    face
        The face that moves, ``built-in`` or a rig file; not used for ``csv``.
    rate
        Frames per second, hertz; None for that of the tracks.

    Returns
    -------
    ExportReport
        What was written.

    Raises
    ------
    MocapFitError
        If the tracks cannot be read, do not belong to the face, or the file cannot be written.
    """
    file = Path(out)
    if file.suffix.lower() not in _ENDINGS[to]:
        raise ConfigurationError(
            f"the file has the wrong ending for {to}",
            path=out,
            found=file.suffix or "no ending",
            expected=f"a name in {' or '.join(_ENDINGS[to])}",
        )
    check_targets([file], [tracks, face])
    remove_partials(file)
    parameters = read_parameters(Path(tracks))
    used = rate or parameters.rate
    # The rate of a damaged file may be that of years.
    numbers = parameters.duration * used * (len(parameters.names) + 1)
    check_size(int(8 * numbers), path=tracks, noun="movement at this rate")
    if to == "csv":
        return ExportReport(file, to, used, _write_csv(parameters, file, rate))
    if to == "fap":
        from mocap_fit.render.fap import write_fap

        return ExportReport(file, to, used, write_fap(parameters, file, load_face(face), rate=rate))
    from mocap_fit.render.gltf import write_gltf

    blended = write_gltf(
        parameters,
        file,
        load_face(face, tongue=None),
        rate=rate,
        phones=_find_phones(Path(tracks)),
    )
    frames = len(blended.times)
    return ExportReport(file, to, used, frames, tuple(blended.names), blended.largest_error)


def _find_phones(tracks: Path) -> PhoneSequence | None:
    """Return the phones of tracks that are in a corpus, by which their tongue moves."""
    beside = tracks.resolve().parent.parent / "phones" / tracks.name
    return read_stored_phones(beside) if beside.is_file() else None


def _write_csv(tracks: ParameterTracks, out: Path, rate: float | None) -> int:
    """Write one line per frame; missing values are empty."""
    import pandas as pd

    times, values = tracks.times, tracks.values
    if rate is not None and rate != tracks.rate:
        frames = max(1, int(np.floor((tracks.frames - 1) * rate / tracks.rate + 1e-6)) + 1)
        times = tracks.start_time + np.arange(frames, dtype=np.float64) / rate
        # A frame whose nearest one is missing stays missing.
        nearest = np.rint((times - tracks.start_time) * tracks.rate).astype(int)
        known = np.isfinite(values[np.clip(nearest, 0, tracks.frames - 1)])
        values = np.where(known, tracks.at(times), np.nan)
    frame = pd.DataFrame(np.column_stack([times, values]), columns=["time", *tracks.names])
    write_text(out, frame.to_csv(index=False, float_format="%.6f", lineterminator="\n"))
    return len(times)
