"""ELAN's documents: annotations in time, parts of others, slots without a value, hostile XML."""

import itertools
from xml.sax.saxutils import escape, quoteattr

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit.errors import DataError, FileFormatError, MocapFitWarning
from mocap_fit.labels import elan, find_label_reader, read_labels, read_phones, write_labels

HEAD = '<?xml version="1.0" encoding="{encoding}"?>\n'


def document(slots, tiers, header="", encoding="UTF-8", head=HEAD):
    """A document: slots with milliseconds or None; tiers of (name, parent, annotations)."""
    lines = [head.format(encoding=encoding)]
    lines.append('<ANNOTATION_DOCUMENT AUTHOR="" FORMAT="3.0" VERSION="3.0">')
    lines.append(header or '<HEADER MEDIA_FILE="" TIME_UNITS="milliseconds"/>')
    lines.append("<TIME_ORDER>")
    for name, value in slots.items():
        time = "" if value is None else f' TIME_VALUE="{value}"'
        lines.append(f'<TIME_SLOT TIME_SLOT_ID="{name}"{time}/>')
    lines.append("</TIME_ORDER>")
    for name, parent, annotations in tiers:
        above = f" PARENT_REF={quoteattr(parent)}" if parent else ""
        lines.append(f'<TIER LINGUISTIC_TYPE_REF="x"{above} TIER_ID={quoteattr(name)}>')
        for key, refers, text in annotations:
            if isinstance(refers, tuple):
                kind = "ALIGNABLE_ANNOTATION"
                more = f'TIME_SLOT_REF1="{refers[0]}" TIME_SLOT_REF2="{refers[1]}"'
            else:
                kind, (parent_key, *previous) = "REF_ANNOTATION", refers.split("<")
                more = f'ANNOTATION_REF="{parent_key}"'
                more += f' PREVIOUS_ANNOTATION="{previous[0]}"' if previous else ""
            lines.append(f'<ANNOTATION><{kind} ANNOTATION_ID="{key}" {more}>')
            lines.append(f"<ANNOTATION_VALUE>{escape(text)}</ANNOTATION_VALUE>")
            lines.append(f"</{kind}></ANNOTATION>")
        lines.append("</TIER>")
    lines.append('<LINGUISTIC_TYPE LINGUISTIC_TYPE_ID="x" TIME_ALIGNABLE="true"/>')
    return "\n".join([*lines, "</ANNOTATION_DOCUMENT>"])


SLOTS = {"ts1": 0, "ts2": 500, "ts3": None, "ts4": None, "ts5": 1400, "ts6": 1400, "ts7": 2000}
TIERS = [
    ("words@anna", None, [("a1", ("ts2", "ts5"), "bam & <co>"), ("a2", ("ts6", "ts7"), "")]),
    (
        "phones@anna",
        "words@anna",
        [("p1", ("ts2", "ts3"), "B"), ("p2", ("ts3", "ts4"), "AA1"), ("p3", ("ts4", "ts5"), "M")],
    ),
    ("gloss", "words@anna", [("g1", "a1", "noun")]),
    # Parts in another order than in time.
    ("parts", "words@anna", [("s3", "a1<s2", "3"), ("s1", "a1", "1"), ("s2", "a1<s1", "2")]),
    ("notes", "parts", [("n2", "s2", "on 2"), ("n1", "s1", "on 1")]),
    ("empty", None, []),
]


def entries(labels, name):
    return [
        (pytest.approx(e.start), pytest.approx(e.end), e.text)
        for e in labels.get_tier(name).entries
    ]


def test_all_kinds_of_tiers(tmp_path):
    path = tmp_path / "take.eaf"
    path.write_text(document(SLOTS, TIERS), encoding="utf-8")
    assert find_label_reader(path) == "elan"
    labels = read_labels(path)
    assert [tier.name for tier in labels.tiers] == [name for name, _, _ in TIERS]
    assert entries(labels, "words@anna") == [(0.5, 1.4, "bam & <co>"), (1.4, 2.0, "")]
    assert entries(labels, "phones@anna") == [(0.5, 0.8, "B"), (0.8, 1.1, "AA1"), (1.1, 1.4, "M")]
    assert entries(labels, "gloss") == [(0.5, 1.4, "noun")]
    assert entries(labels, "parts") == [(0.5, 0.8, "1"), (0.8, 1.1, "2"), (1.1, 1.4, "3")]
    assert entries(labels, "notes") == [(0.5, 0.8, "on 1"), (0.8, 1.1, "on 2")]
    assert labels.get_tier("empty").entries == ()
    phones = read_phones(path, phone_set="en-arpabet")
    assert [(s.phone, s.word) for s in phones] == [(p, "bam & <co>") for p in ("B", "AA", "M")]
    write_labels(labels, tmp_path / "take.TextGrid")
    assert read_labels(tmp_path / "take.TextGrid").tiers == labels.tiers
    with pytest.raises(DataError, match=r"read, and not written.*TextGrid, which ELAN imports"):
        write_labels(labels, tmp_path / "copy.eaf")
    assert not (tmp_path / "copy.eaf").exists()


