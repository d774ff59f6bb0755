"""Defects, each planted in an utterance of a clean corpus, and what must be found of it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from mocap_fit.sound import Sound, read_sound, write_sound
from mocap_fit.tracks import (
    MarkerTracks,
    Origin,
    ParameterTracks,
    PoseTracks,
    Step,
    read_parquet,
    write_parquet,
)
from mocap_fit.utterance import read_utterances, write_utterances


@dataclass(frozen=True)
class Expected:
    """A finding that a defect must lead to.

    `item` must be in the finding's, and its frames (seconds) must be those given, to within
    `slack` frames (0.02 s a frame); frames until 10 000 are those to the end. `also` are codes
    that the defect may rightly lead to as well.
    """

    code: str
    item: str = ""
    frames: tuple[int, int] | None = None
    seconds: tuple[float, float] | None = None
    slack: int = 1
    also: frozenset[str] = frozenset()
    utterance: str | None = None
    whole: bool = False


Plant = Callable[[Path, str], Expected]
DEFECTS: dict[str, Plant] = {}


def defect(plant: Plant) -> Plant:
    DEFECTS[plant.__name__] = plant
    return plant


def seed(name: str) -> np.random.Generator:
    return np.random.default_rng(list(name.encode()))


def change_tracks(corpus: Path, part: str, name: str, change) -> None:
    path = corpus / part / f"{name}.parquet"
    write_parquet(change(read_parquet(path)), path)


def change_positions(corpus: Path, name: str, change) -> None:
    """Change `(frames, markers, 3)` in place; what is there afterwards counts as measured."""

    def changed(tracks: MarkerTracks) -> MarkerTracks:
        positions = tracks.positions.copy()
        change(positions, tracks)
        origin = np.where(np.isnan(positions[:, :, 0]), Origin.MISSING, Origin.MEASURED)
        return tracks.replace(positions=positions, origin=origin)

    change_tracks(corpus, "markers", name, changed)


def change_values(corpus: Path, name: str, change) -> None:
    """Change `(frames, parameters)` in place."""

    def changed(tracks: ParameterTracks) -> ParameterTracks:
        values = tracks.values.copy()
        change(values, tracks)
        return tracks.replace(values=values)

    change_tracks(corpus, "tracks", name, changed)


def change_table(path: Path, change) -> None:
    """Change a Parquet file as pandas has it; its description stays."""
    import pyarrow as pa

    table = pq.read_table(path)
    frame = change(table.to_pandas())
    fields = [table.schema.field(c) for c in frame.columns if c in table.column_names]
    metadata = {k: v for k, v in (table.schema.metadata or {}).items() if k == b"mocap_fit"}
    schema = pa.schema(fields, metadata=metadata) if len(fields) == len(frame.columns) else None
    new = pa.Table.from_pandas(frame, schema=schema, preserve_index=False)
    pq.write_table(new.replace_schema_metadata(metadata), path, compression="zstd")


def change_phones(corpus: Path, name: str, change) -> None:
    change_table(corpus / "phones" / f"{name}.parquet", change)


def change_description(path: Path, change) -> None:
    table = pq.read_table(path)
    content = json.loads(table.schema.metadata[b"mocap_fit"])
    change(content)
    pq.write_table(
        table.replace_schema_metadata({b"mocap_fit": json.dumps(content).encode()}), path
    )


def change_sound(corpus: Path, name: str, change) -> None:
    path = corpus / "audio" / f"{name}.wav"
    write_sound(change(read_sound(path)), path)


def change_row(corpus: Path, name: str, **changes) -> None:
    rows = read_utterances(corpus)
    rows = [dataclasses.replace(r, **changes) if r.id == name else r for r in rows]
    write_utterances(rows, corpus)


def phones_of(corpus: Path, name: str):
    return pq.read_table(corpus / "phones" / f"{name}.parquet").to_pandas()


def spoken(corpus: Path, name: str, nth: int = 5) -> int:
    """The row of a phone that is no silence, with others about it."""
    frame = phones_of(corpus, name)
    rows = [k for k in range(2, len(frame) - 2) if (frame["phone"][k - 1 : k + 2] != "sil").all()]
    return rows[nth]


def filled(positions: np.ndarray, marker: int) -> None:
    """Fill the gaps of a marker, so that a defect has a track to be planted in."""
    track = positions[:, marker]
    seen = np.flatnonzero(~np.isnan(track[:, 0]))
    for axis in range(3):
        track[:, axis] = np.interp(np.arange(len(track)), seen, track[seen, axis])


# ---- single markers -----------------------------------------------------------------------------


def _swap(*names: str, part: slice = slice(60, 100)):
    def change(positions, tracks):
        columns = [tracks.index(n) for n in names]
        for column in columns:
            filled(positions, column)
        positions[part, columns] = positions[part, np.roll(columns, 1)]

    return change


@defect
def swapped(corpus, name):
    change_positions(corpus, name, _swap("lip_corner_left", "cheek_left"))
    return Expected("MF106", "lip_corner_left and cheek_left", (60, 99))


@defect
def swapped_lips(corpus, name):
    change_positions(corpus, name, _swap("lip_upper_mid", "lip_lower_mid"))
    return Expected("MF106", "lip_upper_mid and lip_lower_mid", (60, 99))


@defect
def swapped_to_the_end(corpus, name):
    change_positions(corpus, name, _swap("jaw_left", "chin_left", part=slice(120, None)))
    return Expected("MF106", "chin_left and jaw_left", (120, 10_000))


@defect
def swapped_from_the_start(corpus, name):
    change_positions(corpus, name, _swap("jaw_left", "chin_left", part=slice(0, 50)))
    return Expected("MF106", "chin_left and jaw_left", (0, 49))


@defect
def swapped_throughout(corpus, name):
    change_positions(corpus, name, _swap("lip_lower_left", "below_lip_left", part=slice(None)))
    return Expected("MF106", "lip_lower_left and below_lip_left")


@defect
def swapped_three(corpus, name):
    change_positions(corpus, name, _swap("brow_left", "brow_inner_left", "cheekbone_left"))
    return Expected("MF106", "brow_inner_left", (60, 99))


@defect
def head_markers_swapped(corpus, name):
    change_positions(corpus, name, _swap("head_rim_left", "head_temple_left"))
    return Expected(
        "MF106", "head_rim_left and head_temple_left", (60, 99), also=frozenset({"MF125", "MF126"})
    )


@defect
def spike(corpus, name):
    def change(positions, tracks):
        column = tracks.index("chin_mid")
        filled(positions, column)
        positions[70, column] += [14.0, -9.0, 12.0]

    change_positions(corpus, name, change)
    return Expected("MF104", "chin_mid", (70, 70), slack=0)


@defect
def spike_of_two_frames(corpus, name):
    def change(positions, tracks):
        column = tracks.index("lip_upper_mid")
        filled(positions, column)
        positions[70:72, column] += [0.0, 20.0, 0.0]

    change_positions(corpus, name, change)
    return Expected("MF104", "lip_upper_mid", (70, 71), slack=0)


@defect
def stuck(corpus, name):
    def change(positions, tracks):
        column = tracks.index("nose_tip")
        filled(positions, column)
        positions[80:111, column] = positions[80, column]

    change_positions(corpus, name, change)
    return Expected("MF105", "nose_tip", (80, 110))


@defect
def long_gap(corpus, name):
    def change(positions, tracks):
        filled(positions, tracks.index("cheek_left"))
        positions[50:100, tracks.index("cheek_left")] = np.nan

    change_positions(corpus, name, change)
    return Expected("MF102", "cheek_left", (50, 99))


@defect
def many_gaps(corpus, name):
    def change(positions, tracks):
        lost = seed(name).random(len(positions)) < 0.45
        positions[lost, tracks.index("jaw_right")] = np.nan

    change_positions(corpus, name, change)
    return Expected("MF101", "jaw_right")


@defect
def never_seen(corpus, name):
    def change(positions, tracks):
        positions[:, tracks.index("brow_right")] = np.nan

    change_positions(corpus, name, change)
    return Expected("MF103", "brow_right")


@defect
def jump(corpus, name):
    def change(positions, tracks):
        filled(positions, tracks.index("brow_left"))
        positions[100:, tracks.index("brow_left")] += [0.0, 25.0, 15.0]

    change_positions(corpus, name, change)
    return Expected("MF107", "brow_left", (100, 100), slack=0, also=frozenset({"MF127"}))


@defect
def two_names_of_one_marker(corpus, name):
    def change(positions, tracks):
        positions[:, tracks.index("philtrum_left")] = positions[:, tracks.index("lip_upper_left")]

    change_positions(corpus, name, change)
    return Expected("MF108", "lip_upper_left and philtrum_left", also=frozenset({"MF127"}))


@defect
def no_marker_at_all(corpus, name):
    def change(positions, tracks):
        positions[40:52] = np.nan

    change_positions(corpus, name, change)
    return Expected("MF109", "", (40, 51), slack=0)


@defect
def repeated_frames(corpus, name):
    def change(positions, tracks):
        positions[8::8] = positions[7:-1:8]

    change_positions(corpus, name, change)
    return Expected("MF110", "", (8, 8), slack=0)


@defect
def marker_left_out(corpus, name):
    change_tracks(
        corpus,
        "markers",
        name,
        lambda t: t.select([n for n in t.names if n != "chin_mid"]),
    )
    return Expected("MF111", "chin_mid")


@defect
def unknown_marker(corpus, name):
    change_tracks(
        corpus,
        "markers",
        name,
        lambda t: t.replace(
            names=(*t.names, "new_12"),
            positions=np.concatenate([t.positions, t.positions[:, :1] + 33.0], axis=1),
            origin=np.concatenate([t.origin, t.origin[:, :1]], axis=1),
        ),
    )
    return Expected("MF112", "new_12")


# ---- shape and axes -----------------------------------------------------------------------------


def _metres(factor: float):
    def change(positions, tracks):
        positions *= factor

    return change


@defect
def metres_for_millimetres(corpus, name):
    change_positions(corpus, name, _metres(0.001))
    also = frozenset({"MF103", "MF106", "MF108"})
    return Expected("MF121", also=also)


@defect
def face_of_fifteen_metres(corpus, name):
    change_positions(corpus, name, _metres(1000.0))
    return Expected("MF121", also=frozenset({"MF104", "MF107", "MF124", "MF125", "MF106"}))


@defect
def size_of_another_speaker(corpus, name):
    change_positions(corpus, name, _metres(1.2))
    return Expected("MF121")


@defect
def mirrored_axis(corpus, name):
    def change(positions, tracks):
        positions[:, :, 0] *= -1.0

    change_positions(corpus, name, change)
    return Expected("MF122")


@defect
def names_of_left_and_right(corpus, name):
    def change(positions, tracks):
        other = [
            n.replace("left", "X").replace("right", "left").replace("X", "right")
            for n in tracks.names
        ]
        positions[:] = positions[:, tracks.indices(other)]

    change_positions(corpus, name, change)
    return Expected("MF122")


@defect
def up_and_forward_exchanged(corpus, name):
    def change(positions, tracks):
        positions[:] = positions[:, :, [0, 2, 1]]

    change_positions(corpus, name, change)
    return Expected("MF123")


@defect
def axes_turned(corpus, name):
    def change(positions, tracks):
        positions[:] = positions[:, :, [0, 2, 1]] * [1.0, 1.0, -1.0]

    change_positions(corpus, name, change)
    return Expected("MF123")


@defect
def head_marker_slipped(corpus, name):
    def change(positions, tracks):
        filled(positions, tracks.index("head_temple_left"))
        positions[130:, tracks.index("head_temple_left")] += [1.5, 4.0, 3.0]

    change_positions(corpus, name, change)
    return Expected("MF125", "head_temple_left", (130, 10_000), slack=6)


@defect
def head_marker_slipped_throughout(corpus, name):
    def change(positions, tracks):
        positions[:, tracks.index("head_temple_right")] += [2.0, 4.0, 3.0]

    change_positions(corpus, name, change)
    return Expected("MF125", "head_temple_right")


@defect
def head_markers_loose(corpus, name):
    def change(positions, tracks):
        head = [k for k, n in enumerate(tracks.names) if n.startswith("head")]
        rng = seed(name)
        positions[:, head] += rng.normal(0.0, 4.0, (len(positions), len(head), 3))

    change_positions(corpus, name, change)
    return Expected("MF124", "head", also=frozenset({"MF125", "MF104", "MF107"}))


@defect
def head_pose_unknown(corpus, name):
    def change(positions, tracks):
        for marker in ("head_bridge", "head_rim_left", "head_temple_right"):
            positions[50:130, tracks.index(marker)] = np.nan

    change_positions(corpus, name, change)
    return Expected("MF126", "head", (50, 129), slack=20, also=frozenset({"MF102", "MF101"}))


@defect
def marker_glued_on_anew(corpus, name):
    def change(positions, tracks):
        positions[:, tracks.index("brow_right")] += [10.0, 12.0, 15.0]

    change_positions(corpus, name, change)
    return Expected("MF127", "brow_right")


# ---- time ---------------------------------------------------------------------------------------


@defect
def rate_wrong(corpus, name):
    for part in ("tracks", "markers", "head"):
        change_tracks(corpus, part, name, lambda t: t.replace(rate=50.0))
    return Expected("MF141", also=frozenset({"MF504", "MF309"}))


@defect
def uneven_time_stamps(corpus, name):
    def change(frame):
        frame.loc[90:, "time"] += 0.012
        return frame

    change_table(corpus / "tracks" / f"{name}.parquet", change)
    return Expected("MF142", "time", (90, 10_000))


@defect
def time_stamps_of_another_rate(corpus, name):
    def change(frame):
        frame["time"] = frame["time"].iloc[0] + np.arange(len(frame)) / 59.0
        return frame

    change_table(corpus / "markers" / f"{name}.parquet", change)
    return Expected("MF141", "time")


@defect
def sound_cut_short(corpus, name):
    change_sound(corpus, name, lambda s: s.replace(samples=s.samples[: int(0.8 * len(s))]))
    return Expected("MF143", also=frozenset({"MF204", "MF504"}))


def _synchronised(corpus: Path, name: str, **noted) -> None:
    def change(content):
        for step in content["provenance"]:
            if step["step"] == "synchronise":
                step["arguments"].update(noted)

    change_description(corpus / "tracks" / f"{name}.parquet", change)


@defect
def clocks_drift(corpus, name):
    _synchronised(corpus, name, drift_ppm=-900.0)
    return Expected("MF145")


@defect
def pulses_scatter(corpus, name):
    _synchronised(corpus, name, residual=0.004)
    return Expected("MF146")


@defect
def time_is_an_estimate(corpus, name):
    _synchronised(corpus, name, kind="estimate", is_estimate=True, correlation=0.6)
    return Expected("MF144")


# ---- labels -------------------------------------------------------------------------------------


@defect
def labels_overlap(corpus, name):
    row = spoken(corpus, name)
    start = float(phones_of(corpus, name)["end"][row])

    def change(frame):
        frame.loc[row, "end"] += 0.02
        return frame

    change_phones(corpus, name, change)
    return Expected(
        "MF201", phones_of(corpus, name)["phone"][row + 1], seconds=(start, start + 0.02)
    )


@defect
def labels_out_of_order(corpus, name):
    row = spoken(corpus, name)
    start, end, phone = phones_of(corpus, name).loc[row, ["start", "end", "phone"]]

    def change(frame):
        order = list(range(len(frame)))
        order[row], order[row + 1] = row + 1, row
        return frame.iloc[order].reset_index(drop=True)

    change_phones(corpus, name, change)
    return Expected("MF202", phone, seconds=(start, end), also=frozenset({"MF205", "MF201"}))


@defect
def label_without_duration(corpus, name):
    row = spoken(corpus, name)
    start = float(phones_of(corpus, name)["start"][row])

    def change(frame):
        frame.loc[row, "end"] = start
        frame.loc[row + 1, "start"] = start
        return frame

    change_phones(corpus, name, change)
    return Expected("MF203", "", seconds=(start, start), also=frozenset({"MF503"}))


@defect
def labels_beyond_the_end(corpus, name):
    def change(frame):
        frame.loc[len(frame) - 1, "end"] += 0.8
        return frame

    change_phones(corpus, name, change)
    return Expected("MF204", "sil")


@defect
def label_missing(corpus, name):
    row = spoken(corpus, name)
    start, end = phones_of(corpus, name).loc[row, ["start", "end"]]
    change_phones(corpus, name, lambda f: f.drop(index=row).reset_index(drop=True))
    return Expected("MF205", "between", seconds=(start, end))


@defect
def half_of_it_labelled(corpus, name):
    change_phones(corpus, name, lambda f: f.iloc[: len(f) // 2])
    return Expected("MF206")


@defect
def unknown_phone(corpus, name):
    row = spoken(corpus, name)
    start, end = phones_of(corpus, name).loc[row, ["start", "end"]]

    def change(frame):
        frame.loc[row, "phone"] = "Q9"
        return frame

    change_phones(corpus, name, change)
    return Expected("MF207", "Q9", seconds=(start, end))


@defect
def boundary_missing(corpus, name):
    row = spoken(corpus, name, 2)
    frame = phones_of(corpus, name)
    last = next(k for k in range(row, len(frame)) if frame["end"][k] > frame["start"][row] + 0.9)
    start, end = float(frame["start"][row]), float(frame["end"][last])

    def change(table):
        table.loc[row, "end"] = end
        return table.drop(index=range(row + 1, last + 1)).reset_index(drop=True)

    change_phones(corpus, name, change)
    return Expected("MF208", frame["phone"][row], seconds=(start, end), also=frozenset({"MF309"}))


@defect
def label_left_over(corpus, name):
    row = spoken(corpus, name)
    end = float(phones_of(corpus, name)["end"][row])

    def change(frame):
        frame.loc[row, "end"] = end - 0.003
        extra = frame.iloc[[row]].assign(start=end - 0.003, end=end)
        parts = [frame.iloc[: row + 1], extra, frame.iloc[row + 1 :]]
        import pandas as pd

        return pd.concat(parts, ignore_index=True)

    change_phones(corpus, name, change)
    return Expected("MF209", "", seconds=(end - 0.003, end))


@defect
def nothing_labelled(corpus, name):
    change_phones(corpus, name, lambda f: f.iloc[:0])
    return Expected("MF210")


@defect
def vowels_labelled_as_silence(corpus, name):
    frame = phones_of(corpus, name)
    row = spoken(corpus, name)
    part = range(row, min(row + 4, len(frame) - 1))
    start, end = float(frame["start"][part[0]]), float(frame["end"][part[-1]])

    def change(table):
        table.loc[list(part), "phone"] = "sil"
        return table

    change_phones(corpus, name, change)
    return Expected("MF211", "sil", seconds=(start, end), slack=20)


@defect
def labels_of_another_time(corpus, name):
    for part in ("tracks", "markers", "head"):
        change_tracks(corpus, part, name, lambda t: t.replace(start_time=t.start_time + 2.5))
    return Expected("MF212", also=frozenset({"MF143", "MF206", "MF141", "MF309"}))


# ---- parameters ---------------------------------------------------------------------------------


def _residual(part: slice, value: float):
    def change(tracks):
        residuals = tracks.residuals.copy()
        residuals[part] = value
        return tracks.replace(residuals=residuals)

    return change


@defect
def bad_fit(corpus, name):
    change_tracks(corpus, "tracks", name, lambda t: t.replace(residuals=t.residuals * 6))
    return Expected("MF301")


@defect
def bad_fit_for_a_while(corpus, name):
    change_tracks(corpus, "tracks", name, _residual(slice(80, 95), 7.5))
    return Expected("MF302", "", (80, 94), slack=0)


@defect
def parameter_at_its_bound(corpus, name):
    def change(values, tracks):
        values[60:120, tracks.index("lip_rounding")] = 1.5

    change_values(corpus, name, change)
    also = frozenset({"MF307", "MF309"})
    return Expected("MF303", "lip_rounding", (60, 119), also=also)


@defect
def parameters_missing(corpus, name):
    def change(values, tracks):
        values[60:90] = np.nan

    change_values(corpus, name, change)
    return Expected("MF304", "", (60, 89), slack=0)


@defect
def no_parameters(corpus, name):
    def change(values, tracks):
        values[:] = np.nan

    change_values(corpus, name, change)
    return Expected("MF305")


@defect
def parameter_undetermined(corpus, name):
    def change(tracks):
        deviations = tracks.standard_deviations.copy()
        deviations[::2, tracks.index("jaw_thrust")] = np.inf
        return tracks.replace(standard_deviations=deviations)

    change_tracks(corpus, "tracks", name, change)
    return Expected("MF306", "jaw_thrust", also=frozenset({"MF503"}))


@defect
def parameter_jumps(corpus, name):
    def change(values, tracks):
        column = tracks.index("jaw_shift")
        values[90:, column] = 1.2 + 0.01 * values[90:, column]

    change_values(corpus, name, change)
    return Expected("MF307", "jaw_shift", (89, 90), slack=0)


@defect
def parameter_still(corpus, name):
    def change(values, tracks):
        values[:, tracks.index("upper_lip_raise")] = 0.0

    change_values(corpus, name, change)
    return Expected("MF308", "upper_lip_raise", also=frozenset({"MF309"}))


@defect
def lips_open_on_a_bilabial(corpus, name):
    frame = phones_of(corpus, name)
    rows = frame[frame["phone"].isin(["B", "P", "M"])]
    start, end, phone = rows.iloc[0][["start", "end", "phone"]]

    def change(values, tracks):
        inside = (tracks.times > start - 0.06) & (tracks.times < end + 0.06)
        values[inside, tracks.index("lower_lip_depression")] += 1.0
        values[inside, tracks.index("jaw_rotation")] += 0.4

    change_values(corpus, name, change)
    return Expected("MF309", phone, seconds=(start, end), also=frozenset({"MF307"}))


@defect
def parameter_beyond_its_bound(corpus, name):
    def change(values, tracks):
        values[60:64, tracks.index("jaw_rotation")] = 2.4

    change_values(corpus, name, change)
    return Expected("MF310", "jaw_rotation", (60, 63), slack=0, also=frozenset({"MF307", "MF309"}))


@defect
def other_parameters(corpus, name):
    change_tracks(
        corpus,
        "tracks",
        name,
        lambda t: t.replace(names=tuple(n.replace("jaw_shift", "jaw_slide") for n in t.names)),
    )
    return Expected("MF311")


# ---- sound --------------------------------------------------------------------------------------


@defect
def clipped_sound(corpus, name):
    def change(sound):
        return sound.replace(samples=np.clip(sound.samples * 20, -1, 1))

    change_sound(corpus, name, change)
    return Expected("MF401", also=frozenset({"MF504"}))


@defect
def silent_sound(corpus, name):
    change_sound(corpus, name, lambda s: s.replace(samples=np.zeros_like(s.samples)))
    return Expected("MF402", also=frozenset({"MF504"}))


@defect
def other_sampling_rate(corpus, name):
    def change(sound):
        return Sound(sound.samples[::2], sound.rate / 2)

    change_sound(corpus, name, change)
    return Expected("MF403", also=frozenset({"MF504"}))


@defect
def sound_missing(corpus, name):
    (corpus / "audio" / f"{name}.wav").unlink()
    return Expected("MF404")


# ---- corpus -------------------------------------------------------------------------------------


@defect
def damaged_file(corpus, name):
    path = corpus / "tracks" / f"{name}.parquet"
    path.write_bytes(path.read_bytes()[:2000])
    return Expected("MF001")


@defect
def file_missing(corpus, name):
    (corpus / "head" / f"{name}.parquet").unlink()
    return Expected("MF501")


@defect
def file_left_over(corpus, name):
    path = corpus / "tracks" / f"{name}.parquet"
    (corpus / "tracks" / f"{name}_old.parquet").write_bytes(path.read_bytes())
    return Expected("MF502", whole=True)


@defect
def column_missing(corpus, name):
    path = corpus / "tracks" / f"{name}.parquet"
    change_table(path, lambda f: f.drop(columns="jaw_rotation_sd"))
    return Expected("MF503", "jaw_rotation_sd")


@defect
def negative_deviation(corpus, name):
    def change(frame):
        frame.loc[7, "jaw_rotation_sd"] = -0.1
        return frame

    change_table(corpus / "tracks" / f"{name}.parquet", change)
    return Expected("MF503", "jaw_rotation_sd")


@defect
def stress_unknown(corpus, name):
    def change(frame):
        frame.loc[4, "stress"] = 5
        return frame

    change_phones(corpus, name, change)
    return Expected("MF503", "stress")


@defect
def pose_that_is_none(corpus, name):
    def change(tracks: PoseTracks) -> PoseTracks:
        rotations = tracks.rotations.copy()
        rotations[12] *= 1.1
        return tracks.replace(rotations=rotations)

    change_tracks(corpus, "head", name, change)
    return Expected("MF503", "head", (12, 12), slack=0)


@defect
def rows_of_another_utterance(corpus, name):
    def change(frame):
        frame.loc[10:, "utterance"] = "somebody"
        return frame

    change_phones(corpus, name, change)
    return Expected("MF504", "utterance")


@defect
def duration_in_the_table(corpus, name):
    change_row(corpus, name, duration=9.5)
    return Expected("MF504", "duration")


@defect
def provenance_lost(corpus, name):
    def change(content):
        content["provenance"] = []

    change_description(corpus / "tracks" / f"{name}.parquet", change)
    return Expected("MF509")


@defect
def provenance_lacks_a_step(corpus, name):
    def change(content):
        content["provenance"] = [s for s in content["provenance"] if s["step"] != "fit_shape"]

    change_description(corpus / "tracks" / f"{name}.parquet", change)
    return Expected("MF510", "fit_shape")


@defect
def provenance_of_one_computer(corpus, name):
    path = corpus / "tracks" / f"{name}.parquet"
    change_tracks(
        corpus,
        "tracks",
        name,
        lambda t: t.replace(provenance=(*t.provenance, Step("copy", {"file": "/home/me/a.tsv"}))),
    )
    assert path.is_file()
    return Expected("MF511", "copy")


@defect
def conversion_not_finished(corpus, name):
    (corpus / "tracks" / f".{name}x.parquet.123.partial").write_bytes(b"PAR1")
    return Expected("MF513", whole=True)


@defect
def remark_of_the_conversion(corpus, name):
    known = ("the head's pose is not known in 3 of 240 frames (first 7): their markers are lost",)
    new = ("reference markers without data are left out: head_bridge",)
    change_row(corpus, name, checks=known + new)
    return Expected("MF514", "checks")


def twin(corpus: Path, name: str, split: str, parts: tuple[str, ...], text: str) -> str:
    """A new utterance that shares parts of another; the others are changed."""
    new = f"{name}_twin"
    rows = read_utterances(corpus)
    row = next(r for r in rows if r.id == name)
    for part in ("tracks", "markers", "head"):
        path = corpus / part / f"{name}.parquet"
        tracks = read_parquet(path).replace(name=new)
        if part == "markers" and "recording" not in parts:
            moved = tracks.positions + seed(name).normal(0, 0.05, tracks.positions.shape)
            tracks = tracks.replace(positions=moved)
        if part == "tracks" and "recording" not in parts:
            tracks = tracks.replace(values=tracks.values * 0.999)
        write_parquet(tracks, corpus / part / f"{new}.parquet")
    from mocap_fit.phones import read_stored_phones, write_phones

    phones = read_stored_phones(corpus / "phones" / f"{name}.parquet")
    write_phones(phones.replace(name=new), corpus / "phones" / f"{new}.parquet")
    sound = read_sound(corpus / "audio" / f"{name}.wav")
    if "sound" not in parts:
        sound = sound.replace(samples=sound.samples * 0.9)
    write_sound(sound, corpus / "audio" / f"{new}.wav")
    write_utterances([*rows, dataclasses.replace(row, id=new, split=split, text=text)], corpus)
    return new


def other_split(corpus: Path, name: str) -> str:
    row = next(r for r in read_utterances(corpus) if r.id == name)
    return "test" if row.split == "train" else "train"


@defect
def recording_in_two_splits(corpus, name):
    new = twin(corpus, name, other_split(corpus, name), ("recording",), "something else is said")
    return Expected("MF505", name, utterance=new, also=frozenset({"MF504"}))


@defect
def sound_in_two_splits(corpus, name):
    new = twin(corpus, name, other_split(corpus, name), ("sound",), "something else is said")
    return Expected("MF506", name, utterance=new, also=frozenset({"MF504"}))


@defect
def text_in_two_splits(corpus, name):
    text = next(r.text for r in read_utterances(corpus) if r.id == name)
    new = twin(corpus, name, other_split(corpus, name), (), text.upper())
    return Expected("MF507", name, utterance=new, also=frozenset({"MF504"}))


@defect
def utterance_twice(corpus, name):
    rows = read_utterances(corpus)
    row = next(r for r in rows if r.id == name)
    new = twin(corpus, name, row.split, ("recording", "sound"), row.text)
    return Expected("MF508", name, utterance=new, also=frozenset({"MF504"}))
