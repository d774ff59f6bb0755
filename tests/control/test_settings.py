"""Settings: checked by the types of a dataclass's fields, for every model in one way."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pytest
from control_cases import SENTENCES, corpus_of
from pydantic import Field, NonNegativeFloat, PositiveInt

from mocap_fit import control
from mocap_fit.control import ControlModel
from mocap_fit.control.settings import check_settings, describe_settings, to_settings
from mocap_fit.errors import ConfigurationError

every_model = pytest.mark.parametrize("name", control.names())


@dataclasses.dataclass
class Example:
    name: ClassVar[str] = "example"

    count: PositiveInt = 3
    strength: NonNegativeFloat = 0.5
    share: Annotated[float, Field(ge=0, lt=1)] = 0.25
    stress: bool = True
    text: str = ""
    way: Literal["tree", "node"] = "tree"
    sizes: PositiveInt | tuple[PositiveInt, ...] | None = None
    table: Mapping[str, Any] = dataclasses.field(default_factory=dict)


@pytest.mark.parametrize(
    "settings",
    [
        {"count": 1},
        {"strength": 0},
        {"strength": 0.0},
        {"share": 0.0},
        {"share": 0.999},
        {"stress": False},
        {"text": "abc"},
        {"way": "node"},
        {"sizes": 4},
        {"sizes": (4, 5)},
        {"sizes": None},
        {"table": {"a": 1}},
    ],
)
def test_values_of_the_declared_type_and_range_are_accepted(settings):
    check_settings(Example, settings)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"count": "abc"}, r"'count' of the control model 'example'.*'abc'.*a valid integer"),
        ({"count": 2.5}, "a valid integer"),
        ({"count": 2.0}, "a valid integer"),
        ({"count": True}, "a valid integer"),
        ({"count": None}, "a valid integer"),
        ({"count": 0}, "greater than 0"),
        ({"strength": "1"}, "a valid number"),
        ({"strength": True}, "a valid number"),
        ({"strength": -1e-9}, "greater than or equal to 0"),
        ({"strength": math.nan}, "finite"),
        ({"strength": math.inf}, "finite"),
        ({"share": 1.0}, "less than 1"),
        ({"stress": 1}, "a valid boolean"),
        ({"stress": "yes"}, "a valid boolean"),
        ({"text": 1}, "a valid string"),
        ({"way": "leaf"}, "'tree' or 'node'"),
        ({"sizes": (4, 0)}, "greater than 0"),
        ({"sizes": (4, 2.5)}, "a valid integer"),
        ({"sizes": "4"}, "a valid integer or a valid tuple"),
        ({"table": [1]}, "a valid dictionary"),
        ({"colour": "red"}, "no setting 'colour'.*some of count, strength"),
    ],
)
def test_other_values_are_refused_with_what_was_expected(settings, message):
    with pytest.raises(ConfigurationError, match=message):
        check_settings(Example, settings)


@every_model
def test_every_setting_of_every_model_is_checked(name):
    for key in control.create(name).get_params():
        with pytest.raises(ConfigurationError, match=f"'{key}' of the control model '{name}'"):
            control.create(name, **{key: object()})


def test_a_word_for_a_number_is_a_wrong_setting():
    with pytest.raises(ConfigurationError, match=r"'cv' of the control model 'cart'.*'abc'"):
        control.create("cart", cv="abc")


def test_a_model_that_is_constructed_with_a_wrong_setting_is_refused_by_fit():
    model = type(control.create("ridge"))(context=-1)
    with pytest.raises(ConfigurationError, match="'context'"):
        model.fit(corpus_of(SENTENCES[:1]))
    assert not model.is_fitted


def test_lists_become_tuples_and_numbers_of_numpy_those_of_python():
    settings = to_settings({"a": [1, 2], "b": np.int64(3), "c": np.float32(0.5), "d": "x"})
    assert settings == {"a": (1, 2), "b": 3, "c": 0.5, "d": "x"}
    assert type(settings["b"]) is int
    assert type(settings["c"]) is float
    assert control.create("ann", hidden_units=[3, 4, 5, 6]).hidden_units == (3, 4, 5, 6)
    assert control.create("ridge", context=np.int64(4)).context == 4


def test_a_model_is_described_by_the_settings_that_differ():
    assert describe_settings(Example()) == "Example()"
    assert describe_settings(Example(count=4, table={"a": 1})) == "Example(count=4, table={'a': 1})"


@every_model
def test_models_print_in_a_line_and_have_params(name, trained):
    model = control.create(name)
    assert repr(model) == f"{type(model).__name__}()"
    assert model.get_params() == model.get_params(deep=False)
    assert list(model.get_params()) == [field.name for field in dataclasses.fields(model)]
    text = repr(trained(name))
    assert len(text) < 200
    assert text.endswith(", trained on 6 utterances")


def test_a_class_of_the_user_needs_no_registration(small_corpus, new_phones):
    @dataclasses.dataclass(eq=False, repr=False)
    class Constant(ControlModel):
        value: NonNegativeFloat = 0.5

        name: ClassVar[str] = "constant"
        title: ClassVar[str] = "Constant"
        parameter_count = 0

        def _fit(self, corpus, validation, progress, checkpoint):
            self.width_ = len(corpus.parameter_names)

        def _predict(self, phones, times):
            return np.full((len(times), self.width_), self.value)

        def _state(self):
            return {}, {}

        def _restore(self, values, arrays):
            pass

    with pytest.raises(ConfigurationError, match="'value' of the control model 'constant'"):
        Constant(value=-1.0).fit(small_corpus)
    model = Constant(value=0.25).fit(small_corpus)
    assert (model.predict(new_phones).values == 0.25).all()

    # Its own mistakes are the user's, and pass as they are.
    class Broken(Constant):
        def _fit(self, corpus, validation, progress, checkpoint):
            raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        Broken().fit(small_corpus)


NETWORK = {
    "groups": None, "hidden_units": None, "n_estimators": 1, "frames_behind": 15,
    "frames_ahead": 15, "delays": 5, "stress": True, "max_iter": 30, "patience": 8,
    "batch_size": 2, "learning_rate": 2e-3, "averaging": 0.98, "detrend": 0.0,
    "random_state": 0, "phone_set": "",
}  # fmt: skip
SYMBOLS = {"phone_set": "", "stress": True}


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("mean", {}),
        ("phone-mean", SYMBOLS),
        ("ridge", SYMBOLS | {"context": 12, "l2": None}),
        ("rule-based", {"stress": True, "rules": ""}),
        ("cohen-massaro", SYMBOLS | {"max_iter": 30, "tol": 1e-3, "patience": 3, "l2": 1.0}),
        (
            "ohman",
            SYMBOLS
            | {"max_iter": 30, "tol": 1e-4, "patience": 3, "l2": 0.1, "hold": 0.07, "pause": 0.2},
        ),
        ("ann", NETWORK),
        ("ann-low-latency", NETWORK | {"frames_behind": 28, "frames_ahead": 2}),
        ("ann-ensemble", NETWORK | {"n_estimators": 4}),
        (
            "cart",
            {
                "min_samples_split": 6, "min_samples_leaf": 1, "max_depth": None, "cv": 10,
                "min_impurity_decrease": 6.0, "pruning": "together", "one_standard_error": False,
                "phone_order": "tree", "by_stress": True, "questions": "",
                "resistance": "phone-set", "reach": 4, "interpolation": "cubic",
                "smoothing": 0.0, "closures": {}, "hold": 0.5, "random_state": 0,
            },
        ),
    ],
)  # fmt: skip
def test_settings_that_are_left_out_are_those_of_the_published_scores(name, settings):
    assert control.create(name).get_params() == settings
