"""What the fit reaches on simulated recordings; ``pytest -s`` prints error and bound in % of range.

Thirty-five markers, head motion of ±30 mm and ±20°, 5 % drop-outs.
"""

import numpy as np
import pytest

from corpus_tools.demonstration.comparison import Accuracy, FittedRecording, measure_accuracy
from corpus_tools.simulation import OTHER_SPEAKER, Conditions, Session
from mocap_fit.face import Rig, load_face
from mocap_fit.face.builtin import load_built_in_head, reshape_head
from mocap_fit.fitting import fit_shape, fit_speaker, load_layout
from mocap_fit.head import restore_head_motion

pytestmark = pytest.mark.slow

LAYOUT = "face30-head5"
# Other speakers: larger; wide with a short chin and a wide mouth; narrow with a long face.
SPEAKERS = {
    "larger": {"size": 1.12},
    "wide": {"width": 1.08, "lower_face": 0.92, "mouth_width": 1.1},
    "narrow": {"size": 0.9, "width": 0.95, "lower_face": 1.1, "mouth_width": 0.9, "depth": 1.05},
    "of the demo": OTHER_SPEAKER,
}


def measure(
    noise: float,
    objective: str,
    *,
    pose_given: bool,
    wearer: Rig | None = None,
    seconds: float = 15,
) -> Accuracy:
    face = load_face()
    conditions = Conditions(noise=noise, duration=seconds)
    session = Session(load_layout(LAYOUT), wearer or face, conditions)
    first, second = np.random.default_rng(7).spawn(2)
    speaker = fit_speaker(face, LAYOUT, session.record_reference(first))
    made = session.record(second, "sim")
    fitted = speaker.fit(made.recording, objective=objective)
    fit, motion = fitted.shape, fitted.head_motion
    if pose_given:
        # The truth takes the place of the pose that was found; what is done with it is the same.
        true_motion = motion.__class__(
            made.pose.replace(
                residuals=np.zeros((made.recording.frames, 1)), start_time=motion.pose.start_time
            ),
            motion.reference_names,
            motion.reference,
            motion.weights,
            motion.marker_residuals,
            motion.rejected,
            motion.noise,
        )
        still = made.recording.replace(
            positions=np.einsum(
                "fji,fmj->fmi",
                made.pose.rotations[:, 0],
                made.recording.positions - made.pose.translations,
            )
        )
        back = restore_head_motion(still, true_motion)
        np.testing.assert_allclose(back.positions, made.recording.positions, atol=1e-6)
        fit = fit_shape(speaker.binding, still, objective=objective)
    recording = FittedRecording(made.recording, fit, motion, made.parameters, made.pose)
    return measure_accuracy(
        [recording],
        speaker.binding,
        noise,
        bounded=wearer is None,
        pose_known=pose_given,
    )


def show(title: str, result: Accuracy) -> None:
    print(f"\n{title}")
    for i, name in enumerate(result.names):
        bound, error = 100 * result.bounds[i], 100 * result.errors[i]
        print(
            f"  {name:22s} bound {bound:6.2f} %  error {error:6.2f} %  "
            f"ratio {error / bound:5.2f}  r {result.correlations[i]:.4f}"
        )
    print(
        f"  head: {result.head_shift:.3f} mm (bound {result.head_shift_bound:.3f}), "
        f"{np.degrees(result.head_turn):.3f}° (bound {np.degrees(result.head_turn_bound):.3f}); "
        f"{result.fitted} of {result.frames} frames fitted"
    )


@pytest.mark.parametrize("pose_given", [True, False], ids=["true pose", "estimated pose"])
@pytest.mark.parametrize(("objective", "factor"), [("squares", 1.3), ("distances", 1.6)])
@pytest.mark.parametrize("noise", [0.1, 0.3, 0.5])
def test_error_is_near_its_bound(noise, objective, factor, pose_given) -> None:
    result = measure(noise, objective, pose_given=pose_given)
    pose = "true" if pose_given else "estimated"
    show(f"noise {noise} mm, {objective}, {pose} pose", result)
    assert result.fitted >= 0.99 * result.frames
    assert (result.errors <= factor * result.bounds).all()
    if noise == 0.1:
        assert result.head_shift <= 0.1
        assert np.degrees(result.head_turn) <= 0.1
        if pose_given:
            # The layout's markers are placed so that the worst parameter is well determined.
            assert result.bounds.max() < 0.026


@pytest.mark.parametrize("proportions", SPEAKERS.values(), ids=SPEAKERS.keys())
@pytest.mark.parametrize("objective", ["squares", "distances"])
def test_a_head_of_other_proportions(objective, proportions) -> None:
    wearer = load_face(mesh=reshape_head(load_built_in_head(), **proportions))
    result = measure(0.1, objective, pose_given=False, wearer=wearer)
    show(f"speaker {proportions}, {objective}", result)
    assert (result.correlations > 0.95).all()
