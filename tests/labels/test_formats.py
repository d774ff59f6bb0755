"""Every format of labels: what is written reads back, what is wrong is said."""

import contextlib
import string
import warnings

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mocap_fit.errors import DataError, FileFormatError, MocapFitError, MocapFitWarning
from mocap_fit.labels import (
    LABEL_READERS,
    Label,
    Labels,
    Tier,
    fill_label_gaps,
    find_label_reader,
    read_all_labels,
    read_labels,
    write_labels,
)
from mocap_fit.labels.text import format_number

# Times that hypothesis draws are short.
pytestmark = pytest.mark.filterwarnings("ignore:.*in HTK's units")

times = st.floats(0, 1e4, allow_nan=False)
any_text = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\r\0"), max_size=8)
line_text = any_text.filter(lambda t: "\n" not in t).map(str.strip)
quick = settings(max_examples=60, deadline=None)


def rounded_trip(labels, path, **settings):
    """Write, read, write again: the labels must be the same, and so must the bytes."""
    write_labels(labels, path, **settings)
    first = path.read_bytes()
    read = read_all_labels(path, **settings)
    write_labels(read if len(read) != 1 else read[0], path, **settings)
    assert path.read_bytes() == first
    assert not list(path.parent.glob(".*"))
    return read


@st.composite
def grids(draw):
    tiers = []
    for kind in draw(st.lists(st.sampled_from(["interval", "point"]), max_size=3)):
        entries = []
        for _ in range(draw(st.integers(0, 4))):
            start = draw(times)
            end = draw(times) if kind == "interval" else start
            entries.append(Label(start, end, draw(any_text)))
        tiers.append(Tier(draw(any_text), tuple(entries), kind, draw(st.none() | st.just(2e4))))
    return Labels(tuple(tiers), draw(times), draw(times), name="take")


@quick
@given(labels=grids())
def test_a_textgrid_keeps_everything(labels, tmp_path_factory):
    path = tmp_path_factory.mktemp("grid") / "take.TextGrid"
    if any(tier.start == labels.start for tier in labels.tiers):
        return
    assert rounded_trip(labels, path) == (labels,)


@st.composite
def stretches(draw, top, contiguous=False):
    """Ordered whole numbers: start and end of some labels, with or without gaps."""
    count = draw(st.integers(1, 6))
    size = count + 1 if contiguous else 2 * count
    marks = sorted(draw(st.lists(st.integers(0, top), min_size=size, max_size=size, unique=True)))
    if contiguous:
        return list(zip([0, *marks[1:]], [*marks[1:], top + 1], strict=True))
    return list(zip(marks[::2], marks[1::2], strict=True))


def made(pairs, texts, unit, extra="", name="phone"):
    return Tier(
        name,
        tuple(Label(a / unit, b / unit, t, extra) for (a, b), t in zip(pairs, texts, strict=False)),
    )


