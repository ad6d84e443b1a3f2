"""results/recovery: which run a cell is of, and that its numbers stand in their own row and column."""

import json
from types import SimpleNamespace
from typing import Any

import pytest

from aircl_jax import METHODS
from experiments import recovery
from experiments.recovery import SECOND, SHOWN, THIRD, main, table


def cell(method: str, **metrics: list[float | None]) -> dict[str, Any]:
    always = {name: [None] for name in ("violation_rate", "violation_rate_policy")}
    return {
        "method": method,
        "command": f"python -m experiments.run env=gridworld method={method} seeds=2",
        "commit": "abc1234",
        "iterations": 250,
        "metrics": {name: {"per_seed": values} for name, values in {**always, **metrics}.items()},
        "alarms": [],
    }


def rows_of(text: str, world: str) -> dict[str, dict[str, str]]:
    lines = text.split(f"## {world}\n")[1].split("\n## ", maxsplit=1)[0].splitlines()
    head, _, *rows = [[part.strip() for part in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    return {row[0]: dict(zip(head, row, strict=True)) for row in rows}


def test_a_row_has_its_methods_numbers_each_under_its_own_name():
    metrics: dict[str, list[float | None]] = {name: [place / 100, place / 100 + 0.02] for place, name in enumerate(SHOWN)}
    found = rows_of(table({("default", "aircl"): cell("aircl", **metrics)}), "default")["aircl"]
    for place, name in enumerate(SHOWN):
        assert found[name] == f"{place / 100 + 0.01:.3f} ± 0.014"  # 0.02 / √2
    assert (found["commit"], found["iterations"]) == ("abc1234", "250")


def test_a_world_has_its_own_rows_and_what_is_undefined_is_a_dash():
    cells = {
        ("default", "aircl"): cell("aircl", goal_rate=[1.0, 1.0]),
        ("non-Markov", "aircl"): cell("aircl", goal_rate=[0.5, None], rc_acc=[0.5, 0.7]),
        ("non-Markov", "airl_centred"): cell("airl_centred", goal_rate=[0.25, 0.25]),
    }
    text = table(cells)
    assert rows_of(text, "default")["aircl"]["goal_rate"] == "1.000 ± 0.000"
    assert rows_of(text, "non-Markov")["aircl"]["goal_rate"] == "—"
    assert rows_of(text, "non-Markov")["airl_centred"]["goal_rate"] == "0.250 ± 0.000"
    assert rows_of(text, "default").keys() == {"aircl"}
    assert "second layout" not in text


def test_every_seed_is_listed_for_q_and_for_the_policy():
    one = cell("aircl", violation_rate=[0.1, 0.2], violation_rate_policy=[0.3, None]) | {"alarms": ["it rang"]}
    text = table({("default", "aircl"): one})
    assert "- aircl: q 0.100 0.200; π 0.300 —" in text
    assert "Alarms:\n\n- aircl: it rang" in text


def test_every_world_is_trained_with_its_layout_and_finished_cells_are_kept(tmp_path, monkeypatch, capsys):
    trained = []

    def train(env, method, **given):
        trained.append((env, method, given))
        return SimpleNamespace(summary=cell(method, violation_rate=[0.1, 0.1]), alarms=[])

    monkeypatch.setattr(recovery, "train", train)
    words = ["seeds=2", "iterations=4", f"out={tmp_path}"]
    assert main(words) == 0
    on_default = [method for method in METHODS if method != "behaviour" and not method.endswith("_tuned")]
    assert [method for env, method, given in trained[: len(on_default)]] == on_default
    asked = {(env, json.dumps(given["env_settings"])) for env, _, given in trained}
    layouts = ({}, {"obstacles": SECOND}, {"obstacles": THIRD})
    assert asked == {*(("gridworld", json.dumps(one)) for one in layouts), ("nonmarkov", "{}")}
    assert len(trained) == len(on_default) + 3 * 4
    assert {(given["seeds"], given["iterations"]) for *_, given in trained} == {(2, 4)}
    contrast = [method.startswith("aircl_contrast") for _, method, _ in trained]
    assert [given["first_seed"] for *_, given in trained] == [1000 if ours else 0 for ours in contrast]
    assert [method for env, method, _ in trained if env == "nonmarkov"][-1] == "aircl_contrast_memory"
    kept = json.loads((tmp_path / "third_layout" / "aircl.json").read_text())
    fresh = json.loads((tmp_path / "default" / "aircl_contrast.json").read_text())
    assert fresh["command"].endswith("env=gridworld method=aircl_contrast seeds=2 first_seed=1000")
    assert kept["command"].endswith("env=gridworld method=aircl seeds=2 env.obstacles=[[0,4],[1,3],[1,4],[2,3],[4,2]]")
    assert main(words) == 0
    assert len(trained) == len(on_default) + 12
    assert rows_of((tmp_path / "table.md").read_text(), "third layout")["aircl"]["violation_rate"] == "0.100 ± 0.000"
    assert "training" in capsys.readouterr().out


@pytest.mark.parametrize("obstacles", [SECOND, THIRD])
def test_a_layout_has_five_different_obstacles(obstacles):
    assert len({tuple(one) for one in obstacles}) == 5
