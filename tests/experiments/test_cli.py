import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from experiments.cli.hydra_settings import _named
from experiments.run import main
from tests.tiny_runs import SMALL
from tests.worlds import command_module

pytestmark = pytest.mark.usefixtures("no_figures")
TINY = ["scale=smoke", "method=airl", "iterations=2", *SMALL]
OWN = {
    "config.yaml",
    "metrics.jsonl",
    "timing.jsonl",
    "state",
    "summary.json",
    "report.md",
    "report.html",
    "card.json",
    "card.md",
    "recovered.npz",
    "plans.json",
    "figures",
}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def refused(arguments: str, capsys) -> str:
    """The one line on standard error of a command that leaves nothing behind."""
    before = sorted(Path().rglob("*"))
    assert main(arguments.split()) == 2
    assert sorted(Path().rglob("*")) == before
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    return printed.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("env=maze", "unknown env 'maze'; choose from gridworld"),
        ("env=5", "unknown env '5'; choose from gridworld"),
        ("method=gail", "unknown method 'gail'; choose from"),
        ("env.slipp=0.1", "unknown setting env.slipp; choose from layout, reward"),
        ("env=swimmer env.body.pole=2", "unknown setting env.body.pole; choose from mass, gear, length, viscosity, gears"),
        ("env=swimmer env.body.gears={knee:-1}", "unknown setting env.body.gears.knee; choose from front, rear"),
        ("env=swimmer env.body.mass=heavy", "env.body.mass=heavy is not a number"),
        ("env=swimmer env.body.mass=-1", "wrong env.body.mass -1.0; choose a number above 0"),
        ("env=swimmer env.body.mass=2", "env=swimmer ships no demonstrations of these settings"),
        ("env=pendulum env.reward=backwards", "unknown reward 'backwards' of pendulum; choose from task, stand, target"),
        ("train.ppo.rate=1", "unknown setting train.ppo.rate; choose from learning_rate"),
        ("speed=3", "unknown setting speed; choose from method"),
        ("scale=huge", "unknown scale 'huge'; choose from full, smoke"),
        ("seeds=abc", "seeds=abc is not an integer"),
        ("seeds=0", "seeds=0 is not an integer of at least 1"),
        ("seeds=-3", "seeds=-3"),
        ("first_seed=-1", "first_seed=-1"),
        ("iterations=0", "iterations=0"),
        ("seeds", "cannot read 'seeds'"),
        ("env.slip=high", "env.slip=high is not a number"),
        ("env.slip=2", "env.slip=2"),
        ("env.obstacles=[[0,0]]", "covers the start"),
        ("env.obstacles=[[5,5]]", "covers the goal"),
        ("env.obstacles=[[9,9]]", "is not a cell"),
        ("env.obstacles=[[0,1],[1,0]]", "no clean path"),
        ("train.checkpoint_every=0", "train.checkpoint_every=0"),
        ("train.hidden=[]", "train.hidden names no layer"),
        ("train.coefficients.sharpness=0", "train.coefficients.sharpness=0.0 is not above 0"),
        ("train.coefficients.false_alarms=2", "train.coefficients.false_alarms=2.0 is more than 1"),
        ("train.ppo.learning_rate=-1", "train.ppo.learning_rate=-1.0 is negative"),
        ("train.ppo.learning_rate=nan", "train.ppo.learning_rate=nan is not a number"),
        ("train.ppo.log_std_min=1", "train.ppo.log_std_init=-0.7 is not between log_std_min=1.0 and log_std_max=0.0"),
        ("train.policy_delay=9 train.lr_decay_iterations=9", "train.policy_delay=9 is not less than lr_decay_iterations=9"),
        ("first_seed=4294967296", "choose seeds below 2147483646"),
        ("env=swimmer train.num_demonstrations=51", "train.num_demonstrations=51: env=swimmer ships 50"),
        ("contrast_prior=maybe", "contrast_prior=maybe is not one of method, on, off"),
        ("method=airl contrast_prior=on", "airl has no feasibility"),
        ("demonstrations=none.npz", "demonstrations=none.npz: there is no such file"),
        ("resume=true overwrite=true", "choose one"),
        ("run_dir=/proc/run", "run_dir=/proc/run cannot be written"),
    ],
)
def test_a_mistake_is_one_line_exit_code_2_and_nothing_written(arguments, message, capsys):
    assert message in refused(arguments, capsys)


def test_a_run_directory_that_is_a_file_is_refused(capsys):
    Path("taken").write_text("mine")
    assert "run_dir=taken is a file" in refused("run_dir=taken", capsys)
    assert "is a file" in refused("run_dir=taken/deeper", capsys)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("recovery seeds=0 out=here", "seeds=0 is not an integer of at least 1"),
        ("recovery iterations=-3 out=here", "iterations=-3 is not an integer of at least 0"),
        ("recovery seeds=2", "results/recovery has 10 seeds; choose out=DIR"),
        ("sweeps seeds=0 out=here", "seeds=0 is not an integer of at least 1"),
        ("physics bodies=horse", "unknown body 'horse'; choose from swimmer, walker, halfcheetah, hopper, pendulum, or all"),
        ("expert env=walker iterations=0", "iterations=0 is not an integer of at least 1"),
        ("expert env=walker env.constraint=none", "env.constraint=none: an expert is trained under a constraint"),
    ],
)
def test_other_commands_refuse_in_one_line_too(words, message, capsys):
    command, *given = words.split()
    assert command_module(f"experiments.{command}").main(given) == 2
    said = capsys.readouterr()
    assert message in said.err and said.err.count("\n") == 1 and said.out == ""
    assert not Path("here").exists()