@quick
@given(data=st.data())
def test_htk_keeps_units_of_100_ns_and_the_words_above(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("htk") / "take.lab"
    names = line_text.filter(lambda t: t != "!NULL")
    pairs = data.draw(stretches(10**12))
    phones = made(pairs, data.draw(st.lists(names, min_size=6, max_size=6)), 1e7, "score=-1.5")
    # Words over groups of phones, with phones between that belong to none.
    words, first = [], 0
    while first < len(pairs):
        last = data.draw(st.integers(first, len(pairs) - 1))
        if data.draw(st.booleans()):
            words.append(
                Label(phones.entries[first].start, phones.entries[last].end, data.draw(names))
            )
        first = last + 1
    tiers = (phones, Tier("word", tuple(words))) if words else (phones,)
    labels = Labels(tiers, 0.0, pairs[-1][1] / 1e7, name="take")
    assert rounded_trip(labels, path, reader="htk-lab") == (labels,)


@quick
@given(data=st.data())
def test_a_master_label_file_keeps_many_utterances(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("mlf") / "all.mlf"
    utterances = []
    for number in range(data.draw(st.integers(0, 3))):
        pairs = data.draw(stretches(10**9))
        texts = data.draw(st.lists(line_text, min_size=6, max_size=6))
        tier = made(pairs, texts, 1e7)
        utterances.append(Labels((tier,), 0.0, pairs[-1][1] / 1e7, name=f"s1.take {number}"))
    assert rounded_trip(utterances, path) == tuple(utterances)


@quick
@given(data=st.data(), colour=st.sampled_from(["", "colour=121"]))
def test_esps_keeps_ends_colours_and_header(data, colour, tmp_path_factory):
    path = tmp_path_factory.mktemp("esps") / "take.lab"
    texts = data.draw(st.lists(line_text, min_size=6, max_size=6))
    pairs = data.draw(stretches(10**9, contiguous=True))
    tier = made(pairs, texts, 7919.0, colour)
    labels = Labels(
        (tier,), 0.0, tier.entries[-1].end, name="take", header=("signal take", "type 0")
    )
    assert rounded_trip(labels, path, reader="esps-lab") == (labels,)
    assert find_label_reader(path) == "esps-lab"


@quick
@given(data=st.data(), rate=st.sampled_from([None, 8000.0, 44100.0]))
def test_timit_keeps_samples(data, rate, tmp_path_factory):
    path = tmp_path_factory.mktemp("timit") / "take.phn"
    texts = data.draw(st.lists(line_text, min_size=6, max_size=6))
    pairs = data.draw(stretches(10**9))
    tier = made(pairs, texts, rate or 16000.0)
    assume(not any(text.lower() == "q" for text in texts))
    labels = Labels((tier,), 0.0, tier.entries[-1].end, name="take")
    assert rounded_trip(labels, path, rate=rate) == (labels,)


@quick
@given(data=st.data())
def test_csv_keeps_all_columns(data, tmp_path_factory):
    path = tmp_path_factory.mktemp("csv") / "take.csv"
    pairs = data.draw(stretches(10**9))
    lists = st.lists(any_text, min_size=6, max_size=6)
    tiers = tuple(
        made(pairs, data.draw(lists), 1009.0, name=n) for n in ("phone", "stress", "word")
    )
    labels = Labels(tiers, 0.0, tiers[0].entries[-1].end, name="take")
    assert rounded_trip(labels, path) == (labels,)


SHORT = """File type = "ooTextFile"
Object class = "TextGrid"

0
1.5
<exists>
2
"IntervalTier"
"phones"
0
1.5
3
0
0.5
" kept blanks "
0.5
0.75
""
0.75
1.5
"say ""xmin = 3"" ä
twice"
"TextTier"
"tones"
0
1.5
1
0.1234567890123456
"H*"
"""


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    ("encoding", "mark"),
    [
        ("utf-8", b""),
        ("utf-8-sig", b""),
        ("utf-16-le", b"\xff\xfe"),
        ("utf-16-be", b"\xfe\xff"),
        ("utf-16-le", b""),
        ("utf-16-be", b""),
    ],
)
def test_textgrids_in_every_encoding(tmp_path, encoding, mark, end):
    path = tmp_path / "take.TextGrid"
    path.write_bytes(mark + SHORT.replace("\n", end).encode(encoding))
    labels = read_labels(path)
    phones, tones = labels.tiers
    assert [entry.text for entry in phones.entries] == [
        " kept blanks ",
        "",
        'say "xmin = 3" ä\ntwice',
    ]
    time = 0.1234567890123456
    assert tones == Tier("tones", (Label(time, time, "H*"),), "point")
    again = tmp_path / "long.TextGrid"
    write_labels(labels, again)
    assert read_labels(again).tiers == labels.tiers


def test_latin_1_is_read_with_a_warning(tmp_path):
    path = tmp_path / "take.TextGrid"
    path.write_bytes(SHORT.encode("latin-1"))
    with pytest.warns(MocapFitWarning, match="Latin-1"):
        assert "ä" in read_labels(path).tiers[0].entries[2].text


def test_praatio_reads_what_we_write(tmp_path):
    textgrid = pytest.importorskip("praatio.textgrid")
    path = tmp_path / "take.TextGrid"
    entries = (Label(0, 0.25, ""), Label(0.25, 0.5, 'a "b"'), Label(0.5, 2, "ə"))
    tones = Tier("tones", (Label(1.5, 1.5, "H"),), "point")
    write_labels(Labels((Tier("phones", entries), tones), 0.0, 2.0), path)
    read = textgrid.openTextgrid(str(path), includeEmptyIntervals=True)
    assert [tuple(e) for e in read.getTier("phones").entries] == [
        (e.start, e.end, e.text) for e in entries
    ]
    assert [tuple(e) for e in read.getTier("tones").entries] == [(1.5, "H")]


@pytest.mark.parametrize(
    ("name", "content", "reader"),
    [
        ("a.lab", "0 100000 sil\n100000 250000 a\n", "htk-lab"),
        ("a.lab", "0\t100000\tsil -12.5 word\r\n", "htk-lab"),
        ("a.lab", "separator ;\nnfields 1\n#\n\t0.2 26 #\n", "esps-lab"),
        ("a.lab", "#\n0.5 100 pau\n", "esps-lab"),
        ("a.lab", "signal x\ntype 0\n#\n", "esps-lab"),
        ("a.txt", "#!MLF!#\n", "htk-mlf"),
        ("a.phn", "0 3050 h#\n3050 4559 sh\n", "timit"),
        ("A.PHN", "0 3050 h#\n", "timit"),
        ("a.csv", "start,end,phone\n0,1,a\n", "csv"),
        ("a.txt", "Begin;End;Segment\n0,5;1,25;a\n", "csv"),
        ("a.csv", "Start Time (s),End [sec],phone\n0,1,a\n", "csv"),
        ("a.csv", "start_s,end_s,phone\n0,1,a\n", "csv"),
        ("a.lab", SHORT, "textgrid"),
    ],
)
def test_the_content_tells_the_format(tmp_path, name, content, reader):
    path = tmp_path / name
    path.write_text(content, newline="")
    assert find_label_reader(path) == reader
    for labels in read_all_labels(path):
        assert labels.tiers


def test_the_units_of_every_format(tmp_path):
    def entries(name, content, **settings):
        path = tmp_path / name
        path.write_text(content)
        return [(e.start, e.end, e.text) for e in read_labels(path, **settings).tiers[0].entries]

    assert entries("a.lab", "0 2500000 a\n") == [(0, 0.25, "a")]
    assert entries("a.phn", "0 4000 a\n") == [(0, 0.25, "a")]
    assert entries("a.phn", "0 4000 a\n", rate=8000) == [(0, 0.5, "a")]
    assert entries("b.lab", "#\n.25 26 a\n1 26 b c\n") == [(0, 0.25, "a"), (0.25, 1, "b c")]
    assert entries("a.csv", "start;end;phone\n0,5;1,25;a\n") == [(0.5, 1.25, "a")]


def test_htk_levels_names_and_scores(tmp_path):
    path = tmp_path / "all.mlf"
    path.write_text(
        '#!MLF!#\n"*/one.lab"\n0 10 sil -3.5\n10 20 h -1 hello -7\n20 30 \\303\\244\n'
        '30 40 "two words" 0 \'it\\\'s\'\n.\n"/x/two.rec"\n0 10 a\n///\n0 10 b\n.\n'
    )
    one = read_labels(path, "one")
    assert [e.text for e in one.get_tier("phone").entries] == ["sil", "h", "ä", "two words"]
    assert [e.extra for e in one.get_tier("phone").entries] == [
        "score=-3.5",
        "score=-1",
        "",
        "score=0",
    ]
    assert one.get_tier("word").entries == (
        Label(1e-6, 3e-6, "hello", "score=-7"),
        Label(3e-6, 4e-6, "it's"),
    )
    assert read_labels(path, "two").tiers[0].entries == (Label(0, 1e-6, "a"),)
    with pytest.raises(DataError, match=r"several utterances.*one, two"):
        read_labels(path)
    with pytest.raises(DataError, match="no utterance 'three'"):
        read_labels(path, "three")


def test_a_wrd_beside_a_phn_is_read_with_it(tmp_path):
    (tmp_path / "a.phn").write_text("0 100 h#\n100 200 sh\n200 300 iy\n")
    (tmp_path / "a.wrd").write_text("100 300 she\n")
    labels = read_labels(tmp_path / "a.phn")
    assert [tier.name for tier in labels.tiers] == ["phone", "word"]
    write_labels(labels, tmp_path / "b.TextGrid")
    with pytest.warns(MocapFitWarning, match="cannot hold: phone"):
        write_labels(labels, tmp_path / "b.wrd")
    assert (tmp_path / "b.wrd").read_bytes() == (tmp_path / "a.wrd").read_bytes()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.TextGrid", SHORT[:-40], "ends too early|has no end|not a whole"),
        ("a.TextGrid", SHORT.replace('"H*"', '"H*'), "no end"),
        ("a.TextGrid", SHORT.replace("TextTier", "PitchTier"), "unknown class of tier"),
        ("a.TextGrid", SHORT.replace("\n0.75\n1.5", "\nx\n1.5"), "TextGrid is damaged"),
        ("a.TextGrid", SHORT.replace("0.1234567890123456", "1e999"), "not a time"),
        ("a.TextGrid", SHORT.replace("TextGrid", "Collection", 1), "not a TextGrid"),
        ("a.lab", "hello world\n", "transcript: text without times.*mocap-fit align"),
        ("a.lab", "0.5 a\n", "line 1: the line has one time"),
        ("a.lab", "0.0 a\n", "no label reader.*'0.0 a'"),
        ("a.rec", "hello\n", "line 1.*not a label of HTK"),
        ("a.phn", "0 10 a\nb\n", "line 2.*not a label of TIMIT"),
        ("a.phn", f"0 {'9' * 400} a\n", "line 1.*not a label of TIMIT"),
        ("a.rec", f"0 {'9' * 5000} a\n", "line 1.*not a label of HTK"),
        ("a.csv", "0,1,a\n", "columns of the table are not named"),
        ("a.csv", "start_ms,end_ms,phone\n0,1,a\n", "columns of the table are not named"),
        ("a.csv", "start,end,phone\n0,1\n", "line 2.*number of columns"),
        ("a.csv", "start,end,phone\n0,x,a\n", "line 2.*not a time"),
        ("a.csv", "start,end,phone\n0,nan,a\n", "line 2.*not a time"),
        ("a.mlf", "hello\n", "not a master label file"),
        ("a.mlf", "#!MLF!#\n0 1 a\n", "line 2.*name in quotation marks"),
        ("a.mlf", '#!MLF!#\n"a.lab"\n.\n"b/a.lab"\n.\n', "line 4|comes twice"),
        ("a.esps", "separator ;\n", "header has no end"),
        ("a.esps", "#\nx\n", "line 2.*not a label of ESPS"),
        ("a.csv", "start,end\0\n", "binary|no label|not named"),
        ("a.csv", "", "empty"),
    ],
)
def test_bad_files_are_refused_in_words(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(FileFormatError, match=message) as caught:
        read_all_labels(path)
    assert name in str(caught.value)


@quick
@given(content=st.binary(max_size=200), name=st.sampled_from(sorted(LABEL_READERS.names())))
def test_any_bytes_are_read_or_refused(content, name, tmp_path_factory):
    path = tmp_path_factory.mktemp("any") / "a.lab"
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MocapFitWarning)
        for cut in (None, name):
            with contextlib.suppress(MocapFitError):
                read_all_labels(path, reader=cut)


