"""``mocap-fit export``: face parameters for other programs."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any, Literal

import numpy as np

from corpus_tools.cli import console
from corpus_tools.cli.console import Status
from corpus_tools.talking.speak import measured
from mocap_fit.atomic_file import write_text
from mocap_fit.errors import ConfigurationError
from mocap_fit.face import load_face
from mocap_fit.tracks import ParameterTracks

Kind = Literal["gltf", "fap", "csv"]
KINDS: tuple[Kind, ...] = ("gltf", "fap", "csv")
_ENDINGS = {"gltf": ".glb", "fap": ".fap", "csv": ".csv"}


def run(
    tracks: Path,
    to: Kind,
    out: Path,
    *,
    face: str = "built-in",
    rate: float | None = None,
    as_json: bool = False,
) -> Status:
    """Write face parameters in another format.

    Parameters
    ----------
    tracks
        Face parameters (Parquet).
    to
        ``gltf``: the head with morph targets and their animation; ``fap``: MPEG-4 facial
        animation parameters; ``csv``: a column a parameter.
    out
        The file.
    face
        The face that moves; of no use to ``csv``.
    rate
        Frames per second; the tracks' own where not given.
    as_json
        Print what was written as JSON.

    Raises
    ------
    MocapFitError
        If the tracks cannot be read, do not belong to the face, or the file cannot be written.
    """
    if out.suffix.lower() != _ENDINGS[to]:
        raise ConfigurationError(
            f"a file of this kind is called otherwise ({to})",
            path=out,
            found=out.suffix or "no ending",
            expected=f"a name in {_ENDINGS[to]}",
        )
    parameters = measured(tracks)
    report: dict[str, Any] = {"file": out, "format": to, "rate": rate or parameters.rate}
    if to == "csv":
        report["frames"] = _write_csv(parameters, out, rate)
    elif to == "fap":
        from mocap_fit.render.fap import write_fap

        report["frames"] = write_fap(parameters, out, load_face(face), rate=rate)
    else:
        from mocap_fit.render.gltf import write_gltf

        blended = write_gltf(parameters, out, load_face(face), rate=rate)
        report["frames"] = len(blended.times)
        report["morph_targets"] = list(blended.names)
        report["largest_error_mm"] = round(blended.largest_error, 4)
    if as_json:
        console.print_json(report)
    else:
        near = ""
        if "largest_error_mm" in report:
            near = (
                f", {len(report['morph_targets'])} morph targets, within "
                f"{report['largest_error_mm']:.2f} mm of the face"
            )
        console.screen().print(f"{report['frames']} frames{near}: {out}", soft_wrap=True)
    return Status.DONE


def _write_csv(tracks: ParameterTracks, out: Path, rate: float | None) -> int:
    """A line a frame; missing values are empty."""
    times, values = tracks.times, tracks.values
    if rate is not None and rate != tracks.rate:
        frames = max(1, int(np.floor((tracks.frames - 1) * rate / tracks.rate + 1e-6)) + 1)
        times = tracks.start_time + np.arange(frames, dtype=np.float64) / rate
        columns = []
        for column in tracks.values.T:
            known = np.isfinite(column)
            bridged = (
                np.interp(times, tracks.times[known], column[known]) if known.any() else np.nan
            )
            # A frame whose nearest one is missing stays missing.
            nearest = np.clip(
                np.rint((times - tracks.start_time) * tracks.rate), 0, len(column) - 1
            )
            columns.append(np.where(known[nearest.astype(int)], bridged, np.nan))
        values = np.stack(columns, axis=1)
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["time", *tracks.names])
    for time, row in zip(times, values, strict=True):
        cells = ["" if np.isnan(value) else f"{value:.6f}" for value in row]
        writer.writerow([f"{time:.6f}", *cells])
    write_text(out, text.getvalue())
    return len(times)
