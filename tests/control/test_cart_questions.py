"""CART: a table of questions of one's own."""

import numpy as np
import pytest
from cart_cases import corpus, neighbour, phones_of, rounded_ahead

from mocap_fit import control
from mocap_fit.control.cart import Cart, find_tree, read_questions
from mocap_fit.errors import ConfigurationError

TABLE = """
[[question]]
ask = "phone"
at = -2

[[question]]
name = "right phone is A or O"
ask = "phone"
at = 1
phones = ["A", "O:"]

[[question]]
ask = "class"
at = 2
class = "vowel"

[[question]]
ask = "feature"
at = -1
feature = "open"

[[question]]
ask = "resistant"
at = 2
"""


def test_questions_of_ones_own_are_asked_and_kept_in_the_file(tmp_path):
    def rule(phones, i):
        return 0.8 if neighbour(phones, i, -2) in ("S", "T") else 0.1, 0.0, 0.0

    spoken = corpus(rule, count=40, noise=0.02)
    table = tmp_path / "questions.toml"
    table.write_text(TABLE, encoding="utf-8")
    found = Cart(questions=str(table)).fit(spoken)
    tree = found.trees_[find_tree(found, "L/jaw_rotation")]
    assert found.questions_[tree.questions[0]].name == "second phone to the left"
    found.save(tmp_path / "m.npz")
    table.unlink()
    again = control.load(tmp_path / "m.npz")
    assert again.questions_ == found.questions_
    assert again.get_params()["questions"] == TABLE
    assert Cart(questions=TABLE).fit(spoken).get_params() == found.get_params()
    new = phones_of("sil T P L A S B L sil")
    np.testing.assert_array_equal(again.select_targets(new), found.select_targets(new))
    names = [question.name for question in found.questions_]
    assert "right phone is A or O" in names
    assert "second phone to the right is a vowel" in names
    assert "feature open of the left phone" in names
    assert "second nearest resistant phone to the right" in names


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("[[question]\n", "not TOML"),
        ("question = 3\n[x]\n", "not understood"),
        ('[[question]]\nask = "weather"\nat = 1', "'ask' is unknown"),
        ('[[question]]\nask = "phone"\nat = 0', "a tree is of one phone"),
        ('[[question]]\nask = "phone"\nat = 1.5', "'at' is not the position"),
        ('[[question]]\nask = "phone"\nat = 99', "'at' is not the position"),
        ('[[question]]\nask = "phone"\nat = true', "'at' is not the position"),
        ('[[question]]\nask = "phone"\nat = 1\nsize = 2', "no setting 'size'"),
        ('[[question]]\nask = "class"\nat = 1', "class of phones is not stated"),
        ('[[question]]\nask = "class"\nat = 1\nclass = "nice"', "class of phones"),
        ('[[question]]\nask = "duration"\nat = 1\nclass = "vowel"', "class of phones"),
        ('[[question]]\nask = "phone"\nat = 1\nphones = []', "not a list of phones"),
        ('[[question]]\nask = "duration"\nat = 1\nphones = ["A"]', "not a list of phones"),
        ('[[question]]\nask = "phone"\nat = 1\nphones = ["Q9"]', "phone set lacks"),
        ('[[question]]\nask = "feature"\nat = 1', "feature is not stated"),
        ('[[question]]\nask = "feature"\nat = 1\nfeature = "nice"', "feature is not stated"),
        ('[[question]]\nask = "phone"\nat = 1\nname = 3', "'name' is not a text"),
    ],
)
def test_a_bad_table_of_questions_is_refused(table, words):
    with pytest.raises(ConfigurationError, match=words):
        Cart(questions=table).fit(corpus(rounded_ahead, count=1))


def test_a_table_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.toml"):
        Cart(questions=str(tmp_path / "none.toml")).fit(corpus(rounded_ahead, count=1))
    assert read_questions("") == ()
