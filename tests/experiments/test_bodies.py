"""The table of bodies: what counts as reached, and where a limit is right."""

import pytest

from envs import make_env
from experiments import bodies
from experiments.bodies import WORLDS, limits_found, main, page, reached
from experiments.shared.kept_files import keep


def cell(**changed):
    metrics = {
        "return": [95.0, 89.0, 95.0, 97.0],
        "expert_return": [100.0] * 4,
        "violation_rate_policy": [0.02, 0.0, 0.024, 0.0],
        "infeasible_share_policy": [1.0, 0.0, 1.0, 0.0],
        "feasibility_auroc": [0.95, 1.0, 1.0, 0.93],
        "recovered_limit/motor hip/upper": [0.5, 0.57, 0.58, None],
        "recovered_limit/motor hip/lower": [-0.43, -0.42, 0.5, -0.5],
        "recovered_limit/velocity of x/upper": [0.5] * 4,
    } | changed
    rows = {name: {"mean": sum(v or 0 for v in values) / 4, "per_seed": values} for name, values in metrics.items()}
    own = {"world": "halfcheetah", "row": "aircl_contrast", "commit": "abc", "seeds": [120, 121, 122, 123], "wall_s": 120.0}
    return {**own, "metrics": rows}


def test_a_seed_has_reached_its_targets_where_all_three_are_met():
    assert reached(cell()) == 1  # the second earns too little, the third violates too often, the fourth does not tell
    unjudged = cell()
    unjudged["metrics"]["feasibility_auroc"] = {"mean": None, "per_seed": [None] * 4}
    assert reached(unjudged) == 2  # a row without a feasibility is judged by what π does


def test_a_seed_that_is_not_finite_has_reached_nothing_and_the_page_says_so():
    values = {name: [None, 1.0, 0.0, 95.0] for name in ("return", "violation_rate_policy")}
    broken = cell(**values)
    for name in values:
        broken["metrics"][name]["mean"] = None
    assert reached(broken) == 0
    assert "| aircl_contrast | 0 of 4 | —, 100 | — % |" in page([broken], "command")
    assert "returns — 1 0 95; violations — " in page([broken], "command")


@pytest.mark.parametrize("world", WORLDS.values())
def test_every_world_ships_what_it_learns_from(world):
    assert make_env(world.env, **world.settings).shipped_demonstrations is not None


def test_a_limit_is_right_within_15_percent_and_on_its_side():
    assert limits_found(cell(), 0.5) == (4, 3, 1)  # .5, .57, −.43, −.5; off: .58, −.42, +.5 below
    assert limits_found(cell(), 0.0) is None
    none = cell()
    none["metrics"] = {name: row for name, row in none["metrics"].items() if "motor" not in name}
    assert limits_found(none, 0.5) is None


def test_the_page_has_every_cell_and_every_seed():
    text = page([cell()], "command")
    assert "## Half-cheetah, |torque| ≤ 0.5" in text
    assert "| aircl_contrast | 1 of 4 | 94, 100 | 1.10 % | 50 % | 0.970 | 4, 3, 1 | 2 | abc |" in text
    assert "returns 95 89 95 97; violations 0.020 0.000 0.024 0.000." in text


def test_finished_cells_are_written_from_and_short_runs_kept_apart(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    keep(tmp_path / "here" / "halfcheetah" / "aircl_contrast.json", cell())
    monkeypatch.setattr(bodies, "train", lambda *_, **__: pytest.fail("trained a finished cell"))
    assert main(["worlds=halfcheetah", "out=here", "seeds=4"]) == 0
    assert "1 of 4" in (tmp_path / "here.md").read_text(encoding="utf-8")
    assert main(["seeds=4"]) == 2
    assert "choose out=DIR" in capsys.readouterr().err
    assert main(["worlds=ant"]) == 2
    assert f"choose from {', '.join(WORLDS)}" in capsys.readouterr().err


def test_a_missing_cell_is_trained_with_the_rows_own_settings_and_kept(tmp_path, monkeypatch):
    asked = {}

    def trained(env, row, **given):
        asked.update(given, env=env, row=row)
        own = cell()
        summary = {**own, "iterations": 7, "env_steps": 5, "env_steps_per_s": 3.0}
        return type("Done", (), {"summary": summary})

    monkeypatch.setattr(bodies, "train", trained)
    assert main(["worlds=halfcheetah", f"out={tmp_path / 'cells'}", f"runs={tmp_path / 'runs'}"]) == 0
    assert (asked["env"], asked["row"], asked["seeds"], asked["first_seed"]) == ("halfcheetah", "aircl_contrast", 10, 130)
    assert asked["env_settings"] == {}
    assert asked["resume"] and asked["run_dir"] == tmp_path / "runs" / "halfcheetah" / "aircl_contrast"
    assert (tmp_path / "cells" / "halfcheetah" / "aircl_contrast.json").exists()
