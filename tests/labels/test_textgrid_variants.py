"""TextGrids in every form that Praat writes, and what other programs make of them."""

import struct
import warnings

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit.errors import FileFormatError, MocapFitWarning
from mocap_fit.labels import Label, Labels, Tier, read_labels, read_phones, write_labels
from mocap_fit.labels.praat_tokens import parse_number

quick = settings(max_examples=40, deadline=None)


# Literal writers: one a form, with nothing of the readers.


def quoted(text):
    return '"' + text.replace('"', '""') + '"'


def as_long(labels, sizes=None):
    """The long form; `sizes` replaces the announced sizes of tiers."""
    lines = ['File type = "ooTextFile"', 'Object class = "TextGrid"', ""]
    lines += [f"xmin = {labels.start!r} ", f"xmax = {labels.end!r} ", "tiers? <exists> "]
    lines += [f"size = {len(labels.tiers)} ", "item []: "]
    for number, tier in enumerate(labels.tiers, start=1):
        interval = tier.kind == "interval"
        noun, name = ("intervals", "IntervalTier") if interval else ("points", "TextTier")
        size = len(tier.entries) if sizes is None else sizes[number - 1]
        lines += [f"    item [{number}]:", f'        class = "{name}" ']
        lines += [f"        name = {quoted(tier.name)} ", f"        xmin = {labels.start!r} "]
        lines += [f"        xmax = {labels.end!r} ", f"        {noun}: size = {size} "]
        for position, entry in enumerate(tier.entries, start=1):
            lines.append(f"        {noun} [{position}]:")
            if interval:
                lines += [
                    f"            xmin = {entry.start!r} ",
                    f"            xmax = {entry.end!r} ",
                ]
                lines.append(f"            text = {quoted(entry.text)} ")
            else:
                lines.append(f"            number = {entry.start!r} ")
                lines.append(f"            mark = {quoted(entry.text)} ")
    return "\n".join(lines) + "\n"


def as_short(labels):
    words = [labels.start, labels.end, "<exists>", len(labels.tiers)]
    for tier in labels.tiers:
        words += ['"IntervalTier"' if tier.kind == "interval" else '"TextTier"', quoted(tier.name)]
        words += [labels.start, labels.end, len(tier.entries)]
        for entry in tier.entries:
            words += [entry.start, entry.end] if tier.kind == "interval" else [entry.start]
            words.append(quoted(entry.text))
    head = 'File type = "ooTextFile"\nObject class = "TextGrid"\n\n'
    return head + "\n".join(map(str, words)) + "\n"


def as_chronological(labels):
    lines = ['"Praat chronological TextGrid text file"']
    lines.append(f"{labels.start!r} {labels.end!r}   ! Time domain.")
    lines.append(f"{len(labels.tiers)}   ! Number of tiers.")
    events = []
    for number, tier in enumerate(labels.tiers, start=1):
        name = "IntervalTier" if tier.kind == "interval" else "TextTier"
        lines.append(f'"{name}" {quoted(tier.name)} {labels.start!r} {labels.end!r}')
        for position, entry in enumerate(tier.entries):
            events.append((entry.start, number, position, tier.kind, entry))
    for _, number, _, kind, entry in sorted(events, key=lambda event: event[:3]):
        times = f"{entry.start!r} {entry.end!r}" if kind == "interval" else f"{entry.start!r}"
        lines += ["", f"! tier {number}:", f"{number} {times}", quoted(entry.text)]
    return "\n".join(lines) + "\n"


def binary_text(text):
    if text.isascii():
        return struct.pack(">H", len(text)) + text.encode()
    return struct.pack(">HH", 0xFFFF, len(text)) + text.encode("utf-16-be")


def as_binary(labels, class_name=b"TextGrid", counts=None):
    parts = [b"ooBinaryFile", bytes([len(class_name)]), class_name]
    parts.append(struct.pack(">dd?i", labels.start, labels.end, True, len(labels.tiers)))
    for number, tier in enumerate(labels.tiers):
        name = b"IntervalTier" if tier.kind == "interval" else b"TextTier"
        parts += [bytes([len(name)]), name, binary_text(tier.name)]
        count = len(tier.entries) if counts is None else counts[number]
        parts.append(struct.pack(">ddi", labels.start, labels.end, count))
        for entry in tier.entries:
            times = (entry.start, entry.end) if tier.kind == "interval" else (entry.start,)
            parts += [struct.pack(f">{len(times)}d", *times), binary_text(entry.text)]
    return b"".join(parts)


