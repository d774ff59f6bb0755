"""Evaluation of control models: error measures, tables, figures."""

from mocap_fit.evaluation.closure import LipGaps, measure_gaps
from mocap_fit.evaluation.evaluation import Difference, Evaluation, evaluate
from mocap_fit.evaluation.landmarks import LandmarkScores, evaluate_landmarks
from mocap_fit.evaluation.measures import DEFINITIONS, GROUPS

__all__ = [
    "DEFINITIONS",
    "GROUPS",
    "Difference",
    "Evaluation",
    "LandmarkScores",
    "LipGaps",
    "evaluate",
    "evaluate_landmarks",
    "measure_gaps",
]
