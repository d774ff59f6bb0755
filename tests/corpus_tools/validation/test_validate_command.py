"""The command: calls, exit statuses, JSON, the page, thresholds, single files and folders."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from spoiling import DEFECTS, change_positions

from corpus_tools.cli import app as cli
from corpus_tools.validation import Evidence, Finding, Location, Report, load_codes, load_thresholds
from corpus_tools.validation.page import write_page
from corpus_tools.validation.validate import validate
from mocap_fit.errors import ConfigurationError
from mocap_fit.io import read_tracks, write_qualisys_tsv
from mocap_fit.labels import Label, Labels, Tier, write_labels
from mocap_fit.tracks import read_parquet

FIXTURES = Path(__file__).parents[3] / "fixtures"


def run(*arguments: object) -> int:
    return cli.main(["validate", *map(str, arguments)])


def found_in(*paths: Path, **options: object):
    return validate(list(paths), **options).findings


def listed(findings) -> list[str]:
    return [finding.code for finding in findings]


class TestCalls:
    def test_a_call_without_a_path_is_wrong(self, capsys):
        assert run() == 2
        assert "PATH" in capsys.readouterr().err

    def test_a_path_that_is_not_there_is_an_error(self, tmp_path, capsys):
        assert run(tmp_path / "nothing.tsv") == 1
        shown = capsys.readouterr().out
        assert "MF001" in shown
        assert "there is no such file" in shown

    def test_an_empty_folder_is_an_error(self, tmp_path):
        assert listed(found_in(tmp_path)) == ["MF002"]

    def test_codes_are_listed(self, capsys):
        assert run("--codes", "--json") == 0
        told = json.loads(capsys.readouterr().out)
        assert [row["code"] for row in told] == list(load_codes())
        assert run("--codes") == 0
        assert "MF106" in capsys.readouterr().out

    def test_unknown_layouts_and_phone_sets_are_named(self, recorded, capsys):
        assert run(recorded, "--layout", "nonesuch") == 1
        assert "nonesuch" in capsys.readouterr().err
        assert run(recorded, "--phone-set", "martian") == 1
        assert "martian" in capsys.readouterr().err


class TestCodes:
    def test_every_code_is_complete_and_in_its_area(self):
        assert list(load_codes()) == sorted(load_codes())
        titles = [code.title for code in load_codes().values()]
        assert len(set(titles)) == len(titles)
        for code in load_codes().values():
            assert re.fullmatch(r"MF[0-5]\d\d", code.code)
            assert code.title
            assert not code.title.endswith(".")
            assert code.advice.endswith(".")
            assert code.area

    def test_every_code_is_used(self):
        folder = Path(__file__).parents[3] / "corpus_tools" / "validation"
        files = list(folder.glob("*.py"))
        source = "\n".join(path.read_text("utf-8") for path in files)
        assert set(re.findall(r'"(MF\d{3})"', source)) == set(load_codes())


class TestThresholds:
    def write(self, folder: Path, text: str) -> Path:
        path = folder / "limits.toml"
        path.write_text(text, encoding="utf-8")
        return path

    def test_the_defaults_are_explained_line_by_line(self):
        folder = Path(__file__).parents[3] / "corpus_tools" / "validation"
        for line in (folder / "thresholds.toml").read_text("utf-8").splitlines():
            if "=" in line and not line.startswith("#"):
                assert "#" in line or line.startswith("steps"), line

    def test_a_file_changes_some_and_leaves_the_others(self, tmp_path):
        plain = load_thresholds()
        other = load_thresholds(self.write(tmp_path, "[markers]\ngap_share = 0.9\n"))
        assert other.markers.gap_share == 0.9
        assert other.markers.longest_gap == plain.markers.longest_gap
        assert other.shape.turned == plain.shape.turned

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("[markers]\ngap_shaer = 0.9", "no threshold 'markers.gap_shaer'.*gap_share"),
            ("[markres]\ngap_share = 0.9", "no section 'markres'.*markers"),
            ("[markers]\ngap_share = 'much'", "markers.gap_share has a wrong value.*number"),
            ("[markers]\nspike_frames = 2.5", "spike_frames has a wrong value.*whole number"),
            ("[markers]\ngap_share = nan", "gap_share has a wrong value"),
            ("[corpus]\nsteps = 'fit'", "corpus.steps has a wrong value.*list"),
            ("[severity]\nMF999 = 'note'", "no code 'MF999'.*--codes"),
            ("[severity]\nMF101 = 'grave'", "MF101 is no severity.*error, warning, note, off"),
            ("gap_share = ", "not TOML"),
        ],
    )
    def test_mistakes_are_named(self, tmp_path, text, words):
        path = self.write(tmp_path, text)
        with pytest.raises(ConfigurationError, match=words) as caught:
            load_thresholds(path)
        assert caught.value.path == str(path)

    def test_a_missing_file_is_named(self, tmp_path, capsys):
        assert run(tmp_path, "--thresholds", tmp_path / "none.toml") == 1
        assert "none.toml" in capsys.readouterr().err

    def test_severities_can_be_changed_and_codes_left_out(self, small, tmp_path, capsys):
        DEFECTS["spike"](small, "sim002")
        DEFECTS["no_marker_at_all"](small, "sim004")
        assert run(small, "--json") == 1
        told = json.loads(capsys.readouterr().out)
        assert told["counts"] == {"error": 1, "warning": 0, "note": 1}
        limits = self.write(tmp_path, '[severity]\nMF104 = "note"\nMF109 = "off"\n')
        assert run(small, "--json", "--thresholds", limits) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["counts"] == {"error": 0, "warning": 0, "note": 1}
        assert told["codes"] == {"MF104": 1}


class TestReports:
    def test_json_says_all_of_a_finding(self, small, capsys):
        expected = DEFECTS["swapped"](small, "sim002")
        assert run(small, "--json") == 1
        told = json.loads(capsys.readouterr().out)
        assert (told["utterances"], told["clean"]) == (2, False)
        (finding,) = told["findings"]
        assert finding["code"] == "MF106"
        assert finding["severity"] == "error"
        assert finding["utterance"] == "sim002"
        assert finding["item"] == expected.item
        assert finding["frames"] == list(expected.frames)
        assert finding["file"] == str(small / "markers" / "sim002.parquet")
        assert finding["seconds"][0] < finding["seconds"][1]
        assert finding["advice"]
        assert told["thresholds"]["markers"]["swap_distance"] == 4

    def test_people_read_code_place_and_advice(self, small, capsys):
        DEFECTS["unknown_phone"](small, "sim002")
        assert run(small) == 1
        shown = capsys.readouterr().out
        assert "error MF207 a label is not in the phone set" in shown
        assert "'Q9'; expected a symbol of 'sv-sta'" in shown
        assert "2 utterances checked: 1 error, 0 warnings, 0 notes" in shown

    def test_warnings_alone_leave_the_status_at_0(self, small):
        DEFECTS["many_gaps"](small, "sim002")
        assert run(small) == 0

    def test_many_findings_of_one_kind_are_counted(self, small):
        def change(positions, tracks):
            for frame in range(20, 200, 15):
                positions[frame, tracks.index("chin_mid")] += 30.0

        change_positions(small, "sim002", change)
        spikes = [f for f in found_in(small) if f.code == "MF104"]
        assert len(spikes) == 5
        assert any(re.search(r"and \d+ more$", finding.found) for finding in spikes)

    def test_a_picture_of_a_finding(self, tmp_path):
        times = np.arange(50) / 100
        picture = Evidence(times, {"chin x": np.sin(times), "chin y": np.full(50, np.nan)}, "mm")
        report = Report(load_thresholds())
        place = Location("a.tsv", "a", "chin", (7, 9), (0.07, 0.09))
        report.add([Finding("MF104", place, "<b>20 mm</b>", evidence=picture)])
        report.finish()
        write_page(report, tmp_path / "page.html")
        text = (tmp_path / "page.html").read_text("utf-8")
        assert "&lt;b&gt;20 mm&lt;/b&gt;" in text
        assert "<b>20 mm" not in text
        assert text.count("data:image/svg+xml") == 1

    @pytest.mark.slow
    def test_the_page_holds_all_and_is_the_same_twice(self, small, tmp_path):
        DEFECTS["swapped"](small, "sim002")
        DEFECTS["spike"](small, "sim004")
        pages = [tmp_path / "one.html", tmp_path / "two.html"]
        for page in pages:
            assert run(small, "--html", page) == 1
        text = pages[0].read_text("utf-8")
        assert text == pages[1].read_text("utf-8")
        for wanted in ("MF106", "MF104", "lip_corner_left and cheek_left", "sim004", "gap_share"):
            assert wanted in text
        # Nothing is loaded from elsewhere; two pictures of findings, and what is usual.
        assert not re.findall(r'(?:src|href)="(?!data:)', text)
        assert text.count("data:image/svg+xml") >= 8

    def test_a_page_that_cannot_be_written_is_said(self, small, tmp_path, capsys):
        assert run(small, "--html", tmp_path / "none" / "page.html") == 1
        assert "the page cannot be written" in capsys.readouterr().err


class TestLooseFiles:
    def test_the_folder_of_a_lab_is_clean(self, recorded):
        assert found_in(recorded, phone_set="sv-sta") == []

    @pytest.mark.slow
    def test_a_recording_of_another_rate_than_the_others(self, recorded, tmp_path):
        folder = Path(shutil.copytree(recorded / "recordings", tmp_path / "recordings"))
        odd = folder / "sim003.tsv"
        write_qualisys_tsv(read_tracks(odd).replace(rate=50.0), odd)
        (folder / "notes.tsv").write_text("who\twhat\n1\t2\n", "utf-8")
        findings = found_in(folder)
        assert listed(findings) == ["MF141", "MF003"]
        assert findings[0].location.file == str(odd)
        assert findings[0].found == "50 Hz"
        assert "notes.tsv" in findings[1].found

    def test_recording_labels_and_sound_of_one_name_are_one_utterance(self, recorded, tmp_path):
        parts = ("recordings/sim001.tsv", "labels/sim001.TextGrid", "sound/sim001.wav")
        report = validate([recorded / part for part in parts], phone_set="sv-sta")
        assert len(report.summaries) == 1
        assert report.findings == []
        # Pulses on the second channel say that a frame is missing.
        short = tmp_path / "sim001.tsv"
        lines = (recorded / parts[0]).read_text("utf-8").splitlines(keepends=True)
        short.write_text(
            "".join(lines[:-30]).replace(
                f"NO_OF_FRAMES\t{len(lines) - 11}", f"NO_OF_FRAMES\t{len(lines) - 41}"
            ),
            "utf-8",
        )
        assert "MF146" in listed(found_in(short, recorded / parts[2]))

    @pytest.mark.parametrize(
        ("entries", "code"),
        [
            ([(0, 0.5, "sil"), (0.5, 0.7, "A:"), (0.65, 0.9, "N")], "MF201"),
            ([(0, 0.5, "sil"), (0.5, 0.7, "A:"), (0.8, 0.9, "N")], "MF205"),
            ([(0, 0.5, "sil"), (0.5, 0.7, "A:"), (0.7, 0.9, "XX")], "MF207"),
            ([(0, 0.5, "sil"), (0.5, 2.7, "A:"), (2.7, 2.9, "N")], "MF208"),
            ([(0, 0.5, "sil"), (0.5, 0.503, "A:"), (0.503, 0.9, "N")], "MF209"),
        ],
    )
    def test_label_files(self, tmp_path, entries, code):
        tier = Tier("phones", tuple(Label(*entry) for entry in entries))
        path = tmp_path / "a.TextGrid"
        write_labels(Labels((tier,), 0.0, entries[-1][1]), path)
        findings = found_in(path, phone_set="sv-sta")
        assert listed(findings) == [code]
        assert findings[0].location.file == str(path)

    def test_parameters_alone(self, clean, tmp_path):
        path = shutil.copy(clean / "tracks" / "sim001.parquet", tmp_path)
        assert found_in(Path(path)) == []

    @pytest.mark.parametrize("path", sorted((FIXTURES / "defects").iterdir()), ids=lambda p: p.name)
    @pytest.mark.slow
    def test_files_that_no_reader_takes_are_named(self, path):
        findings = found_in(path)
        assert findings
        assert {finding.location.file for finding in findings} == {str(path)}

    @pytest.mark.parametrize(
        ("name", "code"),
        [
            ("uneven_times.csv", "MF142"),
            ("uneven_times.tsv", "MF142"),
            ("times_going_back.tsv", "MF142"),
            ("frame_left_out.tsv", "MF142"),
            ("rate_against_times.tsv", "MF141"),
            ("cut_off.parquet", "MF001"),
        ],
    )
    def test_what_readers_refuse_has_its_code(self, name, code):
        (finding,) = found_in(FIXTURES / "defects" / name)
        assert finding.code == code
        assert finding.severity == "error"

    @pytest.mark.slow
    def test_every_recording_of_the_fixtures_can_be_looked_at(self):
        report = validate([FIXTURES / "recordings"])
        assert len(report.summaries) > 20
        # Most are one recording in other formats; of two it must be said how they are to be read,
        # and some programs export trajectories that are seen never, or where they are expected.
        codes = {"MF001", "MF003", "MF103", "MF104", "MF126", "MF508"}
        assert {f.code for f in report.findings} == codes
        unread = {Path(f.location.file).name for f in report.findings if f.code == "MF001"}
        assert unread == {"timeless.csv", "two_subjects.c3d"}


def test_a_corpus_that_cannot_be_opened(small):
    (small / "corpus.toml").write_text("format_version = 9", encoding="utf-8")
    (finding,) = found_in(small)
    assert finding.code == "MF001"
    assert "format" in finding.found


def test_one_id_twice_is_found_in_the_table(small):
    from spoiling import change_table

    def change(frame):
        frame.loc[1, "id"] = frame.loc[0, "id"]
        return frame

    change_table(small / "utterances.parquet", change)
    findings = found_in(small)
    assert listed(findings) == ["MF001", "MF503"]
    assert findings[1].location.item == "id"


def test_a_corpus_in_memory_that_was_saved_has_no_provenance(small, tmp_path):
    from mocap_fit.corpus import Corpus, Utterance, open_corpus, save_corpus
    from mocap_fit.tracks import ParameterTracks

    kept = [
        Utterance.from_tracks(
            ParameterTracks(
                u.read_tracks().names,
                u.read_tracks().rate,
                u.read_tracks().values,
                name=u.id,
                start_time=u.read_tracks().start_time,
            ),
            u.read_phones(),
            split=u.split,
        )
        for u in open_corpus(small)
    ]
    save_corpus(Corpus.from_utterances(kept, "sv-sta"), tmp_path / "saved")
    found = found_in(tmp_path / "saved")
    assert set(listed(found)) == {"MF003", "MF509"}
    assert sum(code == "MF509" for code in listed(found)) == 3
    assert read_parquet(tmp_path / "saved" / "tracks" / "sim002.parquet").provenance == ()
