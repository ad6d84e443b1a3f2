"""Claims about the fused step, one jitted function per row of the table (tiny.fused_step)."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.interpreters.partial_eval import dce_jaxpr

from aircl_jax.algorithm.trainer import FINITE, make_trainer, observation_stats, refresh, scheduled
from aircl_jax.methods import METHODS
from aircl_jax.model.networks import make_networks
from aircl_jax.types import TrainState, Trajectory
from envs import Env, Step
from tests.worlds import TINY, UNOPTIMISED, fused_step, poisoned, random_trajectories, tiny_grid

CLEAN, POISON, GARBAGE = jnp.float32(0.0), jnp.float32(jnp.nan), jnp.float32(50.0)
# What is fitted has no step that is traced, and what practises runs on boxes alone (boxes/test_baselines.py).
STEPPED = [name for name, row in METHODS.items() if not row.is_fitted and not row.practises]
LEARNED = [name for name in STEPPED if not METHODS[name].needs_true_reward]
QUICK = {"aircl", "aircl_corrected", "aircl_contrast", "icrl_prior", "bc"}  # every learner, judge of its own kind and sampler
ROWS, LONGEST = (
    [name if name in quick else pytest.param(name, marks=pytest.mark.slow) for name in STEPPED]
    for quick in (QUICK, {"aircl_corrected"})
)


def assert_equal_and_finite(one, other):
    def compare(a, b):
        assert np.isfinite(a).all()
        np.testing.assert_array_equal(a, b)

    jax.tree.map(compare, one, other)


def moved(first, last):
    return any((a != b).any() for a, b in zip(jax.tree.leaves(first), jax.tree.leaves(last), strict=True))


@pytest.mark.parametrize("name", ROWS)
def test_fused_step_of_every_row_moves_what_it_learns_and_nothing_else(name):
    row = METHODS[name]
    first, last, metrics = fused_step(name)(CLEAN, CLEAN)
    assert last.step == 1
    assert moved(first.params.policy, last.params.policy)
    assert moved(first.params.value, last.params.value) == (row.learner == "ppo")
    assert moved(first.params.reward, last.params.reward) == row.learns_reward
    assert moved(first.params.feasibility, last.params.feasibility) == (row.feasibility != "none")
    assert all(np.isfinite(value) for value in metrics.values())
    assert metrics[FINITE] == 1
    assert {f"loss_{term}" for term in row.terms} <= set(metrics)


@pytest.mark.parametrize("name", ROWS)
def test_a_step_returns_a_state_of_the_types_it_was_given_or_a_chunk_would_compile_twice(name):
    env = tiny_grid()
    trainer = make_trainer(env, METHODS[name], TINY)
    expert = random_trajectories(env, 0, TINY.num_demonstrations)
    before = jax.eval_shape(trainer.init, jax.random.key(0), expert)
    after = jax.eval_shape(lambda *inputs: trainer.step(*inputs)[0], before, expert)
    assert jax.tree.leaves(before) == jax.tree.leaves(after)  # weak_type is compared too


@pytest.mark.parametrize("name", ["airl_centred", "bc"])
def test_annealed_learning_rates_are_linear_and_end_at_zero(name):
    env, config = tiny_grid(), replace(TINY, lr_decay_iterations=4)
    nets = make_networks(env, METHODS[name], config)
    for step, share in ((0, 1.0), (1, 0.75), (4, 0.0), (9, 0.0)):
        now = scheduled(nets, jnp.asarray(step)).config
        np.testing.assert_allclose(now.ppo.learning_rate, share * config.ppo.learning_rate, rtol=1e-6)
        np.testing.assert_allclose(now.adversary.learning_rate, share * config.adversary.learning_rate, rtol=1e-6)


@pytest.mark.parametrize("decay", [0, 10])
def test_the_policy_waits_and_the_adversary_does_not(decay):
    env, config = tiny_grid(), replace(TINY, policy_delay=2, lr_decay_iterations=decay)
    nets = make_networks(env, METHODS["airl_centred"], config)
    for step, moves in ((0, False), (1, False), (2, True), (9, True)):
        now = scheduled(nets, jnp.asarray(step)).config
        left = 1.0 - step / decay if decay else 1.0
        np.testing.assert_allclose(now.ppo.learning_rate, moves * left * config.ppo.learning_rate, rtol=1e-6)
        np.testing.assert_allclose(now.adversary.learning_rate, left * config.adversary.learning_rate, rtol=1e-6)


def test_nothing_learns_once_the_learning_rates_are_annealed():
    env, config = tiny_grid(), replace(TINY, lr_decay_iterations=1)
    trainer = make_trainer(env, METHODS["aircl_corrected"], config)
    expert = random_trajectories(env, 0, TINY.num_demonstrations)
    step = jax.jit(trainer.step, compiler_options=UNOPTIMISED)
    first = jax.jit(trainer.init, compiler_options=UNOPTIMISED)(jax.random.key(0), expert)
    second, _ = step(first, expert)
    third, _ = step(second, expert)
    assert moved(first.params.policy, second.params.policy)
    assert moved(first.params.reward, second.params.reward)
    for name in ("policy", "value", "reward", "feasibility"):
        assert not moved(getattr(second.params, name), getattr(third.params, name))


def test_a_warm_start_is_a_clone_of_the_demonstrations_and_nothing_else():
    env, method = tiny_grid(), METHODS["aircl_corrected"]
    expert = random_trajectories(env, 0, TINY.num_demonstrations)

    def start(steps):
        config = replace(TINY, clone_epochs=steps)
        state = jax.jit(make_trainer(env, method, config).init)(jax.random.key(0), expert)
        nets = make_networks(env, method, config)
        along = jax.vmap(nets.bind(state.params, state.obs_stats).log_pi)(expert)
        return state, float((along * expert.mask).sum() / expert.mask.sum())

    (cold, before), (warm, after) = start(0), start(60)
    assert after > before + 0.1
    assert_equal_and_finite(cold.params._replace(policy=None), warm.params._replace(policy=None))
    assert_equal_and_finite(cold.replay, warm.replay)


@pytest.mark.parametrize("name", ROWS)
def test_parameters_are_the_same_where_true_reward_and_cost_are_nan(name):
    reward = POISON if name in LEARNED else CLEAN
    _, clean, _ = fused_step(name)(CLEAN, CLEAN)
    _, blind, metrics = fused_step(name)(reward, POISON)
    assert np.isnan(metrics["violation_rate"])  # the poison arrived
    assert np.isnan(metrics["return"]) == (name in LEARNED)
    assert_equal_and_finite(clean.params, blind.params)


def reads(name, field):
    """Whether a row's fused step computes anything that it keeps from the true reward or cost, by its dataflow."""
    base, key = tiny_grid(), jax.random.key(0)
    expert = random_trajectories(base, 0, TINY.num_demonstrations)
    state = jax.eval_shape(make_trainer(base, METHODS[name], TINY).init, key, expert)

    def step(true: tuple, state: TrainState, expert: Trajectory):
        of_world, of_expert, of_replay = true
        zero = jnp.zeros(())
        env = poisoned(base, of_world if field == "reward" else zero, of_world if field == "cost" else zero)
        state = state._replace(replay=state.replay._replace(**{field: of_replay}))
        new, _ = make_trainer(env, METHODS[name], TINY).step(state, expert._replace(**{field: of_expert}))
        return new.params, new.ppo_opt, new.adversary_opt

    true = (jnp.zeros(()), getattr(expert, field), getattr(state.replay, field))
    closed = jax.make_jaxpr(step)(true, state, expert)
    _, used = dce_jaxpr(closed.jaxpr, [True] * len(closed.jaxpr.outvars))
    return used[:3]


