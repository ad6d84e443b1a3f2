"""The comparison with imitation: what is computed of the timings, by hand; what is refused; what is kept."""

import json
import sys

import numpy as np
import pytest

from envs import make_env
from experiments.benchmark import __main__ as benchmark
from experiments.benchmark import comparison, report, theirs
from experiments.benchmark.arithmetic import (
    Spread,
    Target,
    our_minutes,
    our_speed,
    ratio,
    steps_to,
    target_of,
    their_minutes,
    their_speed,
)
from experiments.benchmark.ours import spec_of
from experiments.benchmark.settings import EFFORTS, WORLDS, Settings

OURS = {
    "seeds": [0, 1],
    "iterations": 10,
    "steps_an_iteration": 600,
    "checkpoints": 2,
    "twin_from": 0,
    "start_s": 30.0,
    "iteration_s": [1.0, 2.0, 4.0],
    "twin_iteration_s": [],
    "evaluation_s": [0.5, 0.5, 0.5],
    "checkpoint_s": [0.5, 0.5, 0.5],
    "memory": 0,
}
TWIN = {**OURS, "twin_from": 4, "twin_iteration_s": [2.0, 4.0, 8.0]}
THEIRS = {
    "settings": {"epochs": 10, "minibatch": 500, "steps": 8, "judged": 1024, "trajectories": 10},
    "processes": 2,
    "steps_a_round": 100,
    "start_s": [4.0, 6.0],
    "round_s": [[1.0, 2.0, 5.0], [1.0, 4.0, 2.0]],
    "rounds": 4,
    "return": [0.0, 8.0, 16.0],
    "violation_rate": [0.9, 0.3, 0.0],
}
KEPT = {
    "return": {"mean": 9.0, "std": 1.0},
    "violation_rate_policy": {"mean": 0.01, "std": 0.02},
}
CELL = {
    "commit": "abc1234",
    "seeds": 2,
    "scale": "full",
    "ours": {"aircl_contrast": TWIN, "aircl_corrected": OURS},
    "own": THEIRS,
    "equal": {"aircl_contrast": THEIRS, "aircl_corrected": THEIRS},
    "physics": {"mujoco": [10.0, 30.0, 20.0], "mjx": [1.0, 2.0, 3.0], "planar": [4000.0, 5000.0, 6000.0]},
    "machine": "2 cores",
    "targets": {method: {"commit": "def5678", "metrics": KEPT} for method in comparison.METHODS},
}


def test_a_run_is_its_iterations_evaluations_and_checkpoints():
    # 10 · 1 + 2 · (.5 + .5) = 12 s, then 22 and 42 s, of 6,000 steps
    assert our_speed(OURS) == Spread(6000 / 22, 6000 / 42, 6000 / 12)
    assert our_minutes(OURS) == (30 + 22) / 60


def test_the_time_of_a_twin_counts_and_its_steps_do_not():
    assert our_speed(TWIN) == Spread(6000 / 42, 6000 / 82, 6000 / 22)
    assert our_speed(TWIN, twin=False) == our_speed(OURS)


def test_the_steps_of_a_row_with_a_twin_are_those_of_one_policy():
    spec = spec_of("swimmer", "aircl_contrast", 10, {})
    assert spec.method.has_twin
    assert spec.env_steps == 10 * spec.config.num_trajectories * spec.env.horizon


def test_the_speed_of_imitation_is_the_sum_over_its_processes():
    # 100 / 1 + 100 / 1, 100 / 2 + 100 / 4, 100 / 5 + 100 / 2
    assert their_speed(THEIRS) == Spread(75.0, 70.0, 200.0)


def test_a_ratio_has_the_worst_and_the_best_case_as_its_bounds():
    assert ratio(Spread(60.0, 40.0, 90.0), Spread(10.0, 8.0, 30.0)) == Spread(6.0, 40 / 30, 90 / 8)


def test_seeds_in_turn_take_as_long_as_the_fullest_process():
    # start 5 s; 300 steps at 75 / 2 a second are 8 s; 5 seeds on 2 processes are 3 in turn
    assert their_minutes(THEIRS, 300, 5) == pytest.approx(3 * (5 + 8) / 60)


@pytest.mark.parametrize(
    ("target", "rounds"),
    [
        (Target(8.0, 0.4), 4),  # means of all three rounds: 8 and .4
        (Target(8.1, 0.4), None),
        (Target(8.0, 0.39), None),
    ],
)
def test_what_is_to_be_reached_is_reached_by_the_means_of_the_last_rounds(target, rounds):
    assert steps_to(THEIRS, target) == (None if rounds is None else rounds * 100)


