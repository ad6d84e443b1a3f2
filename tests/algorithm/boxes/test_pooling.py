"""Several tasks under one constraint: evidence is summed over tasks, and δ is one function of all of them."""

from dataclasses import replace
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm import entries
from aircl_jax.algorithm.boxes import action_limits
from aircl_jax.algorithm.pooling import ALONE, TASKS, Pool
from aircl_jax.algorithm.tasks import check_alike, make_task_trainer, one_of
from aircl_jax.methods import METHODS
from aircl_jax.model.features import UNLIMITED
from envs import Box, Env
from tests.algorithm.boxes.test_twins import CONFIG, METHOD, pushed_point, shown
from tests.worlds import TINY, UNOPTIMISED, random_trajectories, table_of, tiny_grid, tiny_networks, unit_stats

GOALS = ([2, 2], [0, 2])


def stacked(*trees: Any) -> Any:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)


def of_both_sides() -> Any:
    """D_E of two tasks of a point, the second pushed half as much again to the other side."""
    forth = shown(pushed_point())
    return stacked(forth, forth._replace(obs=-1.5 * forth.obs, action=-1.5 * forth.action))


@cache
def of_points() -> tuple[Any, Any]:
    """The states of two tasks at the start, and after two steps."""
    trainer, experts = make_task_trainer([pushed_point()] * 2, METHOD, CONFIG), of_both_sides()

    def run(key):
        state = trainer.init(key, experts)
        return state, jax.lax.scan(lambda now, _: trainer.step(now, experts), state, length=2)[0]

    return jax.jit(run, compiler_options=UNOPTIMISED)(jax.random.key(0))


@cache
def of_grids() -> tuple[Any, Any]:
    """D_E of two goals, and the states after two steps."""
    envs = [tiny_grid(goal=goal) for goal in GOALS]
    experts = stacked(*(random_trajectories(env, seed, 5) for seed, env in enumerate(envs)))
    trainer = make_task_trainer(envs, METHODS["aircl_contrast"], TINY)

    def run(key):
        state = trainer.init(key, experts)
        return jax.lax.scan(lambda now, _: trainer.step(now, experts), state, length=2)[0]

    return experts, jax.jit(run, compiler_options=UNOPTIMISED)(jax.random.key(0))


def test_what_tasks_pool_is_what_numpy_pools():
    values, weight = np.random.default_rng(0).normal(size=(3, 4)), np.array([1.0, 2.0, 5.0])

    def each(value, share):
        pool = Pool(3)
        return pool.total(value), pool.least(value), pool.greatest(value), pool.first(value), pool.mean(value, share)

    found = jax.vmap(each, axis_name=TASKS)(jnp.asarray(values), jnp.asarray(weight))
    expected = values.sum(0), values.min(0), values.max(0), values[0], weight @ values / 8.0
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, np.broadcast_to(other, (3, 4)), rtol=1e-6)
    every = jax.vmap(lambda value: Pool(3).every(value > 0), axis_name=TASKS)
    assert not every(jnp.array([1.0, -1.0, 2.0])).any() and every(jnp.ones(3)).all()


def test_alone_a_task_hears_itself_bit_for_bit():
    values, share = jnp.asarray(np.random.default_rng(0).normal(size=4)), jnp.asarray(0.3)
    for same in (
        ALONE.total(values),
        ALONE.least(values),
        ALONE.greatest(values),
        ALONE.first(values),
        ALONE.mean(values, share),
    ):
        assert same is values


def test_actions_made_are_counted_over_all_tasks():
    action = np.asarray(of_both_sides().action[..., 0]).reshape(2, -1, 1)
    count = jax.vmap(
        lambda own: action_limits.pooled(action_limits.actions_made(own, jnp.ones(len(own))), Pool(2)), axis_name=TASKS
    )
    made = jax.jit(count, compiler_options=UNOPTIMISED)(jnp.asarray(action))
    counted = np.histogram(action, bins=np.asarray(action_limits.EDGES))[0]
    for own in range(2):
        np.testing.assert_array_equal(made.number[own, 0], counted)
        assert float(made.steps[own]) == action.size
        assert (float(made.least[own].min()), float(made.greatest[own].max())) == (action.min(), action.max())


def test_two_tasks_draw_a_limit_that_neither_would_draw_alone():
    coefficients = replace(CONFIG.coefficients, least_expected=20.0)
    inside = jnp.linspace(-0.45, 0.45, 400)[:, None]
    share = jnp.full((1, action_limits.BINS), 1.0 / action_limits.BINS).at[0, -45:].mul(0.15)  # 15 of 400 steps beyond .5

    def drawn(pool):
        made = action_limits.pooled(action_limits.actions_made(inside, jnp.ones(400)), pool)
        return action_limits.limits(made, pool.mean(share, jnp.asarray(400.0)), coefficients)[1]

    both = jax.vmap(lambda _: (drawn(ALONE), drawn(Pool(2))), axis_name=TASKS)
    alone, together = jax.jit(both, compiler_options=UNOPTIMISED)(jnp.arange(2))
    np.testing.assert_array_equal(alone, np.full((2, 1), UNLIMITED))
    np.testing.assert_array_equal(together, np.full((2, 1), np.float32(0.45)))


