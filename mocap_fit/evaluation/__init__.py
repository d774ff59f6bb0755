"""Evaluation of control models: error measures, tables, figures."""

from mocap_fit.evaluation.closure import Gaps, segment_gaps
from mocap_fit.evaluation.evaluation import Difference, Evaluation, evaluate
from mocap_fit.evaluation.landmarks import LandmarkScores, landmark_scores
from mocap_fit.evaluation.measures import DEFINITIONS, GROUPS

__all__ = [
    "DEFINITIONS",
    "GROUPS",
    "Difference",
    "Evaluation",
    "Gaps",
    "LandmarkScores",
    "evaluate",
    "landmark_scores",
    "segment_gaps",
]
