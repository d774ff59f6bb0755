"""What ``mocap-fit simulate`` writes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from corpus_tools import console
from corpus_tools.console import Status
from corpus_tools.simulate.session import Conditions, Session
from mocap_fit.errors import ConfigurationError, MocapFitError
from mocap_fit.face import load_face
from mocap_fit.fitting import load_layout
from mocap_fit.tracks import write_parquet


def run(
    out: Path,
    *,
    utterances: int,
    seed: int,
    layout: str,
    conditions: Conditions,
    head: dict[str, float] | None = None,
    progress: Callable[[int], object] | None = None,
) -> Status:
    """Write a simulated session: recordings, the reference pose, and the truth beside them.

    Parameters
    ----------
    out
        A folder that does not exist yet, or is empty.
    utterances
        Number of recordings.
    seed
        The same seed gives the same files.
    layout
        A layout's name or file.
    conditions
        What the session is like.
    head
        Proportions of the speaker's head, for `reshape_head`; the built-in head where not given.
    progress
        Called with the number of recordings written so far.
    """
    from mocap_fit.io import write_qualisys_tsv

    session = _session(out, layout, conditions, head)
    folders = [out / "recordings", out / "truth" / "tracks", out / "truth" / "head"]
    for folder in (out, *folders):
        console.make_folder(folder)
    generators = np.random.default_rng(seed).spawn(utterances + 1)
    write_qualisys_tsv(session.reference(generators[0]), out / "reference.tsv")
    width = max(3, len(str(utterances)))
    for i, rng in enumerate(generators[1:]):
        name = f"sim{i + 1:0{width}d}"
        simulation = session.record(rng, name)
        write_parquet(simulation.parameters, folders[1] / f"{name}.parquet")
        write_parquet(simulation.pose.replace(name=name), folders[2] / f"{name}.parquet")
        # The recording comes last: where it is, its truth is too.
        write_qualisys_tsv(simulation.recording, folders[0] / f"{name}.tsv")
        if progress is not None:
            progress(i + 1)
    return Status.DONE


def _session(
    out: Path, layout: str, conditions: Conditions, head: dict[str, float] | None
) -> Session:
    from mocap_fit.face.builtin import built_in_head, reshape_head

    if out.is_dir() and any(out.iterdir()):
        raise ConfigurationError(
            "the folder for the simulation is not empty",
            path=str(out),
            advice="Give a new folder, or empty this one.",
        )
    face = load_face()
    if head:
        face = load_face(mesh=reshape_head(built_in_head(), **head))
    try:
        return Session(load_layout(layout), face, conditions)
    except MocapFitError as error:
        raise console.located(error, layout) from None
