"""Which tier holds the phones: the names that programs give, speakers, and what a user is told."""

import pytest

from mocap_fit.errors import DataError
from mocap_fit.labels import Label, Labels, Tier, find_phone_tier, find_word_tier, to_phones


def tier(name, *texts, kind="interval"):
    return Tier(name, tuple(Label(i, i + 1, text) for i, text in enumerate(texts)), kind)


def labels(*tiers):
    return Labels(tiers, 0.0, 3.0, name="take")


@pytest.mark.parametrize(
    ("words", "phones", "others"),
    [
        ("ORT-MAU", "MAU", ["KAN-MAU", "TRN"]),
        ("words", "phones", []),
        ("anna - words", "anna - phones", ["anna - utterances"]),
        ("BOB - word", "BOB - phone", []),
        ("words@anna", "phones@anna", ["gloss@anna"]),
        ("WRD", "PHN", ["SENT"]),
        ("Word", "Phonetic", ["Syllable"]),
        ("TokensAlign", "PhonAlign", ["PhnTokAlign"]),
        ("ort", "segments", ["stress marks"]),
        ("tokens", "Sounds", []),
        ("orthography", "X-SAMPA", []),
    ],
)
def test_the_names_of_programs(words, phones, others):
    # The others look more like phones than the phones do.
    tiers = [tier(name, "a", "b", "c", "d") for name in others]
    grid = labels(*tiers, tier(words, "ab", "c"), tier(phones, "longer", "than", "symbols"))
    assert find_phone_tier(grid).name == phones
    assert find_word_tier(grid).name == words
    assert [s.word for s in to_phones(grid)] == ["ab", "c", ""]


def test_speakers_are_chosen_by_the_user_and_have_their_own_words():
    grid = labels(
        tier("anna - words", "ja"),
        tier("anna - phones", "j", "a"),
        tier("ben - words", "nej"),
        tier("ben - phones", "n", "e", "j"),
    )
    with pytest.raises(
        DataError,
        match=r"several tiers of 'take' hold phones .*'anna - phones' \(intervals\), 'ben - phones'"
        r".*tier=\.\.\..*--tier.*phones = \.\.\. under \[labels\]",
    ):
        to_phones(grid)
    assert [(s.phone, s.word) for s in to_phones(grid, "ben - phones")] == [
        ("n", "nej"),
        ("e", ""),
        ("j", ""),
    ]
    # The aligner makes tiers for a speaker who says nothing.
    silent = labels(*grid.tiers[2:], tier("anna - phones", "", ""))
    assert find_phone_tier(silent).name == "ben - phones"


def test_two_tiers_of_one_name_are_refused():
    with pytest.raises(DataError, match="several tiers"):
        find_phone_tier(labels(tier("phones", "a"), tier("Phones", "b")))


def test_all_tiers_are_listed_where_none_holds_phones():
    long = "x" * 300
    grid = labels(tier("words", "abcdef"), tier(long, "remark one"), tier("t", "H", kind="point"))
    with pytest.raises(
        DataError, match=r"no tier.*'words' \(intervals\).*'t' \(points\)"
    ) as caught:
        to_phones(grid)
    assert long not in str(caught.value)
    assert "--tier" in str(caught.value)


def test_long_labels_are_cut_in_messages():
    text = "b" * 10_000
    wrong = labels(Tier("phones", (Label(0, 1, text), Label(0.5, 2, text), Label(2, 2, text))))
    with pytest.raises(DataError, match=r"overlap at 0.5000 to 1.0000 s.*no duration") as caught:
        to_phones(wrong)
    assert len(str(caught.value)) < 600
    with pytest.raises(DataError, match="not in the phone set") as caught:
        to_phones(labels(tier("phones", text, "a")), phone_set="en-arpabet")
    assert len(str(caught.value)) < 600
    with pytest.raises(DataError, match="impossible time") as caught:
        Label(0, float("inf"), text)
    assert len(str(caught.value)) < 300
