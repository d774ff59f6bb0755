"""``mocap-fit fit``: recordings and a reference pose → face parameters, a Parquet file each."""

from __future__ import annotations

import glob
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from corpus_tools import console
from corpus_tools.console import Status
from mocap_fit.errors import ConfigurationError, DataError, MocapFitError
from mocap_fit.face import load_face, parameters_from
from mocap_fit.fitting import (
    Binding,
    Layout,
    ShapeFit,
    bind_markers,
    fit_orientation,
    fit_shape,
    load_layout,
)
from mocap_fit.fitting.objective import Objective
from mocap_fit.fitting.orientation import reference_pose
from mocap_fit.head import HeadMotion, match_size, remove_head_motion
from mocap_fit.io import READERS, read_tracks
from mocap_fit.tracks import MarkerTracks, write_parquet
from mocap_fit.tracks.rigid import refusal


@dataclass(frozen=True)
class Options:
    """How recordings are fitted; see `mocap_fit.fitting.fit_shape`."""

    objective: Objective = "distances"
    solver: str = "newton-nlopt"
    refine_pose: bool = False


@dataclass(frozen=True, eq=False)
class Speaker:
    """All that the recordings of one speaker share.

    Parameters
    ----------
    layout
        The marker layout.
    reference
        The reference pose; its coordinates are the speaker's head coordinates.
    binding
        The virtual markers on the face.
    face_name
        The face, as the user named it.
    """

    layout: Layout
    reference: MarkerTracks
    binding: Binding
    face_name: str

    @classmethod
    def load(cls, reference: Path, layout: str, face: str) -> Speaker:
        """Read the reference pose and tie the layout's markers to the face."""
        markers = load_layout(layout)
        rig = load_face(face)
        pose = read_tracks(reference)
        absent = [m.name for m in markers.markers if m.name not in pose.names]
        if absent:
            raise DataError(
                f"the reference pose lacks {len(absent)} of the {len(markers.markers)} markers of "
                f"the layout '{markers.name}': {', '.join(absent)}",
                path=str(reference),
                found=", ".join(pose.names),
                advice="Choose the layout that it was recorded with, or correct the names.",
            )
        try:
            parameters_from(markers.reference_parameters, rig.parameter_names)
        except DataError as error:
            raise console.located(error, layout) from None
        try:
            _check_head(markers, pose)
            orientation = fit_orientation(rig, markers, pose)
            binding = bind_markers(rig, markers, pose, orientation)
        except DataError as error:
            raise console.located(error, reference) from None
        except ConfigurationError as error:
            raise console.located(error, layout) from None
        return cls(markers, pose, binding, Path(face).name)

    def fit(
        self,
        recording: MarkerTracks,
        options: Options,
        progress: Callable[[int], object] | None = None,
    ) -> tuple[ShapeFit, HeadMotion]:
        """Remove the head's motion from a recording and fit its frames."""
        weights = {m.name: m.weight for m in self.layout.head_markers}
        if self.layout.size_varies:
            recording, _ = match_size(recording, self.reference, tuple(weights))
        still, motion = remove_head_motion(
            recording, self.reference, names=tuple(weights) or None, weights=weights or None
        )
        still = still.with_step(
            "bind_markers",
            {
                "layout": self.layout.name,
                "face": self.face_name,
                "reference": self.reference.name,
                "scale": self.binding.orientation.scale,
            },
        )
        result = fit_shape(
            self.binding,
            still,
            objective=options.objective,
            solver=options.solver,
            refine_pose=options.refine_pose,
            progress=progress,
        )
        return result, motion


def _check_head(layout: Layout, reference: MarkerTracks) -> None:
    """Refuse a reference pose that tells no head pose, once and not for every recording."""
    places = reference_pose(reference)
    names = [m.name for m in layout.head_markers]
    reason = None
    if names:
        unseen = np.full(3, np.nan)
        reason = refusal(np.array([places.get(name, unseen) for name in names]))
    if reason is not None:
        raise DataError(
            "the head's pose cannot be told from the head markers in the reference pose",
            found=reason,
            expected=f"three or more of {', '.join(names)}, not on a line",
            advice="Record the reference pose with all head markers in view.",
        )


