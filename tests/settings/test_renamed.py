"""Names of before: `load` reads them, everything else refuses them in one line that gives today's."""

import json
import shutil
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from aircl_jax import load, train
from aircl_jax.runs.directory import CONFIG
from aircl_jax.settings.renamed import RENAMED, old_name, renamed
from aircl_jax.settings.train_config import TrainConfig
from envs.settings import flatten, plain
from experiments import run
from tests.tiny_runs import FAST, GRID

pytestmark = pytest.mark.usefixtures("no_figures")
SETTINGS: dict[str, Any] = {**FAST, "iterations": 2}
WINDY: dict[str, Any] = {**SETTINGS, "env_settings": {**GRID, "wind": 0.2}}


@pytest.fixture(scope="module")
def today(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "today"
    train(**SETTINGS, run_dir=path)
    return path


@pytest.fixture
def older(today, tmp_path) -> Path:
    """The same run as an earlier version would have written it."""
    path = Path(shutil.copytree(today, tmp_path / "older"))
    settings = yaml.safe_load((path / CONFIG).read_text())
    for old, new in RENAMED.items():
        *groups, name = old.split(".")
        group = settings
        for part in groups:
            group = group[part]
        group[name] = group.pop(new.rpartition(".")[2]) if new else 0.0
    (path / CONFIG).write_text(yaml.safe_dump(settings, sort_keys=False))
    return path


def test_the_table_leads_from_names_that_are_gone_to_fields_that_are_there():
    known = {f"train.{name}" for name in flatten(plain(asdict(TrainConfig())))}
    for old, new in RENAMED.items():
        assert old not in known
        assert new is None or (new in known and new.rpartition(".")[0] == old.rpartition(".")[0])


def test_kept_cells_name_their_settings_as_today():
    known = {f"train.{name}" for name in flatten(plain(asdict(TrainConfig())))}
    paths = list(Path("results/cells").glob("*/*.json"))
    assert paths
    for path in paths:
        settings = json.loads(path.read_text())["settings"]
        assert [name for name in flatten(settings) if RENAMED.get(name)] == []
        assert {name for name in flatten(renamed(settings)) if name.startswith("train.")} <= known


def test_settings_of_before_get_their_names_of_today_and_others_stay():
    given = {"env": {"pool": 1}, "train": {"pool": 4, "ppo": {"chunk": 2}, "coefficients": {"cost_budget": 0.0}}}
    assert renamed(given) == {"env": {"pool": 1}, "train": {"pool_factor": 4, "ppo": {"chunk": 2}, "coefficients": {}}}
    assert old_name("train.pool_factor") is None


def test_a_run_of_before_is_read(older, today):
    before, now = load(older), load(today)
    assert before.summary == now.summary
    assert before.networks.config == now.networks.config
    np.testing.assert_array_equal(before.states.step, now.states.step)


def test_a_run_older_than_a_setting_is_read_and_continued_as_its_default(today, tmp_path):
    path = Path(shutil.copytree(today, tmp_path / "older"))
    settings = yaml.safe_load((path / CONFIG).read_text())
    for name in ("layout", "reward", "walls", "dislikes", "dislike", "wind", "lapse"):
        del settings["env"][name]
    (path / CONFIG).write_text(yaml.safe_dump(settings, sort_keys=False))
    assert load(path).spec.settings == load(today).spec.settings
    assert train(**SETTINGS, run_dir=path, resume=True).summary == load(today).summary
    with pytest.raises(ValueError, match=r"env.wind is 0.0 there and 0.2 here"):
        train(**WINDY, run_dir=path, resume=True)


def test_a_run_of_before_is_not_continued(older):
    with pytest.raises(ValueError, match=r"train\.\w+; it is called train\.\w+ now; choose overwrite=true"):
        train(**SETTINGS, run_dir=older, resume=True)


def test_a_setting_that_is_gone_is_refused():
    with pytest.raises(ValueError, match=r"train.coefficients.cost_budget; it is gone, for it changed nothing"):
        train("gridworld", config={"coefficients": {"cost_budget": 0.1}})


@pytest.mark.parametrize(("old", "new"), [(old, new) for old, new in RENAMED.items() if new])
def test_an_old_name_is_refused_with_the_new_one(old, new, tmp_path, monkeypatch, capsys):
    line = f"unknown setting {old}; it is called {new} now"
    with pytest.raises(ValueError, match=line):
        train("gridworld", config={old.partition(".")[2]: 1})
    monkeypatch.chdir(tmp_path)
    assert run.main([f"{old}=1"]) == 2
    assert capsys.readouterr().err == f"error: {line}\n"
    assert list(tmp_path.iterdir()) == []
