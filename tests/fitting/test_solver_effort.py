"""Solvers need few evaluations: a constant or a derivative that is wrong shows as slowness."""

import numpy as np
import pytest

from corpus_tools.simulation import Conditions, Session
from mocap_fit.fitting import fit_over_time, fit_speaker
from mocap_fit.fitting.solving import (
    BRIDGED,
    NOT_FITTED,
    STATUS,
    Solution,
    compute_variable_scale,
)

pytest.importorskip("numba")


@pytest.fixture(scope="module")
def speech(layout, face):
    """A speaker and two seconds of speech in head coordinates, without gaps."""
    session = Session(layout, face, Conditions(noise=0.1, duration=2.0, drop_outs=0.0))
    speaker = fit_speaker(face, layout, session.record_reference(np.random.default_rng(2)))
    recording = session.record(np.random.default_rng(1)).recording
    return speaker, speaker.remove_head_motion(recording)[0]


@pytest.mark.parametrize("objective", ["distances", "squares", "huber"])
def test_newton_takes_two_steps_a_frame(speech, objective):
    """One to predict, one to confirm: it converges quadratically from the frame before."""
    speaker, still = speech
    fit = speaker.fit_shape(still, objective=objective, solver="newton")
    assert np.median(fit.evaluations) == 2
    assert fit.evaluations.mean() < 2.4
    assert fit.evaluations.max() <= 4
    certified = speaker.fit_shape(still, objective=objective)
    assert certified.evaluations.mean() < 7.5
    assert (certified.costs <= fit.costs * (1 + 1e-7)).all()
    assert set(certified.status) <= {-1, 1, 3, 4}


@pytest.mark.parametrize("objective", ["distances", "squares"])
def test_newton_takes_few_steps_after_a_jump(speech, objective):
    speaker, still = speech
    order = np.arange(still.frames)
    order = np.stack([order[: still.frames // 2], order[still.frames // 2 :]], axis=1).ravel()
    jumpy = still.replace(positions=still.positions[order], origin=still.origin[order])
    fit = speaker.fit_shape(jumpy, objective=objective, solver="newton")
    straight = speaker.fit_shape(still, objective=objective, solver="newton")
    np.testing.assert_allclose(fit.costs, straight.costs[order], rtol=1e-5)
    assert fit.evaluations.mean() < 3.6
    assert fit.evaluations.max() <= 6


@pytest.mark.parametrize(("objective", "most"), [("distances", 18), ("squares", 6)])
def test_all_frames_together_take_few_rounds(speech, objective, most):
    speaker, still = speech
    alone = speaker.fit_shape(still, objective=objective)
    for weight in (None, 1e-3):
        smooth = fit_over_time(speaker.binding, still, alone, objective=objective, weight=weight)
        rounds = smooth.evaluations - alone.evaluations
        assert 2 <= rounds.min() == rounds.max() <= most


def test_scaled_variables_move_the_markers_alike(rng):
    jacobian, weights = rng.normal(0.0, [1, 5, 0.2, 1e-9], (12, 3, 4)), rng.uniform(0.5, 2, 12)
    scaled = jacobian * compute_variable_scale(jacobian, weights)
    moved = np.sqrt(np.einsum("m,mip,mip->p", weights, scaled, scaled))
    np.testing.assert_allclose(moved[:3], 1.0, rtol=1e-12)
    # What moves nothing is not blown up without end: a thousandth of the largest is the least.
    largest = np.sqrt(np.einsum("m,mi,mi->", weights, jacobian[:, :, 1], jacobian[:, :, 1]))
    scale = compute_variable_scale(jacobian, weights)
    assert scale[3] == pytest.approx(1000 / largest)


def test_results_of_chunks_are_put_together():
    chunks = [Solution.allocate(frames, 3) for frames in (2, 4)]
    chunks[0].costs[:] = 1.0
    chunks[1].values[:] = 2.0
    chunks[1].corrections[:] = 3.0
    both = Solution.concatenate(chunks)
    assert both.values.shape == (6, 3)
    assert both.corrections.shape == (6, 6)
    assert np.isnan(both.values[:2]).all()
    assert both.costs[:2].tolist() == [1.0, 1.0]
    assert (both.values[2:] == 2.0).all()
    assert (both.corrections[:2] == 0.0).all()
    assert (both.status == NOT_FITTED).all()
    assert (both.evaluations == 0).all()


def test_every_status_has_words():
    """Those of nlopt's documentation, and ours."""
    assert {-4, -1, 1, 2, 3, 4, 5} | {NOT_FITTED, BRIDGED} == set(STATUS)
    assert len(set(STATUS.values())) == len(STATUS)