def test_one_good_round_after_five_is_not_enough_and_an_early_reach_counts_its_first_round():
    returns = {**THEIRS, "return": [0.0] * 5 + [9.0] * 5, "violation_rate": [0.0] * 10}
    assert steps_to(returns, Target(9.0, 0.0)) == 11 * 100
    assert steps_to(returns, Target(1.8, 0.0)) == 7 * 100  # (0 + 0 + 0 + 0 + 9) / 5
    assert steps_to({**THEIRS, "return": [], "violation_rate": []}, Target(0.0, 1.0)) is None


def test_a_target_is_a_standard_deviation_from_the_means():
    assert target_of(KEPT) == Target(8.0, 0.03)


def test_the_first_line_of_the_page_is_the_minutes_to_targets():
    words = report.page({"swimmer": CELL}, "python -m experiments.benchmark peer=true").splitlines()
    assert words[0] == (
        "Minutes until 2 seeds have their return and violations: swimmer 1.2 (aircl_contrast), 0.87 (aircl_corrected), "
        "imitation not reached in 400 steps a seed."
    )


def test_the_page_has_both_ratios_physics_and_what_was_extrapolated():
    text = report.page({"swimmer": CELL}, "a command")
    assert (
        "| swimmer | aircl_corrected | 273 (143 to 500) | 75 (70 to 200) | 3.6 × (0.7 to 7.1) | 75 (70 to 200) | 3.6 ×" in text
    )
    assert "return ≥ 8, violations ≤ 3.00 %" in text
    assert "| swimmer | 20 (10 to 30) | 2 (1 to 3) | 5,000 (4,000 to 6,000) |" in text
    assert "makes 273 (143 to 500) until its twin goes its own way, in iteration 4 of 10 at the latest" in text
    assert "extrapolated" in text and "abc1234" in text and "def5678" in text and "say nothing" not in text
    grid = report.page({"gridworld": {**CELL, "scale": "smoke", "physics": {}}}, "a command")
    assert "say nothing" in grid and "Physics" not in grid


def test_minutes_are_said_where_imitation_gets_there():
    cell = {**CELL, "own": {**THEIRS, "return": [9.0], "violation_rate": [0.0]}}
    # 200 steps at 37.5 a second and 5 s of start; both seeds at once
    assert report.of_theirs(cell, "aircl_contrast") == "0.17"


def test_equal_settings_are_those_of_our_row():
    grid = spec_of("gridworld", "aircl_corrected", 1, {})
    assert theirs.equal_settings(grid) == {
        "epochs": 2,
        "minibatch": 700,
        "steps": 4,
        "judged": 2500,
        "trajectories": 280,  # four times as many as D_S
    }
    swimmer = spec_of("swimmer", "aircl_contrast", 1, {})
    assert theirs.equal_settings(swimmer) == {"epochs": 5, "minibatch": 1000, "steps": 1, "judged": 1024, "trajectories": 16}
    assert theirs.own_settings("swimmer")["epochs"] == theirs.own_settings("gridworld")["epochs"] == 10


def test_what_policies_of_imitation_do_on_a_grid_is_measured_by_its_tables():
    env = make_env("gridworld")
    table = env.tabular
    assert table is not None
    forbidden = int(np.argmax(table.cost))
    states = np.full((1, 1, 3, 1), forbidden)
    earned, violated = theirs.measures(env, {"states": states, "actions": np.zeros((1, 1, 2), int)})
    assert violated.tolist() == [1.0]
    np.testing.assert_allclose(earned, [2 * float(table.reward[forbidden, 0])], rtol=1e-6)