def test_what_a_format_cannot_say_is_refused_or_warned_of(tmp_path):
    gap = Labels((Tier("phone", (Label(0.5, 1, "a"),)),), 0.0, 1.0)
    with pytest.raises(DataError, match="only ends"):
        write_labels(gap, tmp_path / "a.lab", reader="esps-lab")
    write_labels(fill_label_gaps(gap), tmp_path / "a.lab", reader="esps-lab")
    points = Labels((*gap.tiers, Tier("tones", (), "point")), 0.0, 1.0)
    for name in ("a.lab", "a.csv", "a.phn"):
        with pytest.warns(MocapFitWarning, match="tones"):
            write_labels(points, tmp_path / name)
    with pytest.raises(DataError, match="cannot write the label"):
        write_labels(Labels((Tier("phone", (Label(0, 1, "a\nb"),)),), 0.0, 1.0), tmp_path / "b.lab")
    with pytest.raises(FileFormatError, match="extension"):
        write_labels(gap, tmp_path / "a.xyz")
    with pytest.raises(FileFormatError, match="cannot be written"):
        write_labels(gap, tmp_path / "none" / "a.csv")
    with pytest.raises(DataError, match="holds one utterance"):
        write_labels([gap, gap], tmp_path / "a.csv")
    with pytest.raises(DataError, match="needs a name"):
        write_labels([gap, gap], tmp_path / "a.mlf")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.csv", "a.lab", "a.phn"]


