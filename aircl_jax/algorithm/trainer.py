"""Run Algorithm 1 as one fused step of one seed: rollout, sampler, adversary and policy update in turn."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Int, PRNGKeyArray

from aircl_jax.algorithm import adversary, cloning, entries
from aircl_jax.algorithm.boxes import baselines, twins
from aircl_jax.algorithm.learners import exact, likelihood, ppo
from aircl_jax.algorithm.measures import FINITE, all_finite, step_metrics
from aircl_jax.algorithm.policy_reward import policy_reward
from aircl_jax.algorithm.pooling import ALONE, Pool
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.algorithm.sampler import refresh
from aircl_jax.algorithm.scoring import calibrated, roll_out_and_draw
from aircl_jax.algorithm.terms.logits import Batches
from aircl_jax.methods import Method
from aircl_jax.model.networks import Networks, make_networks
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import Metrics, ObsStats, TrainState, Trajectory
from envs import Env


class Trainer(NamedTuple):
    """`init(key, expert) -> state` and `step(state, expert) -> (state, metrics)`, pure functions of one seed.

    Beside the metrics `step` says whether its parameters, losses and observations are all finite, as `metrics[FINITE]`.
    """

    init: Callable[[PRNGKeyArray, Trajectory], TrainState]
    step: Callable[[TrainState, Trajectory], tuple[TrainState, Metrics]]
    networks: Networks
    traced: bool = True  # False: `step` computes on the host, and is called for one seed after another
    together: bool = False  # whether many seeds step as one `vmap` on a CPU too: few bodies at a time fill no vector unit


def make_trainer(env: Env, method: Method, config: TrainConfig, pool: Pool = ALONE) -> Trainer:
    """Make the training loop's two functions for a method on an environment. `expert` is D_E, [N_E, T, …].

    With a pool they are of one of its tasks, within the `vmap` over tasks of `algorithm.tasks`.
    """
    if method.needs_true_reward and not env.has_reward and not method.assumes_no_reward:
        raise ValueError(f"method needs the true reward and {env.name} has none; choose a row that learns the reward")
    if method.is_of_boxes:
        nets = make_networks(env, method, config)
        steps = twins.make_steps(nets, pool) if method.has_twin else baselines.make_steps(nets)
        return Trainer(
            lambda key, expert: steps.init(key, expert, observation_stats(expert)),
            steps.step,
            nets,
            together=method.has_twin,
        )
    if method.is_fitted:
        return Trainer(*likelihood.make_steps(nets := make_networks(env, method, config)), nets, traced=False)
    table = exact.plannable(env, method, config) if config.learner == "exact" else None
    places = entries.counted_table(env, method) if method.state_reward else None
    nets = make_networks(env, method, config)
    num_policy = config.num_trajectories * (config.pool_factor if method.has_pool else 1)
    # In methods that draw D_S from a pool, the terms see N trajectories of D_P ∪ replay, half of each.
    num_negatives = max(1, config.num_trajectories // 2) if method.has_pool else config.num_trajectories

    def init(key: PRNGKeyArray, expert: Trajectory) -> TrainState:
        key, key_nets, key_replay = jax.random.split(key, 3)
        untrained, stats = entries.begun(nets.init(key_nets), env.obs_size, pool), observation_stats(expert, pool)
        ppo_opt = ppo.make_optimiser(config.ppo).init((untrained.policy, untrained.value))
        params = untrained
        if config.clone_epochs:
            key, key_clone = jax.random.split(key)
            passes = replace(
                config.ppo,
                num_epochs=config.clone_epochs,
                minibatch_size=config.clone_minibatch_size,
                learning_rate=config.clone_learning_rate,
            )
            params, _, _ = cloning.update(nets.bind(untrained, stats), ppo_opt, expert, key_clone, passes)
        return TrainState(
            params=params,
            ppo_opt=ppo_opt,
            adversary_opt=adversary.make_optimiser(method, config).init((params.reward, params.feasibility)),
            obs_stats=stats,
            replay=rollouts(nets.bind(untrained, stats), key_replay, num_negatives),
            key=key,
            step=jnp.zeros((), jnp.int32),
        )

    def step(state: TrainState, expert: Trajectory) -> tuple[TrainState, Metrics]:
        key, key_rollout, key_sampler, key_adversary, key_policy, key_replay = jax.random.split(state.key, 6)
        now, stats = scheduled(nets, state.step), state.obs_stats  # the networks with this iteration's learning rates
        ours = now.bind(state.params, stats)

        drawn = roll_out_and_draw(ours, key_rollout, key_sampler, num_policy, config.num_trajectories)  # lines 4 and 3
        policy, sampled = drawn.policy, drawn.sampled  # D_P, and D_S drawn from it by Eq. 9
        negatives = jax.tree.map(lambda leaf: leaf[:num_negatives], policy)
        batches = Batches(expert, sampled, policy=negatives, replay=state.replay)
        of_states = entries.scorer(ours, expert, places, pool) if places is not None else None
        params, adversary_opt, adversary_metrics = adversary.update(  # lines 5, 6: `num_steps` minibatches
            ours, state.adversary_opt, batches, key_adversary, of_states
        )
        params, expert_log_delta = calibrated(now.bind(params, stats), expert, pool)
        ours, ppo_opt = now.bind(params, stats), state.ppo_opt
        if method.clones:
            params, ppo_opt, policy_metrics = cloning.update(ours, ppo_opt, expert, key_policy, now.config.ppo)
        elif table is not None:
            params, policy_metrics = exact.update(ours, expert, table, moves=state.step >= config.policy_delay)  # line 7
        else:
            reward, bonus = policy_reward(ours, expert, policy)
            params, ppo_opt, policy_metrics = ppo.update(  # line 7
                ours, ppo_opt, policy, reward, bonus, key_policy, now.config.ppo
            )
        if places is not None and of_states is not None and method.tests_entries:
            params = entries.noted(now.bind(params, stats), places, of_states, state.step, pool)
        metrics = step_metrics(env, sampled, policy, drawn.log_delta, expert_log_delta)
        seen = jnp.where(policy.mask[..., None] > 0, policy.obs, 0.0)
        metrics[FINITE] = all_finite((params, adversary_metrics, policy_metrics, seen)).astype(jnp.float32)
        state = state._replace(
            params=params,
            ppo_opt=ppo_opt,
            adversary_opt=adversary_opt,
            replay=refresh(state.replay, negatives, key_replay, config.adversary.replay_rate),
            key=key,
            step=state.step + 1,
        )
        return state, {**metrics, **adversary_metrics, **policy_metrics}

    return Trainer(init, step, nets)


def scheduled(nets: Networks, step: Int[Array, ""]) -> Networks:
    """Scale the learning rates by 1 − step / lr_decay_iterations; those of π and V are 0 before `policy_delay`.

    The potential waits as δ₁ does: what g can say is said first, while h is 0, where its prior holds it.
    """
    config = nets.config
    if not (config.lr_decay_iterations or config.policy_delay or config.feasibility_delay):
        return nets
    left = optax.linear_schedule(1.0, 0.0, config.lr_decay_iterations)(step)
    moves, says_more = step >= config.policy_delay, step >= config.feasibility_delay
    acting = replace(config.ppo, learning_rate=moves * left * config.ppo.learning_rate)
    discriminating = replace(
        config.adversary,
        learning_rate=left * config.adversary.learning_rate,
        potential_rate=says_more * left * config.adversary.potential_rate,
    )
    return replace(nets, config=replace(config, ppo=acting, adversary=discriminating))


def observation_stats(expert: Trajectory, pool: Pool = ALONE) -> ObsStats:
    """Compute mean and standard deviation of D_E's observations over unmasked steps, of all tasks of the pool."""
    steps = expert.mask.sum()
    weight = expert.mask / steps
    mean = pool.mean(jnp.einsum("nt,nto->o", weight, expert.obs), steps)
    return ObsStats.of(mean, jnp.sqrt(pool.mean(jnp.einsum("nt,nto->o", weight, (expert.obs - mean) ** 2), steps)))
