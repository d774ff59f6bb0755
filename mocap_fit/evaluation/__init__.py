"""Evaluation of control models: error measures, tables, figures."""

from mocap_fit.evaluation.closure import LipEvent as LipEvent
from mocap_fit.evaluation.closure import LipGaps as LipGaps
from mocap_fit.evaluation.closure import LipScores as LipScores
from mocap_fit.evaluation.closure import measure_gaps as measure_gaps
from mocap_fit.evaluation.evaluation import Evaluation as Evaluation
from mocap_fit.evaluation.evaluation import evaluate as evaluate
from mocap_fit.evaluation.landmarks import LandmarkScores as LandmarkScores
from mocap_fit.evaluation.landmarks import evaluate_landmarks as evaluate_landmarks
from mocap_fit.evaluation.measures import DEFINITIONS as DEFINITIONS
from mocap_fit.evaluation.measures import GROUPS as GROUPS
from mocap_fit.evaluation.measures import Difference as Difference
