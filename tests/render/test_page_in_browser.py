"""The web page in headless Chromium, from disk, without network."""

import io
import shutil

import numpy as np
import pytest
from matplotlib.image import imread

import mocap_fit as mf
from mocap_fit.control.rule_based import RuleBased
from mocap_fit.render import FaceScene, Mark, write_page
from mocap_fit.render.liveliness import LivelyFace, plan_liveliness
from mocap_fit.render.sampling import sample_parameters
from mocap_fit.render.talking import deform_face
from mocap_fit.sound import Sound, read_sound
from mocap_fit.tracks import MarkerTracks, ParameterTracks

pytestmark = pytest.mark.slow
SWIFTSHADER = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
ARGUMENTS = ("--no-sandbox", "--autoplay-policy=no-user-gesture-required", *SWIFTSHADER)
PLAY = """async () => {
    const page = window.page;
    await page.play();
    await new Promise((done) => setTimeout(done, 2000));
    return new Promise((done) => requestAnimationFrame(() => {
        const audio = page.clock.sound ? page.clock.sound.currentTime + page.record.start : null;
        page.draw();
        done({
            audio,
            picture: page.record.first + page.frame / page.record.rate,
            line: page.strip.toTime(page.strip.line),
            slider: page.record.start + Number(document.getElementById("scrub").value),
            playing: page.clock.playing,
        });
    }));
}"""


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api")
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        pytest.skip("chromium is not installed")
    with playwright.sync_playwright() as engine:
        chromium = engine.chromium.launch(executable_path=program, args=list(ARGUMENTS))
        yield chromium
        chromium.close()


@pytest.fixture
def show(browser):
    """Open a page from disk and collect what its console says."""
    contexts = []

    def open_page(path, **options):
        options = {"viewport": {"width": 1280, "height": 800}, **options}
        context = browser.new_context(offline=True, **options)
        contexts.append(context)
        page = context.new_page()
        page.said = []
        page.on("console", lambda message: page.said.append(message.text))
        page.on("pageerror", lambda error: page.said.append(str(error)))
        page.goto(path.as_uri())
        page.wait_for_function("window.page")
        return page

    yield open_page
    for context in contexts:
        context.close()


@pytest.fixture(scope="module")
def phones():
    return mf.read_phones(mf.load_sample("take_01.TextGrid"), phone_set="sv-sta")


@pytest.fixture(scope="module")
def heads(phones):
    model = RuleBased().prepare("sv-sta")
    predicted = mf.synthesise(phones, model, 60.0)
    return {"measured": predicted.replace(values=0.8 * predicted.values), "rules": predicted}


@pytest.fixture(scope="module")
def sounding(tmp_path_factory, heads, phones):
    path = tmp_path_factory.mktemp("pages") / "sounding.html"
    return write_page(
        path,
        mf.load_face(tongue=True),
        heads,
        title="take 1",
        sound=read_sound(mf.load_sample("take_01.wav")),
        phones=phones,
        marks=[Mark("a spike", 1.0, 1.2, "error")],
        blinks=True,
        head_motion=True,
    )


def measure_vertices(page, head, frame):
    """Vertices that the page draws, as its own decoder gives them."""
    flat = page.evaluate(
        f"() => {{ const face = window.page.view.face;"
        f" face.pose({head}, {frame}, window.page.record.frames); return [...face.vertices]; }}"
    )
    return np.reshape(flat, (-1, 3))


def test_vertices_are_within_a_tenth_of_a_millimetre_of_the_rig(show, sounding, heads, phones):
    page = show(sounding.path)
    rig = mf.load_face(tongue=True)
    record = page.evaluate("({first: page.record.first, frames: page.record.frames})")
    times = record["first"] + np.arange(record["frames"]) / 60.0
    life = plan_liveliness(times, rig.mesh, blinks=True, head_motion=True, seed=0)
    lively = LivelyFace(rig.mesh)
    assert life.blinks.max() == 1.0
    for number, head in enumerate(heads.values()):
        values = sample_parameters(head, times, rig, phones)
        frames = {*range(0, len(times), 61), int(life.blinks.argmax()), int(values[:, 0].argmax())}
        for frame in frames:
            drawn = measure_vertices(page, number, frame)
            true = deform_face(rig, lively, values[frame], life, frame)
            assert np.linalg.norm(drawn - true, axis=1).max() < 0.1
    assert sounding.largest_error < 0.1
    assert page.said == []


