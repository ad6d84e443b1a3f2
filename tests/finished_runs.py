"""Finished cells of Table 1 and runs at their start, made up: what reports and figures are tested on."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np

from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.demonstrations.sources import demonstrations
from aircl_jax.figures.style import STYLE, Drawing
from aircl_jax.model.networks import make_networks
from aircl_jax.reports.summary import MEANINGS, summarise
from aircl_jax.runs.opening import open_run
from aircl_jax.runs.result import Result
from aircl_jax.runs.spec import make_spec
from aircl_jax.types import ObsStats, TrainState, Trajectory
from envs import Env
from experiments.table1 import cells
from experiments.table1.cells import COLUMNS, ROWS, Cell, Job, Study
from tests.worlds import TINY, UNOPTIMISED

FULL = Job("full", 10, 0, Path("mine"), Path("mine/runs"))  # Table 1, elsewhere


def drawn(draw: Any, *shown: Any) -> Drawing:
    """What a figure's function draws, in the style of all figures."""
    with mpl.rc_context(STYLE):
        return draw(*shown)


def finished_cell(env: str = "gridworld", method: str = "aircl", seeds: int = 10, **metrics: Any) -> dict[str, Any]:
    """A cell of Table 1 with these measures, one number for all seeds or one each; the others are undefined."""
    names = (*cells.CURVES, "logit_size", "expert_return", "feasibility_auroc", "reward_correlation")
    per_seed = {name: np.broadcast_to(metrics.get(name, np.nan), seeds).tolist() for name in names}
    per_seed = {name: [None if np.isnan(one) else one for one in given] for name, given in per_seed.items()}
    return {
        "env": env,
        "method": method,
        "seeds": list(range(seeds)),
        "iterations": 250,
        "env_steps": 7000,
        "wall_s": 60.0,
        "versions": {"devices": "1 × cpu"},
        "metrics": {name: {"per_seed": given} for name, given in per_seed.items()},
        "scale": "full",
        "command": f"python -m experiments.run env={env} method={method}",
        "commit": "abc1234",
        "commits": ["abc1234"],
        "settings": {},
        "alarms": [],
        "curves": {"iteration": [0, 250], "violation_rate_policy": [[0.5] * seeds, [0.1] * seeds]},
    }


def study_of(*given: Cell) -> Study:
    """What a full table with these cells alone is written from."""
    found = {(cell["env"], cell["method"]): cell for cell in given}
    missing = {(env, method): "not trained yet" for env in COLUMNS for method in ROWS if (env, method) not in found}
    return Study(FULL, found, missing, "python -m experiments.table1", "abc1234")


def around(centre: float, width: float = 0.01) -> np.ndarray:
    """Ten different values with that mean."""
    return centre + width * np.linspace(-1, 1, 10)


def begin_grid(path: Path, chunks: int) -> None:
    """Make the directory of a run on the grid that has learned nothing in so many chunks of one iteration."""
    given: dict[str, Any] = {"contrast_prior": "method", "seeds": 1, "first_seed": 0, "demonstrations": "default"}
    settings = make_spec("gridworld", "bc", env_settings={}, config={}, iterations=9, **given).settings
    directory = open_run(path, settings, chunk=1)
    with directory.held():
        for end in range(1, chunks + 1):
            directory.on_chunk(end, {"nothing": np.zeros(1)}, [{"return": np.zeros(1)}], {"iteration": end})


@cache
def untrained(method: str) -> Result:
    """Two seeds at their start, with a made-up history of four iterations."""
    measured = [*MEANINGS, "loss_discriminator", "value_loss", "approx_kl"]
    spec = make_spec(
        "gridworld",
        method,
        contrast_prior="method",
        seeds=2,
        first_seed=0,
        iterations=4,
        demonstrations="default",
        env_settings={"size": 3, "goal": [2, 2], "obstacles": [[1, 1]], "horizon": 5},
        config=replace(TINY, num_evaluation=12),
    )
    expert, reference = demonstrations(spec.env, spec.seeds, spec.config)
    reference = jax.tree.map(lambda leaf: leaf[::20], reference)
    init = jax.jit(jax.vmap(make_trainer(spec.env, spec.method, spec.config).init), compiler_options=UNOPTIMISED)
    random = np.random.default_rng(0)  # one for all: a curve in another's place would show
    history = {name: random.uniform(size=(4, 2)) for name in measured}
    history["log_std_at_bound"][:] = np.nan
    summary = summarise(spec, {name: history[name][-1] for name in MEANINGS}, [])
    return Result(
        summary=summary,
        alarms=[],
        history=history,
        spec=spec,
        networks=make_networks(spec.env, spec.method, spec.config),
        states=init(jax.random.split(jax.random.key(0)), expert),
        expert=expert,
        reference=reference,
        run_dir=None,
    )


@cache
def untrained_robot(method: str, seeds: int = 2) -> Result:
    """Seeds of a swimmer of eight steps with random weights, and demonstrations that are noise."""
    spec = make_spec(
        "swimmer",
        method,
        contrast_prior="method",
        seeds=seeds,
        first_seed=0,
        iterations=1,
        demonstrations="default",
        env_settings={"horizon": 8},
        config=replace(TINY, hidden=(4,)),
    )
    nets, random = make_networks(spec.env, spec.method, spec.config), np.random.default_rng(0)
    shapes = jax.eval_shape(jax.vmap(nets.init), jax.random.split(jax.random.key(0), seeds))
    params = jax.tree.map(lambda leaf: jnp.asarray(random.normal(size=leaf.shape), jnp.float32), shapes)
    stats = ObsStats(*(jnp.asarray(random.uniform(0.5, 2.0, (seeds, spec.env.obs_size)), jnp.float32) for _ in range(2)))
    sets = [random_episodes(spec.env, seed, 5) for seed in range(seeds)]
    nothing: Any = None
    states = TrainState(params, nothing, nothing, stats, nothing, jax.random.split(jax.random.key(1), seeds), jnp.zeros(seeds))
    expert = jax.tree.map(lambda *leaves: jnp.stack(leaves), *sets)
    summary = {"seeds": list(spec.seeds)}
    return Result(summary, [], {}, spec, nets, states, expert, sets[0], None)


def random_episodes(env: Env, seed: int, number: int) -> Trajectory:
    """Episodes of a robot that are noise, and end after 1 to T steps, [N, T, …]."""
    random, shape = np.random.default_rng(seed), (number, env.horizon)
    drawn = {
        "obs": random.normal(size=(*shape, env.obs_size)),
        "action": random.uniform(-1.5, 1.5, size=(*shape, env.action_space.feature_size)),
        "reward": random.normal(size=shape),
        "cost": random.integers(2, size=shape),
        "mask": np.arange(env.horizon) < random.integers(1, env.horizon + 1, size=(number, 1)),
        "bootstrap": np.zeros(number),
    }
    zeros = jnp.zeros(shape)
    return Trajectory(
        **{"log_prob": zeros, "value": zeros} | {name: jnp.asarray(one, jnp.float32) for name, one in drawn.items()}
    )