def expand(paths: Sequence[Path]) -> list[Path]:
    """Files that the user means: themselves, those of a folder, or those of a pattern.

    Shells on Windows do not expand patterns, so they are expanded here.

    Raises
    ------
    ConfigurationError
        If a folder or a pattern holds no recording, or two recordings have one name.
    """
    known = {ending for name in READERS.names() for ending in READERS.get(name).extensions}
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            found = sorted(f for f in path.iterdir() if f.suffix.lower() in known and f.is_file())
        elif not path.exists() and glob.has_magic(str(path)):
            found = sorted(Path(name) for name in glob.glob(str(path)))
        else:
            found = [path]
        if not found:
            raise ConfigurationError(
                "no recording is there",
                path=str(path),
                expected=f"files that end in {', '.join(sorted(known))}",
            )
        files += found
    files = list(dict.fromkeys(files))
    by_name: dict[str, Path] = {}
    for file in files:
        twin = by_name.setdefault(file.stem, file)
        if twin != file:
            raise ConfigurationError(
                f"two recordings are called '{file.stem}' and would overwrite each other's result",
                found=f"{twin} and {file}",
                advice="Rename one, or fit them into two folders.",
            )
    return files


def run(
    recordings: Sequence[Path],
    *,
    reference: Path,
    layout: str,
    out: Path,
    face: str = "built-in",
    options: Options | None = None,
    as_json: bool = False,
) -> Status:
    """Fit recordings and write ``OUT/ID.parquet`` for each.

    A recording that cannot be fitted is named on stderr and does not keep the others from it.

    Parameters
    ----------
    recordings
        Files, folders or patterns.
    reference
        A recording of the reference pose; the median over its frames is used.
    layout
        A layout's name or file.
    out
        The folder to write to; made where it is not there.
    face
        ``built-in``, or a rig file.
    options
        How to fit.
    as_json
        Print what was done as one JSON object on stdout.

    Returns
    -------
    Status
        `BAD_DATA` if any recording was not fitted.
    """
    files = expand(recordings)
    speaker = Speaker.load(reference, layout, face)
    console.make_folder(out)
    options = options or Options()
    rows: list[dict[str, Any]] = []
    status = Status.DONE
    with console.progress("fitting recordings", len(files)) as advance:
        for file in files:
            try:
                row = _fit_file(file, speaker, options, out / f"{file.stem}.parquet")
            except (MocapFitError, OSError) as error:
                told = console.located(error, file) if isinstance(error, MocapFitError) else error
                console.report(told)
                row = {"recording": file.stem, "file": file, "error": console.describe_error(told)}
                status = Status.BAD_DATA
            rows.append(row)
            advance()
    orientation = speaker.binding.orientation
    if as_json:
        console.print_json(
            {
                "layout": speaker.layout.name,
                "scale": orientation.scale,
                "orientation_residuals_mm": dict(orientation.residuals or {}),
                "recordings": rows,
            }
        )
    else:
        _show(rows, out)
    return status


def _fit_file(file: Path, speaker: Speaker, options: Options, target: Path) -> dict[str, Any]:
    recording = read_tracks(file)
    result, motion = speaker.fit(recording, options)
    write_parquet(result.parameters, target)
    fitted = result.fitted
    return {
        "recording": file.stem,
        "file": file,
        "output": target,
        "frames": len(fitted),
        "fitted": int(fitted.sum()),
        "residual_mm": float(np.median(result.parameters.residuals[fitted])),
        "head_residual_mm": float(np.nanmedian(motion.residuals)),
        "uncertain_frames": int(result.parameters.uncertain.any(axis=1).sum()),
        "unfinished_frames": int(np.isin(result.status, (-1, 5)).sum()),
        "evaluations_per_frame": float(result.evaluations[fitted].mean()),
    }


_COLUMNS = {
    "frames": "frames",
    "fitted": "fitted",
    "residual_mm": "residual mm",
    "head_residual_mm": "head mm",
    "uncertain_frames": "uncertain",
    "evaluations_per_frame": "evaluations",
}
# More recordings than this are summed up, and only the worst are listed.
_LISTED = 20


def _show(rows: list[dict[str, Any]], out: Path) -> None:
    from rich import box
    from rich.table import Table

    done = [row for row in rows if "error" not in row]
    if not done:
        return
    listed, title = done, None
    if len(done) > _LISTED:
        listed = sorted(done, key=lambda row: -float(row["residual_mm"]))[:5]
        title = f"the {len(listed)} recordings with the largest residuals"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("recording", no_wrap=True)
    for label in _COLUMNS.values():
        table.add_column(label, justify="right")
    for row in listed:
        cells = [row[key] for key in _COLUMNS]
        table.add_row(
            row["recording"], *(f"{c:.2f}" if isinstance(c, float) else str(c) for c in cells)
        )
    screen = console.screen()
    screen.print(table)
    frames, fitted = (sum(row[key] for row in done) for key in ("frames", "fitted"))
    middle = float(np.median([row["residual_mm"] for row in done]))
    screen.print(
        f"{len(done)} of {len(rows)} recordings fitted: {fitted} of {frames} frames, median "
        f"residual {middle:.2f} mm. Parameters are in {out}.",
        soft_wrap=True,
    )
