"""Run one expert: train in chunks that resume, measure fresh episodes, choose a seed, write demonstrations and reference."""

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
import numpy as np

from aircl_jax.algorithm.learners.lagrangian import LagrangianState
from aircl_jax.demonstrations import files
from aircl_jax.experts.config import Config
from aircl_jax.experts.selection import (
    MEASURED,
    EpisodeMeasures,
    Runner,
    Sampler,
    best_expert,
    best_free,
    clean_episodes,
    make_runner,
    measure,
    random_return,
    reference_set,
)
from aircl_jax.experts.training import State, make_training, settled
from aircl_jax.messages import say
from aircl_jax.runs.directory import RunDirectory
from aircl_jax.settings.lagrangian_config import LagrangianConfig
from envs import Env
from envs.robots.practice_worlds import clipped_world
from envs.settings import plain

PACKAGES = ("jax", "flax", "optax", "distrax", "mujoco", "numpy")
EPISODE_SEED = 2_147_483_645  # of the key of all episodes drawn after training: no run's seed
CHECKPOINT_EVERY = 20  # iterations, of the learner whose settings name no number
LIVE = ("return", "cost", "clean_share", "multiplier", "std")


@dataclass(frozen=True, eq=False)
class Task:
    """A checked command: what to train, and where its files go."""

    name: str  # ENV_CONSTRAINT
    env: Env  # where experts are measured and demonstrate
    practice: Env  # where they train: the same world, in some tasks with an early end
    env_settings: Mapping[str, Any]
    config: Config
    seeds: int
    free_seeds: int
    first_seed: int
    episodes: int
    reference: int  # episodes of a group of the reference set
    out: Path
    command: str

    @property
    def checkpoint_every(self) -> int:
        """Iterations between two checkpoints."""
        return self.config.checkpoint_every if isinstance(self.config, LagrangianConfig) else CHECKPOINT_EVERY

    @property
    def settings(self) -> dict[str, Any]:
        """Return the settings as config.yaml holds them; a resumed run must repeat them."""
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
    training = make_training(task.practice, task.config)
    total = task.seeds + task.free_seeds
    seeds = range(task.first_seed, task.first_seed + total)
    runner = make_runner(training, seeds, [i < task.seeds for i in range(total)])
    states = directory.load(jax.eval_shape(runner.init)) if directory.start else runner.init()
    with directory.held():
        states = _train(task, runner, states, directory)
        summary = harvest(task, Sampler(task.env, training.nets), settled(states))
        directory.write_summary(summary)
    say(json.dumps({name: summary[name] for name in ("chosen", "demonstrations", "beside")}, indent=2))


def _train(task: Task, runner: Runner, states: State, directory: RunDirectory) -> State:
    iteration, iterations, chunk = directory.start, task.config.iterations, task.checkpoint_every
    while iteration < iterations:
        started, length = time.perf_counter(), min(chunk, iterations - iteration)
        states, metrics = runner.run_chunk(states, length)
        metrics = jax.device_get(metrics)
        iteration += length
        rows = [{name: values[i] for name, values in metrics.items()} for i in range(length)]
        seconds = round(time.perf_counter() - started, 2)
        directory.on_chunk(iteration, states, rows, {"iteration": iteration, "seconds": seconds})
        means = {name: metrics[name].mean(axis=0) for name in LIVE if name in metrics}
        shown = "  ".join(f"{name} {' '.join(f'{x:.3g}' for x in values)}" for name, values in means.items())
        say(f"iteration {iteration}/{iterations}  {seconds:.0f} s  {shown}")
    return states


def harvest(task: Task, draw: Sampler, states: LagrangianState) -> dict[str, Any]:
    """Measure every seed, choose one, draw and write its episodes; return the contents of summary.json.

    Raises ValueError where no seed is clean enough.
    """
    keys = iter(jax.random.split(jax.random.key(EPISODE_SEED), 8))
    key_measure, key_draw, key_reference, key_clip, key_random = (next(keys) for _ in range(5))
    total = task.seeds + task.free_seeds
    each = [jax.tree.map(lambda leaf, i=i: leaf[i], jax.device_get(states)) for i in range(total)]
    of_seeds = [measure(draw(state, jax.random.fold_in(key_measure, i), MEASURED)) for i, state in enumerate(each)]
    best = best_expert(of_seeds[: task.seeds])
    free = task.seeds + best_free(of_seeds[task.seeds :])

    clean, share = clean_episodes(draw, each[best], key_draw, task.episodes)
    reference, groups = reference_set(draw, each[best], each[free], key_reference, task.reference)
    beside = {"unconstrained expert": of_seeds[free], "random N(0, 1)": random_return(task.env, key_random)}
    beside |= _clipped(task, draw, each[free], key_clip)
    facts = _provenance(task, task.first_seed + best, each[best])
    shown = measure(clean)
    shipped = {"returns_mean": shown.mean, "returns_std": shown.std, "clean_share_before_filtering": round(share, 4)}
    task.out.mkdir(parents=True, exist_ok=True)
    files.save(task.out / f"{task.name}.npz", clean, {**facts, **shipped})
    composition = {name: measures.as_json() for name, measures in groups.items()}
    about = {**facts, "unconstrained_seed": task.first_seed + free, "groups": composition}
    files.save(task.out / f"{task.name}_reference.npz", reference, about)
    return {
        **facts,
        "chosen": {"seed": task.first_seed + best, **of_seeds[best].as_json()},
        "demonstrations": shipped,
        "beside": {name: measures.as_json() for name, measures in beside.items()},
        "reference": {"feasible_share": measure(reference).clean_share, "groups": composition},
        "seeds": [measures.as_json() for measures in of_seeds],
    }


def _clipped(task: Task, draw: Sampler, free: LagrangianState, key: jax.Array) -> dict[str, EpisodeMeasures]:
    """Measure the unconstrained expert with its actions clipped to the limit; empty where no action is constrained."""
    limit = task.env.limit
    if limit is None or limit.bounds != "actions":
        return {}
    world = clipped_world(task.env, -limit.value, limit.value)
    return {f"unconstrained expert, clipped to ±{limit.value:g}": measure(Sampler(world, draw.nets)(free, key, MEASURED))}


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
