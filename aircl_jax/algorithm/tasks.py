"""Train several tasks under one constraint: the fused step of each task, all at once, with their evidence pooled."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int, PRNGKeyArray

from aircl_jax.algorithm.measures import FINITE
from aircl_jax.algorithm.pooling import TASKS, Pool
from aircl_jax.algorithm.trainer import Trainer, make_trainer
from aircl_jax.methods import Method
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import Metrics, TrainState, Trajectory
from envs import Env

OF_TASKS = 1_000  # folded into a seed's key with the number of a task, so that no task has the noise of another
FUNCTIONS = ("reset", "step", "reward_view", "position", "restore")
SHARED = (
    *("name", "horizon", "obs_size", "action_space", "finite_horizon", "reward_view_size", "constraint_input", "has_reward"),
    *("coordinate_names", "motor_names"),
)


def check_alike(envs: Sequence[Env], names: Sequence[str], method: Method, method_name: str) -> None:
    """Raise ValueError, in one line, where these worlds or this row cannot share one constraint."""
    if not (method.tests_entries or method.has_twin):
        raise ValueError(f"method={method_name} counts no evidence that tasks could share; choose aircl_contrast")
    for env, name in zip(envs, names, strict=True):
        for field in SHARED:
            own, first = getattr(env, field), getattr(envs[0], field)
            if repr(own) != repr(first):
                raise ValueError(f"tasks.{name}: {field} is {own}, and {first} in {names[0]}; one constraint needs the same")


def make_task_trainer(envs: Sequence[Env], method: Method, config: TrainConfig) -> Trainer:
    """Make a trainer of one seed whose states, metrics and D_E have a task axis: [K, …] and [K, N, T, …].

    Each task has a reward, a policy and statistics of its own. The feasibility is the same function in all, of n and M summed
    over tasks. Where the worlds differ, each step computes all of them and takes the task's own. A seed is finite where all of
    its tasks are, since each has the evidence of all. One task alone computes as `make_trainer` does, number for number.
    """
    count = len(envs)
    own = [make_trainer(env, method, config) for env in envs]  # refuses what the row cannot do
    if count == 1:
        return _of_one(own[0])

    def of(which: Int[Array, ""]) -> Trainer:
        return make_trainer(one_of(envs, which), method, config, Pool(count))

    def init(key: PRNGKeyArray, expert: Trajectory) -> TrainState:
        others = [jax.random.fold_in(key, OF_TASKS + number) for number in range(1, count)]
        over = jax.vmap(lambda which, key, expert: of(which).init(key, expert), axis_name=TASKS)
        return over(jnp.arange(count), jnp.stack([key, *others]), expert)

    def step(state: TrainState, expert: Trajectory) -> tuple[TrainState, Metrics]:
        over = jax.vmap(lambda which, state, expert: of(which).step(state, expert), axis_name=TASKS)
        state, metrics = over(jnp.arange(count), state, expert)
        return state, {**metrics, FINITE: metrics[FINITE].min()}

    return Trainer(init, step, own[0].networks)


def _of_one(alone: Trainer) -> Trainer:
    """Give the states, metrics and D_E of a trainer a task axis of one, without a `vmap`."""

    def only(tree: Any) -> Any:
        return jax.tree.map(lambda leaf: leaf[0], tree)

    def step(state: TrainState, expert: Trajectory) -> tuple[TrainState, Metrics]:
        state, metrics = alone.step(only(state), only(expert))
        finite = metrics.pop(FINITE)
        return jax.tree.map(lambda leaf: leaf[None], state), {**jax.tree.map(lambda leaf: leaf[None], metrics), FINITE: finite}

    def init(key: PRNGKeyArray, expert: Trajectory) -> TrainState:
        return jax.tree.map(lambda leaf: leaf[None], alone.init(key, only(expert)))

    return alone._replace(init=init, step=step)


def one_of(envs: Sequence[Env], which: Int[Array, ""]) -> Env:
    """Return the world of this number, where a traced number chooses among what differs between them."""
    if all(env is envs[0] for env in envs):
        return envs[0]
    chosen: dict[str, Any] = {name: _function_of([getattr(env, name) for env in envs], which) for name in FUNCTIONS}
    tables = [env.tabular for env in envs]
    if all(table is not None for table in tables):
        chosen["tabular"] = jax.tree.map(lambda *leaves: _array_of(leaves, which), *tables)
    returns = [env.success_return for env in envs]
    if None not in returns and len(set(returns)) > 1:
        chosen["success_return"] = jnp.asarray(returns, jnp.float32)[which]
    return replace(envs[0], **chosen)


def _function_of(functions: Sequence[Callable | None], which: Int[Array, ""]) -> Callable | None:
    known = [function for function in functions if function is not None]
    if len(known) < len(functions) or all(function is functions[0] for function in functions):
        return functions[0]
    return lambda *arguments: jax.lax.switch(which, known, *arguments)


def _array_of(leaves: Sequence[Any], which: Int[Array, ""]) -> Any:
    """Choose an array; those that are alike stay known."""
    same = all(np.array_equal(leaf, leaves[0], equal_nan=True) for leaf in leaves)
    return leaves[0] if same else jnp.stack([jnp.asarray(leaf) for leaf in leaves])[which]
