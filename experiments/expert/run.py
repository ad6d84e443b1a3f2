"""One expert's run: train in chunks that resume, judge fresh episodes, choose a seed, write demonstrations and reference."""

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np

from aircl_jax.algorithm.learners.lagrangian import LagrangianState, make_lagrangian
from aircl_jax.demonstrations import files
from aircl_jax.experts.selection import (
    JUDGED,
    Judgement,
    Runner,
    Sampler,
    best_expert,
    best_free,
    clean_episodes,
    judge,
    make_runner,
    random_return,
    reference_set,
)
from aircl_jax.runs.directory import RunDirectory
from aircl_jax.settings.lagrangian_config import LagrangianConfig
from envs import Env
from envs.robots.practice_worlds import clipped_world
from envs.settings import plain

PACKAGES = ("jax", "flax", "optax", "distrax", "mujoco", "numpy")
EPISODE_SEED = 2_147_483_645  # of the key of all episodes drawn after training: no run's seed
LIVE = ("return", "cost", "clean_share", "multiplier", "std")


@dataclass(frozen=True, eq=False)
class Task:
    """A checked command: what to train, and where its files go."""

    name: str  # ENV_CONSTRAINT
    env: Env  # where experts are judged and demonstrate
    practice: Env  # where they train: the same, perhaps with an early end
    env_settings: Mapping[str, Any]
    config: LagrangianConfig
    seeds: int
    free_seeds: int
    first_seed: int
    episodes: int
    out: Path
    command: str

    @property
    def settings(self) -> dict[str, Any]:
        """As config.yaml holds them, and as a resumed run must repeat them."""
        config = plain(asdict(self.config))
        return {
            "env": self.env_settings,
            "seeds": self.seeds,
            "free_seeds": self.free_seeds,
            "first_seed": self.first_seed,
            "iterations": config.pop("iterations"),
            "train": config,
        }


def run(task: Task, directory: RunDirectory) -> None:
    """Train what is missing, then write both files and summary.json."""
    training = make_lagrangian(task.practice, task.config)
    total = task.seeds + task.free_seeds
    seeds = range(task.first_seed, task.first_seed + total)
    runner = make_runner(training, seeds, [i < task.seeds for i in range(total)])
    states = directory.load(jax.eval_shape(runner.init)) if directory.start else runner.init()
    with directory.held():
        states = _train(task, runner, states, directory)
        summary = harvest(task, Sampler(task.env, training.nets), states)
        directory.write_summary(summary)
    print(json.dumps({name: summary[name] for name in ("chosen", "demonstrations", "beside")}, indent=2))


def _train(task: Task, runner: Runner, states: LagrangianState, directory: RunDirectory) -> LagrangianState:
    iteration, iterations, chunk = directory.start, task.config.iterations, task.config.checkpoint_every
    while iteration < iterations:
        started, length = time.perf_counter(), min(chunk, iterations - iteration)
        states, metrics = runner.run_chunk(states, length)
        metrics = jax.device_get(metrics)
        iteration += length
        rows = [{name: values[i] for name, values in metrics.items()} for i in range(length)]
        seconds = round(time.perf_counter() - started, 2)
        directory.on_chunk(iteration, states, rows, {"iteration": iteration, "seconds": seconds})
        means = {name: metrics[name].mean(axis=0) for name in LIVE}
        shown = "  ".join(f"{name} {' '.join(f'{x:.3g}' for x in values)}" for name, values in means.items())
        print(f"iteration {iteration}/{iterations}  {seconds:.0f} s  {shown}", flush=True)
    return states


def harvest(task: Task, draw: Sampler, states: LagrangianState) -> dict[str, Any]:
    """Judge every seed, choose, draw, write; returns what summary.json holds. ValueError where no seed is clean enough."""
    keys = iter(jax.random.split(jax.random.key(EPISODE_SEED), 8))
    key_judge, key_draw, key_reference, key_clip, key_random = (next(keys) for _ in range(5))
    total = task.seeds + task.free_seeds
    each = [jax.tree.map(lambda leaf, i=i: leaf[i], jax.device_get(states)) for i in range(total)]
    judged = [judge(draw(state, jax.random.fold_in(key_judge, i), JUDGED)) for i, state in enumerate(each)]
    best = best_expert(judged[: task.seeds])
    free = task.seeds + best_free(judged[task.seeds :])

    clean, share = clean_episodes(draw, each[best], key_draw, task.episodes)
    reference, groups = reference_set(draw, each[best], each[free], key_reference)
    beside = {"unconstrained expert": judged[free], "random N(0, 1)": random_return(task.env, key_random)}
    beside |= _clipped(task, draw, each[free], key_clip)
    facts = _provenance(task, task.first_seed + best, each[best])
    kept = judge(clean)
    shipped = {"returns_mean": kept.mean, "returns_std": kept.std, "clean_share_before_filtering": round(share, 4)}
    task.out.mkdir(parents=True, exist_ok=True)
    files.save(task.out / f"{task.name}.npz", clean, {**facts, **shipped})
    composition = {name: one.as_json() for name, one in groups.items()}
    about = {**facts, "unconstrained_seed": task.first_seed + free, "groups": composition}
    files.save(task.out / f"{task.name}_reference.npz", reference, about)
    return {
        **facts,
        "chosen": {"seed": task.first_seed + best, **judged[best].as_json()},
        "demonstrations": shipped,
        "beside": {name: one.as_json() for name, one in beside.items()},
        "reference": {"feasible_share": judge(reference).clean_share, "groups": composition},
        "seeds": [one.as_json() for one in judged],
    }


def _clipped(task: Task, draw: Sampler, free: LagrangianState, key: jax.Array) -> dict[str, Judgement]:
    """Where actions are constrained: the unconstrained expert with its actions clipped to the limit."""
    limit = task.env.limit
    if limit is None or limit.bounds != "actions":
        return {}
    world = clipped_world(task.env, limit.value)
    return {f"unconstrained expert, clipped to ±{limit.value:g}": judge(Sampler(world, draw.nets)(free, key, JUDGED))}


def _provenance(task: Task, seed: int, state: LagrangianState) -> dict[str, Any]:
    return {
        "command": task.command,
        "env": dict(task.env_settings),
        "seed": seed,
        "seeds_trained": [task.seeds, task.free_seeds],
        "iterations": task.config.iterations,
        "std": np.exp(state.policy["params"]["log_std"]).round(5).tolist(),
        "versions": {name: version(name) for name in PACKAGES},
    }
