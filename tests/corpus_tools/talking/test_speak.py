"""speak, stream and export, as they are called."""

import io
import json
import subprocess

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from corpus_tools.cli import app as cli
from corpus_tools.cli import speak_printing
from corpus_tools.talking import speak_models
from corpus_tools.talking.prepare_voices import prepare_voices
from corpus_tools.talking.speak_models import DEFAULT_MODEL, choose_default
from corpus_tools.talking.stream import stream
from corpus_tools.talking.voice_training import (
    estimate_training,
    list_languages,
    simulate_corpus,
    train_model,
)
from mocap_fit.control.rule_based import RuleBased
from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.labels import to_labels, write_labels
from mocap_fit.phones import ARTICULATORY_PARAMETERS, PhoneSegment, PhoneSequence
from mocap_fit.sound import Sound, write_sound
from mocap_fit.tracks import MarkerTracks, ParameterTracks, PoseTracks, read_parquet, write_parquet

SMALL = ["--size", "64", "--model", "rule-based"]


@pytest.fixture(scope="module", autouse=True)
def _can_draw(drawing: None) -> None:
    pass


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache of our own, with the head from the common one."""
    from mocap_fit.face import load_face

    load_face()
    folder = tmp_path / "cache"
    monkeypatch.setenv("MOCAP_FIT_CACHE", str(folder))
    return folder


def run(*arguments: object) -> int:
    return cli.main([str(argument) for argument in arguments])


def one_line(capsys) -> str:
    lines = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
    assert len(lines) == 1, lines
    return lines[0]


@pytest.fixture
def labels(tmp_path):
    segments = [(0.0, 0.2, "sil"), (0.2, 0.3, "B"), (0.3, 0.6, "AA1"), (0.6, 0.8, "sil")]
    phones = PhoneSequence(tuple(PhoneSegment(*segment) for segment in segments), name="said")
    write_labels(to_labels(phones), tmp_path / "said.TextGrid")
    write_sound(Sound(np.zeros(16000), 16000), tmp_path / "said.wav")
    return tmp_path / "said.TextGrid"


@pytest.fixture
def tracks(tmp_path):
    values = np.zeros((20, 10))
    values[:, 0] = 0.5 - 0.5 * np.cos(np.arange(20))
    made = ParameterTracks(ARTICULATORY_PARAMETERS, 25, values, name="said")
    write_parquet(made, tmp_path / "said.parquet")
    return tmp_path / "said.parquet"


class TestText:
    @pytest.fixture(autouse=True)
    def _voice(self):
        pytest.importorskip("espeakng_loader")

    @pytest.mark.parametrize(
        ("language", "text"),
        [
            ("sv", "svenska kyrkan ska vara till hjälp"),
            pytest.param("cs", "dobrý den, jak se máte", marks=pytest.mark.slow),
            pytest.param("en", "a baby may pay", marks=pytest.mark.slow),
        ],
    )
    def test_a_sentence_becomes_a_movie_with_its_sound(self, tmp_path, capsys, language, text):
        out = tmp_path / "a.mp4"
        assert run("speak", text, "--lang", language, "--out", out, "--json", *SMALL) == 0
        report = json.loads(capsys.readouterr().out)
        assert report["sound"] is True
        assert report["phones"][0] == report["phones"][-1] == "sil"
        from mocap_fit.render.movie_file import find_ffmpeg

        probe = subprocess.run([find_ffmpeg(), "-i", out], capture_output=True, text=True).stderr
        assert "Video: h264" in probe
        assert "Audio: aac" in probe
        assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]

    def test_what_was_synthesised_can_be_kept(self, tmp_path):
        out, keep = tmp_path / "a", tmp_path / "keep"
        assert run("speak", "hello", "--out", out, "--keep", keep, *SMALL) == 0
        assert sorted(path.name for path in keep.iterdir()) == [
            "phones.TextGrid",
            "rule-based.parquet",
            "sound.wav",
        ]
        kept = read_parquet(keep / "rule-based.parquet")
        assert isinstance(kept, ParameterTracks)
        assert abs(len(list(out.iterdir())) / 25 - kept.duration) < 0.1

    @pytest.mark.slow
    def test_another_voice_speaks_by_rule(self, tmp_path, capsys):
        out = tmp_path / "a"
        assert run("speak", "guten Tag", "--lang", "de", "--out", out, "--size", 64) == 0
        assert "Rule-based, for phones of ipa" in capsys.readouterr().out

    @pytest.mark.parametrize("text", ["", "..."])
    def test_text_without_speech_is_refused(self, tmp_path, capsys, text):
        assert run("speak", text, "--out", tmp_path / "a", *SMALL) == 1
        assert "nothing to say" in one_line(capsys)
        assert not list(tmp_path.iterdir())

    def test_an_unknown_voice_is_refused(self, tmp_path, capsys):
        assert run("speak", "hello", "--lang", "nowhere", "--out", tmp_path / "a", *SMALL) == 1
        assert "no voice 'nowhere'" in one_line(capsys)

    def test_a_kind_of_model_needs_sentences_of_the_language(self, tmp_path, capsys):
        options = ["--lang", "de", "--model", "phone-mean", "--out", tmp_path / "a"]
        assert run("speak", "guten Tag", *options) == 1
        said = one_line(capsys)
        assert "cannot be trained for the language 'de'" in said
        assert "rule-based" in said

    def test_a_model_of_another_phone_set_is_refused_unless_the_nearest_will_do(
        self, tmp_path, capsys
    ):
        RuleBased().prepare("sv-sta").save(tmp_path / "sv.model")
        call = ["speak", "hello", "--lang", "en", "--model", tmp_path / "sv.model", "--size", 64]
        assert run(*call, "--out", tmp_path / "a") == 1
        assert "another phone set" in one_line(capsys)
        assert not (tmp_path / "a").exists()
        assert run(*call, "--out", tmp_path / "a", "--nearest") == 0

    def test_missing_extras_are_said_before_anything_begins(self, tmp_path, capsys, monkeypatch):
        import builtins
        import importlib.util

        real_import, real_find = builtins.__import__, importlib.util.find_spec

        def without(name, *rest, **options):
            if name == "imageio_ffmpeg":
                raise ImportError(name)
            return real_import(name, *rest, **options)

        monkeypatch.setattr(builtins, "__import__", without)
        assert run("speak", "hello", "--out", tmp_path / "a.mp4", *SMALL) == 1
        assert "mocap-fit[movie]" in one_line(capsys)
        monkeypatch.setattr(
            "mocap_fit.synthesis.text_to_phones.find_spec",
            lambda name: None if name == "espeakng_loader" else real_find(name),
        )
        assert run("speak", "hello", "--out", tmp_path / "a", *SMALL) == 1
        assert "mocap-fit[speech]" in one_line(capsys)


class TestLabelsAndTracks:
    def test_labels_of_days_are_refused_before_their_frames_are_computed(self, tmp_path, capsys):
        phones = PhoneSequence((PhoneSegment(0, 1, "AA"), PhoneSegment(1, 9e5, "sil")))
        write_labels(to_labels(phones), tmp_path / "days.TextGrid")
        call = ["speak", "--labels", tmp_path / "days.TextGrid", "--out", tmp_path / "a"]
        assert run(*call, *SMALL) == 1
        assert "days.TextGrid: the labels last longer than a movie may" in one_line(capsys)

    def test_labels_with_their_sound(self, tmp_path, labels, capsys):
        out = tmp_path / "a.mp4"
        call = ["speak", "--labels", labels, "--audio", tmp_path / "said.wav", "--lang", "en"]
        assert run(*call, "--out", out, "--json", *SMALL) == 0
        report = json.loads(capsys.readouterr().out)
        assert report["phones"] == ["sil", "B", "AA", "sil"]
        assert report["frames"] == 25
        (lips,) = report["lips"].values()
        (bilabial,) = lips["bilabials"]
        assert bilabial["phone"] == "B"
        assert bilabial["closed"] is True
        assert bilabial["gap"] <= 0.5
        assert lips["labiodentals"] == []
        assert lips["largest_speed"] <= 350
        assert report["sound"] is True

    def test_measured_tracks_and_a_model_on_a_page(self, tmp_path, labels, tracks, capsys):
        page = tmp_path / "said.html"
        arguments = ["--tracks", tracks, "--labels", labels, "--audio", tmp_path / "said.wav"]
        assert run("speak", *arguments, "--model", "rule-based", "--out", page, "--json") == 0
        report = json.loads(capsys.readouterr().out)
        assert [head["head"] for head in report["heads"]] == ["measured", "Rule-based"]
        assert (report["rate"], report["size"], report["sound"]) == (60.0, None, True)
        assert report["lips"]["Rule-based"]["bilabials"][0]["closed"]
        assert "data-view" in page.read_text(encoding="utf-8")

    def test_measured_tracks_alone_and_beside_a_model(self, tmp_path, labels, tracks, capsys):
        assert run("speak", "--tracks", tracks, "--out", tmp_path / "a", "--size", 64) == 0
        assert len(list((tmp_path / "a").iterdir())) == 20
        capsys.readouterr()
        call = ["speak", "--tracks", tracks, "--labels", labels, "--curves", "--subtitles"]
        assert run(*call, "--out", tmp_path / "b", "--json", *SMALL) == 0
        report = json.loads(capsys.readouterr().out)
        assert [head["head"] for head in report["heads"]] == ["measured", "Rule-based"]
        assert report["size"][0] == 128

    def test_tracks_of_a_corpus_have_their_phones_beside_them(self, tmp_path, tracks, capsys):
        from mocap_fit.phones import write_phones

        folder = tmp_path / "corpus"
        for part in ("tracks", "phones"):
            (folder / part).mkdir(parents=True)
        copied = folder / "tracks" / "a.parquet"
        copied.write_bytes(tracks.read_bytes())
        segments = (PhoneSegment(0.0, 0.3, "sil"), PhoneSegment(0.3, 0.6, "AA"))
        phones = PhoneSequence(segments, phone_set="en-arpabet", name="a")
        write_phones(phones, folder / "phones" / "a.parquet")
        call = ["speak", "--tracks", copied, "--subtitles", "--json", "--size", 64]
        assert run(*call, "--out", tmp_path / "a") == 0
        assert json.loads(capsys.readouterr().out)["phones"] == ["sil", "AA"]

    def test_markers_of_a_recording_are_drawn_where_they_are_on_the_face(
        self, tmp_path, session, capsys
    ):
        from matplotlib.image import imread

        call = ["speak", "--tracks", session.truth[0], "--size", 128]
        assert run(*call, "--out", tmp_path / "plain") == 0
        call += ["--markers", session.recordings[0], "--reference", session.reference]
        assert run(*call, "--layout", session.layout, "--out", tmp_path / "marked") == 0
        plain, marked = (
            np.rint(255 * imread(tmp_path / name / "frame_000005.png")[..., :3]).astype(int)
            for name in ("plain", "marked")
        )
        changed = (plain != marked).any(axis=2)
        # Some thirty balls on the face, which moves under them as they do.
        assert 30 < changed.sum() < 2500
        blue = marked[changed]
        assert (blue[:, 2] > blue[:, 0]).mean() > 0.6
        # The layout that fits is found; one without a reference pose is no use.
        assert run(*call, "--out", tmp_path / "found") == 0
        without = call[: call.index("--reference")]
        assert run(*without, "--layout", session.layout, "--out", tmp_path / "a") == 2

    @pytest.mark.slow
    def test_a_head_lives_as_its_seed_says_but_not_where_it_was_measured(self, tmp_path):
        segments = (PhoneSegment(0.0, 0.9, "sil"),)
        write_labels(to_labels(PhoneSequence(segments)), tmp_path / "silence.TextGrid")
        rest = ParameterTracks(ARTICULATORY_PARAMETERS, 25, np.zeros((20, 10)), name="rest")
        write_parquet(rest, tmp_path / "rest.parquet")
        nods = Rotation.from_rotvec(np.outer(np.linspace(-0.2, 0.2, 20), [1, 0, 0])).as_matrix()
        pose = PoseTracks(("head",), 25, nods[:, None], np.zeros((20, 1, 3)))
        write_parquet(pose, tmp_path / "pose.parquet")

        def count_pictures(name, *call):
            """Return how many of the pictures differ, and the pictures."""
            small = ["--size", 64, "--rate", 5, "--out", tmp_path / name]
            assert run("speak", *call, *small) == 0
            pictures = [path.read_bytes() for path in sorted((tmp_path / name).iterdir())]
            return len(set(pictures)), pictures

        spoken = ["--labels", tmp_path / "silence.TextGrid", "--model", "rule-based"]
        lively, first = count_pictures("lively", *spoken, "--seed", 5)
        assert lively > 2
        assert count_pictures("again", *spoken, "--seed", 5)[1] == first
        assert count_pictures("still", *spoken, "--still")[0] == 1
        measured = ["--tracks", tmp_path / "rest.parquet"]
        assert count_pictures("measured", *measured)[0] == 1
        assert count_pictures("nodding", *measured, "--head", tmp_path / "pose.parquet")[0] > 2

    def test_a_pose_that_is_none_is_refused(self, tmp_path, tracks, capsys):
        call = ["speak", "--tracks", tracks, "--out", tmp_path / "a", "--head", tracks]
        assert run(*call) == 1
        assert "does not hold the pose of a head" in one_line(capsys)

    @pytest.mark.slow
    def test_two_models_of_a_kind_are_told_apart(self, tmp_path, labels, capsys):
        for name in ("one", "two"):
            RuleBased().prepare("en-arpabet").save(tmp_path / f"{name}.model")
        call = ["speak", "--labels", labels, "--out", tmp_path / "a", "--json", "--size", 64]
        assert run(*call, "--model", tmp_path / "one.model", "--model", tmp_path / "two.model") == 0
        heads = [head["head"] for head in json.loads(capsys.readouterr().out)["heads"]]
        assert len(set(heads)) == 2

    def test_tracks_of_something_else_are_refused(self, tmp_path, capsys):
        markers = MarkerTracks(("a",), 25, np.zeros((3, 1, 3)))
        write_parquet(markers, tmp_path / "m.parquet")
        assert run("speak", "--tracks", tmp_path / "m.parquet", "--out", tmp_path / "a") == 1
        assert "face parameters" in one_line(capsys)

    def test_labels_of_another_phone_set_are_refused(self, tmp_path, labels, capsys):
        RuleBased().prepare("cs-sampa").save(tmp_path / "cs.model")
        call = ["speak", "--labels", labels, "--model", tmp_path / "cs.model"]
        assert run(*call, "--out", tmp_path / "a") == 1
        assert "AA1" in one_line(capsys)
        assert run(*call, "--phone-set", "en-arpabet", "--out", tmp_path / "a") == 1
        assert "another phone set" in one_line(capsys)

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (["--out", "a.mp4"], "TEXT"),
            (["hello"], "--out"),
            (["hello", "--labels", "x", "--out", "a"], "by itself"),
            (["hello", "--audio", "x", "--out", "a"], "its own sound"),
            (["hello", "--view", "back", "--out", "a"], "--view"),
            (["hello", "--head", "x", "--out", "a"], "--tracks"),
            (["--tracks", "x", "--layout", "y", "--out", "a"], "goes with"),
        ],
    )
    def test_wrong_calls(self, capsys, arguments, message):
        assert run("speak", *arguments) == 2
        assert message in capsys.readouterr().err

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (["hello", "--out", "a.avi", "--model", "rule-based"], ".avi"),
            (["hello", "--out", "a", "--model", "nonsense"], "no model 'nonsense'"),
            (["hello", "--out", "a", "--model", "none.model"], "none.model"),
            (["--labels", "none.TextGrid", "--out", "a", "--model", "rule-based"], "none.TextGrid"),
            (["--tracks", "none.parquet", "--out", "a"], "none.parquet"),
        ],
    )
    def test_bad_data(self, tmp_path, monkeypatch, capsys, arguments, message):
        monkeypatch.chdir(tmp_path)
        assert run("speak", *arguments) == 1
        assert message in one_line(capsys)
        assert not list(tmp_path.iterdir())


class TestModels:
    def test_a_simulated_corpus_is_what_it_says(self):
        corpus = simulate_corpus("sv", 6)
        again = simulate_corpus("sv", 3)
        assert corpus.splits == ("test", "train")
        assert corpus.language == "sv"
        np.testing.assert_array_equal(
            corpus["sim002"].read_tracks().values, again["sim002"].read_tracks().values
        )
        first = corpus["sim001"]
        phones = first.read_phones()
        assert phones[len(phones) - 1].end == pytest.approx(first.duration, abs=1 / 60)

    def test_a_trained_model_is_kept_and_says_what_it_was_trained_on(self, cache, capsys):
        seen = []

        def note(task, done, total):
            seen.append(task)

        first = speak_models.prepare_model("phone-mean", "sv", utterances=6, progress=note)
        kept = speak_models.locate_model("phone-mean", "sv", 6)
        assert kept.is_file()
        assert kept.is_relative_to(cache)
        assert any("training phone-mean" in task for task in seen)
        seen.clear()
        second = speak_models.prepare_model("phone-mean", "sv", utterances=6, progress=note)
        assert not seen
        assert "simulated-sv" in speak_models.describe_model(second)
        assert second.trained_on_ == first.trained_on_
        phones = simulate_corpus("sv", 1)["sim001"].read_phones()
        np.testing.assert_array_equal(first.predict(phones).values, second.predict(phones).values)

    @pytest.mark.slow
    def test_a_damaged_one_is_made_again(self, cache, capsys):
        speak_models.prepare_model("mean", "sv", utterances=4)
        kept = speak_models.locate_model("mean", "sv", 4)
        kept.write_bytes(b"damaged")
        with pytest.warns(MocapFitWarning, match="made again"):
            assert speak_models.prepare_model("mean", "sv", utterances=4).is_fitted
        assert len(kept.read_bytes()) > 100

    def test_one_command_prepares_them(self, cache, capsys):
        prepared = prepare_voices(["sv"], ["mean"], utterances=6, check=True)
        report = prepared.to_dict()
        assert report["folder"] == cache / "models"
        assert [row["model"] for row in report["models"]] == ["mean", "rule-based"]
        assert report["models"][0]["trained_on"]["corpus"] == "simulated-sv"
        for row in report["models"]:
            assert 0 < row["rmse_percent"] < 60
            assert 0 <= row["bilabials_closed"] <= 1
        speak_printing.print_voices(prepared)
        assert "trained on" in capsys.readouterr().out

    def test_an_unknown_language_or_model_cannot_be_prepared(self, cache, capsys):
        assert run("speak", "--prepare", "--lang", "xx", "--model", "mean") == 1
        assert "'xx'" in one_line(capsys)
        assert run("speak", "--prepare", "--lang", "sv", "--model", "nonsense") == 1
        assert "nonsense" in one_line(capsys)

    def test_the_name_of_a_kept_model_depends_on_kind_language_and_size(self):
        names = {
            speak_models.locate_model(*which)
            for which in (
                ("mean", "sv", 4),
                ("mean", "cs", 4),
                ("ridge", "sv", 4),
                ("mean", "sv", 5),
            )
        }
        assert len(names) == 4

    def test_the_default_speaks_every_language(self, cache, capsys):
        for language in list_languages():
            assert choose_default(language) == DEFAULT_MODEL
            # As it is shipped: nothing is trained, or written into the cache.
            model = speak_models.prepare_model(DEFAULT_MODEL, language)
            assert model.trained_on_["corpus"] == f"simulated-{language}"
        assert not cache.exists()
        assert choose_default("de") == "rule-based"
        assert run("speak", "--help") == 0
        helped = " ".join(capsys.readouterr().out.replace("│", " ").split())
        assert f"By default {DEFAULT_MODEL}" in helped

    def test_shipped_voices_are_small(self):
        files = list(speak_models.SHIPPED.iterdir())
        assert len(files) == len(list_languages())
        assert sum(file.stat().st_size for file in files) < 5_000_000

    @pytest.mark.slow
    def test_shipped_voices_are_what_the_script_makes(self):
        """fixtures/make_voices.py, run again after the head or the simulation has changed."""
        corpus = simulate_corpus("cs")
        shipped = speak_models.prepare_model(DEFAULT_MODEL, "cs")
        again = train_model(DEFAULT_MODEL, corpus)
        for utterance in corpus.get_split("test").utterances[:10]:
            phones = utterance.read_phones()
            np.testing.assert_allclose(
                again.predict(phones).values, shipped.predict(phones).values, atol=1e-6
            )

    def test_how_long_training_takes_is_known_beforehand(self, cache):
        assert estimate_training({"sv": ["mean"]}).startswith("about 10 seconds")
        assert estimate_training({"sv": ["ann"], "cs": ["ann-ensemble"]}).startswith("about 2 m")
        seen = []
        prepare_voices(
            ["sv"], ["mean"], utterances=6, progress=lambda task, done, total: seen.append(task)
        )
        assert seen[0].startswith("training 1 model: about 10 seconds")
        seen.clear()
        speak_models.prepare_model(
            "mean", "cs", utterances=6, progress=lambda task, done, total: seen.append(task)
        )
        assert seen[0].startswith("training mean for cs, for this time and later ones: about 10 s")


class TestStream:
    def frames(self, text: str, **options) -> list[dict[str, float]]:
        return list(stream("rule-based", io.StringIO(text), language="en", **options))

    PLAIN = "0 0.1 sil\n0.1 0.2 B\n0.2 0.5 AA 1\n"

    def test_a_frame_a_line_with_time_and_parameters(self):
        frames = self.frames(self.PLAIN, rate=20)
        assert [frame["time"] for frame in frames] == pytest.approx(np.arange(10) / 20)
        assert max(frames, key=lambda f: f["jaw_rotation"])["time"] > 0.25

    def test_json_lines_say_the_same(self):
        lines = [
            {"start": 0, "end": 0.1, "phone": "sil"},
            {"start": 0.1, "end": 0.2, "phone": "B"},
            {"start": 0.2, "end": 0.5, "phone": "AA", "stress": 1},
        ]
        text = "\n".join(map(json.dumps, lines))
        assert self.frames(text, rate=20) == self.frames(self.PLAIN, rate=20)

    def test_an_empty_line_begins_another_utterance(self):
        once = self.frames(self.PLAIN, rate=20)
        assert self.frames(f"{self.PLAIN}\n{self.PLAIN}\n\n", rate=20) == once + once
        assert self.frames("") == []

    @pytest.mark.parametrize(
        "text", ["0 1e9 AA", "0 1e308 AA", "-1e9 0 AA", "0 0.1 AA\n1e9 1000000001 AA"]
    )
    def test_frames_for_hours_are_refused_before_they_are_computed(self, text):
        with pytest.raises(FileFormatError, match="too long after the one before"):
            self.frames(text)

    def test_times_may_begin_anywhere_and_the_file_with_a_mark(self):
        assert len(self.frames("\ufeff5000 5000.1 AA\n", rate=20)) == 2

    @pytest.mark.parametrize(
        "wrong", ["0.5", "a b c", "0 1 B 1 2", '{"start": 1}', "{", '{"start":0,"end":1,"phone":3}']
    )
    def test_a_line_that_is_no_phone_is_named(self, wrong):
        with pytest.raises(FileFormatError, match=r"line 2.*not a phone"):
            self.frames(f"0 0.1 sil\n{wrong}\n")

    def test_it_says_whether_the_model_is_live(self):
        said = []
        frames = stream("rule-based", io.StringIO(""), progress=lambda text, *_: said.append(text))
        assert list(frames) == []
        assert "waits for the end of each utterance; live are ann, " in said[-1]

    @pytest.mark.parametrize(
        ("wrong", "message"),
        [("0.05 0.2 B", "order of time"), ("0.1 0.2 XYZ", "XYZ"), ("0.3 0.2 B", "impossible time")],
    )
    def test_a_phone_that_cannot_be_said_is_named(self, wrong, message):
        with pytest.raises(FileFormatError, match=rf"line 2.*{message}"):
            self.frames(f"0 0.1 sil\n{wrong}\n")


class TestExport:
    @pytest.mark.parametrize(
        ("kind", "ending"), [("gltf", "glb"), ("gltf", "gltf"), ("fap", "fap"), ("csv", "csv")]
    )
    def test_each_format(self, tmp_path, tracks, capsys, kind, ending):
        out = tmp_path / f"a.{ending}"
        assert run("export", tracks, "--to", kind, "--out", out, "--json") == 0
        assert json.loads(capsys.readouterr().out)["frames"] == 20
        assert out.stat().st_size > 500

    @pytest.mark.slow
    def test_gltf_in_text_is_what_it_is_in_binary(self, tmp_path, tracks):
        for name in ("a.glb", "a.gltf"):
            assert run("export", tracks, "--to", "gltf", "--out", tmp_path / name) == 0
        library = pytest.importorskip("pygltflib").GLTF2
        binary, text = (library().load(str(tmp_path / name)) for name in ("a.glb", "a.gltf"))
        assert text.get_data_from_buffer_uri(text.buffers[0].uri) == binary.binary_blob()
        assert text.accessors == binary.accessors

    def test_a_rate_of_years_is_refused(self, tmp_path, capsys):
        made = ParameterTracks(("a",), 1e-6, np.zeros((20, 1)))
        write_parquet(made, tmp_path / "x.parquet")
        call = ["export", tmp_path / "x.parquet", "--to", "csv", "--out", tmp_path / "x.csv"]
        assert run(*call, "--rate", 240) == 1
        assert "claims to be larger" in one_line(capsys)
        assert not (tmp_path / "x.csv").exists()

    def test_csv_holds_the_values_and_leaves_what_is_missing_empty(self, tmp_path):
        values = np.array([[0.1, 1.0], [np.nan, 0.5], [0.3, 0.0]])
        made = ParameterTracks(("a", "b"), 10, values, start_time=0.5)
        write_parquet(made, tmp_path / "x.parquet")
        assert (
            run("export", tmp_path / "x.parquet", "--to", "csv", "--out", tmp_path / "x.csv") == 0
        )
        assert (tmp_path / "x.csv").read_text().splitlines() == [
            "time,a,b",
            "0.500000,0.100000,1.000000",
            "0.600000,,0.500000",
            "0.700000,0.300000,0.000000",
        ]
        call = ["export", tmp_path / "x.parquet", "--to", "csv", "--out", tmp_path / "y.csv"]
        assert run(*call, "--rate", "20") == 0
        rows = (tmp_path / "y.csv").read_text().splitlines()
        assert len(rows) == 6
        assert rows[2] == "0.550000,0.150000,0.750000" or rows[2] == "0.550000,,0.750000"

    def test_wrong_names_are_refused(self, tmp_path, tracks, capsys):
        assert run("export", tracks, "--to", "csv", "--out", tmp_path / "a.txt") == 1
        assert ".csv" in one_line(capsys)
        assert run("export", tracks, "--to", "fbx", "--out", tmp_path / "a.fbx") == 2
