"""Small worlds, scores and one jitted fused step, shared by the tests."""

import importlib
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from aircl_jax.algorithm.terms.logits import Batches
from aircl_jax.algorithm.terms.table import TERMS
from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.demonstrations.soft_optimal import occupancy
from aircl_jax.methods import METHODS, Method
from aircl_jax.model.networks import Networks, make_networks
from aircl_jax.settings.train_config import AdversaryConfig, Coefficients, PPOConfig, TrainConfig
from aircl_jax.types import ObsStats, Params, Scores, Thresholds, Trajectory
from envs import Discrete, Env, Step, Tabular, make_env

TINY = TrainConfig(
    num_trajectories=6,
    num_demonstrations=5,
    pool_factor=2,
    hidden=(4, 3),
    checkpoint_every=1,
    ppo=PPOConfig(num_epochs=1, minibatch_size=24, discount=1.0),
    adversary=AdversaryConfig(num_steps=2),
)
UNOPTIMISED = {"xla_backend_optimization_level": 0}  # compiles in half the time, for what runs once
# As a run compiles, for what learns to a tolerance: with few passes the means that PPO ended at in four seeds lay wider apart.
OPTIMISED = {"xla_backend_optimization_level": 3, "xla_llvm_disable_expensive_passes": False}
# The policy's own optimum under a known reward: no adversary, only PPO.
KNOWN_REWARD = Method(reward="true", discriminator_of="none", feasibility="none", terms=())


def tiny_grid(**settings: Any) -> Env:
    return make_env("gridworld", **{"size": 3, "goal": [2, 2], "obstacles": [[1, 1]], "horizon": 4} | settings)


def table_of(env: Env) -> Tabular:
    assert env.tabular is not None
    return env.tabular


def random_scores(seed: int, number: int, horizon: int = 4) -> Scores:
    """Well-scaled scores of trajectories that end at various steps, in the precision that is switched on."""
    random = np.random.default_rng(seed)
    shape = (number, horizon)
    lengths = random.integers(1, horizon + 1, size=number)
    return Scores(
        f=jnp.asarray(random.normal(size=shape)),
        log_pi=jnp.asarray(np.log(random.uniform(0.2, 0.9, size=shape))),
        step_logit=jnp.asarray(random.normal(size=shape)),
        sequence_logit=jnp.asarray(random.normal(size=number)),
        mask=jnp.asarray((np.arange(horizon) < lengths[:, None]).astype(float)),
        thresholds=Thresholds(*[jnp.full(number, jnp.log(Coefficients().threshold))] * 2),
    )


def random_batches() -> Batches:
    return Batches(*(random_scores(seed, number) for seed, number in enumerate([5, 4, 6, 3])))


def naive(scores: Scores) -> Scores:
    """The same numbers as float64 numpy."""
    return jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), scores)  # pyright: ignore[reportArgumentType]


def one_state_env(
    reward: Callable[[Array, Array], Array],
    horizon: int = 1,
    action_space: Any = None,
    terminates: bool = False,
    finite_horizon: bool = True,
) -> Env:
    """A world whose state is the step count; reward(t, action) is all that happens."""
    obs = jnp.eye(horizon + 1)

    def step(key: Array, state: Array, action: Array) -> tuple[Array, Step]:
        zero = jnp.zeros(())
        return state + 1, Step(obs[state + 1], reward(state, action), zero, jnp.full((), float(terminates)))

    return Env(
        name="probe",
        horizon=horizon,
        obs_size=horizon + 1,
        action_space=action_space or Discrete(2),
        reset=lambda key: (jnp.zeros((), jnp.int32), obs[0]),
        step=step,
        finite_horizon=finite_horizon,
    )


def unit_stats(env: Env) -> ObsStats:
    return ObsStats(jnp.zeros(env.obs_size), jnp.ones(env.obs_size))


def tiny_networks(env: Env, method: Method | str, config: TrainConfig = TINY) -> tuple[Networks, Params]:
    """A row's networks and their parameters, in the precision that is switched on."""
    nets = make_networks(env, METHODS[method] if isinstance(method, str) else method, config)
    return nets, jax.tree.map(lambda leaf: leaf.astype(jnp.ones(()).dtype), jax.jit(nets.init)(jax.random.key(0)))