@pytest.mark.parametrize(("view", "key"), [("front", "1"), ("three-quarter", "7"), ("side", "3")])
def test_the_head_looks_as_in_a_movie(show, tmp_path, view, key):
    rig = mf.load_face()
    values = np.zeros((2, 10))
    values[:, 0] = 0.4
    tracks = ParameterTracks(rig.parameter_names, 60.0, values)
    page = show(write_page(tmp_path / "look.html", rig, {"open": tracks}).path)
    page.keyboard.press(key)
    page.add_style_tag(content="#views, #captions, #names { display: none !important }")
    page.wait_for_timeout(300)
    picture = imread(io.BytesIO(page.locator("#view").screenshot()))
    drawn = 255 * picture[..., :3]
    with FaceScene(rig.mesh, view=view, size=drawn.shape[1::-1]) as scene:
        movie = scene.draw(rig.deform(values[0])).astype(float)
    # Rounded corners are not compared, nor are outlines, which are smoothed in two ways.
    difference = np.abs(drawn - movie)[20:-20, 20:-20].max(axis=2)
    assert np.median(difference) <= 2
    assert (difference > 24).mean() < 0.02
    assert page.said == []


def test_picture_line_and_sound_agree_while_it_plays(show, sounding):
    page = show(sounding.path)
    now = page.evaluate(PLAY)
    assert now["playing"]
    assert now["audio"] > 0.5
    for what in ("picture", "line", "slider"):
        assert abs(now[what] - now["audio"]) < 1 / sounding.rate, (what, now)
    assert page.said == []


def test_without_sound_the_page_has_its_clock(show, tmp_path, heads):
    written = write_page(tmp_path / "silent.html", mf.load_face(), {"rules": heads["rules"]})
    page = show(written.path)
    now = page.evaluate(PLAY)
    assert now["audio"] is None
    assert 1.0 < now["picture"] < 3.0
    assert abs(now["line"] - now["picture"]) < 1 / written.rate
    assert page.said == []


def test_keys_play_step_select_and_stop(show, sounding):
    page = show(sounding.path)
    state = "({time: page.clock.time, playing: page.clock.playing, chosen: page.strip.selection})"
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    assert page.evaluate(state)["time"] == pytest.approx(2 / 60, abs=1e-3)
    page.keyboard.press("ArrowLeft")
    assert page.evaluate(state)["time"] == pytest.approx(1 / 60, abs=1e-3)
    page.keyboard.press("Space")
    page.wait_for_function("page.clock.playing")
    page.keyboard.press("Space")
    assert not page.evaluate(state)["playing"]
    # A click on a phone selects it; Tab plays it and stops at its end.
    box = page.locator("#curves").bounding_box()
    page.mouse.click(box["x"] + box["width"] * 0.05, box["y"] + 88)
    start, end = page.evaluate(state)["chosen"]
    assert [start, end] == page.evaluate("page.record.phones[0].slice(0, 2)")
    page.keyboard.press("Tab")
    page.wait_for_function("!page.clock.playing")
    assert page.evaluate(state)["time"] == pytest.approx(end, abs=1 / 60)
    page.keyboard.press("Escape")
    assert page.evaluate(state)["chosen"] is None
    # Without a selection Tab goes to the next control.
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement !== document.body")
    assert page.said == []


def test_a_loop_stays_in_its_selection_at_another_speed(show, sounding):
    page = show(sounding.path)
    page.select_option("#speed", "2")
    page.evaluate("page.select(1.0, 1.2); page.setLoop(true); page.playSelection()")
    page.evaluate("page.before = 0; page.turns = 0")
    page.wait_for_function(
        "() => { const now = page.clock.now(); page.turns += now < page.before;"
        " page.before = now; return page.turns > 2; }"
    )
    assert page.evaluate("page.clock.playing && page.clock.now() > 0.9")
    assert page.evaluate("page.clock.sound.playbackRate") == 2
    assert page.said == []