def grid(*tiers, start=0.0, end=2.0):
    return Labels(tuple(tiers), start, end, name="take")


def intervals(name, *texts, end=2.0):
    marks = [end * index / len(texts) for index in range(len(texts) + 1)]
    pairs = zip(marks[:-1], marks[1:], texts, strict=True)
    return Tier(name, tuple(Label(*entry) for entry in pairs))


WORDS = intervals("words", "", "bäm", 'say "x" ! 3')
PHONES = intervals("phones", "sil", "B", "AA1", "M", "sil")
TONES = Tier("tönes", (Label(0.25, 0.25, "H*"), Label(1e-05, 1e-05, "L")), "point")


texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\r\0"), max_size=6)


@st.composite
def grids(draw):
    tiers = []
    for kind in draw(st.lists(st.sampled_from(["interval", "point"]), min_size=1, max_size=3)):
        count = draw(st.integers(0, 4))
        marks = sorted(draw(st.lists(st.floats(0, 9), min_size=count + 1, max_size=count + 1)))
        labels = draw(st.lists(texts, min_size=count, max_size=count))
        pairs = zip(marks[:-1], marks[1:], labels, strict=True)
        entries = [Label(a, b if kind == "interval" else a, text) for a, b, text in pairs]
        tiers.append(Tier(draw(texts), tuple(entries), kind))
    return Labels(tuple(tiers), draw(st.sampled_from([0.0, -1.0, 0.5])), 10.0, name="take")


@quick
@given(labels=grids())
def test_all_forms_are_read_alike(labels, tmp_path_factory):
    folder = tmp_path_factory.mktemp("forms")
    path = folder / "take.TextGrid"
    read = {}
    for form, content in {
        "long": as_long(labels).encode(),
        "short": as_short(labels).encode(),
        "chronological": as_chronological(labels).encode("utf-16"),
        "binary": as_binary(labels),
    }.items():
        path.write_bytes(content)
        read[form] = read_labels(path)
    # Of one tier, entries at one time come in the order of the file.
    assert read == dict.fromkeys(read, labels)
    write_labels(read["binary"], path)
    assert read_labels(path) == labels


def test_praatio_reads_the_same(tmp_path):
    textgrid = pytest.importorskip("praatio.textgrid")
    tones = Tier("tönes", (Label(0.25, 0.25, "H*"), Label(1.5, 1.5, "L")), "point")
    labels = grid(intervals("words", "", "bäm", "c d"), PHONES, tones)
    for name, content in {"long": as_long(labels), "short": as_short(labels)}.items():
        path = tmp_path / f"{name}.TextGrid"
        path.write_text(content, encoding="utf-8")
        theirs = textgrid.openTextgrid(str(path), includeEmptyIntervals=True)
        for tier in read_labels(path).tiers:
            entries = theirs.getTier(tier.name).entries
            assert sorted((e.start, e.text) for e in tier.entries) == sorted(
                (entry[0], entry[-1]) for entry in entries
            )


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    ("encoding", "mark"),
    [
        ("utf-8", b"\xef\xbb\xbf"),
        ("utf-16-le", b"\xff\xfe"),
        ("utf-16-be", b"\xfe\xff"),
        ("utf-16-le", b""),
        ("utf-16-be", b""),
    ],
)
@pytest.mark.parametrize("form", [as_long, as_chronological])
def test_every_encoding_and_line_end(tmp_path, form, encoding, mark, end):
    path = tmp_path / "take.TextGrid"
    labels = grid(WORDS, intervals("phones", "two\nlines", "ə𝄞"), TONES)
    path.write_bytes(mark + form(labels).replace("\n", end).encode(encoding))
    assert read_labels(path).tiers[:2] == labels.tiers[:2]


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("1e-05", 1e-5),
        ("-1.5E+2", -150.0),
        ("0.5%", 0.005),
        ("1/4", 0.25),
        (".5", 0.5),
        ("5.", 5.0),
        ("+3", 3.0),
        ("--undefined--", None),
        ("1/0", None),
        ("1,5", None),
        ("nan", None),
        ("1e", None),
    ],
)
def test_the_numbers_of_praat(word, value):
    assert parse_number(word) == value


