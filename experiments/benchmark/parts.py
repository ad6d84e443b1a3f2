"""The parts of one iteration of one seed, each a function that is compiled alone."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from aircl_jax.algorithm import adversary, entries
from aircl_jax.algorithm.boxes import moments, practice_rollouts, twins
from aircl_jax.algorithm.learners import ppo
from aircl_jax.algorithm.learners import practice as practising
from aircl_jax.algorithm.policy_reward import policy_reward
from aircl_jax.algorithm.pooling import ALONE
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.algorithm.terms.logits import Batches
from aircl_jax.algorithm.trainer import Trainer, make_trainer
from aircl_jax.demonstrations.sources import demonstrations
from aircl_jax.methods import Method, get_method
from aircl_jax.settings.env_defaults import default_config
from envs import Box, Env, make_env
from envs.settings import updated
from experiments.benchmark.ours import with_twin
from experiments.benchmark.settings import Settings
from experiments.physics import BODIES

PHYSICS, ROLLOUT, WHOLE = "bare physics", "rollout", "whole step"
MJX = "a tenth of the steps by engine mjx"


class Part(NamedTuple):
    """A function of what it is given, and how often it runs in one iteration; 0: it is no part of one."""

    run: Callable[..., Any]
    inputs: tuple[Any, ...]
    times: int = 1


def world_and_row(settings: Settings) -> tuple[Env, Method]:
    """Make the environment and the row. Raises ValueError, in one line, for a row whose iteration has other parts."""
    env = make_env(settings.world, **settings.env_settings)
    method = get_method(settings.method, of_box=isinstance(env.action_space, Box))
    if method.is_fitted or method.practises or method.clones:
        raise ValueError(
            f"method={settings.method}: its iteration has other parts; choose a row with an adversary, or aircl_contrast"
        )
    return env, method


def parts_of(settings: Settings) -> Mapping[str, Part]:
    """Make the parts of one iteration on a state at its beginning, with a twin that goes its own way where there is one."""
    env, method = world_and_row(settings)
    config = updated(default_config(settings.world, method.settings), settings.training)
    trainer = make_trainer(env, method, config)
    expert = jax.tree.map(lambda leaf: leaf[0], demonstrations(env, [0], config)[0])
    state = jax.jit(trainer.init)(jax.random.key(0), expert)
    if method.has_twin:
        state = with_twin(state)
        inner, actions = _of_twins(trainer, state, expert)
    else:
        inner, actions = _of_adversary(trainer, state, expert)
    bare = {PHYSICS: Part(partial(physics, env), (state.key, actions), 0)}
    if settings.world in BODIES:
        by_mjx = make_env(settings.world, **settings.env_settings, engine="mjx")
        bare[MJX] = Part(partial(physics, by_mjx), (state.key, actions[: len(actions) // 10]), 0)
    return {**bare, **inner, WHOLE: Part(trainer.step, (state, expert))}


def _of_adversary(trainer: Trainer, state: Any, expert: Any) -> tuple[dict[str, Part], Any]:
    """The parts of the rows with an adversary, and the actions of a rollout, [T, N, …]."""
    networks, config = trainer.networks, trainer.networks.config
    number = config.num_trajectories * (config.pool_factor if networks.method.has_pool else 1)
    places = entries.counted_table(networks.env, networks.method) if networks.method.state_reward else None

    def roll_out(state: Any) -> Any:
        return rollouts(networks.bind(state.params, state.obs_stats), state.key, number)

    def relabel(state: Any, expert: Any, policy: Any) -> Any:
        return policy_reward(networks.bind(state.params, state.obs_stats), expert, policy)

    def discriminate(state: Any, expert: Any, sampled: Any) -> Any:
        nets, batches = networks.bind(state.params, state.obs_stats), Batches(expert, sampled, state.replay, state.replay)
        of_states = None if places is None else entries.scorer(nets, expert, places)
        return adversary.update(nets, state.adversary_opt, batches, state.key, of_states)

    def learn(state: Any, policy: Any, reward: Any, bonus: Any) -> Any:
        nets = networks.bind(state.params, state.obs_stats)
        return ppo.update(nets, state.ppo_opt, policy, reward, bonus, state.key, config.ppo)

    policy = jax.jit(roll_out)(state)
    head = jax.tree.map(lambda leaf: leaf[: config.num_trajectories], policy)
    inner = {
        ROLLOUT: Part(roll_out, (state,)),
        "relabelling": Part(relabel, (state, expert, policy)),
        "adversary": Part(discriminate, (state, expert, head)),
        "PPO": Part(learn, (state, policy, *jax.jit(relabel)(state, expert, policy))),
    }
    return inner, policy.action.swapaxes(0, 1)


def _of_twins(trainer: Trainer, state: Any, expert: Any) -> tuple[dict[str, Part], Any]:
    """The same of the contrast row where actions are of a box: π and its twin roll out together, and each learns."""
    networks, config = trainer.networks, trainer.networks.config
    learning = twins.learning_of(networks)

    def roll_out(state: Any) -> Any:
        return practice_rollouts.rolled_out(networks, learning, state, *jax.random.split(state.key))

    def average(state: Any, expert: Any, policy: Any) -> Any:
        nets = networks.bind(state.params, state.obs_stats)
        return moments.mean_features(nets, expert), moments.mean_features(nets, policy)

    def limits(state: Any, expert: Any, tempted: Any) -> Any:
        nets, contrast = networks.bind(state.params, state.obs_stats), state.adversary_opt
        share = twins.asked_of(practising.acting(nets, contrast.twin), expert, state.key)
        met = twins.met_by(contrast, tempted, jnp.ones((), bool), config, ALONE, expert.mask.sum())
        return share, twins.limited(networks, contrast._replace(expected=share, met=met), state.obs_stats)

    def learn(state: Any, policy: Any) -> Any:
        nets = networks.bind(state.params, state.obs_stats)
        paid, cost = jax.vmap(nets.f)(policy), twins.beyond(nets, policy)
        return practising.learn(learning, nets, state.ppo_opt, policy, paid, cost, jnp.ones(()), state.key)

    policy = jax.jit(roll_out)(state).policy
    inner = {
        ROLLOUT: Part(roll_out, (state,)),
        "moments": Part(average, (state, expert, policy)),
        "n against M": Part(limits, (state, expert, policy)),
        "PPO": Part(learn, (state, policy), 2),
    }
    return inner, policy.action.swapaxes(0, 1)


def physics(env: Env, key: Any, actions: Any) -> Any:
    """Step each environment through `actions`, [T, N, A], from a reset on, and return the rewards, [T, N]."""
    keys = jax.random.split(key, actions.shape[1])

    def one_step(states: Any, now: Any) -> Any:
        states, result = jax.vmap(env.step)(keys, states, now)
        return states, result.reward

    return jax.lax.scan(one_step, jax.vmap(env.reset)(keys)[0], actions)[1]
