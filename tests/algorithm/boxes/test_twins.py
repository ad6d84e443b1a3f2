"""The contrast row where actions are of a box: what one fused step reads, and when twin and constraint begin."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.boxes import action_limits, practice_rollouts, state_limits, twins
from aircl_jax.algorithm.learners import practice as practising
from aircl_jax.algorithm.measures import FINITE
from aircl_jax.algorithm.trainer import Trainer, make_trainer
from aircl_jax.methods import get_method
from aircl_jax.model.features import LIMIT_SLOPE, UNLIMITED
from aircl_jax.settings.train_config import Coefficients, MomentConfig, PPOConfig, TrainConfig
from envs import Box, Env, Step, make_env
from tests.finished_runs import random_episodes
from tests.worlds import UNOPTIMISED, poisoned, tiny_grid

METHOD = get_method("aircl_contrast", of_box=True)
CONFIG = TrainConfig(
    iterations=8,
    num_trajectories=4,
    num_demonstrations=6,
    hidden=(4,),
    ppo=PPOConfig(learning_rate=1e-2, num_epochs=1, minibatch_size=24),
    coefficients=Coefficients(threshold=0.05, pseudo_count=0.5, least_expected=5.0),
)


def pushed_point(horizon=6) -> Env:
    """A point that actions push: x' = x + a, r = x', the cost is of |a| > .5."""

    def step(key, state, action):
        action = jnp.clip(action, -1.0, 1.0)
        moved = state + action
        cost = (jnp.abs(action) > 0.5).any().astype(jnp.float32)
        return moved, Step(moved, moved.sum(), cost, jnp.zeros(()))

    return Env(
        name="point",
        horizon=horizon,
        obs_size=1,
        action_space=Box(1),
        reset=lambda key: (jnp.zeros(1), jnp.zeros(1)),
        step=step,
        constraint_input="action",
    )


def shown(env: Env, number=6):
    """Demonstrations that go forward by up to .5 a step."""
    action = jnp.asarray(np.random.default_rng(0).uniform(0.0, 0.5, (number, env.horizon, 1)), jnp.float32)
    obs = jnp.concatenate([jnp.zeros((number, 1, 1)), jnp.cumsum(action, axis=1)[:, :-1]], axis=1)
    zeros = jnp.zeros((number, env.horizon))
    episodes = random_episodes(make_env("swimmer", horizon=env.horizon), 0, number)
    return episodes._replace(obs=obs, action=action, reward=obs[..., 0], cost=zeros, mask=zeros + 1.0)


def trainer_of(near: float, poison: Any = 0.0) -> Trainer:
    poison = jnp.asarray(poison)
    delay = 3 if near == 0.0 else 100
    config = replace(CONFIG, feasibility_delay=delay, moments=MomentConfig(near=near))
    return make_trainer(poisoned(pushed_point(), poison, poison), METHOD, config)


@cache
def stepper(near: float) -> Callable:
    """(state, expert, poison of the true reward and cost) -> one step."""
    return jax.jit(lambda state, expert, poison: trainer_of(near, poison).step(state, expert), compiler_options=UNOPTIMISED)


@cache
def ran(steps=5, near=0.0, poison=0.0):
    """States and metrics of the first steps: the initial state first."""
    expert = shown(pushed_point())
    expert = expert._replace(reward=expert.reward + poison, cost=expert.cost + poison)
    states, metrics = [trainer_of(near).init(jax.random.key(0), expert)], [{}]
    for _ in range(steps):
        state, measured = stepper(near)(states[-1], expert, jnp.asarray(poison))
        states.append(state)
        metrics.append(measured)
    return states, metrics


def leaves(tree):
    return [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]


def same(one, two):
    return all(np.array_equal(a, b) for a, b in zip(leaves(one), leaves(two), strict=True))


def test_no_true_reward_and_no_true_cost_is_read():
    plain, poisoned_ = ran()[0][-1], ran(poison=7.0)[0][-1]
    assert same(plain.params, poisoned_.params)
    assert same(plain.ppo_opt.trained, poisoned_.ppo_opt.trained)
    assert same(plain.adversary_opt.twin.trained, poisoned_.adversary_opt.twin.trained)


def test_the_twin_is_the_policy_until_the_delay_and_goes_its_own_way_after_it():
    states, _ = ran()
    alike = [same(state.adversary_opt.twin.trained.policy, state.ppo_opt.trained.policy) for state in states]
    assert alike == [True] * 5 + [False]  # the step at which 3 have passed says so, the next one acts by it
    assert [float(state.adversary_opt.since) for state in states] == [0, 0, 0, 0, 1, 2]


def test_twin_and_constraint_begin_once_the_means_have_nearly_met_for_a_while():
    states, _ = ran(twins.LASTING + 1, near=1e6)
    since = [float(state.adversary_opt.since) for state in states[1:]]
    assert since == [0.0] * (twins.LASTING - 1) + [1.0, 2.0]


def test_the_parameters_of_a_state_are_those_that_its_practice_trains():
    for state in ran()[0]:
        own = {name: leaf for name, leaf in state.params.policy["params"].items() if name not in ("lower", "upper")}
        assert same((own, state.params.value), (state.ppo_opt.trained.policy["params"], state.ppo_opt.trained.value))


def test_what_the_policy_draws_is_clipped_to_the_limits_once_they_bind_and_the_twin_is_not():
    states, _ = ran()
    nets = trainer_of(0.0).networks
    for state, bound in zip(states, [False] * 4 + [True] * 2, strict=True):
        own, drawn = state.params.policy["params"], state.params.feasibility["step"]["params"]
        ends = (drawn["lower"], drawn["upper"]) if bound else (-UNLIMITED, UNLIMITED)
        np.testing.assert_array_equal(own["lower"], ends[0])
        np.testing.assert_array_equal(own["upper"], ends[1])
    wide = {"log_std": jnp.zeros(1), "lower": jnp.array([-0.2]), "upper": jnp.array([0.3])}
    last = states[-1]
    policy = {"params": {**last.params.policy["params"], **wide}}
    acting = nets.bind(last.params._replace(policy=policy), last.obs_stats)
    lower, upper = practice_rollouts.motor_limits(acting)
    here: Any = acting.policy(jnp.zeros(1), jnp.zeros((), jnp.int32))
    taken = np.asarray(here.sample(seed=jax.random.key(0), sample_shape=(200,)))
    assert (taken.min(), taken.max()) == (float(lower[0]), float(upper[0])) == (np.float32(-0.2), np.float32(0.3))
    assert 0 < ((taken > -0.2) & (taken < 0.3)).sum() < 200
    twin: Any = acting.with_params(policy=last.adversary_opt.twin.trained.policy).policy(jnp.zeros(1), jnp.zeros((), jnp.int32))
    assert np.abs(twin.sample(seed=jax.random.key(0), sample_shape=(200,))).max() > 0.3


def test_m_is_what_the_twin_would_do_in_demonstrated_states_averaged_over_the_iterations():
    states, _ = ran()
    env = pushed_point()
    nets = make_trainer(env, METHOD, CONFIG).networks
    expert = shown(env)
    told = []
    for state in states[:-1]:
        key_asked = jax.random.split(state.key, 6)[2]
        policy = state.adversary_opt.twin.trained.policy
        acting = nets.bind(state.params, state.obs_stats).with_params(policy=policy)
        which = jax.random.permutation(key_asked, 6)[: twins.ASKED]
        seen = expert.obs[which].reshape(-1, 1)
        mean = np.stack([np.asarray(acting.policy(obs, jnp.zeros((), jnp.int32)).mean()) for obs in seen])
        std = jnp.exp(policy["params"]["log_std"])
        taken = expert.action[which].reshape(-1, 1)
        told.append(np.asarray(action_limits.share_expected(jnp.asarray(mean), std, taken, jnp.ones(len(seen)))))
    np.testing.assert_allclose(states[-1].adversary_opt.expected, np.mean(told, axis=0), rtol=1e-3, atol=1e-5)


def test_the_first_policy_is_as_wide_as_the_demonstrated_actions():
    state = ran()[0][0]
    wide = twins.WIDER * np.asarray(shown(pushed_point()).action).std()
    np.testing.assert_allclose(np.exp(state.params.policy["params"]["log_std"]), wide, rtol=1e-4)


def test_a_policy_that_leaves_the_demonstrations_behind_starts_anew():
    env, expert = pushed_point(), shown(pushed_point())
    low, high = practice_rollouts.reached(expert)
    world = practice_rollouts.practice_world(env, (low, high), CONFIG)
    state, _ = world.reset(jax.random.key(0))
    greatest = 2.0 * float(high[0])  # its range begins at 0
    seen = []
    for _ in range(int(greatest) + 3):
        state, step = world.step(jax.random.key(1), state, jnp.ones(1))
        seen.append((float(step.obs[0]), float(step.counts)))
    last = next(index for index, (x, _) in enumerate(seen) if x > greatest)
    assert seen[last + 1] == (0.0, 0.0)  # reset, which is no step of the task
    assert all(counts == 1.0 for _, counts in seen[: last + 1])


def test_limits_follow_from_what_was_made_and_expected():
    state = ran()[0][-1]
    contrast = state.adversary_opt
    lower, upper = action_limits.limits(contrast.made, contrast.expected, CONFIG.coefficients)
    drawn = state.params.feasibility["step"]["params"]
    np.testing.assert_array_equal(drawn["lower"], lower)
    np.testing.assert_array_equal(drawn["upper"], upper)


def test_of_a_constraint_on_states_the_states_that_the_twin_meets_are_counted_once_it_goes_its_own_way():
    env = replace(pushed_point(), constraint_input="state")
    config = replace(CONFIG, feasibility_delay=1, moments=MomentConfig(near=0.0))
    trainer = make_trainer(env, METHOD, config)
    step, expert = jax.jit(trainer.step, compiler_options=UNOPTIMISED), shown(env)
    states = [trainer.init(jax.random.key(0), expert)]
    for _ in range(4):
        states.append(step(states[-1], expert)[0])
    assert [float(state.adversary_opt.met.iterations) for state in states] == [0, 0, 0, 1, 2]
    contrast = states[-1].adversary_opt
    assert float(contrast.met.share.sum()) == pytest.approx(1.0)
    lower, upper = state_limits.drawn(contrast.met, state_limits.scale_of(contrast.reach, 1.0), states[-1].obs_stats)
    drawn = states[-1].params.feasibility["step"]["params"]
    np.testing.assert_allclose(drawn["lower"], lower, rtol=1e-5)
    np.testing.assert_allclose(drawn["upper"], upper, rtol=1e-5)
    assert ran()[0][-1].adversary_opt.met is None  # where actions are counted


def test_what_lies_beyond_a_limit_is_charged_and_what_is_masked_is_not():
    env = pushed_point(horizon=2)
    nets = make_trainer(env, METHOD, CONFIG).networks
    expert = shown(env)
    params = nets.init(jax.random.key(0))._replace(
        feasibility={"step": {"params": {"lower": jnp.array([-0.2]), "upper": jnp.array([0.5])}}}
    )
    stats = ran()[0][0].obs_stats
    action = jnp.array([[[0.4], [0.51]], [[-0.21], [0.9]], [[0.5001], [0.9]]])
    mask = jnp.array([[1.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    taken = jax.tree.map(lambda leaf: leaf[:3], expert)._replace(action=action, mask=mask)
    by_a_hundredth, by_little = (np.log2(1 + np.exp(CONFIG.coefficients.sharpness * LIMIT_SLOPE * x)) for x in (1e-2, 1e-4))
    expected = [[0.0, by_a_hundredth], [by_a_hundredth, 0.0], [by_little, twins.MOST_CHARGED]]
    np.testing.assert_allclose(twins.beyond(nets.bind(params, stats), taken), expected, rtol=1e-3)


def test_a_policy_whose_motors_stop_is_charged_little_at_first_and_less_while_it_strays():
    moments = CONFIG.moments
    stopped, free = (twins.learner_of(CONFIG, sees_state=not stops, stops=stops) for stops in (True, False))
    assert (stopped.multiplier_init, stopped.most_strays) == (pytest.approx(moments.multiplier_init / 30), 0.2)
    assert (free.multiplier_init, free.most_strays > 1e6) == (moments.multiplier_init, True)
    assert (stopped.cost_discount, free.cost_discount) == (0.0, 0.99)
    assert float(ran()[0][0].ppo_opt.multiplier) == pytest.approx(moments.multiplier_init / 30)
    of_states = make_trainer(replace(pushed_point(), constraint_input="state"), METHOD, CONFIG)
    begun = of_states.init(jax.random.key(0), shown(pushed_point()))
    assert float(begun.ppo_opt.multiplier) == pytest.approx(moments.multiplier_init)


def test_a_stray_costs_more_once_the_reward_is_chosen(monkeypatch):
    learn = practising.learn

    def priced(learning, *own):
        practice, metrics = learn(learning, *own)
        return practice, {**metrics, "price": jnp.asarray(learning.config.stray_cost)}

    monkeypatch.setattr(practising, "learn", priced)
    step = jax.jit(trainer_of(0.0).step, compiler_options=UNOPTIMISED)
    prices = [float(step(state, shown(pushed_point()))[1]["price"]) for state in ran()[0][2:5]]
    assert prices == [250.0, 250.0, 1000.0]  # the constraint begins after the fourth step


def test_every_number_of_a_step_is_finite():
    for measured in ran()[1][1:]:
        assert float(measured[FINITE]) == 1.0


def test_a_world_of_discrete_actions_is_refused_in_a_line():
    with pytest.raises(ValueError, match="env=gridworld is no world of a bounded box of actions that goes on"):
        make_trainer(tiny_grid(), METHOD, CONFIG)
