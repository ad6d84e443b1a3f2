"""Several tasks under one constraint: evidence is summed over tasks, and δ is one function of all of them."""

from dataclasses import replace
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm import entries
from aircl_jax.algorithm.boxes.action_limits import BINS
from aircl_jax.algorithm.pooling import ALONE, TASKS, Pool
from aircl_jax.algorithm.tasks import check_alike, make_task_trainer, one_of
from aircl_jax.methods import METHODS
from envs import Box, Env
from tests.algorithm.boxes.test_twins import CONFIG, METHOD, pushed_point, shown
from tests.worlds import TINY, UNOPTIMISED, random_trajectories, table_of, tiny_grid

GOALS = ([2, 2], [0, 2])


def stacked(*trees: Any) -> Any:
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *trees)


@cache
def of_points() -> tuple[Any, Any, Any]:
    """D_E of two tasks, one of twice the pushes to the other side, and the states after no and after two steps."""
    env = pushed_point()
    forth = shown(env)
    experts = stacked(forth, forth._replace(obs=-1.5 * forth.obs, action=-1.5 * forth.action))
    trainer = make_task_trainer([env, env], METHOD, CONFIG)

    def run(key):
        state = trainer.init(key, experts)
        return state, jax.lax.scan(lambda now, _: trainer.step(now, experts), state, length=2)[0]

    return experts, *jax.jit(run, compiler_options=UNOPTIMISED)(jax.random.key(0))


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
    experts, begun, _ = of_points()
    action = np.clip(np.asarray(experts.action, np.float64), -1.0, 1.0).ravel()
    counted = np.histogram(action, bins=np.linspace(-1.0, 1.0, BINS + 1))[0]
    made = begun.adversary_opt.made
    np.testing.assert_array_equal(made.number[:, 0].sum(-1), [action.size] * 2)
    assert np.abs(np.asarray(made.number[0, 0]) - counted).sum() <= 2  # an edge in single precision
    assert float(made.least[0].min()) == pytest.approx(action.min()) and float(made.greatest[1].max()) == pytest.approx(
        action.max()
    )


def test_tasks_have_one_reach_and_one_count_and_policies_and_rewards_of_their_own():
    experts, begun, after = of_points()
    low, high = begun.adversary_opt.reach
    assert float(low[0, 0]) == float(low[1, 0]) == float(experts.obs.min())
    assert float(high[0, 0]) == float(high[1, 0]) == float(experts.obs.max())
    shared = after.adversary_opt.expected, after.adversary_opt.made, after.params.feasibility, after.params.thresholds
    for leaf in jax.tree.leaves(shared):
        np.testing.assert_array_equal(leaf[0], leaf[1])
    np.testing.assert_allclose(after.adversary_opt.expected.sum(-1), 1.0, rtol=1e-5)  # M / steps, over all bins
    weights = after.params.reward["params"]["weights"]
    assert float(weights[0, 0]) > 0 > float(weights[1, 0])
    assert not np.array_equal(*jax.tree.leaves(after.params.policy)[0])


def test_entries_are_counted_over_all_tasks_and_the_feasibility_stays_one():
    experts, state = of_grids()
    worlds = [tiny_grid(goal=goal) for goal in GOALS]
    own = [
        entries.shown_by(jax.tree.map(lambda leaf, index=index: leaf[index], experts), env, table_of(env)).entered
        for index, env in enumerate(worlds)
    ]
    made, expected = state.params.evidence[0]
    np.testing.assert_array_equal(made, np.asarray(own[0]) + np.asarray(own[1]))
    assert float(expected.sum()) > 0
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