@pytest.mark.parametrize("name", LEARNED)
def test_no_row_with_a_learned_reward_reads_the_true_reward(name):
    assert reads(name, "reward") == [False, False, False]


@pytest.mark.parametrize("name", STEPPED)
def test_no_row_reads_the_true_cost(name):
    assert reads(name, "cost") == [False, False, False]


def test_rows_that_know_the_reward_read_it():
    assert reads("icrl", "reward")[0]


def test_a_row_that_knows_the_reward_is_refused_where_there_is_none():
    env = replace(tiny_grid(), has_reward=False)
    with pytest.raises(ValueError, match="needs the true reward"):
        make_trainer(env, METHODS["icrl"], TINY)


def test_observation_stats_are_of_unmasked_steps():
    expert = random_trajectories(tiny_grid(), 0, 3)
    mask = expert.mask.at[:, 2:].set(0.0)
    stats = observation_stats(expert._replace(mask=mask, obs=expert.obs.at[:, 2:].set(1e3)))
    kept = np.asarray(expert.obs)[:, :2].reshape(-1, 9)
    np.testing.assert_allclose(stats.mean, kept.mean(axis=0), atol=1e-6)
    spread = kept.std(axis=0)
    np.testing.assert_allclose(stats.std, np.where(spread > 0, spread, 1e-3), atol=1e-6)  # a still coordinate has a floor


@pytest.mark.parametrize(("rate", "share"), [(0.0, 0.0), (0.25, 0.25), (1.0, 1.0)])
def test_each_replay_slot_is_overwritten_with_the_given_probability(rate, share):
    one = random_trajectories(tiny_grid(), 0, 1)
    old, new = (jax.tree.map(lambda leaf, v=v: jnp.full((2000, *leaf.shape[1:]), v, leaf.dtype), one) for v in (0, 1))
    replay = refresh(old, new, jax.random.key(0), rate)
    np.testing.assert_allclose(replay.mask.mean(), share, atol=0.04)
    np.testing.assert_array_equal(replay.mask, replay.obs[:, :, 0])  # whole trajectories


def ending_early(base: Env, garbage) -> Env:
    """A world whose episodes end after two or three steps; what follows the end is garbage."""

    def reset(key):
        state, obs = base.reset(key)
        length = jax.random.randint(key, (), 2, 4)
        return (state, jnp.zeros((), jnp.int32), length), obs

    def step(key, state, action):
        inner, t, length = state
        inner, result = base.step(key, inner, action)
        over = garbage * (t >= length)  # this step is past the end
        seen = garbage * (t + 1 >= length)  # and so is what it leads to
        terminated = (t + 1 == length).astype(jnp.float32)
        return (inner, t + 1, length), Step(result.obs + seen, result.reward + over, result.cost + over, terminated)

    return replace(base, reset=reset, step=step, finite_horizon=False)


@pytest.mark.parametrize("name", LONGEST)
def test_nothing_after_termination_reaches_a_parameter_or_a_metric(name):
    base = tiny_grid()

    expert = random_trajectories(base, 0, TINY.num_demonstrations)

    @partial(jax.jit, compiler_options=UNOPTIMISED)
    def run(garbage):
        past = garbage * (1.0 - expert.mask)
        littered = expert._replace(obs=expert.obs + past[..., None], reward=expert.reward + past, cost=expert.cost + past)
        trainer = make_trainer(ending_early(base, garbage), METHODS[name], TINY)
        state, metrics = trainer.step(trainer.init(jax.random.key(1), littered), littered)
        return state.params, metrics

    assert_equal_and_finite(run(CLEAN), run(GARBAGE))
