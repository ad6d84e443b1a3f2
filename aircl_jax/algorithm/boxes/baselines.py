"""The baselines where actions are of a box, with all that the contrast row has there: learner, practice world and scales.

One fused step of one seed, as in `trainer`. The adversary is that of the row's own terms; π learns by PPO-Lagrangian, paid the
true reward or what AIRL pays, and charged for what the learned feasibility says (docs/equations.md).
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from aircl_jax.algorithm import adversary
from aircl_jax.algorithm.boxes.practice_rollouts import box_of, practice_world, reached
from aircl_jax.algorithm.boxes.twins import Steps, beyond, learner_of, with_std
from aircl_jax.algorithm.learners import practice as practising
from aircl_jax.algorithm.learners.practice import Learning
from aircl_jax.algorithm.learners.scale_free import falls
from aircl_jax.algorithm.learners.scale_free_update import make_optimiser
from aircl_jax.algorithm.measures import FINITE, all_finite, step_metrics
from aircl_jax.algorithm.sampler import refresh
from aircl_jax.algorithm.scoring import calibrated, trajectory_feasibility
from aircl_jax.algorithm.terms.logits import Batches
from aircl_jax.model.feasibility import SIGMOID_FLOOR, log_step_feasibility
from aircl_jax.model.networks import BoundNetworks, Networks
from aircl_jax.types import Metrics, ObsStats, TrainState, Trajectory


def make_steps(nets: Networks) -> Steps:
    """Make the training loop's two functions.

    Raises:
        ValueError: in one line, where actions are not of a bounded box, or the task ends at the horizon.
    """
    env, config, method = nets.env, nets.config, nets.method
    box_of(env, "airl, gacl or icrl")
    settings = replace(learner_of(config, sees_state=nets.feasibility_sees_state, stops=False), strays_bootstrap=True)
    if method.discriminates:  # GACL has no budget, for its policy is paid r + log δ; AIRL has no cost
        settings = replace(settings, multiplier_init=1.0, multiplier_rate=0.0)
    learning = Learning(settings, make_optimiser(settings, env.horizon))

    def init(key: PRNGKeyArray, expert: Trajectory, stats: ObsStats) -> TrainState:
        key, key_nets, key_cost, key_world, key_replay = jax.random.split(key, 5)
        taken = jax.vmap(jax.vmap(env.action_space.features))(expert.action)
        params, world = with_std(nets.init(key_nets), taken, expert.mask), practice_world(env, reached(expert), config)
        practice = practising.begin(learning, params, nets.init(key_cost).value, world, key_world)
        opt = adversary.make_optimiser(method, config).init((params.reward, params.feasibility))
        replay = practising.roll_out(learning, nets.bind(params, stats), practice, world, jnp.zeros((), bool), key_replay)[0]
        return TrainState(params, practice, opt, stats, replay, key, jnp.zeros((), jnp.int32))

    def step(state: TrainState, expert: Trajectory) -> tuple[TrainState, Metrics]:
        key, key_rollout, key_adversary, key_update, key_replay = jax.random.split(state.key, 5)
        before, world = nets.bind(state.params, state.obs_stats), practice_world(env, reached(expert), config)
        policy, practice = practising.roll_out(learning, before, state.ppo_opt, world, state.step > 0, key_rollout)

        batches = Batches(expert, sampled=policy, policy=beside(policy, state.replay), replay=state.replay)
        params, adversary_opt, losses = adversary.update(before, state.adversary_opt, batches, key_adversary)
        params, expert_log_delta = calibrated(nets.bind(params, state.obs_stats), expert)

        after, always = nets.bind(params, state.obs_stats), jnp.ones(())
        pay, cost = paid(after, policy), charged(after, policy)
        new, learned = practising.learn(learning, before, practice, policy, pay, cost, always, key_update)
        params = params._replace(policy=new.trained.policy, value=new.trained.value)
        metrics = {
            **step_metrics(env, policy, policy, trajectory_feasibility(after, policy), expert_log_delta),
            **losses,
            **learned,
            "charged": (cost * policy.mask).sum(axis=1).mean(),
            "multiplier": new.multiplier,
            "strays": falls(policy.mask).sum(axis=1).mean(),
        }
        metrics[FINITE] = all_finite((params, losses, learned, policy.obs)).astype(jnp.float32)
        replay = refresh(state.replay, policy, key_replay, config.adversary.replay_rate)
        return TrainState(params, new, adversary_opt, state.obs_stats, replay, key, state.step + 1), metrics

    return Steps(init, step)


def beside(policy: Trajectory, replay: Trajectory) -> Trajectory:
    """D_P and earlier policies' trajectories as one set, so that what π has learned to avoid is not forgotten."""
    return jax.tree.map(lambda new, old: jnp.concatenate([new, old]), policy, replay)


def paid(nets: BoundNetworks, policy: Trajectory) -> Float[Array, "N T"]:
    """The true reward in the rows that know it; else f − β log π, which is log D − log(1 − D) but for a constant."""
    if nets.method.needs_true_reward:
        return policy.reward
    return jax.vmap(nets.f)(policy) - nets.networks.entropy_weight * policy.log_prob


def charged(nets: BoundNetworks, policy: Trajectory) -> Float[Array, "N T"]:
    """ICRL: how far a step lies beyond δ₁ = ½, as in the contrast row. GACL: −log δ₁, which it pays everywhere."""
    if not nets.method.discriminates:
        return beyond(nets, policy)
    scores = jax.vmap(nets.feasibility_scores)(policy)
    return -jnp.maximum(log_step_feasibility(nets.method, nets.config.coefficients, scores), SIGMOID_FLOOR)
