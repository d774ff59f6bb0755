"""Names in context and states, as HTK and HTS write them: the phone in the middle."""

import warnings

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocap_fit.errors import DataError, FileFormatError, MocapFitWarning
from mocap_fit.labels import read_all_labels, read_labels, read_phones, write_labels

PHONES = ["sil", "b", "aa", "m", "ax-h", "t", "sil"]


def triphones(phones):
    """Names with the neighbours on both sides but for silence, as HTK writes them."""
    padded = ["sil", *phones, "sil"]
    for left, phone, right in zip(padded, phones, padded[2:], strict=False):
        before = "" if "sil" in (left, phone) else f"{left}-"
        after = "" if "sil" in (right, phone) else f"+{right}"
        yield f"{before}{phone}{after}"


def full_contexts(phones, form):
    """Full-context names: English of HTS (and Merlin), Japanese of Open JTalk, or of Sinsy."""
    padded = ["x", "x", *phones, "x", "x"]
    for index in range(len(phones)):
        ll, l, c, r, rr = padded[index : index + 5]  # noqa: E741
        yield {
            "hts": f"{ll}^{l}-{c}+{r}={rr}@1_0/A:0_0_0/B:1-1-2@1-1&1-7#1-4$1-3!0-2;0-4|ah/C:0+0+2",
            "jtalk": f"{ll}^{l}-{c}+{r}={rr}/A:-2+1+3/B:xx-xx_xx/C:02_xx+xx",
            "sinsy": f"p@{ll}^{l}-{c}+{r}={rr}_xx%xx^00_00~00-1!1[xx$xx]xx/A:xx-xx-xx@xx~xx",
        }[form]


def write(path, names, step=500_000, extra=""):
    rows = [f"{i * step} {(i + 1) * step} {name}{extra}\n" for i, name in enumerate(names)]
    path.write_text("".join(rows))
    return path


def read(path):
    return [(e.start, e.end, e.text) for e in read_labels(path).get_tier("phone").entries]


def test_triphones_are_read_as_their_centres(tmp_path):
    path = write(tmp_path / "a.lab", triphones(PHONES), extra=" -12.5")
    assert "b-aa+m" in path.read_text()
    assert read(path) == [(i / 20, (i + 1) / 20, name) for i, name in enumerate(PHONES)]
    assert {e.extra for e in read_labels(path).tiers[0].entries} == {"score=-12.5"}
    write_labels(read_labels(path), tmp_path / "b.lab")
    assert read_labels(tmp_path / "b.lab").tiers == read_labels(path).tiers
    phones = read_phones(path, phone_set="en-arpabet")
    assert phones.phones == ("sil", "B", "AA", "M", "AH", "T", "sil")


@pytest.mark.parametrize("form", ["hts", "jtalk", "sinsy"])
@pytest.mark.parametrize("states", [False, True])
def test_full_contexts_are_read_as_their_centres(tmp_path, form, states):
    names = list(full_contexts(PHONES, form))
    if states:
        names = [f"{name}[{state}]" for name in names for state in range(2, 7)]
    path = write(tmp_path / "a.lab", names, step=100_000 if states else 500_000)
    assert read(path) == [(i / 20, (i + 1) / 20, name) for i, name in enumerate(PHONES)]


def test_states_are_merged_into_their_phones(tmp_path):
    # One phone twice, and a phone whose model skips a state.
    names = ["sil[2]", "sil[3]", "sil[4]", "aa[2]", "aa[3]", "aa[4]", "aa[2]", "aa[4]", "sp[3]"]
    path = write(tmp_path / "a.lab", names, step=1_000_000)
    assert read(path) == [(0, 0.3, "sil"), (0.3, 0.6, "aa"), (0.6, 0.8, "aa"), (0.8, 0.9, "sp")]


def test_states_on_a_level_of_their_own(tmp_path):
    path = tmp_path / "a.rec"
    path.write_text(
        "0 100000 s2 -1.5 sil -9 SILENCE\n100000 300000 s3 -1\n300000 400000 s2 -2 b-aa+m -8 BAM\n"
        "400000 500000 s4 -2\n500000 600000 s2 -1 aa-m\n"
    )
    labels = read_labels(path)
    assert [tier.name for tier in labels.tiers] == ["state", "phone", "word"]
    assert read(path) == [(0, 0.03, "sil"), (0.03, 0.05, "aa"), (0.05, 0.06, "m")]
    phones = read_phones(path)
    assert [(s.phone, s.word) for s in phones] == [
        ("sil", "SILENCE"),
        ("aa", "BAM"),
        ("m", "BAM"),
    ]


