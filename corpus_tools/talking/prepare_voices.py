"""``mocap-fit speak --prepare``: train the models of the talking head beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from corpus_tools.talking import speak_models, voice_training
from corpus_tools.tasks import TaskProgress
from mocap_fit import control
from mocap_fit.control import CONTROL_MODELS, ControlModel
from mocap_fit.corpus import Corpus
from mocap_fit.processes import limit_to_one_thread

if TYPE_CHECKING:
    from mocap_fit.evaluation import Evaluation


@dataclass(frozen=True, eq=False)
class Voice:
    """A model that speaks a language.

    Parameters
    ----------
    name
        Name of the control model.
    language
        The language.
    model
        The trained model; None for the rules, which are only scored.
    file
        Its file; None where it could not be saved.
    scores
        ``rmse_percent``, in per cent of the range, and ``bilabials_closed``, 0 to 1; empty where
        it was not scored.
    """

    name: str
    language: str
    model: ControlModel | None = None
    file: Path | None = None
    scores: Mapping[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON can hold it.

        Returns
        -------
        dict[str, Any]
            The fields, and the size of the model.
        """
        content: dict[str, Any] = {"model": self.name, "language": self.language}
        if self.model is not None:
            content |= {
                "file": self.file,
                "free_parameters": self.model.parameter_count,
                "trained_on": self.model.trained_on_,
            }
        return {**content, **self.scores}


@dataclass(frozen=True, eq=False)
class VoicesReport:
    """What a run of `prepare_voices` has done.

    Parameters
    ----------
    voices
        The models.
    folder
        Folder of their files.
    evaluations
        Scores by language; empty where none were computed.
    """

    voices: tuple[Voice, ...]
    folder: Path
    evaluations: Mapping[str, Evaluation]

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON can hold it.

        Returns
        -------
        dict[str, Any]
            Models and folder.
        """
        return {"models": [voice.to_dict() for voice in self.voices], "folder": self.folder}

    def __repr__(self) -> str:
        names = ", ".join(f"{voice.language} {voice.name}" for voice in self.voices)
        return f"VoicesReport({names}, folder={self.folder})"


@limit_to_one_thread()
def prepare_voices(
    languages: Sequence[str] = (),
    names: Sequence[str] = (),
    *,
    fresh: bool = False,
    check: bool = False,
    utterances: int = voice_training.UTTERANCES,
    progress: TaskProgress | None = None,
) -> VoicesReport:
    """Train the models that `speak` and `stream` take by their names, and save them in the cache.

    Parameters
    ----------
    languages
        Languages; by default all that there are sentences of.
    names
        Names of control models; by default all that learn something.
    fresh
        Whether models are trained again that are in the cache.
    check
        Whether they are scored on test sentences: error, and on how many of p, b and m the lips
        close.
    utterances
        Number of simulated sentences; `speak` takes models that were trained with the default.
    progress
        Called with a task, the number of its steps done, and of all.

    Returns
    -------
    VoicesReport
        The models.

    Raises
    ------
    MocapFitError
        If there is no such language or model.
    """
    voices: list[Voice] = []
    evaluations: dict[str, Evaluation] = {}
    wanted = names or [name for name in control.names() if name != speak_models.RULE_BASED]
    languages = languages or voice_training.list_languages()
    to_train: dict[str, list[str]] = {}
    for language in languages:
        for name in wanted:
            CONTROL_MODELS.get(name)
            if fresh or speak_models.find_saved(name, language, utterances) is None:
                to_train.setdefault(language, []).append(name)
    if progress is not None and to_train:
        time = voice_training.estimate_training(to_train)
        count = sum(map(len, to_train.values()))
        progress(f"training {count} model{'s' * (count > 1)}: {time}", 0, None)
    for language in languages:
        corpora: dict[str, Corpus] = {}
        how: dict[str, Any] = {"utterances": utterances, "progress": progress}
        models = {
            name: speak_models.prepare_model(name, language, fresh=fresh, corpora=corpora, **how)
            for name in wanted
        }
        scores: dict[str, dict[str, float]] = {}
        if check:
            corpus = corpora.get(language) or voice_training.simulate_corpus(language, **how)
            result = voice_training.score_models(corpus, models, progress=progress)
            evaluations[language] = result
            averages = result.compute_averages("rmse")[0][:, 0]
            scores = {
                name: {
                    "rmse_percent": float(average),
                    "bilabials_closed": result.lips[name].closed.value,
                }
                for name, average in zip(result.models, averages, strict=True)
            }
        for name, model in models.items():
            saved = speak_models.find_saved(name, language, utterances)
            voices.append(Voice(name, language, model, saved, scores.get(name, {})))
        if check:
            rules = speak_models.RULE_BASED
            voices.append(Voice(rules, language, scores=scores[rules]))
    return VoicesReport(tuple(voices), speak_models.get_folder(), evaluations)
