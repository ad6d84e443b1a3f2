"""Train fresh policies from scratch on a known or a learned (reward, constraint): many seeds as one program."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import PartitionSpec
from jaxtyping import PRNGKeyArray

from aircl_jax.algorithm.learners.scale_free import (
    TRUE,
    Learner,
    LearnerState,
    Motors,
    Objective,
    Task,
    bound,
    make_learner,
)
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.model.networks import BoundNetworks, Networks
from aircl_jax.runs.seeds import SEED, seed_keys, spread
from aircl_jax.settings.learner_config import LearnerConfig
from aircl_jax.types import Metrics, Trajectory
from envs import Box, Env

CANDIDATE = 100_000  # candidate k of seed s has the key of seed s + k · CANDIDATE
COMPARED = 10  # iterations at the end of the trial, over which candidates are compared
BATCH = 16  # evaluation episodes drawn at once


class Fresh(NamedTuple):
    """Policies trained from scratch, with the metrics of their training, {metric: [iterations, S]}."""

    nets: Networks
    states: LearnerState
    motors: Motors | None  # [S, A], to which a constrained policy's draws are clipped for good; None: to nothing
    history: dict[str, np.ndarray]


def train_fresh(
    env: Env,
    seeds: Sequence[int],
    config: LearnerConfig,
    objective: Objective = TRUE,
    *,
    constrained: bool = True,
    motors: Motors | None = None,
) -> Fresh:
    """Train `candidates` policies a seed for the `trial`, then the one with the greatest return of its own to the end.

    What `objective` holds, if anything, has a leading seed axis: what each seed's policy is paid by. So have `motors`.
    """
    learner = make_learner(env, config)
    tasks = Task(objective, jnp.full(len(seeds), float(constrained)), motors)
    count = config.candidates
    trial = max(1, int(config.trial * config.iterations)) if count > 1 else 0
    crowd = [seed + CANDIDATE * k for seed in seeds for k in range(count)]
    states = _over(len(crowd), jax.vmap(learner.init), SEED)(seed_keys(crowd))
    history: dict[str, np.ndarray] = {}
    if count > 1:
        crowded = jax.tree.map(lambda leaf: jnp.repeat(leaf, count, axis=0), tasks)
        states, early = _train(learner, states, crowded, trial)
        score = early["return"][-COMPARED:].mean(axis=0).reshape(len(seeds), count)
        best = score.argmax(axis=1) + count * np.arange(len(seeds))
        states = jax.tree.map(lambda leaf: leaf[best], states)
        history = {name: values[:, best] for name, values in early.items()}
    states, late = _train(learner, states, tasks, config.iterations - trial)
    history = {name: np.concatenate([history[name], values]) if history else values for name, values in late.items()}
    return Fresh(learner.nets, states, motors if constrained else None, history)


def acting(fresh: Fresh, state: LearnerState, motors: Motors | None) -> BoundNetworks:
    """Bind one seed's policy as it is judged: what it draws is clipped where its motors stopped in practice."""
    nets, space = bound(fresh.nets, state), fresh.nets.env.action_space
    if motors is None or not isinstance(space, Box):
        return nets
    ends = {side: space.in_half_widths(end) for side, end in zip(("lower", "upper"), motors, strict=True)}
    return nets.with_params(policy={"params": {**state.trained.policy["params"], **ends}})


def episodes(fresh: Fresh, env: Env, number: int, key: PRNGKeyArray) -> Trajectory:
    """Draw `number` episodes of each seed's policy in a world, [S, N, T, …]; all seeds have the same keys."""

    def of_seed(state: LearnerState, motors: Motors | None) -> Trajectory:
        nets = acting(fresh, state, motors)
        batches = jax.lax.map(lambda key: rollouts(nets, key, BATCH, env), jax.random.split(key, -(-number // BATCH)))
        return jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[:number], batches)

    return _over(len(fresh.states.step), jax.vmap(of_seed), SEED)(fresh.states, fresh.motors)


def _train(learner: Learner, states: LearnerState, tasks: Task, length: int) -> tuple[LearnerState, dict[str, np.ndarray]]:
    def on_device(states: LearnerState, tasks: Task) -> tuple[LearnerState, Metrics]:
        return jax.lax.scan(lambda states, _: jax.vmap(learner.step)(states, tasks), states, length=length)

    train = _over(len(states.step), on_device, (SEED, PartitionSpec(None, "seed")))
    states, metrics = train(states, tasks)
    return states, jax.device_get(metrics)


def _over(number: int, of: Callable[..., Any], out: Any) -> Callable[..., Any]:
    """`of`, which takes trees with a leading seed axis, over shards of `number` seeds on every device."""
    shard, place = spread(number)
    run = jax.jit(partial(shard, in_specs=SEED, out_specs=out)(of))
    return lambda *trees: run(*(place(tree) for tree in trees))