def test_markers_have_names_and_distances_under_the_mouse(show, tmp_path, heads):
    places = [[0.0, -60.0, 110.0], [30.0, -20.0, 100.0]]
    positions = np.tile(places, (len(heads["rules"].times), 1, 1))
    positions[5:9, 1] = np.nan
    markers = MarkerTracks(("chin", "cheek"), 60.0, positions)
    virtual = {"rules": markers.select(["chin"]).replace(positions=positions[:, :1] + [0, 0, 3])}
    one = {"rules": heads["rules"]}
    write_page(
        tmp_path / "m.html", mf.load_face(), one, markers={"measured": markers}, virtual=virtual
    )
    page = show(tmp_path / "m.html")
    page.evaluate("page.seek(0.1)")
    page.wait_for_function("page.frame > 5")
    x, y, _ = page.evaluate("page.view.project([0, -60, 110], 0)")
    page.evaluate(f"page.mouse = [{x}, {y}]")
    shown = "page.listPoints(page.record.markers)"
    assert page.evaluate(f"{shown}.points.map((p) => [p.name, p.ring])") == [
        ["chin", 0],
        ["chin", 1],
    ]
    assert page.evaluate(f"{shown}.lines.length") == 2
    near = page.evaluate(f"page.findPoint([{shown}]).point")
    assert near["name"] == "chin"
    assert near["distance"] == pytest.approx(3.0, abs=0.02)
    assert page.evaluate("findGaps(page.record.markers[0])") == [[1, 5, 9]]
    assert page.said == []


def test_models_change_the_face_and_values_are_those_of_the_tracks(show, sounding, heads, phones):
    page = show(sounding.path)
    page.select_option("#face", "1")
    page.select_option("#beside", "-1")
    page.evaluate("page.seek(1.0)")
    page.wait_for_function("page.view.columns === 1")
    assert page.evaluate("page.strip.chosen") == 1
    lines = page.evaluate("page.toTable()").splitlines()
    rows = [line.split("\t") for line in lines]
    assert rows[0][:3] == ["track", "phone", "word"]
    assert len(rows) == 1 + len(heads) * 10 * len(phones)
    row = next(r for r in rows if r[:2] == ["rules", "A"] and r[5] == "jaw_rotation")
    times, values = heads["rules"].times, heads["rules"]["jaw_rotation"]
    inside = values[(times >= float(row[3]) - 1e-4) & (times < float(row[4]) - 1e-4)]
    expected = [inside.min(), inside.mean(), inside.max()]
    assert [float(each) for each in row[6:]] == pytest.approx(expected, abs=2e-4)
    page.click("#marks-box summary")
    page.click("#marks button")
    assert page.evaluate("page.strip.selection") == [1.0, 1.2]
    assert page.said == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_is_usable_on_a_telephone(show, sounding, scheme):
    size = {"width": 400, "height": 800}
    page = show(sounding.path, viewport=size, has_touch=True, color_scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    for control in ("#play", "#scrub", "#loop", "#speed", "#face", "#curves", "#head"):
        box = page.locator(control).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 400
        assert box["height"] >= 24
    # Head and the button that plays are in the first screen.
    assert page.locator("#play").bounding_box()["y"] < 760
    page.tap("#play")
    page.wait_for_function("page.clock.playing && page.clock.now() > 0.2")
    # Every control has a name.
    unnamed = page.evaluate(
        "[...document.querySelectorAll('button, select, input')].filter((e) => !(e.textContent"
        " || e.ariaLabel || e.labels && e.labels[0]?.textContent)).map((e) => e.outerHTML)"
    )
    assert unnamed == []
    assert page.said == []


def test_ten_seconds_are_less_than_four_megabytes(tmp_path, heads, rng):
    rates = [np.tile(head.values, (4, 1))[:600] for head in heads.values()]
    longer = {
        name: head.replace(values=values, standard_deviations=None, residuals=None)
        for (name, head), values in zip(heads.items(), rates, strict=True)
    }
    sound = Sound(0.1 * rng.normal(size=480000), 48000.0)
    page = write_page(
        tmp_path / "long.html", mf.load_face(tongue=True), longer, sound=sound, blinks=True
    )
    assert page.duration == pytest.approx(10.0)
    assert page.size < 4e6
