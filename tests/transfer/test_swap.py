"""Recombinations: which world, reward, cost and settings a call asks for, what it refuses, and measures by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.settings.learner_config import LearnerConfig
from aircl_jax.settings.train_config import PPOConfig
from aircl_jax.transfer import swap as swaps
from aircl_jax.transfer.fresh import Fresh
from aircl_jax.transfer.swap import EPISODES, SwapResult, measure, recombine, swap
from envs import Env, Step
from tests.finished_runs import random_episodes, untrained_robot
from tests.worlds import one_state_env

RESULT = untrained_robot("aircl_corrected")
WORLD = RESULT.spec.env
EPISODE = jax.tree.map(lambda leaf: leaf[0], random_episodes(WORLD, 3, 1))

NOTHING: Any = None
STOPPING = LearnerConfig(stops=True, multiplier_max=1.0)
FRESH = Fresh(RESULT.networks, NOTHING, None, {})


@pytest.fixture
def asked(monkeypatch):
    """What a call would have trained, in place of training it; worlds are made as settings alone."""
    seen = SimpleNamespace(made=[])

    def recombined(world, objective, seeds, config, constrained, motors):
        seen.motors = motors
        seen.world, seen.seeds, seen.config, seen.constrained = world, list(seeds), config, constrained
        seen.objective = [np.asarray(part) for part in objective_of(objective, 0)]
        return SwapResult(world, FRESH, tuple(seeds), {})

    def made(name, **settings):
        seen.made.append((name, settings))
        return WORLD

    monkeypatch.setattr(swaps, "recombine", recombined)
    monkeypatch.setattr(swaps, "make_env", made)
    return seen


def objective_of(objective, seed):
    return jax.tree.map(lambda leaf: leaf[seed], objective)(EPISODE)


def learned():
    kept = np.asarray(EPISODE.mask) > 0
    return RESULT.bound(0).f(EPISODE), np.where(kept, RESULT.step_feasibility(EPISODE) < 0.5, 0.0)


def test_by_default_both_parts_are_the_learned_ones_in_the_runs_own_world(asked):
    swap(RESULT, seeds=2, first_seed=7)
    reward, cost = learned()
    np.testing.assert_allclose(asked.objective[0], reward, rtol=1e-5)
    np.testing.assert_array_equal(asked.objective[1], cost)
    assert asked.world is WORLD and asked.made == []
    assert (asked.seeds, asked.constrained, asked.config.release) == ([7, 8], True, 0.0)


def test_a_name_makes_the_runs_world_anew_with_that_reward_and_pays_it(asked):
    swap(RESULT, reward="backwards", seeds=1)
    assert asked.made == [("swimmer", {**RESULT.spec.env_settings, "reward": "backwards"})]
    assert asked.made[0][1]["horizon"] == 8
    np.testing.assert_array_equal(asked.objective[0], EPISODE.reward)
    np.testing.assert_array_equal(asked.objective[1], learned()[1])


def test_a_named_constraint_has_a_limit_of_its_own_and_leaves_the_learned_reward(asked):
    settings = {**RESULT.spec.env_settings, "limit": 0.3}
    swap(replace(RESULT, spec=replace(RESULT.spec, env_settings=settings)), constraint="position", seeds=1)
    assert asked.made == [("swimmer", {**settings, "constraint": "position", "limit": "default"})]
    np.testing.assert_allclose(asked.objective[0], learned()[0], rtol=1e-5)
    np.testing.assert_array_equal(asked.objective[1], EPISODE.cost)


def test_without_a_constraint_practice_begins_under_the_learned_one_and_the_truth_is_still_the_worlds(asked):
    swap(RESULT, constraint="none", seeds=1)
    np.testing.assert_array_equal(asked.objective[1], learned()[1])
    assert not asked.constrained and asked.config.release > 0
    assert asked.made == [] and asked.world is WORLD  # violations are those of its own constraint


def test_functions_of_a_step_take_either_place(asked):
    swap(RESULT, reward=lambda obs, action: obs[1], constraint=lambda obs, action: action[0] > 0, seeds=1)
    np.testing.assert_array_equal(asked.objective[0], EPISODE.obs[:, 1])
    np.testing.assert_array_equal(asked.objective[1], EPISODE.action[:, 0] > 0)


def test_a_world_that_is_given_is_acted_in_and_pays_its_own_under_the_name_world(asked):
    other = untrained_robot("bc").spec.env
    settings = LearnerConfig(iterations=3)
    swap(RESULT, reward="world", env=other, seeds=1, config=settings)
    assert asked.world is other and asked.world is not WORLD and asked.config is settings
    np.testing.assert_array_equal(asked.objective[0], EPISODE.reward)
    np.testing.assert_array_equal(asked.objective[1], learned()[1])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"reward": "backwards", "env": WORLD}, "reward='backwards' beside an Env"),
        ({"reward": "none", "env": WORLD}, "reward='none' beside an Env"),
        ({"constraint": "torque", "env": WORLD}, "constraint='torque' beside an Env"),
        ({"env": one_state_env(lambda t, action: 0.0 * t)}, "env=probe is neither a table nor a robot"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(asked, given, said):
    with pytest.raises(ValueError, match=said) as error:
        swap(RESULT, **given)
    assert "\n" not in str(error.value)


def with_limits(lower, upper):
    """A contrast run of two seeds whose feasibility has these limits, in half-widths."""
    run = untrained_robot("aircl_contrast")
    ends = {"lower": jnp.asarray(lower), "upper": jnp.asarray(upper)}
    params = run.states.params._replace(feasibility={"step": {"params": ends}})
    return replace(run, states=run.states._replace(params=params))


DRAWN = with_limits([[-100.0, -0.5], [-0.25, -100.0]], [[0.5, 100.0], [100.0, 100.0]])


def test_motors_of_a_fresh_seed_stop_at_the_limits_that_its_learned_seed_has_drawn_and_nowhere_else():
    found = swaps.learned_motors(DRAWN, 3)
    assert found is not None
    lower, upper = found
    np.testing.assert_allclose(lower, [[-np.inf, -0.5], [-0.25, -np.inf], [-np.inf, -0.5]])
    np.testing.assert_allclose(upper, [[0.5, np.inf], [np.inf, np.inf], [0.5, np.inf]])
    assert swaps.learned_motors(with_limits(np.full((2, 2), -100.0), np.full((2, 2), 100.0)), 3) is None
    assert swaps.learned_motors(untrained_robot("bc"), 3) is None


@pytest.mark.parametrize(
    ("given", "ends"),
    [
        ({}, [-0.25, np.inf]),
        ({"constraint": "none"}, [-0.25, np.inf]),
        ({"constraint": "world"}, [-0.5, 0.5]),
        ({"constraint": lambda obs, action: action[0] > 0}, None),
    ],
)
def test_motors_stop_where_the_constraint_that_counts_says_so(asked, given, ends):
    swap(DRAWN, seeds=2, **given)
    found = None if asked.motors is None else [float(asked.motors[0][1, 0]), float(asked.motors[1][1, 0])]
    assert found == (None if ends is None else pytest.approx(ends))


def test_a_run_without_that_part_is_refused(asked):
    with pytest.raises(ValueError, match="method=bc learns no reward to swap"):
        swap(untrained_robot("bc"), constraint="none")
    with pytest.raises(ValueError, match="method=airl_centred has no δ₁ to swap"):
        swap(untrained_robot("airl_centred"))


def test_policies_are_trained_and_judged_in_the_world_with_motors_that_stop_if_the_settings_have_such(monkeypatch):
    world, motors = one_state_env(lambda t, action: 0.0 * t), (-jnp.ones((2, 1)), jnp.ones((2, 1)))
    seen = {}

    def trained(env, *given, constrained, motors):
        seen.update(trained=env, held=constrained, motors=motors, config=given[1])
        return FRESH

    monkeypatch.setattr(swaps, "train_fresh", trained)
    drawn = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), random_episodes(WORLD, 0, 3))
    monkeypatch.setattr(swaps, "episodes", lambda fresh, env, number, key: seen.update(judged=env, number=number) or drawn)
    found = recombine(world, swaps.objectives.world_reward(), range(5, 7), STOPPING, False, motors)
    assert seen["trained"] is world and seen["judged"] is world and seen["held"] is False and seen["motors"] is motors
    assert (found.seeds, seen["number"]) == ((5, 6), EPISODES)
    assert found.world is world and found.made is FRESH and found.metrics == measure(drawn)
    assert seen["config"] is STOPPING
    recombine(world, swaps.objectives.world_reward(), range(5, 7), LearnerConfig(), True, motors)
    assert seen["motors"] is None
    recombine(world, swaps.objectives.world_reward(), range(5, 7), STOPPING, True)  # then only λ keeps the constraint
    assert seen["config"] == replace(STOPPING, multiplier_max=1000.0)


def test_measures_of_episodes_by_hand():
    # Two seeds of two episodes of three steps. The first seed's second episode ends after one step.
    mask = jnp.asarray([[[1.0, 1, 1], [1, 0, 0]], [[1, 1, 1], [1, 1, 0]]])
    reward = jnp.asarray([[[1.0, 2, 3], [4, 90, 90]], [[0, 0, 0], [-1, -1, 90]]])
    cost = jnp.asarray([[[0.0, 1, 0], [1, 0, 0]], [[0, 0, 0], [0, 0, 1]]])
    base = random_episodes(WORLD, 0, 2)
    drawn = jax.tree.map(lambda leaf: jnp.stack([leaf[:, :3] if leaf.ndim > 1 else leaf] * 2), base)
    found = measure(drawn._replace(mask=mask, reward=reward, cost=cost))
    assert found["return"] == [(6 + 4) / 2, -1.0]
    np.testing.assert_allclose(found["violation_rate"], [(1 / 3 + 1) / 2, 0.0], rtol=1e-6)
    assert found["infeasible_share"] == [1.0, 0.0]


def still(size: int) -> Env:
    """A body of the swimmer's sizes that never moves: what it is paid is f at that place."""
    here = jnp.ones(size)
    zero = jnp.zeros(())
    return replace(
        WORLD,
        reset=lambda key: (zero, here),
        step=lambda key, state, action: (state, Step(here, action.sum(), (action[0] > 0).astype(jnp.float32), zero)),
    )


def test_a_swap_from_first_to_last():
    tiny = LearnerConfig(iterations=2, num_trajectories=2, hidden=(4,), candidates=1, ppo=PPOConfig(num_epochs=1))
    found = swap(RESULT, env=still(WORLD.obs_size), seeds=2, config=tiny)
    assert isinstance(found.made, Fresh) and found.made.history["return"].shape == (2, 2)
    assert set(found.metrics) == {"return", "violation_rate", "infeasible_share"}
    assert all(np.isfinite(values).all() and len(values) == 2 for values in found.metrics.values())
    means = [found.policy(EPISODE.obs[0], index=index).mean() for index in (0, 1)]
    assert means[0].shape == (2,) and not np.allclose(means[0], means[1])
