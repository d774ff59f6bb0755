"""Figures of a fit beside its truth: tracks, residuals, accuracy, faces, head motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from corpus_tools.demonstration.comparison import Accuracy, FittedRecording, compute_pose_errors
from mocap_fit.drawing import BLUE, GREEN, GREY, INK, ORANGE, PALE, RED, create_figure, write_title
from mocap_fit.fitting import Binding
from mocap_fit.tracks import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_SHADE: dict[str, Any] = {"alpha": 0.35, "lw": 0}
_MARK: dict[str, Any] = {"ms": 6, "mec": "white", "mew": 0.7, "ls": "none"}


def draw_tracks(recording: FittedRecording, speaker: str) -> Figure:
    """Draw every parameter over time: truth, fit, and two standard deviations around the fit.

    Parameters
    ----------
    recording
        The recording.
    speaker
        Whose it is, for the title.

    Returns
    -------
    Figure
        The figure.
    """
    from matplotlib.patches import Patch

    fit, truth = recording.fit.parameters, recording.truth
    times, count, columns = truth.times, len(truth.names), 2
    rows = -(-count // columns)
    size, heights = (10.5, 1.25 * rows + 1.5), [1.0] * rows + [0.55]
    figure, axes = create_figure(size, rows + 1, columns, height_ratios=heights, sharex=True)
    for i, name in enumerate(truth.names):
        axis: Axes = axes[i // columns, i % columns]
        deviation = 2 * fit.standard_deviations[:, i]
        # Where the markers do not determine the parameter, the band fills the panel.
        deviation = np.where(np.isinf(deviation), 10.0, deviation)
        value = fit.values[:, i]
        axis.plot(times, truth.values[:, i], color=INK, lw=2.6, alpha=0.35, label="truth")
        band = (value - deviation, value + deviation)
        axis.fill_between(times, *band, **_SHADE, color=ORANGE, label="±2 standard deviations")
        axis.plot(times, value, color=BLUE, lw=1.1, label="fit")
        axis.set_title(name.replace("_", " "), pad=3)
        axis.set(ylim=(-0.65, 1.25), yticks=[-0.5, 0, 0.5, 1])
        axis.grid(axis="y")
        _shade(axis, times, ~recording.motion.known)
    for axis in axes[rows]:
        gaps = recording.hidden.sum(axis=1)
        axis.fill_between(times, gaps, step="mid", color=GREY, lw=0)
        axis.locator_params(axis="y", nbins=3, integer=True)
        axis.set_title(f"face markers hidden (of {recording.hidden.shape[1]})", pad=3)
        axis.set(xlabel="time (s)", xlim=(times[0], times[0] + truth.duration))
        axis.set_ylim(0, max(5, int(gaps.max())))
        _shade(axis, times, ~recording.motion.known)
    for spare in axes[:rows].ravel()[count:]:
        spare.axis("off")
    figure.supylabel("parameter (0 rest, 1 full gesture)", fontsize=9)
    whose = f"{truth.name} of {speaker}"
    write_title(figure, f"Face parameters of the recording {whose}: truth and fit")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    if not recording.motion.known.all():
        handles.append(Patch(color=RED, alpha=0.25, lw=0))
        labels.append("head pose not known")
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


def draw_residuals(recording: FittedRecording) -> Figure:
    """Draw how far the markers are from the fitted face, over time and by marker.

    Parameters
    ----------
    recording
        The recording.

    Returns
    -------
    Figure
        The figure.
    """
    import matplotlib

    residuals, times = recording.fit.marker_residuals, recording.truth.times
    markers = residuals.shape[1]
    figure, axes = create_figure(
        (10.5, 7.2), 2, 2, height_ratios=[1, 3.6], width_ratios=[3.4, 1], sharex="col"
    )
    over_time, corner, heat, by_marker = axes.ravel()
    corner.axis("off")
    rms = recording.fit.parameters.residuals
    over_time.plot(times, rms, color=BLUE, lw=1.2)
    over_time.axhline(float(np.nanmedian(rms)), color=GREY, lw=1, ls="--")
    over_time.set(ylim=(0, 1.25 * float(np.nanmax(rms))), ylabel="RMS (mm)")
    over_time.set_title(f"each frame (dashed: the median, {np.nanmedian(rms):.2f} mm)", pad=3)
    over_time.grid(axis="y")
    _shade(over_time, times, ~recording.motion.known)

    half = 0.5 / recording.truth.rate
    extent = (times[0] - half, times[-1] + half, markers - 0.5, -0.5)
    image = heat.imshow(residuals.T, aspect="auto", interpolation="nearest", extent=extent)
    image.set_cmap(matplotlib.colormaps["viridis"].with_extremes(bad=PALE))
    image.set_clim(0, float(np.nanpercentile(residuals, 99.5)))
    heat.set_yticks(range(markers), [n.replace("_", " ") for n in recording.fit.marker_names])
    heat.tick_params(axis="y", labelsize=7, length=0)
    heat.set_title("each marker in each frame", pad=3)
    heat.set_xlabel("time (s)")
    bar = figure.colorbar(image, ax=heat, location="bottom", shrink=0.55, pad=0.02, aspect=40)
    bar.set_label("distance from the fitted face (mm); grey: hidden")
    bar.outline.set_visible(False)

    root = np.sqrt(np.nanmean(residuals**2, axis=0))
    by_marker.barh(range(markers), root, color=BLUE, height=0.7)
    by_marker.set(ylim=(markers - 0.5, -0.5), yticks=[], xlabel="RMS (mm)")
    by_marker.spines["left"].set_visible(False)
    by_marker.set_title("each marker", pad=3)
    by_marker.grid(axis="x")
    write_title(figure, f"Residuals of the recording {recording.truth.name}")
    return figure


def draw_accuracy(by_objective: dict[str, Accuracy], noise: float) -> Figure:
    """Draw the error of each parameter and its bound in one frame, for several objectives.

    Parameters
    ----------
    by_objective
        Errors by the name of the objective.
    noise
        Standard deviation of a coordinate of a marker, millimetres.

    Returns
    -------
    Figure
        The figure.
    """
    first = next(iter(by_objective.values()))
    rows = np.arange(len(first.names))
    figure, axes = create_figure((8.0, 4.6), 1, 1)
    axis: Axes = axes[0, 0]
    axis.barh(
        rows, 100 * first.bounds, color=PALE, height=0.72, label="Cramér-Rao bound of one frame"
    )
    looks = (("o", BLUE, -0.14), ("D", RED, 0.14))
    for (objective, result), (mark, colour, shift) in zip(by_objective.items(), looks, strict=True):
        label = f"RMS error, {objective}"
        axis.plot(100 * result.errors, rows + shift, mark, **_MARK, color=colour, label=label)
    axis.set_yticks(rows, [name.replace("_", " ") for name in first.names])
    axis.tick_params(axis="y", length=0)
    axis.invert_yaxis()
    axis.set_xlabel("% of a full gesture (1.0 of the parameter)")
    axis.set_xlim(left=0)
    axis.grid(axis="x")
    figure.legend(loc="outside lower center", ncols=1 + len(by_objective))
    write_title(figure, f"Error of the parameters and its bound: {noise:g} mm of marker noise")
    return figure


def draw_head(recording: FittedRecording) -> Figure:
    """Draw the head's estimated motion, the true one, and the difference.

    Parameters
    ----------
    recording
        The recording.

    Returns
    -------
    Figure
        The figure.
    """
    motion, truth, times = recording.motion, recording.true_pose, recording.truth.times
    figure, axes = create_figure(
        (10.5, 5.4), 2, 2, height_ratios=[2.4, 1], sharex=True, gridspec_kw={"wspace": 0.12}
    )
    centre = motion.centre
    shifts = (
        motion.rotations @ centre + motion.translations - centre,
        truth.rotations[:, 0] @ centre + truth.translations[:, 0] - centre,
    )
    turns = (np.full((len(times), 3), np.nan), np.full((len(times), 3), np.nan))
    for turn, rotations in zip(turns, (motion.rotations, truth.rotations[:, 0]), strict=True):
        known = np.isfinite(rotations).all(axis=(1, 2))
        turn[known] = Rotation.from_matrix(rotations[known]).as_rotvec(degrees=True)
    names = (
        ("x, to the side", "y, back and forth", "z, up and down"),
        ("about x (nod)", "about y (tilt)", "about z (turn)"),
    )
    errors, units = compute_pose_errors(motion, truth), ("mm", "degrees")
    for column, (estimate, true) in enumerate((shifts, turns)):
        axis, below = axes[:, column]
        for i, colour in enumerate((BLUE, RED, GREEN)):
            axis.plot(times, true[:, i], color=colour, lw=5, alpha=0.25, solid_capstyle="butt")
            axis.plot(times, estimate[:, i], color=colour, lw=1.2, label=names[column][i])
        axis.axhline(0, color=GREY, lw=0.8)
        axis.grid(axis="y")
        axis.set_ylabel(f"{('shift', 'turn')[column]} ({units[column]})")
        axis.margins(y=0.12)
        axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, handlelength=1.2)
        error = np.degrees(errors[1]) if column else errors[0]
        below.plot(times, error, color=INK, lw=1)
        below.set(xlabel="time (s)", ylabel=f"error ({units[column]})")
        below.set_xlim(times[0], times[0] + recording.truth.duration)
        below.set_ylim(0, 1.2 * float(np.nanmax(error)))
        below.grid(axis="y")
        for panel in (axis, below):
            _shade(panel, times, ~motion.known)
    write_title(
        figure,
        f"Head motion of the recording {recording.truth.name} (thin: estimate, broad: truth), at "
        "the centre of the reference markers",
    )
    return figure


def draw_faces(recording: FittedRecording, binding: Binding, frames: Sequence[int]) -> Figure:
    """Draw the head in some fitted frames, with the measured markers and the fitted ones on it.

    Parameters
    ----------
    recording
        The recording.
    binding
        The virtual markers that were fitted.
    frames
        Indices of the frames.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    MissingExtraError
        If this machine cannot draw faces.
    """
    from matplotlib.lines import Line2D

    from mocap_fit.render import FaceScene

    positions = binding.orientation.apply(recording.in_head_coordinates)
    columns = recording.recording.indices(binding.names)
    mesh = binding.rig.mesh
    corners = binding.vertex_ids[binding.corners[:, 0]]
    size = (420, 500)
    figure, axes = create_figure(
        (2.1 * len(frames), 5.6), 2, len(frames), gridspec_kw={"wspace": 0.0, "hspace": 0.0}
    )
    for row, view in enumerate(("front", "three-quarter")):
        centre = mesh.vertices[mesh.get_feature_point("9.3")] * (0.15, 1.0, 0.3) - (0.0, 22.0, 0.0)
        with FaceScene(mesh, view=view, size=size, zoom=1.5, centre=centre) as scene:  # type: ignore[arg-type]
            for column, frame in enumerate(frames):
                values = recording.fit.parameters.values[frame]
                vertices = binding.rig.deform(values)
                virtual, _ = binding.evaluate(values)
                # The far side of the head hides its markers.
                towards = scene.camera_position - virtual
                towards /= np.linalg.norm(towards, axis=1, keepdims=True)
                seen = np.sum(towards * mesh.compute_normals(vertices)[corners], axis=1) > 0.12
                measured = np.where(seen[:, None], positions[frame, columns], np.nan)
                virtual = np.where(seen[:, None], virtual, np.nan)
                axis: Axes = axes[row, column]
                axis.imshow(scene.draw(vertices))
                axis.plot(*scene.project(measured).T, "o", color=BLUE, ms=2.6, mew=0)
                axis.plot(*scene.project(virtual).T, "o", mfc="none", mec=ORANGE, ms=5, mew=1)
                axis.set(xlim=(0, size[0]), ylim=(size[1], 0))
                axis.axis("off")
                if row == 0:
                    axis.set_title(f"{recording.truth.times[frame]:.2f} s", loc="center", pad=3)
    measured_look: dict[str, Any] = {"color": BLUE, "ms": 5, "mew": 0}
    fitted_look: dict[str, Any] = {"mfc": "none", "mec": ORANGE, "ms": 7, "mew": 1.4}
    looks = {
        "measured marker": measured_look,
        "the same on the fitted face (alone: hidden from the cameras)": fitted_look,
    }
    handles = [Line2D([], [], marker="o", ls="none", label=n, **look) for n, look in looks.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    write_title(figure, f"The face fitted to the recording {recording.truth.name}")
    return figure


def choose_frames(
    recording: FittedRecording, count: int, *, least_distance: float = 0.2
) -> list[int]:
    """Choose fitted frames whose faces differ much from each other.

    Parameters
    ----------
    recording
        The recording.
    count
        Largest number of frames.
    least_distance
        Time between any two of them, seconds.

    Returns
    -------
    list[int]
        Indices of frames, in ascending order.
    """
    values, times = recording.fit.parameters.values, recording.truth.times
    usable = np.isfinite(values).all(axis=1)
    chosen: list[int] = []
    # The first is the most expressive; each next is the farthest from those before.
    apart = np.sum(values**2, axis=1)
    while len(chosen) < count and usable.any():
        best = int(np.argmax(np.where(usable, apart, -1.0)))
        distance = np.sum((values - values[best]) ** 2, axis=1)
        apart = np.minimum(apart, distance) if chosen else distance
        chosen.append(best)
        usable &= np.abs(times - times[best]) > least_distance
    return sorted(chosen)


def _shade(axis: Axes, times: FloatArray, where: NDArray[np.bool_]) -> None:
    """Mark frames over the complete height of a panel."""
    half = 0.5 * (times[1] - times[0])
    for time in times[where]:
        axis.axvspan(time - half, time + half, color=RED, alpha=0.25, lw=0)