@pytest.mark.parametrize("encoding", ["UTF-8", "UTF-16", "ISO-8859-1", "windows-1252"])
def test_encodings(tmp_path, encoding):
    path = tmp_path / "take.eaf"
    text = document(
        {"a": 0, "b": 1000}, [("tiér", None, [("x", ("a", "b"), "é\nö")])], encoding=encoding
    )
    path.write_bytes(text.encode(encoding))
    (labels,) = elan.read(path)
    assert entries(labels, "tiér") == [(0, 1, "é\nö")]


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_any_division_fills_its_parent(data, tmp_path_factory):
    """Slots without values and parts divide evenly what they are in, in any order of the file."""
    path = tmp_path_factory.mktemp("elan") / "take.eaf"
    marks = sorted(data.draw(st.lists(st.integers(0, 10**6), min_size=2, max_size=5, unique=True)))
    count = data.draw(st.integers(1, 5))
    slots, annotations, parts, expected = {}, [], [], []
    for index, (first, last) in enumerate(itertools.pairwise(marks)):
        names = [f"s{index}.{k}" for k in range(count + 1)]
        slots |= dict.fromkeys(names, None) | {names[0]: first, names[-1]: last}
        step = (last - first) / count / 1000
        for k in range(count):
            name = f"a{index}.{k}"
            annotations.append((name, (names[k], names[k + 1]), name))
            parts += [(f"p{name}", name, ""), (f"q{name}", f"{name}<p{name}", "")]
            expected.append((first / 1000 + k * step, first / 1000 + (k + 1) * step, name))
    shuffled = data.draw(st.permutations(annotations))
    parts = data.draw(st.permutations(parts))
    path.write_text(document(slots, [("whole", None, shuffled), ("parts", "whole", parts)]))
    (labels,) = elan.read(path)
    assert entries(labels, "whole") == expected
    halves = [
        pytest.approx(time) for a, b, _ in expected for time in (a, (a + b) / 2, (a + b) / 2, b)
    ]
    assert [t for e in labels.get_tier("parts").entries for t in (e.start, e.end)] == halves


def test_the_origin_of_the_first_sound_is_added(tmp_path):
    path = tmp_path / "take.eaf"
    video, sound, other = (
        f'<MEDIA_DESCRIPTOR MEDIA_URL="a" MIME_TYPE="{kind}" TIME_ORIGIN="{origin}"/>'
        for kind, origin in (("video/mpeg", 7000), ("audio/x-wav", 1500), ("audio/x-wav", 3000))
    )
    tiers = [("phones", None, [("x", ("a", "b"), "B")])]
    for media, offset in (
        ((video, sound, other), 1.5),
        ((sound, video), 1.5),
        ((other, sound), 3.0),
        ((video,), 7.0),
    ):
        header = f'<HEADER TIME_UNITS="milliseconds">{"".join(media)}</HEADER>'
        path.write_text(document({"a": 0, "b": 1000}, tiers, header))
        with pytest.warns(MocapFitWarning, match=rf"from {offset:g} s on \(TIME_ORIGIN\)"):
            (labels,) = elan.read(path)
        assert entries(labels, "phones") == [(offset, offset + 1, "B")]
        assert labels.end == offset + 1


BOMB = (
    '<?xml version="1.0"?>\n<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(9))
    + "]>\n"
)
FILE = '<?xml version="1.0"?>\n<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>\n'
ONE = [("phones", None, [("x", ("a", "b"), "B")])]


def good(**changes):
    return document(**{"slots": {"a": 0, "b": 1000}, "tiers": ONE} | changes)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (good(head=BOMB).replace(">B<", ">&j;<"), "line 2: the document has a DOCTYPE"),
        (good(head=FILE).replace(">B<", ">&a;<"), "line 2: the document has a DOCTYPE"),
        (good().replace(">B<", ">&a;<"), "line 11: this is not whole XML.*undefined entity"),
        (good()[:-60], "not whole XML"),
        (good(encoding="x-none"), "encoding|XML"),
        (good(slots={"a": 0}), "line 9: there is no such slot of time.*found b"),
        (good(slots={"a": 0, "b": None}), "line 10: the annotation has no time.*slots a to b"),
        (good(slots={"a": None, "b": None}), "the annotation has no time"),
        (good(slots={"a": 0, "b": "x"}), "line 7: this is not a time.*'x'"),
        (good(slots={"a": 0, "b": "1e400"}), "line 7: this is not a time"),
        (good(slots={"a": 0, "b": "99999999999999"}), "line 7: this is not a time"),
        (good(tiers=[("t", None, [("x", "y", ""), ("y", "x", "")])]), "no time.*a part of 'y'"),
        (good(tiers=[("t", None, [("x", "none", "")])]), "line 10: .*no time.*a part of 'none'"),
        (good(tiers=[*ONE, *ONE]), "line 15: the annotation comes twice.*found x"),
        (good().replace("TIER_ID", "NAME"), "line 9: the attribute TIER_ID is missing"),
        (good().replace("TIER ", "T ").replace("/TIER", "/T"), "the annotation is in no tier"),
        (good().replace("milliseconds", "PAL-frames"), "line 4: the times have another unit"),
        ("<x/>", "line 1: this is not a document of ELAN.*<x>"),
        ("hello", "not whole XML"),
    ],
)  # fmt: skip
def test_bad_documents_are_refused_in_words(tmp_path, content, message):
    path = tmp_path / "take.eaf"
    path.write_text(content)
    with pytest.raises(FileFormatError, match=message) as caught:
        read_labels(path, reader="elan")
    assert "take.eaf" in str(caught.value)


def test_deep_nesting_ends_in_an_answer(tmp_path):
    path = tmp_path / "take.eaf"
    path.write_text(good().replace("<HEADER", "<a>" * 50000 + "</a>" * 50000 + "<HEADER"))
    assert len(elan.read(path)[0].tiers) == 1