def test_a_master_label_file_of_triphones(tmp_path):
    path = tmp_path / "all.mlf"
    one = write(tmp_path / "a", triphones(PHONES)).read_text()
    two = write(tmp_path / "a", ["sil", "b+aa", "b-aa", "sil"]).read_text()
    path.write_text(f'#!MLF!#\n"*/one.lab"\n{one}.\n"*/two.lab"\n{two}.\n')
    first, second = read_all_labels(path)
    assert [e.text for e in first.tiers[0].entries] == PHONES
    assert [e.text for e in second.tiers[0].entries] == ["sil", "b", "aa", "sil"]


@pytest.mark.parametrize(
    "names",
    [
        ["a+b", "c", "d"],
        ["x-y", "z"],
        ["ax-h", "t"],
        ["a+b", "c-d"],
        ["-", "+", "-+"],
        ["++noise++", "a"],
        ["a[2]", "b"],
        ["s2", "s3"],
        ["a=b", "c^d"],
    ],
)
def test_other_names_stay_as_they_are(tmp_path, names):
    assert [text for *_, text in read(write(tmp_path / "a.lab", names))] == names


@settings(max_examples=60, deadline=None)
@given(
    phones=st.lists(
        st.text("abcdefgXYZ@:~_'0123ə", min_size=1, max_size=3).filter(lambda t: not t.isdigit()),
        min_size=3,
        max_size=8,
    )
)
def test_any_phones_come_back_out_of_their_contexts(phones, tmp_path_factory):
    path = tmp_path_factory.mktemp("names") / "a.lab"
    padded = ["sil", *phones, "sil"]
    middle = [f"{a}-{b}+{c}" for a, b, c in zip(padded, phones, padded[2:], strict=False)]
    rows = [f"{i}00000 {i + 1}00000 '{name}'" for i, name in enumerate(middle) if "'" not in name]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    if rows:
        centres = [b for b, name in zip(phones, middle, strict=True) if "'" not in name]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MocapFitWarning)
            assert [e.text for e in read_labels(path, reader="htk-lab").tiers[0].entries] == centres


@pytest.mark.parametrize("phone_set", [None, "en-arpabet"])
def test_pauses_without_duration_are_left_out(tmp_path, phone_set):
    path = tmp_path / "a.lab"
    path.write_text(
        "0 7400000 EY1 a\n7400000 7400000 sp sp\n7400000 10700000 IH1 in\n10700000 10700000 sil\n"
    )
    phones = read_phones(path, phone_set=phone_set)
    assert [(s.start, s.end, s.word) for s in phones] == [(0, 0.74, "a"), (0.74, 1.07, "in")]
    path.write_text("0 7400000 EY1\n7400000 7400000 T\n7400000 10700000 IH1\n")
    with pytest.raises(DataError, match=r"no duration at 0.7400 to 0.7400 s \('T', entry 2"):
        read_phones(path, phone_set=phone_set)


def test_samples_in_a_lab_are_warned_of(tmp_path):
    path = tmp_path / "a.lab"
    path.write_text("0 8000 sil\n8000 16000 aa\n")
    with pytest.warns(MocapFitWarning, match=r"lasts 1.6 ms in HTK's units.*reader='timit'"):
        read_labels(path)
    assert read_labels(path, reader="timit", rate=16000).end == 1.0


def test_what_is_no_phone_with_times_is_refused(tmp_path):
    path = tmp_path / "a.lab"
    path.write_text("0 46797 She had your dark suit in greasy wash water all year\n")
    with pytest.raises(
        FileFormatError, match=r"line 1: .*too many names.*found 11.*mocap-fit align"
    ):
        read_labels(path)
    path.write_text("0 99999999999999999 sil\n")
    with pytest.raises(FileFormatError, match=r"line 1: this is not a time.*1/1e\+07 s"):
        read_labels(path)
    path.write_text(f"0 100000 {'x' * 5000}\n100000 y\n")
    with pytest.raises(FileFormatError, match="line 2") as caught:
        read_labels(path, reader="htk-lab")
    assert len(str(caught.value)) < 700