@pytest.mark.parametrize(
    "command",
    [
        "accelerator",
        "benchmark",
        "figure2",
        "figure3",
        "figure4",
        "pendulum_lqr",
        "physics",
        "recovery",
        "sweeps",
        "table1",
        "watch",
    ],
)
def test_every_command_says_what_it_is_for(command, capsys):
    with pytest.raises(SystemExit) as ended:
        command_module(f"experiments.{command}").main(["--help"])
    assert ended.value.code == 0
    assert f"python -m experiments.{command}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), "a"),
        (("env=b", "env.size=3", "seeds=2", "hydra/launcher=joblib"), "ab"),
        (("-m", "env=b,c", "method=d"), "abc"),
        (("env=maze",), "a"),
        (("-m", "env=glob(*)"), "abcd"),
        (("+env=b",), "abcd"),
        (("hydra.sweeper.params.env=b",), "abcd"),
    ],
)
def test_only_what_the_words_name_is_registered_unless_they_may_name_anything(words, expected):
    assert _named("env", "a", "abcd", words) == list(expected)


def test_help_names_every_env_and_method(capsys):
    assert main(["--help"]) == 0
    printed = capsys.readouterr().out
    assert all(word in printed for word in ("gridworld", "nonmarkov", "aircl_corrected", "demonstrations", "slip"))


def test_a_command_in_a_new_process_leaves_a_whole_run_and_nothing_else():
    command = [sys.executable, "-m", "experiments.run", *TINY]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    first = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert first.returncode == 0, first.stderr
    assert "violation_rate" in first.stdout and "What to try next" in first.stdout
    assert [path.name for path in Path().iterdir()] == ["runs"]
    run = Path("runs/smoke/gridworld/airl")
    assert {path.name for path in run.iterdir()} <= OWN
    lines = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert len(lines) == 2 and all(len(values) == 2 for values in lines[0].values())
    summary = json.loads((run / "summary.json").read_text())
    assert summary["seeds"] == [0, 1]
    assert summary["metrics"]["feasibility_gap"]["per_seed"] == [None, None]
    assert yaml.safe_load((run / "config.yaml").read_text())["env"]["size"] == 3

    refusal = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert refusal.returncode == 2 and "already holds a run" in refusal.stderr and refusal.stdout == ""


def test_a_sweep_runs_every_combination_and_leaves_only_runs(capsys):
    assert main(["-m", *TINY, "first_seed=0,7", "run_dir=runs/from_${first_seed}"]) == 0
    assert sorted(path.name for path in Path("runs").iterdir()) == ["from_0", "from_7"]
    assert [path.name for path in Path().iterdir()] == ["runs"]
    assert main([*TINY, "first_seed=7", "run_dir=runs/from_7", "resume=true"]) == 0


def test_own_demonstrations_without_reward_or_cost_train_to_finite_numbers():
    obs = np.eye(9, dtype=np.float32)[np.array([[0, 1, 2, 5], [0, 3, 6, 7]])]
    np.savez("mine.npz", obs=obs, action=np.array([[1, 1, 2, 2], [2, 2, 1, 1]]))
    assert main([*TINY, "demonstrations=mine.npz", "run_dir=mine"]) == 0
    summary = json.loads(Path("mine/summary.json").read_text())
    assert summary["metrics"]["violation_rate_expert"]["mean"] is None
    assert summary["metrics"]["rc_acc"]["mean"] is not None


def test_contrast_prior_of_a_known_reward_refuses_demonstrations_without_one(capsys):
    obs = np.eye(9, dtype=np.float32)[np.array([[0, 1, 2, 5], [0, 3, 6, 7]])]
    np.savez("mine.npz", obs=obs, action=np.array([[1, 1, 2, 2], [2, 2, 1, 1]]))
    assert main([*TINY, "method=icrl_prior", "demonstrations=mine.npz", "run_dir=mine"]) == 2
    assert capsys.readouterr().err.startswith("error: demonstrations=mine.npz: reward is missing")
    assert not Path("mine").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("episods=3", "unknown setting episods; choose from seeds, first_seed, free_seeds"),
        ("train.cost_limit=1", "unknown setting train.cost_limit; choose from "),
    ],
)
def test_an_expert_answers_a_mistyped_setting_with_its_own(words, said, capsys):
    from experiments.expert.__main__ import main as expert

    assert expert([words]) == 2
    error = capsys.readouterr().err
    assert said in error and ("cost_budget" in error) == words.startswith("train") and "adversary" not in error