def random_trajectories(env: Env, seed: int, number: int) -> Trajectory:
    """Random cells, actions, log π, rewards and costs of episodes that end after 1 to T steps, [N, T, …]."""
    random = np.random.default_rng(seed)
    shape = (number, env.horizon)
    lengths = random.integers(1, env.horizon + 1, size=(number, 1))
    return Trajectory(
        obs=jnp.asarray(np.eye(env.obs_size)[random.integers(env.obs_size, size=shape)]),
        action=jnp.asarray(random.integers(4, size=shape)),
        log_prob=jnp.asarray(np.log(random.uniform(0.2, 0.9, size=shape))),
        value=jnp.zeros(shape),
        reward=jnp.asarray(random.normal(size=shape)),
        cost=jnp.asarray(random.integers(2, size=shape).astype(float)),
        mask=jnp.asarray((np.arange(env.horizon) < lengths).astype(float)),
        bootstrap=jnp.zeros(number),
    )


def poisoned(env: Env, reward: Array, cost: Array) -> Env:
    """The same world with something added to its true reward and cost."""

    def step(key: Array, state: Any, action: Array) -> tuple[Any, Step]:
        state, result = env.step(key, state, action)
        return state, result._replace(reward=result.reward + reward, cost=result.cost + cost)

    return replace(env, step=step)


@cache
def fused_step(name: str) -> Callable:
    """(poison of reward, of cost) -> (first state, last state, metrics) of one fused step of a method's row."""
    base = tiny_grid()

    def run(reward: Array, cost: Array) -> tuple:
        expert = random_trajectories(base, 0, TINY.num_demonstrations)
        expert = expert._replace(reward=expert.reward + reward, cost=expert.cost + cost)
        trainer = make_trainer(poisoned(base, reward, cost), METHODS[name], TINY)
        first = trainer.init(jax.random.key(0), expert)
        return first, *trainer.step(first, expert)

    return jax.jit(run, compiler_options=UNOPTIMISED)


def expected_return(table: Tabular, log_policy: Float[Array, "T X A"], reward: Float[Array, "X A"]) -> Float[Array, ""]:
    """E[Σ_t r(x_t, a_t)] of a time-dependent policy, exactly."""
    return jnp.einsum("tx,txa,xa->", occupancy(table, log_policy), jnp.exp(log_policy), reward)


def command_module(name: str) -> Any:
    """The module that `python -m NAME` runs."""
    package = importlib.import_module(name)
    return importlib.import_module(f"{name}.__main__") if hasattr(package, "__path__") else package


# Of the terms in the tests of equations: each another number, so that none stands for another.
COEFFICIENTS = Coefficients(contrast_coef=0.3, minimal_coef=0.2, sampled_coef=0.5, icrl_coef=0.6, sequence_ridge=0.1)


def sigmoid(x: Any) -> Any:
    return 1 / (1 + np.exp(-x))


def masked(x: Any, scores: Scores, reduce: Callable) -> Any:
    """A reduction over the unmasked steps of each trajectory."""
    return np.array([reduce(row[keep > 0]) for row, keep in zip(x, naive(scores).mask, strict=True)])


def term(
    name: str,
    method: str = "aircl",
    batches: Batches | None = None,
    coefficients: Coefficients = COEFFICIENTS,
    **adversary: Any,
) -> Array:
    """One term of a row's loss, in random batches where none are given."""
    config = replace(TINY, adversary=AdversaryConfig(**adversary))
    return TERMS[name](METHODS[method], config, coefficients, batches or random_batches())


def guides_world() -> Any:
    """The point that goes round a disc, with demonstrations and a reference set, as the guide writes them."""
    guide = Path(__file__).parents[1] / "docs" / "guide.md"
    names: dict[str, Any] = {}
    for block in re.findall(r"^```python\n(.*?)^```$", guide.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL):
        if any(begin in block for begin in ("point = Env(", "def record(", "scored = replace(")):
            exec(compile(block, str(guide), "exec"), names)
    return names["scored"]
