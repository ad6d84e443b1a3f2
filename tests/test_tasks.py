"""`train_tasks`: one folder and one ordinary result a task, resumed bit for bit; what does not fit is a line."""

import json
import re
import shutil
from typing import Any

import jax
import numpy as np
import pytest

from aircl_jax import load, train, train_tasks
from aircl_jax.reports.card import as_markdown
from aircl_jax.runs.directory import METRICS, REPORT, STATE, SUMMARY
from envs import make_env
from experiments.cli.tasks import tasks_of
from experiments.run import main as run
from experiments.tasks import main
from tests.tiny_runs import CONFIG, GRID
from tests.tiny_runs import SMALL as SMALL_WORDS

pytestmark = pytest.mark.usefixtures("no_figures")

SMALL: dict[str, Any] = {"seeds": 2, "env_settings": GRID, "config": CONFIG, "iterations": 4}
GOALS: dict[str, Any] = {"corner": {}, "right": {"env_settings": {"goal": [0, 2]}}}


@pytest.mark.parametrize(
    ("tasks", "changed", "line"),
    [
        ({}, {}, "tasks is empty"),
        ({"../up": {}}, {}, "task '../up' is no name of a folder"),
        ({"a": {"seeds": 3}}, {}, "tasks.a: unknown setting 'seeds'; choose from env, env_settings, demonstrations"),
        ({"a": {"demonstrations": "none.npz"}}, {}, "tasks.a: demonstrations=none.npz: there is no such file"),
        (
            {"a": {}, "b": {"env_settings": {"size": 4}}},
            {},
            "tasks.b: obs_size is 16, and 9 in a; one constraint needs the same",
        ),
        ({"a": {}, "b": {"env": make_env("swimmer")}}, {"env_settings": {}}, "tasks.b: name is swimmer, and gridworld in a"),
        (GOALS, {"method": "aircl"}, "method=aircl counts no evidence that tasks could share; choose aircl_contrast"),
        (GOALS, {"resume": True, "overwrite": True}, "resume=true and overwrite=true exclude each other"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(tasks, changed, line):
    with pytest.raises(ValueError, match=re.escape(line[:12])) as error:
        train_tasks("gridworld", tasks, **{**SMALL, **changed})
    assert str(error.value).startswith(line)
    assert "\n" not in str(error.value)


def test_animals_tables_have_no_tasks():
    animals = {"a": {}, "b": {}}
    with pytest.raises(ValueError, match="env=labyrinth is no table of places, of which the row's reward speaks"):
        train_tasks("labyrinth", animals, seeds=1, iterations=1, env_settings={"data": "simulated"})


def test_tasks_of_other_numbers_of_demonstrations_are_refused(tmp_path):
    rng = np.random.default_rng(0)
    for name, number in (("a", 5), ("b", 4)):
        obs = np.eye(9)[rng.integers(9, size=(number, 4))]
        np.savez(tmp_path / f"{name}.npz", obs=obs, action=rng.integers(4, size=(number, 4)))
    tasks = {name: {"demonstrations": tmp_path / f"{name}.npz"} for name in ("a", "b")}
    with pytest.raises(ValueError, match=r"tasks\.b: 4 demonstrations, of a 5; give each task as many"):
        train_tasks("gridworld", tasks, **SMALL)


def test_the_card_says_once_that_the_constraint_is_of_all_tasks():
    card = {"wants": [], "never": [], "cannot_tell": [], "separable": True}
    said = "One constraint from 2 tasks (corner, right). The counts are sums over all of them"
    assert said in as_markdown({**card, "tasks": ["corner", "right"]}, "")
    assert "One constraint" not in as_markdown(card, "")


@pytest.mark.parametrize(
    ("word", "line"), [("env=walker", "env=walker has no tasks here"), ("env=swimmer", "backwards= is missing")]
)
def test_the_command_refuses_in_one_line(word, line, capsys):
    assert main([word]) == 2
    assert capsys.readouterr().err.startswith(f"error: {line}")


def test_the_list_of_demonstrations_names_tasks_by_their_files():
    forward, back = tasks_of(["runs/forward.npz", {"source": "back.npz", "name": "home", "reward": "backwards"}]).items()
    assert forward == ("forward", {"demonstrations": "runs/forward.npz", "env_settings": {}})
    assert back == ("home", {"demonstrations": "back.npz", "env_settings": {"reward": "backwards"}})
    assert list(tasks_of([{"goal": [2, 2]}, {"goal": [0, 2]}])) == ["task1", "task2"]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["demonstrations=[a.npz,other/a.npz]"], "demonstrations: two tasks are called a; name one"),
        (["demonstrations=[a.npz,b.npz]"], "tasks.a: demonstrations=a.npz: there is no such file"),
        (["demonstrations=[{goall: [2,2]},{}]"], "tasks.task1: unknown setting env.goall"),
        (["demonstrations=[{},{}]", "log=tensorboard"], "log is not for several tasks"),
        (["demonstrations=[1,2]"], "demonstrations=[1, 2] is not a text or a list"),
    ],
)
def test_the_command_line_of_several_tasks_refuses_in_one_line(words, line, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(["env=gridworld", "method=aircl_contrast", *SMALL_WORDS, "seeds=1", "iterations=2", *words]) == 2
    assert capsys.readouterr().err.startswith(f"error: {line}")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_command_line_trains_tasks_as_python_does(tmp_path, capsys):
    words = ["env=gridworld", "method=aircl_contrast", *SMALL_WORDS, "seeds=2", "iterations=4", f"run_dir={tmp_path / 'run'}"]
    named = "demonstrations=[{name: corner, goal: [2,2]},{name: right, goal: [0,2]}]"
    assert run([*words, named]) == 0
    printed = capsys.readouterr().out
    assert "corner:" in printed and "right:" in printed
    train_tasks("gridworld", GOALS, run_dir=tmp_path / "python", **SMALL)
    for task in GOALS:
        assert (tmp_path / "run" / task / METRICS).read_bytes() == (tmp_path / "python" / task / METRICS).read_bytes()
    assert run([*words, named, "resume=true"]) == 0


@pytest.mark.slow
def test_one_task_alone_is_an_ordinary_run_bit_for_bit(tmp_path):
    plain = train("gridworld", "aircl_contrast", run_dir=tmp_path / "plain", **SMALL)
    alone = train_tasks("gridworld", {"only": {}}, run_dir=tmp_path / "tasks", **SMALL)["only"]
    for file in (METRICS, "config.yaml"):
        assert (tmp_path / "tasks" / "only" / file).read_bytes() == (tmp_path / "plain" / file).read_bytes()
    assert alone.summary["metrics"] == plain.summary["metrics"]
    for one, other in zip(*(jax.tree.leaves(result.states.params) for result in (alone, plain)), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_each_task_is_an_ordinary_run_that_resumes_bit_for_bit(tmp_path):
    whole = train_tasks("gridworld", GOALS, run_dir=tmp_path / "whole", **SMALL)
    part, ends = tmp_path / "part", {**SMALL, "iterations": 2}
    train_tasks("gridworld", GOALS, run_dir=part, **ends)
    train_tasks("gridworld", GOALS, run_dir=part, resume=True, **SMALL)
    killed = tmp_path / "killed"  # after the first task's chunk was kept, and before the second's
    shutil.copytree(tmp_path / "whole", killed)
    shutil.rmtree(killed / "right" / STATE / "00000004")
    for task, name in (("right", SUMMARY), ("right", REPORT), ("corner", SUMMARY), ("corner", REPORT)):
        (killed / task / name).unlink()
    train_tasks("gridworld", GOALS, run_dir=killed, resume=True, **SMALL)
    for task, result in whole.items():
        expected = (tmp_path / "whole" / task / METRICS).read_bytes()
        assert (part / task / METRICS).read_bytes() == (killed / task / METRICS).read_bytes() == expected
        again = load(killed / task)
        assert again.summary["metrics"] == result.summary["metrics"] == load(part / task).summary["metrics"]
        assert again.spec.tasks == tuple(GOALS)
        assert json.loads((part / task / "card.json").read_text())["tasks"] == list(GOALS)
        for one, other in zip(*(jax.tree.leaves(each.states.params) for each in (again, result)), strict=True):
            np.testing.assert_array_equal(one, other)
    done = train_tasks("gridworld", GOALS, run_dir=killed, resume=True, **SMALL)
    assert done["right"].summary == load(killed / "right").summary
    with pytest.raises(ValueError, match="run with other settings: tasks"):
        train("gridworld", "aircl_contrast", run_dir=killed / "corner", resume=True, **SMALL)
    corner, right = (np.asarray(jax.tree.leaves(whole[task].states.params.feasibility)[0]) for task in GOALS)
    np.testing.assert_array_equal(corner, right)
