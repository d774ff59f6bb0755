"""Lips close on what espeak-ng says; `benchmarks/closure.py` tries more sentences and models."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "closure.py"


@pytest.fixture(scope="module")
def benchmark() -> ModuleType:
    specification = importlib.util.spec_from_file_location("closure", SCRIPT)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::mocap_fit.errors.MocapFitWarning")
def test_every_bilabial_of_typed_text_closes_and_no_open_vowel_is_flattened(benchmark) -> None:
    pytest.importorskip("espeakng_loader")
    texts = benchmark.read_sentences(benchmark.SENTENCES, ["sv"])["sv"][:5]
    counts = benchmark.judge_models(texts, "sv", ["rule-based", "phone-mean"])
    assert len(counts) == 2 * 5
    for (name, way), count in counts.items():
        assert count.bilabials >= 5 * len(texts)
        assert count.closed == count.bilabials, (name, way, count.faults)
        assert not count.flattened, (name, way, count.faults)
        assert count.speed <= 350