def test_only_free_standing_numbers_strings_and_flags_count(tmp_path):
    path = tmp_path / "take.TextGrid"
    path.write_text(
        'File type = "ooTextFile"\nObject class = "TextGrid"\n\n'
        'xmin=0 ! begins at 7 "or" 8\nxmax = 200%\ntiers? <exists> \nsize = 1 item [ 1 ]:\n'
        'class = "IntervalTier" name = "phones"\n! 3 "comment"\nxmin = 0 xmax = 2'
        " intervals: size=2\n"
        'intervals[9]: xmin = 0 xmax = 1e-05\n text = "a ""b"" ! no comment"\n'
        'intervals [ 7 ]: xmin=1/100000 xmax = 2 text="third [3]\nline 2"\n'
    )
    (phones,) = read_labels(path).tiers
    assert phones == Tier(
        "phones", (Label(0, 1e-5, 'a "b" ! no comment'), Label(1e-5, 2, "third [3]\nline 2"))
    )
    old = tmp_path / "old.TextGrid"
    old.write_text('File type = "ooTextFile short"\n"TextGrid"\n\n0\n1\n<absent>\n')
    assert read_labels(old).tiers == ()


@pytest.mark.parametrize("announced", [0, 1, 4, 6, 40])
@pytest.mark.parametrize("position", [0, 1, 2])
def test_wrong_sizes_drop_nothing(tmp_path, announced, position):
    labels = grid(
        intervals("words", "a", "b", "c", "d", "e"),
        Tier("tones", tuple(Label(t / 9, t / 9, "H") for t in range(5)), "point"),
        PHONES,
    )
    sizes = [5, 5, 5]
    sizes[position] = announced
    path = tmp_path / "take.TextGrid"
    path.write_text(as_long(labels, sizes))
    name = labels.tiers[position].name
    with pytest.warns(MocapFitWarning, match=rf"tier '{name}' announces {announced} .*, 5 follow"):
        assert read_labels(path) == labels


def test_wrong_numbers_of_tiers(tmp_path):
    path = tmp_path / "take.TextGrid"
    content = as_long(grid(WORDS, PHONES))
    path.write_text(content.replace("size = 2 ", "size = 1 ", 1), encoding="utf-8")
    with pytest.warns(MocapFitWarning, match="1 tiers are announced, 2 follow"):
        assert len(read_labels(path).tiers) == 2
    path.write_text(content.replace("size = 2 ", "size = 3 ", 1), encoding="utf-8")
    with pytest.raises(FileFormatError, match="ends too early"):
        read_labels(path)


def test_a_file_that_is_cut_off_is_not_a_wrong_size(tmp_path):
    path = tmp_path / "take.TextGrid"
    lines = as_long(grid(WORDS, PHONES)).splitlines(keepends=True)
    for count in range(1, len(lines)):
        path.write_text("".join(lines[:count]), encoding="utf-8")
        with pytest.raises(FileFormatError, match=r"take\.TextGrid"):
            read_labels(path, reader="textgrid")


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (
            "xmax = 0.8",
            "xmax = --undefined--",
            r"line 21.*not a time.*undefined.*entry 2.*'phones'",
        ),
        ("xmax = 0.8", "xmax = 1e300", r"line 21.*not a time.*1e300"),
        ("xmax = 0.8", "xmax = 0,8", r"line 21.*not a time.*0,8"),
        ("xmax = 0.8", "xmax = NaN", r"line 21.*not a time.*NaN"),
        ("xmax = 0.8", 'xmax = "0.8"', r"line 21.*found text '0.8'"),
        ('text = "B"', "text = B", r"line 24.*damaged.*found number.*label \(entry 2"),
        ("intervals: size = 5", "intervals: size = 5.5", "line 14.*number of entries"),
        ('"IntervalTier"', '"PitchTier"', "line 10.*unknown class of tier"),
        ("<exists>", "3", "line 6.*found number '3'.*<exists>"),
        ("ooTextFile", "other", "not a TextGrid"),
        ("TextGrid", "Collection", "not a TextGrid.*found Collection.*TextGrid alone"),
        ("TextGrid", "Sound 2", "not a TextGrid.*found Sound 2"),
    ],
)
def test_damage_is_named_with_its_line(tmp_path, before, after, message):
    path = tmp_path / "take.TextGrid"
    path.write_text(as_long(grid(PHONES)).replace(before, after, 1))
    with pytest.raises(FileFormatError, match=message):
        read_labels(path, reader="textgrid")