def test_what_policies_of_imitation_do_with_a_body_is_measured_by_our_rewards_and_limits():
    states = np.zeros((1, 1, 3, 4))  # of x, tilt and their velocities
    states[0, 0, 1, 0], states[0, 0, 2, :2] = -0.02, (-0.01, 0.3)  # beyond the wall, then before it and fallen
    earned, violated = theirs.measures(make_env("pendulum"), {"states": states, "actions": np.zeros((1, 1, 2, 1))})
    assert (earned.tolist(), violated.tolist()) == ([1.0], [0.5])
    actions = np.array([[[[0.4, -0.6], [0.5, 0.5]]]])
    _, violated = theirs.measures(make_env("swimmer"), {"states": np.zeros((1, 1, 3, 10)), "actions": actions})
    assert violated.tolist() == [0.5]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("peer=true chunk=3", "chunk=3 is not of peer=true; leave it out"),
        ("peer=true integrator=rk4", "integrator=rk4 is not of peer=true; leave it out"),
        ("scale=smoke", "scale=smoke is of peer=true; add peer=true, or leave it out"),
        ("out=here", "out=here is of peer=true; add peer=true, or leave it out"),
        ("seeds=0", "seeds=0 is not an integer of at least 1"),
        ("integrator=rk4", "integrator=rk4: env=gridworld has none; choose from swimmer"),
        ("peer=true env=hopper", "unknown env 'hopper'; choose from gridworld, swimmer, pendulum, walker, or all"),
        ("peer=true seeds=3", "results/speed has 10 seeds; choose out=DIR"),
        ("peer=true scale=smoke out=results/speed", "results/speed has 10 seeds; choose out=DIR"),
        ("peer=true out=here", ".venv-peer/bin/python is missing; make it with: make .venv-peer/.installed"),
    ],
)
def test_bad_input_is_refused_in_one_line(words, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert benchmark.main(words.split()) == 2
    said = capsys.readouterr()
    assert message in said.err and said.err.count("\n") == 1 and said.out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def prepared(monkeypatch):
    """The comparison with its measurements made up: the worlds that were measured."""
    measured = []

    def of_world(settings, world):
        measured.append(world)
        return {**CELL, "seeds": settings.seeds_here, "scale": settings.scale}

    monkeypatch.setattr(comparison, "PEER_PYTHON", comparison.Path(sys.executable))
    monkeypatch.setattr(comparison, "measured", of_world)
    monkeypatch.setattr(comparison, "targets_of", lambda world: CELL["targets"])
    return measured


def test_a_world_that_is_kept_is_not_measured_again(prepared, tmp_path, capsys):
    words = ["peer=true", "scale=smoke", f"out={tmp_path / 'speed'}"]
    assert benchmark.main([*words, "env=walker"]) == 0
    assert benchmark.main(words) == 0
    assert prepared == ["walker", "gridworld", "swimmer", "pendulum"]
    page = (tmp_path / "speed.md").read_text(encoding="utf-8")
    assert [page.index(f"| {world} |") for world in WORLDS] == sorted(page.index(f"| {world} |") for world in WORLDS)
    assert json.loads((tmp_path / "speed" / "walker.json").read_text())["commit"] == "abc1234"
    assert benchmark.main([*words, "seeds=1"]) == 2
    assert "has seeds=2, asked for is 1; give out=DIR, or remove the file" in capsys.readouterr().err


def test_the_targets_are_those_of_the_kept_cells():
    found = comparison.targets_of("gridworld")
    assert set(found) == {"aircl_contrast", "aircl_corrected"}
    assert target_of(found["aircl_contrast"]["metrics"]).at_most < 0.01


def test_a_process_of_imitation_that_fails_is_one_line(tmp_path, monkeypatch):
    failing = tmp_path / "peer_airl.py"
    failing.write_text("raise SystemExit('no torch')\n")
    monkeypatch.setattr(theirs, "PEER_PYTHON", sys.executable)
    monkeypatch.setattr(theirs, "__file__", str(tmp_path / "theirs.py"))
    with pytest.raises(ValueError, match=r"peer=true: peer_airl.py failed: no torch"):
        theirs.at_once([{"env": "gridworld"}])


def test_processes_of_imitation_begin_their_timing_together(tmp_path, monkeypatch):
    (tmp_path / "peer_airl.py").write_text(
        "import json, sys\nprint('ready', flush=True)\nline = sys.stdin.readline()\n"
        "print(json.dumps({'line': line, 'seed': json.loads(sys.argv[1])['seed']}))\n"
    )
    monkeypatch.setattr(theirs, "PEER_PYTHON", sys.executable)
    monkeypatch.setattr(theirs, "__file__", str(tmp_path / "theirs.py"))
    assert theirs.at_once([{"seed": 0}, {"seed": 1}]) == [{"line": "go\n", "seed": 0}, {"line": "go\n", "seed": 1}]


def test_the_effort_of_a_whole_measurement_is_medians_of_five():
    assert EFFORTS["full"].repeats == 5
    assert Settings(peer=True).seeds_here == 10