def test_entries_made_and_expected_are_sums_over_tasks():
    worlds = [tiny_grid(goal=goal) for goal in GOALS]
    experts = stacked(*(random_trajectories(env, seed, 5) for seed, env in enumerate(worlds)))
    networks = [tiny_networks(env, "aircl_contrast") for env in worlds]
    params = stacked(*(params for _, params in networks))

    def counted(which, params, expert, pool):
        env = one_of(worlds, which)
        nets = tiny_networks(env, "aircl_contrast")[0].bind(params, unit_stats(env))
        states = entries.scorer(nets, expert, table_of(env), pool)(nets)
        return states.entered, states.expected, states.demonstrations

    each = jnp.arange(2), params, experts

    def both_ways(which, params, expert):
        return counted(which, params, expert, ALONE), counted(which, params, expert, Pool(2))

    both = jax.vmap(both_ways, axis_name=TASKS)
    alone, together = jax.jit(both, compiler_options=UNOPTIMISED)(*each)
    for own, pooled in zip(alone[:2], together[:2], strict=True):
        assert not np.array_equal(own[0], own[1])
        np.testing.assert_allclose(pooled, np.broadcast_to(np.asarray(own, np.float64).sum(0), (2, 9)), rtol=1e-5)
    np.testing.assert_array_equal(together[2], [5.0, 5.0])


@pytest.mark.slow
def test_tasks_have_one_reach_and_one_count_and_policies_and_rewards_of_their_own():
    experts, (begun, after) = of_both_sides(), of_points()
    low, high = begun.adversary_opt.reach
    assert float(low[0, 0]) == float(low[1, 0]) == float(experts.obs.min())
    assert float(high[0, 0]) == float(high[1, 0]) == float(experts.obs.max())
    shared = after.adversary_opt.expected, after.adversary_opt.made, after.params.feasibility, after.params.thresholds
    for leaf in jax.tree.leaves(shared):
        np.testing.assert_array_equal(leaf[0], leaf[1])
    share = after.adversary_opt.expected.sum(-1)  # M / steps, over all bins: where π̃ would go to the side that was shown
    np.testing.assert_allclose(share, 0.5, atol=0.05)  # it knows no side yet
    weights = after.params.reward["params"]["weights"]
    assert float(weights[0, 0]) > 0 > float(weights[1, 0])
    assert not np.array_equal(*jax.tree.leaves(after.params.policy)[0])


@pytest.mark.slow
def test_the_feasibility_of_a_grid_stays_one_and_its_rewards_do_not():
    _, state = of_grids()
    assert (np.asarray(state.params.evidence).sum(-1) > 0).all()
    for leaf in jax.tree.leaves((state.params.feasibility, state.params.evidence, state.params.thresholds, state.obs_stats)):
        np.testing.assert_array_equal(leaf[0], leaf[1])
    assert not np.array_equal(*jax.tree.leaves(state.params.reward["state"])[0])


def test_a_traced_number_chooses_the_world():
    worlds = [tiny_grid(goal=goal) for goal in GOALS]
    cell = jnp.asarray(5)  # beside [2, 2], not beside [0, 2]'s left

    def paid(which):
        env = one_of(worlds, which)
        return env.step(jax.random.key(0), cell, jnp.asarray(1))[1].reward, table_of(env).reward

    for which, env in enumerate(worlds):
        reward, table = jax.jit(paid, compiler_options=UNOPTIMISED)(which)
        assert float(reward) == float(env.step(jax.random.key(0), cell, jnp.asarray(1))[1].reward)
        np.testing.assert_array_equal(table, table_of(env).reward)
    assert not np.array_equal(table_of(worlds[0]).reward, table_of(worlds[1]).reward)
    assert one_of([worlds[0]] * 2, jnp.asarray(1)) is worlds[0]


def boxed(low: float, high: float) -> Env:
    return replace(pushed_point(), action_space=Box(1, low, high))


@pytest.mark.parametrize(
    ("worlds", "row", "line"),
    [
        (
            [tiny_grid(), tiny_grid(size=4)],
            "aircl_contrast",
            "tasks.b: obs_size is 16, and 9 in a; one constraint needs the same",
        ),
        ([tiny_grid(), tiny_grid(horizon=6)], "aircl_contrast", "tasks.b: horizon is 6, and 4 in a"),
        ([tiny_grid(), tiny_grid()], "aircl_corrected", "method=aircl_corrected counts no evidence that tasks could share"),
        ([tiny_grid(), tiny_grid()], "aircl_contrast_memory", "method=aircl_contrast_memory counts no evidence"),
    ],
)
def test_worlds_and_rows_that_cannot_share_a_constraint_are_refused(worlds, row, line):
    with pytest.raises(ValueError, match=line.replace("[", r"\[")):
        check_alike(worlds, ["a", "b"], METHODS[row], row)


def test_boxes_of_other_units_are_refused():
    with pytest.raises(ValueError, match=r"tasks\.b: action_space is Box.*200.*one constraint needs the same"):
        check_alike([boxed(-1.0, 1.0), boxed(100.0, 200.0)], ["a", "b"], METHOD, "aircl_contrast")
