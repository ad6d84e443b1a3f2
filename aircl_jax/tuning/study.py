"""Try settings one after another and keep each trial in a file of Optuna; an interrupted study goes on where it was."""

import importlib
import json
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from aircl_jax.tuning.ranges import Choice, Range, Ranges, label

STUDY = "study.journal"  # of Optuna's JournalStorage; `optuna-dashboard` reads it
NAME = "search"
MISSING = "a search needs the package optuna, which is not installed; install aircl-jax[search]"
SCORE, MEASURES, FAILURE, SETTINGS = "score", "measures", "failure", "settings"


class Trial(NamedTuple):
    """Settings that were tried, by name, with the measures that they reached, or why they reached none."""

    values: dict[str, Any]
    measures: dict[str, float]
    failure: str

    @property
    def score(self) -> float:
        return self.measures.get(SCORE, -math.inf)


OnTrial = Callable[[list[Trial], float], None]  # all trials so far, and the seconds that the others will take


def explore(
    folder: Path,
    ranges: Ranges,
    defaults: Mapping[str, Any],
    measure: Callable[[dict[str, Any]], dict[str, float]],
    budget: int,
    settings: Mapping[str, Any],
    on_trial: OnTrial,
) -> list[Trial]:
    """Go on with the study in this folder, or begin it, until `budget` trials are done; return all of them.

    The first trial is the defaults, where the ranges hold them. `measure` gives the score and whatever else is to be kept; a
    ValueError of it, or a score that is not finite, is a trial that failed. Each trial's proposal depends on those before it
    alone, so that an interrupted study ends as an uninterrupted one.

    Raises ValueError where optuna is missing, or the study there has other settings.
    """
    optuna = imported()
    study = _opened(optuna, folder, settings)
    space = {name: _distribution(optuna, of) for name, of in ranges.items()}
    states, began, done = optuna.trial.TrialState, time.monotonic(), finished(study, ranges)
    already = len(done)
    while len(done) < budget:
        study.sampler = optuna.samplers.TPESampler(seed=len(done))
        if not done and not study.get_trials(states=[states.WAITING]) and defaults_within(ranges, defaults):
            study.enqueue_trial({name: _coded(ranges[name], defaults[name]) for name in ranges})
        trial = study.ask(space)
        found, failure = {}, ""
        try:
            found = measure(_decoded(ranges, trial.params))
        except ValueError as error:
            failure = str(error)
        if found and not math.isfinite(found[SCORE]):
            failure = f"its {SCORE} is not finite"
        if failure:
            trial.set_user_attr(FAILURE, failure)
            study.tell(trial, state=states.FAIL)
        else:
            trial.set_user_attr(MEASURES, found)
            study.tell(trial, found[SCORE])
        done = finished(study, ranges)
        each = (time.monotonic() - began) / (len(done) - already)
        on_trial(done, each * (budget - len(done)))
    return done


def imported() -> Any:
    """Import Optuna, which then speaks of errors alone. Raises ValueError, in one line, where it is missing."""
    try:
        optuna = importlib.import_module("optuna")
    except ImportError as error:
        raise ValueError(MISSING) from error
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    return optuna


def finished(study: Any, ranges: Ranges) -> list[Trial]:
    """List the trials that came to an end, in their order; what an interrupt has left is none."""
    ended = [trial for trial in study.get_trials(deepcopy=False) if {MEASURES, FAILURE} & set(trial.user_attrs)]
    return [
        Trial(_decoded(ranges, trial.params), dict(trial.user_attrs.get(MEASURES, {})), trial.user_attrs.get(FAILURE, ""))
        for trial in ended
        if trial.state.is_finished()
    ]


def defaults_within(ranges: Ranges, defaults: Mapping[str, Any]) -> bool:
    return all(of.holds(defaults[name]) for name, of in ranges.items())


def _opened(optuna: Any, folder: Path, settings: Mapping[str, Any]) -> Any:
    """Open the study of a folder, or make one, and end what an interrupt has left running."""
    backend = optuna.storages.journal.JournalFileBackend(str(folder / STUDY))
    storage = optuna.storages.JournalStorage(backend)
    study = optuna.create_study(storage=storage, study_name=NAME, direction="maximize", load_if_exists=True)
    here = json.loads(json.dumps(settings))
    there = study.user_attrs.get(SETTINGS)
    if there is None:
        study.set_user_attr(SETTINGS, here)
    elif there != here:
        differing = [name for name in {**there, **here} if there.get(name) != here.get(name)]
        listed = "; ".join(f"{name} is {there.get(name)} there and {here.get(name)} here" for name in differing)
        raise ValueError(f"run_dir={folder} holds a search with other settings: {listed}; choose overwrite=true")
    for trial in study.get_trials(states=[optuna.trial.TrialState.RUNNING]):
        study.tell(trial.number, state=optuna.trial.TrialState.FAIL)
    return study


def _distribution(optuna: Any, of: Range | Choice) -> Any:
    if isinstance(of, Choice):
        return optuna.distributions.CategoricalDistribution([label(option) for option in of.options])
    if of.whole:
        return optuna.distributions.IntDistribution(int(of.low), int(of.high), log=of.log)
    return optuna.distributions.FloatDistribution(of.low, of.high, log=of.log)


def _coded(of: Range | Choice, value: Any) -> Any:
    """Return a value as Optuna keeps it: a choice by its label."""
    return label(value) if isinstance(of, Choice) else value


def _decoded(ranges: Ranges, params: Mapping[str, Any]) -> dict[str, Any]:
    """Return Optuna's values as settings, in the order of the ranges."""
    return {name: _of_label(of, params[name]) for name, of in ranges.items() if name in params}


def _of_label(of: Range | Choice, value: Any) -> Any:
    """Return an option by its label, and a number to four digits, as the command line repeats it."""
    if isinstance(of, Choice):
        return next(one for one in of.options if label(one) == value)
    return value if of.whole else min(max(float(f"{value:.4g}"), of.low), of.high)