@given(value=st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_read_back_exactly(value):
    text = format_number(value)
    assert float(text) == value
    assert set(text) <= set(string.digits + ".-")


def test_a_textgrid_is_written_as_praat_writes_it(tmp_path):
    words = Tier("words", (Label(0, 0.5, 'a "b"'), Label(0.5, 1, "")))
    tones = Tier("tones", (Label(0.25, 0.25, "H"),), "point")
    write_labels(Labels((words, tones), 0.0, 1.0), tmp_path / "a.TextGrid")
    assert (tmp_path / "a.TextGrid").read_text(encoding="utf-8") == (
        'File type = "ooTextFile"\n'
        'Object class = "TextGrid"\n'
        "\n"
        "xmin = 0 \n"
        "xmax = 1 \n"
        "tiers? <exists> \n"
        "size = 2 \n"
        "item []: \n"
        "    item [1]:\n"
        '        class = "IntervalTier" \n'
        '        name = "words" \n'
        "        xmin = 0 \n"
        "        xmax = 1 \n"
        "        intervals: size = 2 \n"
        "        intervals [1]:\n"
        "            xmin = 0 \n"
        "            xmax = 0.5 \n"
        '            text = "a ""b""" \n'
        "        intervals [2]:\n"
        "            xmin = 0.5 \n"
        "            xmax = 1 \n"
        '            text = "" \n'
        "    item [2]:\n"
        '        class = "TextTier" \n'
        '        name = "tones" \n'
        "        xmin = 0 \n"
        "        xmax = 1 \n"
        "        points: size = 1 \n"
        "        points [1]:\n"
        "            number = 0.25 \n"
        '            mark = "H" \n'
    )


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("a.lab", "0 1 a\n"),
        ("a.phn", "0 1 a\n"),
        ("a.esps", "1 1 a\n"),
        ("a.mlf", "0 1 a\n"),
        ("a.csv", ",,\n"),
        ("a.eaf", "<a/><a/>\n"),
        ("a.TextGrid", '""\n'),
    ],
)
def test_more_labels_than_fit_into_memory_are_refused(tmp_path, monkeypatch, name, line):
    path = tmp_path / name
    start = {".csv": "start,end,a\n", ".mlf": "#!MLF!#\n", ".esps": "#\n"}.get(path.suffix, "")
    path.write_text(start + 21_000 * line)
    reader = {".eaf": "elan", ".TextGrid": "textgrid"}.get(path.suffix)
    monkeypatch.setenv("MOCAP_FIT_MAX_SIZE", "10MB")
    with pytest.raises(FileFormatError, match=r"larger than.*10,000,000 bytes.*--max-size"):
        read_all_labels(path, reader=reader)


def test_a_file_far_too_large_for_labels_is_not_read(tmp_path):
    path = tmp_path / "a.TextGrid"
    with path.open("wb") as file:
        file.truncate(256 * 2**20 + 1)
    with pytest.raises(FileFormatError, match="too large for labels"):
        read_all_labels(path, reader="textgrid")
