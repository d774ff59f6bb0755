"""Convert one utterance: its recording, labels and sound → its files in the corpus."""

from __future__ import annotations

import contextlib
import hashlib
import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from corpus_tools.batch import Context, catch_warnings
from corpus_tools.conversion.material import (
    add_energy,
    check_times,
    describe_clock,
    read_labels,
    read_recording,
    remove_pulses,
    synchronise_recording,
)
from corpus_tools.conversion.plan import AUDIO, PARTS, Settings, UtteranceItem
from mocap_fit.atomic_file import write_atomically
from mocap_fit.errors import DataError, MocapFitWarning, add_path
from mocap_fit.fitting.memory import check_memory
from mocap_fit.phones import write_phones
from mocap_fit.plain_text import to_unicode
from mocap_fit.size_limit import sum_file
from mocap_fit.sound import Sound, is_plain_wav, read_sound, write_sound
from mocap_fit.tracks import write_parquet

STEP = "convert"
"""The last step in the provenance of every file, and in that of the corpus."""


@dataclass(frozen=True, eq=False)
class ConversionJob:
    """How the utterances of a corpus are converted.

    Parameters
    ----------
    settings
        What they share.
    step
        The last step in the provenance of every file.
    """

    settings: Settings
    step: str = STEP

    def compute_fingerprint(self, item: UtteranceItem, sums: Mapping[str, str]) -> str:
        """Return a sum over everything that the files of an utterance depend on.

        Parameters
        ----------
        item
            The utterance.
        sums
            SHA-256 of each of its files, by path.

        Returns
        -------
        str
            The sum, as hexadecimal digits.
        """
        entry, named = item.entry, [[path, sums[path]] for path in item.sources]
        shared = self.settings.fingerprints[entry.reference]
        about = [shared, entry.id, entry.start_time, named]
        if item.edits is not None:
            about.append(item.edits.digest)
        return hashlib.sha256(json.dumps(about).encode()).hexdigest()

    def is_complete(self, item: UtteranceItem, out: Path, figures: Mapping[str, Any]) -> bool:
        """Whether the sound of an earlier conversion is there unchanged.

        Parameters
        ----------
        item
            The utterance.
        out
            Folder of the corpus.
        figures
            What the tracks say of the utterance.

        Returns
        -------
        bool
            False where the utterance must be converted again.
        """
        with contextlib.suppress(OSError):
            path = out / AUDIO / f"{item.name}.wav"
            return "audio" not in figures or sum_file(path) == str(figures["audio"])
        return False

    def process(self, item: UtteranceItem, context: Context) -> dict[str, Any]:
        """Convert an utterance and write its files, the tracks last.

        Parameters
        ----------
        item
            The utterance.
        context
            Where it is converted.

        Returns
        -------
        dict[str, Any]
            What report and table say of the utterance.

        Raises
        ------
        MocapFitError
            If its files cannot be used.
        """
        settings, name = self.settings, item.name
        speaker = settings.speakers[item.entry.reference]
        with catch_warnings(context.rename_paths) as checks:
            with context.time("reading"):
                recording = read_recording(settings, context.folder, item)
                check_memory(
                    recording.frames,
                    len(recording.names),
                    smooth=settings.options["smooth"],
                    path=context.folder / item.recording,
                    processes=context.processes,
                    free=context.free_memory,
                )
                sound = None if item.sound is None else read_sound(context.folder / item.sound)
                rate = None if sound is None else sound.rate
                phones = read_labels(settings, context.folder, item, rate)
            recorded_rate = recording.rate
            with context.time("synchronising"):
                recording, sync = synchronise_recording(settings, item, recording, sound)
                speech = remove_pulses(settings, sound)
            check_times(settings, item, phones, recording, speech)
            if speech is not None:
                phones = add_energy(phones, speech)
            try:
                with context.time("head_motion"):
                    still, motion = speaker.remove_head_motion(recording)
                with context.time("fitting"):
                    result = speaker.fit_shape(
                        still,
                        **settings.options,
                        progress=lambda frames: context.progress(frames, still.frames),
                    )
            except DataError as error:
                raise add_path(error, item.recording) from None
        fitted = np.isfinite(result.parameters.residuals)
        if not fitted.any():
            raise DataError("no frame could be fitted", path=item.recording)
        with context.time("writing"):
            inputs = {"inputs": context.fingerprint}
            figures: dict[str, Any] = {
                **inputs,
                "frames": recording.frames,
                "fitted": int(fitted.sum()),
                "duration": result.parameters.duration,
                "recorded_rate": recorded_rate,
                "phones": len(phones),
                "residual_mm": float(np.median(result.parameters.residuals[fitted])),
                "head_residual_mm": float(np.nanmedian(motion.residuals)),
                "sync": sync,
                "sources": [to_unicode(source) for source in item.sources],
                "checks": [*describe_clock(sync, recording.frames), *checks],
            }
            if item.sound is not None and speech is not None:
                target = context.out / AUDIO / f"{name}.wav"
                source = context.folder / item.sound if speech is sound else None
                figures["audio"] = _write_audio(target, speech, source)
            files = {part: context.out / part / f"{name}.parquet" for part in PARTS}
            write_parquet(recording.replace(name=name).add_step(STEP, inputs), files["markers"])
            write_parquet(motion.pose.replace(name=name).add_step(STEP, inputs), files["head"])
            write_phones(phones.replace(name=name).add_step(STEP, inputs), files["phones"])
            tracks = result.parameters.replace(name=name).add_step(STEP, figures)
            write_parquet(tracks, files["tracks"])
        # The report shows them too.
        for line in checks:
            warnings.warn(line, MocapFitWarning, stacklevel=1)
        return figures


def _write_audio(target: Path, speech: Sound, source: Path | None) -> str:
    """Write the sound, or copy a wav file that is unchanged; return the SHA-256 of the file."""
    if source is None or not is_plain_wav(source):
        write_sound(speech, target)
    else:
        with write_atomically(target) as partial:
            partial.write_bytes(source.read_bytes())
    return sum_file(target)
