"""Cells of the swap table on robots: results/swap/ENV/ROW/TEST.json, made one after the other, skipped where they exist."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from aircl_jax import make_env, train
from aircl_jax.algorithm.learners.scale_free import Motors, true_motors
from aircl_jax.messages import say
from aircl_jax.methods import METHODS
from aircl_jax.model.networks import BoundNetworks, make_networks
from aircl_jax.runs.result import Result
from aircl_jax.settings.learner_config import learner_config
from aircl_jax.transfer import objectives
from aircl_jax.transfer.fresh import Fresh
from aircl_jax.transfer.judges import learned_motors
from aircl_jax.transfer.swap import SwapResult, measure, recombine
from envs import Env
from experiments.shared.commits import current_commit
from experiments.shared.fresh_seeds import first_seed_of
from experiments.shared.kept_files import keep, read_kept
from experiments.swap.playing import played, uniform
from experiments.swap.robot_tests import Test

CONTRAST = "aircl_contrast"
ORACLE, UNIFORM, RANDOM, AS_IS = "oracle", "uniform", "random", " as it is"
FIRST_SEED = 9000  # of fresh policies: no learned seed, no seed that a setting was chosen on
FIRST_SEED_OF = {"walker": 9800}  # earlier ones had served (docs/learner.md)
FIRST_FREE_SEED = 9300  # of those without a constraint: earlier ones were spent on a defect (docs/learner.md)
Cell = Mapping[str, Any]


@dataclass(frozen=True)
class Study:
    """Where cells and runs are kept, and how many seeds and iterations they have."""

    out: Path
    runs: Path
    oracle_seeds: int
    seeds: int
    iterations: int  # of fresh policies; 0: the learner's own
    result: Result | None = None  # a finished run in place of the rows' own

    def seeds_of(self, method: str) -> int:
        """How many seeds a row has: the contrast row as many as the oracle, unless a run or a smaller study was given."""
        return max(self.seeds, self.oracle_seeds) if method == CONTRAST and self.result is None else self.seeds

    def path(self, env: str, row: str, test: str) -> Path:
        return self.out / env / row.replace(" ", "_") / f"{test.replace(' ', '_')}.json"


def cell(study: Study, env: str, row: str, test: Test) -> Cell:
    """Return the finished cell, trained now where it is missing."""
    path = study.path(env, row, test.name)
    if path.exists():
        return read_kept(path, "env", "row", "test")
    say(f"{row} on {env}, {test.name}: {test.about}")
    commit, started = current_commit(), time.perf_counter()
    measures = _measured(study, env, row, test)
    made = {
        "env": env,
        "row": row,
        "test": test.name,
        "about": test.about,
        "commit": commit,
        "seconds": round(time.perf_counter() - started, 1),
        **measures,
    }
    keep(path, made)
    return made


def applies(row: str, test: Test) -> bool:
    """Whether the row has what the test recombines."""
    if row in (ORACLE, UNIFORM):
        return True
    if row.endswith(AS_IS):
        return test.reward == "learned" and test.constraint == "learned"
    method = METHODS[row if row != RANDOM else "airl_centred"]
    if method.needs_true_reward:  # a row that knows the reward has its constraint alone
        return test.reward == "world" and test.constraint == "learned"
    return not method.clones  # a clone has nothing to recombine: its policy is tried as it is


def _measured(study: Study, env: str, row: str, test: Test) -> dict[str, Any]:
    world = make_env(env, **test.settings)
    if row == UNIFORM:
        return {"metrics": measure(played(world, uniform(world), study.oracle_seeds))}
    if row.endswith(AS_IS):
        return {"metrics": _as_it_is(_trained(study, env, row.removesuffix(AS_IS)), world)}
    config = learner_config(world, constrained=test.constrained)
    if study.iterations:
        config = replace(config, iterations=study.iterations)
    number = study.oracle_seeds if row == ORACLE else study.seeds_of(row)
    reward, cost = _parts(study, env, row, test, number, world)
    motors = _motors(study, env, row, test, number, world)
    first = FIRST_SEED_OF.get(env, FIRST_SEED) if test.constrained else FIRST_FREE_SEED
    seeds = range(first, first + number)
    swapped = recombine(world, objectives.objective(reward, cost), seeds, config, test.constrained, motors)
    return {"seeds": list(seeds), "metrics": swapped.metrics, "curve": _curve(swapped)}


def _parts(study: Study, env: str, row: str, test: Test, number: int, world: Any) -> tuple[Any, Any]:
    """Take the reward and the cost of the test from this row; without a constraint, the cost that practice begins under."""
    reward, cost = objectives.world_reward(), objectives.world_cost()
    if row == ORACLE:
        return reward, cost
    if row == RANDOM:
        result = _trained(study, env, "airl_centred")
        keys = jax.vmap(jax.random.key)(np.arange(number, dtype=np.uint32))
        stats = result.state(0).obs_stats
        networks = make_networks(world, result.spec.method, result.spec.config)
        drawn = objectives.random_reward(networks, stats, keys)
        return (drawn if test.reward == "learned" else reward), cost if test.constrained else objectives.no_cost()
    result = _trained(study, env, row)
    if test.reward == "learned":
        reward = objectives.learned_reward(result, number)
    if test.constraint != "world":
        tests_steps = result.networks.method.tests_steps
        cost = objectives.learned_cost(result, number) if tests_steps else objectives.no_cost()
    return reward, cost


def _motors(study: Study, env: str, row: str, test: Test, number: int, world: Env) -> Motors | None:
    """Where motors stop in practice: by the world's own limit, or by what the row has learned."""
    known = row in (ORACLE, RANDOM) or test.constraint == "world"
    return true_motors(world, number) if known else learned_motors(_trained(study, env, row), number)


def _trained(study: Study, env: str, method: str) -> Result:
    """The run of a row of `METHODS` with its own settings, which resumes where it was cut."""
    if study.result is not None:
        return study.result
    directory = study.runs / env / method
    first = first_seed_of(env, method)
    return train(env, method, seeds=study.seeds_of(method), first_seed=first, run_dir=directory, resume=True)


def _as_it_is(result: Result, world: Env) -> dict[str, list[float]]:
    """Measure the learned policies in the world, without any further training."""
    per_seed = []
    for index in range(len(result.summary["seeds"])):
        acting = result.bound(index)

        def act(obs: Array, t: Array, key: Array, acting: BoundNetworks = acting) -> Array:
            return jnp.asarray(acting.policy(obs, t).sample(seed=key))

        per_seed.append(measure(played(world, act, 1)))
    return {name: [value for seed in per_seed for value in seed[name]] for name in per_seed[0]}


def _curve(swapped: SwapResult, points: int = 20) -> dict[str, list]:
    """Thin the return and the cost by the policy's own (reward, cost) to a few iterations."""
    if not isinstance(swapped.made, Fresh):
        return {}
    history = swapped.made.history
    length = len(history["return"])
    rows = sorted({round(i * (length - 1) / points) for i in range(points + 1)})
    shown = ("return", "cost")
    return {"iteration": rows} | {name: np.round(history[name][rows], 3).tolist() for name in shown}
