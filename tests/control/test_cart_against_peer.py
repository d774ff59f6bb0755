"""CART is no worse than scikit-learn's pruned trees, on the targets of new sentences."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sklearn")

pytestmark = pytest.mark.slow

PATH = Path(__file__).parents[2] / "benchmarks" / "cart.py"


@pytest.fixture(scope="module")
def benchmark():
    spec = importlib.util.spec_from_file_location("benchmark_cart", PATH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_held_out_targets_are_predicted_no_worse(benchmark):
    simulated = benchmark.simulated_corpus(150)
    train, test = simulated.get_split("train"), simulated.get_split("test")
    found = benchmark.compared("simulated", train, test, quick=True)
    assert found["no_worse"], found
    assert found["error"] < 0.6


def test_the_path_of_the_peer_is_scikit_learns_own(benchmark):
    """The walk along it is ours; what it walks along is not."""
    from sklearn.tree import DecisionTreeRegressor

    rng = np.random.default_rng(0)
    questions = rng.integers(0, 6, (300, 8)).astype(np.float32)
    targets = questions[:, 0] + (questions[:, 1] > 3) + rng.normal(0, 1, 300)
    tree = benchmark.PeerTree(questions, targets)
    grown = DecisionTreeRegressor(min_samples_leaf=5, random_state=0)
    path = grown.cost_complexity_pruning_path(questions, targets)
    mine = np.unique(np.concatenate([[0.0], tree.alphas[tree.alphas >= 0]]))
    np.testing.assert_allclose(np.unique(path.ccp_alphas), mine, atol=1e-12)
    alpha = float(np.sqrt(mine[-3] * mine[-4]))
    pruned = DecisionTreeRegressor(min_samples_leaf=5, random_state=0, ccp_alpha=alpha)
    np.testing.assert_allclose(
        tree.answers(questions, np.array([alpha]))[0],
        pruned.fit(questions, targets).predict(questions),
    )
