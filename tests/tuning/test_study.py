"""A study tries the defaults first, finds a known optimum, keeps what failed apart and goes on as if nothing had been."""

import sys
from pathlib import Path

import pytest

from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.tuning.ranges import read_ranges
from aircl_jax.tuning.study import STUDY, explore

optuna = pytest.importorskip("optuna", reason="the extra `search` is not installed")

RANGES = read_ranges(
    {
        "train.ppo.learning_rate": (1e-4, 1e-1, "log"),
        "train.encoder": ["attention", "gru"],
        "train.adversary.num_steps": (1, 9),
    },
    TrainConfig(),
)
BEFORE = {"train.ppo.learning_rate": 1e-3, "train.encoder": "gru", "train.adversary.num_steps": 9}


def bowl(values):
    """Greatest at 0.01, attention and 4 steps."""
    rate = abs(values["train.ppo.learning_rate"] - 0.01)
    return {
        "score": -rate - (values["train.encoder"] == "gru") - 0.1 * abs(values["train.adversary.num_steps"] - 4),
        "rate": rate,
    }


def study(folder: Path, budget: int, measure=bowl, defaults=BEFORE, settings=None, on_trial=lambda trials, left: None):
    folder.mkdir(exist_ok=True)
    return explore(folder, RANGES, defaults, measure, budget, settings or {"env": "bowl"}, on_trial)


def test_the_defaults_come_first_and_what_is_better_is_found(tmp_path):
    told = []
    trials = study(tmp_path, 25, on_trial=lambda done, left: told.append((len(done), left > 0)))
    assert trials[0].values == BEFORE
    best = max(trials, key=lambda trial: trial.score)
    assert best.values["train.encoder"] == "attention" and best.values["train.adversary.num_steps"] in (3, 4, 5)
    assert best.measures == bowl(best.values)
    assert told == [(number, number < 25) for number in range(1, 26)]


def test_numbers_are_those_that_a_command_repeats(tmp_path):
    rates = [trial.values["train.ppo.learning_rate"] for trial in study(tmp_path, 5)]
    assert rates == [float(f"{rate:.4g}") for rate in rates]
    assert all(1e-4 <= rate <= 1e-1 for rate in rates)


def test_defaults_outside_the_ranges_are_not_tried(tmp_path):
    assert study(tmp_path, 2, defaults={**BEFORE, "train.adversary.num_steps": 12})[0].values != BEFORE


def test_an_interrupted_study_ends_as_an_uninterrupted_one(tmp_path):
    whole = study(tmp_path / "whole", 14)

    def interrupted_at(number):
        def measure(values):
            if len(seen) == number:
                raise KeyboardInterrupt
            seen.append(values)
            return bowl(values)

        return measure

    for number in (0, 3, 12):  # the defaults, a random trial, one that Optuna proposed
        seen = study(tmp_path / "cut", number) if number else []
        with pytest.raises(KeyboardInterrupt):
            study(tmp_path / "cut", 14, interrupted_at(number))
    assert study(tmp_path / "cut", 14) == whole


def test_a_finished_study_tries_nothing_and_a_greater_budget_goes_on(tmp_path):
    def never(values):
        raise AssertionError

    first = study(tmp_path, 3)
    assert study(tmp_path, 3, never) == first
    assert study(tmp_path, 5)[:3] == first


def test_what_fails_or_is_not_finite_has_no_score_and_ends_nothing(tmp_path):
    def measure(values):
        if values["train.adversary.num_steps"] == 9:
            raise ValueError("nine is too many")
        return {**bowl(values), "score": float("nan")} if values["train.encoder"] == "gru" else bowl(values)

    trials = study(tmp_path, 8, measure)
    assert (trials[0].failure, trials[0].measures) == ("nine is too many", {})
    assert {trial.failure for trial in trials if trial.values["train.encoder"] == "gru"} <= {
        "nine is too many",
        "its score is not finite",
    }
    assert max(trials, key=lambda trial: trial.score).values["train.encoder"] == "attention"
    assert study(tmp_path, 8) == trials


def test_other_settings_are_refused_by_name(tmp_path):
    study(tmp_path, 1)
    with pytest.raises(ValueError, match="env is bowl there and hill here; choose overwrite=true"):
        study(tmp_path, 2, settings={"env": "hill"})


def test_the_file_is_one_that_optuna_reads_itself(tmp_path):
    study(tmp_path, 3)
    storage = optuna.storages.JournalStorage(optuna.storages.journal.JournalFileBackend(str(tmp_path / STUDY)))
    read = optuna.load_study(study_name="search", storage=storage)
    assert len(read.trials) == 3 and read.best_value == max(trial.value for trial in read.trials)


def test_without_optuna_one_line_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    with pytest.raises(ValueError, match=r"needs the package optuna, which is not installed; install aircl-jax\[search\]$"):
        study(tmp_path, 1)