def test_other_objects_of_praat_are_refused_whatever_their_ending(tmp_path):
    for name, content in {
        "a.Collection": b'File type = "ooTextFile"\nObject class = "Collection"\n\nsize = 2\n',
        "a.Pitch": b'File type = "ooTextFile"\nObject class = "Pitch 1"\n\n0\n',
        "a.bin": as_binary(grid(PHONES), b"Collection"),
    }.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(FileFormatError, match="this Praat file is not a TextGrid"):
            read_labels(tmp_path / name)


def test_a_binary_file_cut_anywhere_is_refused(tmp_path):
    content = as_binary(grid(WORDS, PHONES, TONES))
    path = tmp_path / "take.TextGrid"
    for count in range(13, len(content), 7):
        path.write_bytes(content[:count])
        with pytest.raises(FileFormatError, match=r"take\.TextGrid"):
            read_labels(path)
    path.write_bytes(content + b"\0\0\0")
    with pytest.warns(MocapFitWarning, match="3 bytes behind the last tier"):
        assert len(read_labels(path).tiers) == 3


@pytest.mark.parametrize("count", [-1, 2**31 - 1, 10**8, 6])
def test_a_binary_file_claims_no_more_than_it_holds(tmp_path, count):
    path = tmp_path / "take.TextGrid"
    path.write_bytes(as_binary(grid(PHONES), counts=[count]))
    with pytest.raises(FileFormatError, match=r"number of entries|shorter than|ends too early"):
        read_labels(path)


def test_a_binary_file_with_impossible_times_or_texts_is_refused(tmp_path):
    path = tmp_path / "take.TextGrid"
    for bad in (float("nan"), float("inf"), 1e300):
        content = as_binary(grid(PHONES)).replace(struct.pack(">d", 0.8), struct.pack(">d", bad))
        path.write_bytes(content)
        with pytest.raises(FileFormatError, match=r"not a time.*entry 2 of tier 'phones'"):
            read_labels(path)
    half = as_binary(grid(intervals("phones", "ə"))).replace(b"\x02\x59", b"\xdc\x00")
    path.write_bytes(half)
    with pytest.raises(FileFormatError, match="a text is damaged"):
        read_labels(path)


def test_a_chronological_file_with_an_unknown_tier_is_refused(tmp_path):
    path = tmp_path / "take.TextGrid"
    path.write_text(as_chronological(grid(PHONES)).replace("\n1 0.8", "\n2 0.8"))
    with pytest.raises(FileFormatError, match=r"line 15: there is no such tier.*found '2'"):
        read_labels(path)


def test_rounded_times_are_joined_and_the_start_may_be_any(tmp_path):
    entries = (Label(5, 5.4999999999, "B"), Label(5.5, 5.75003, "AA1"), Label(5.75, 6.0, "M"))
    labels = Labels((Tier("phones", entries),), 5.0, 6.0)
    path = tmp_path / "take.TextGrid"
    path.write_text(as_long(labels))
    with pytest.warns(MocapFitWarning, match="1 labels of 'take' overlap by less than 0.5 ms"):
        phones = read_phones(path, phone_set="en-arpabet")
    assert phones.starts.tolist() == [5, 5.5, 5.75]
    assert phones.ends.tolist() == [5.5, 5.75, 6]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        path.write_text(as_long(labels).replace("5.75003", "5.75"))
        assert read_phones(path).ends.tolist() == [5.5, 5.75, 6]
