"""Cells of the swap table on grids: results/swap/gridworld/WORLD/ROW.json, planned exactly on what a run has learned."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aircl_jax import train
from aircl_jax.analysis.episodes import learned_tables
from aircl_jax.messages import say
from aircl_jax.runs.result import Result
from aircl_jax.transfer.grid import in_every_world, learned, maps_of_a_grid
from aircl_jax.transfer.table_tests import Learned, by_world, case, measures, true_reward
from envs import Tabular
from envs.layouts import LAYOUTS
from envs.options import GridOptions
from envs.registry import options_of
from experiments.shared.commits import current_commit
from experiments.shared.fresh_seeds import first_seed_of
from experiments.shared.kept_files import keep, read_kept

REWARDS: Mapping[str, Mapping[str, Any]] = {
    "distance": {"reward": "distance"},
    "goal": {"reward": "goal"},
    "sites": {"reward": "sites", "start": "any"},  # from one start most of the world is never seen
}
WORLDS: Mapping[str, Mapping[str, Any]] = {
    f"{layout}, {reward}": {"layout": layout, **settings} for layout in LAYOUTS for reward, settings in REWARDS.items()
}
CONTROLS: Mapping[str, Mapping[str, Any]] = {
    "dislikes": {"obstacles": [], "dislikes": [list(cell) for cell in LAYOUTS["default"].obstacles], "dislike": 3.0},
    "lapses of 1 %": {"lapse": 0.01},
    "lapses of 5 %": {"lapse": 0.05},
}
FEWEST = 70  # demonstrations, of every cell that does not say another number
MORE: Mapping[str, tuple[str, int]] = {  # a world with more demonstrations
    f"{world}, {number} demonstrations": (world, number)
    for world in (*(name for name in WORLDS if name.startswith("default, ")), *CONTROLS)
    for number in (200, 500)
}
ORACLE, RANDOM = "oracle", "random"
CONTRAST, PLANNED = "aircl_contrast", "aircl_contrast planned"
CONTRAST_SEEDS = 10
RANDOM_SEEDS = 10
OF_THE_POLICY = ("violation_rate_policy", "violation_rate_expert", "goal_rate", "expert_goal_rate", "return", "expert_return")


@dataclass(frozen=True)
class GridStudy:
    """Where cells are kept, and how many seeds and iterations (0: each row's own) the runs have."""

    out: Path
    seeds: int
    iterations: int

    def path(self, world: str, row: str) -> Path:
        return self.out / "gridworld" / world.replace(", ", "_").replace(" ", "_") / f"{row}.json"


def worlds_of(row: str) -> list[str]:
    """List the worlds of a row's cells. More demonstrations are for one contrast row: both learn the same of them."""
    return [*WORLDS, *CONTROLS, *(MORE if row == PLANNED else ())]


def cell(study: GridStudy, world: str, row: str) -> Mapping[str, Any]:
    """Return the finished cell, trained now where it is missing."""
    path = study.path(world, row)
    if path.exists():
        return read_kept(path, "seeds", "metrics", "changed_worlds")
    say(f"{row} on {world}")
    commit, started = current_commit(), time.perf_counter()
    base, demonstrations = MORE.get(world, (world, FEWEST))
    settings = {**WORLDS, **CONTROLS}[base]
    options: GridOptions = options_of("gridworld", settings)
    seeds, tables, apart = _learned(study, row, settings, options, demonstrations)
    rows = [measures(options, one) for one in tables]
    elsewhere = [by_world(options, one) for one in tables]
    made = {
        "env": "gridworld",
        "world": world,
        "row": row,
        "env_settings": settings,
        "demonstrations": demonstrations,
        "seeds": seeds,
        "commit": commit,
        "seconds": round(time.perf_counter() - started, 1),
        "metrics": {name: [_number(one[name]) for one in rows] for name in rows[0]},
        "changed_worlds": {name: [list(map(_number, one[name])) for one in elsewhere] for name in elsewhere[0]},
        **apart,
    }
    keep(path, made)
    return made


def _learned(
    study: GridStudy, row: str, settings: Mapping[str, Any], options: GridOptions, demonstrations: int
) -> tuple[list[int], list[Learned], Mapping[str, Any]]:
    """What each seed of a row knows, the truth, nothing, or what it has learned; and what else is kept of its training."""
    world, horizon = case(options).world, case(options).horizon
    nowhere = np.zeros((horizon, *world.reward.shape))  # no policy is asked for where there is a reward
    if row == ORACLE:
        return [0], [Learned(true_reward, world.forbidden, nowhere)], {}
    if row == RANDOM:
        draws = [np.random.default_rng(seed).normal(size=world.reward.shape) for seed in range(RANDOM_SEEDS)]
        return list(range(RANDOM_SEEDS)), [Learned(in_every_world(reward), None, nowhere) for reward in draws], {}
    ours = row in (CONTRAST, PLANNED)
    method = CONTRAST if ours else row
    result = train(
        "gridworld",
        method,
        seeds=max(study.seeds, CONTRAST_SEEDS) if ours else study.seeds,
        first_seed=first_seed_of("gridworld", method),
        iterations=study.iterations or "default",
        env_settings=settings,
        config={
            **({"learner": "exact"} if row == PLANNED else {}),
            **({"num_demonstrations": demonstrations} if demonstrations != FEWEST else {}),
        },
    )
    table = result.spec.env.tabular
    if table is None:
        raise TypeError("a grid is a table")
    found = learned(result.spec.method, learned_tables(result.networks, result.states, table))
    return list(result.summary["seeds"]), found, _apart(result, table, found, options)


def _apart(result: Result, table: Tabular, found: Sequence[Learned], options: GridOptions) -> dict[str, Any]:
    """Keep π's own measures, and which obstacles each seed found beside the true M of each: who could have found what.

    Of cells that are only disliked it is kept how often each was entered, and which seeds flagged it.
    """
    metrics = result.summary["metrics"]
    kept = {name: metrics[name]["per_seed"] for name in OF_THE_POLICY}
    if not result.spec.method.tests_steps:
        return {"policy": kept}
    forbidden = np.flatnonzero(np.asarray(table.forbidden))
    maps = maps_of_a_grid(result.spec, result.networks, result.states, result.expert)
    flags = [one.forbids for one in found if one.forbids is not None]
    disliked = [row * int(options.size) + column for row, column in options.dislikes]
    tastes = {
        "entered": [seed[disliked].astype(int).tolist() for seed in maps["entered"]],
        "flagged": [[bool(flag) for flag in seed[disliked]] for seed in flags],
    }
    return {
        "policy": kept,
        **({"dislikes": tastes} if disliked else {}),
        "obstacles": {
            "true_tempted": [[round(float(value), 3) for value in seed[forbidden]] for seed in maps["true_tempted"]],
            "found": [[bool(flag) for flag in seed[forbidden]] for seed in flags],
        },
        "false_flags": [int(seed.sum() - seed[forbidden].sum()) for seed in flags],
        "wall_s": result.summary["wall_s"],
    }


def _number(value: float) -> float | None:
    return round(float(value), 5) if np.isfinite(value) else None
