"""What figures and words are drawn from, worked out again from the states of a run that was never trained."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.sampler import SAMPLERS
from aircl_jax.algorithm.scoring import trajectory_feasibility
from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.analysis import episodes
from aircl_jax.analysis.recovered import recover
from aircl_jax.demonstrations.soft_optimal import soft_value_iteration
from aircl_jax.demonstrations.sources import demonstrations, tabular_reference
from aircl_jax.model.networks import make_networks
from aircl_jax.runs.result import Result
from aircl_jax.runs.spec import make_spec
from envs import SoftOptimalExpert, Tabular
from tests.worlds import random_trajectories, table_of

SEEDS = 2
GRID = {"size": 3, "goal": [2, 2], "obstacles": [[1, 1]], "horizon": 4, "slip": 0.2, "temperature": 2.0}
CONFIG = {"num_trajectories": 6, "num_demonstrations": 5, "num_evaluation": 6, "hidden": [4]}


@cache
def result() -> Result:
    """Two seeds with random weights; their demonstrations end at various steps."""
    given: Any = {"seeds": SEEDS, "first_seed": 0, "iterations": 1, "demonstrations": "default", "contrast_prior": "method"}
    spec = make_spec("gridworld", "aircl_corrected_sa", env_settings=GRID, config=CONFIG, **given)
    sets = [random_trajectories(spec.env, seed, 5) for seed in range(SEEDS)]
    expert = jax.tree.map(lambda *leaves: jnp.stack(leaves), *sets)
    trainer = make_trainer(spec.env, spec.method, spec.config)
    states = jax.jit(jax.vmap(trainer.init))(jax.random.split(jax.random.key(0), SEEDS), expert)
    random = np.random.default_rng(1)
    params = jax.tree.map(lambda leaf: jnp.asarray(random.normal(size=leaf.shape), jnp.float32), states.params)
    nets = make_networks(spec.env, spec.method, spec.config)
    reference = random_trajectories(spec.env, 9, 7)
    return Result({}, [], {}, spec, nets, states._replace(params=params), expert, reference, None)


def each_pair(of: Any) -> np.ndarray:
    """of(state, cell, action), [S, C, A]."""
    pairs = [[[of(result().state(s), jnp.eye(9)[c], jnp.asarray(a)) for a in range(4)] for c in range(9)] for s in range(SEEDS)]
    return np.array(pairs, np.float64)


def mean_visits(table: Tabular, log_policy: np.ndarray) -> np.ndarray:
    """How often a policy [T, C, A] is in each cell, forward in t, cell by cell."""
    at, move, total = np.asarray(table.start, np.float64), np.asarray(table.transition, np.float64), np.zeros(9)
    for policy in np.exp(np.asarray(log_policy, np.float64)):
        total += at / 4
        at = np.array([at[x] * policy[x, a] * move[x, a] for x in range(9) for a in range(4)]).sum(axis=0)
    return total


@cache
def maps() -> episodes.GridEvidence:
    return episodes.gather_grid(result(), table_of(result().spec.env))


def test_the_map_of_the_reward_is_that_of_every_cell_and_action():
    nets = result().networks
    expected = each_pair(lambda state, obs, action: nets.bind(state.params, state.obs_stats).reward(obs, action))
    np.testing.assert_allclose(maps().reward, expected, rtol=1e-4, atol=1e-5)


def test_the_map_of_the_feasibility_is_tested_at_the_settings_threshold():
    nets, coefficients = result().networks, result().spec.config.coefficients
    logit = each_pair(lambda state, obs, action: nets.bind(state.params, state.obs_stats).step_logit(obs, action))
    shifted = float(coefficients.sharpness) * (logit - np.log(float(coefficients.threshold)))
    np.testing.assert_allclose(maps().step_delta, np.maximum(1 / (1 + np.exp(-shifted)), np.exp(-10)), rtol=1e-3)


@pytest.mark.parametrize("seed", range(SEEDS))
def test_the_map_of_visits_is_how_often_each_seeds_policy_is_in_a_cell(seed):
    nets, state = result().networks, result().state(seed)

    def log_policy(t: int, cell: int) -> Any:
        return nets.bind(state.params, state.obs_stats).policy(jnp.eye(9)[cell], jnp.asarray(t)).log_prob(jnp.arange(4))

    expected = mean_visits(
        table_of(result().spec.env), np.array([[log_policy(t, cell) for cell in range(9)] for t in range(4)])
    )
    np.testing.assert_allclose(maps().occupancy[seed], expected, rtol=1e-3, atol=1e-5)


def test_the_experts_visits_are_those_of_the_constrained_expert_at_its_own_temperature():
    table = table_of(result().spec.env)
    expert = soft_value_iteration(table, table.reward, 4, 2.0, forbid=True)
    np.testing.assert_allclose(maps().expert_occupancy, mean_visits(table, np.asarray(expert.log_policy)), rtol=1e-4, atol=1e-6)


def test_shown_episodes_and_the_reference_set_have_their_own_feasibility_and_q_is_drawn_by_it(monkeypatch):
    monkeypatch.setitem(SAMPLERS, "resample", lambda log_delta, number, key: jnp.argsort(log_delta)[:number][::-1])
    found = episodes.gather(result())
    for seed in range(SEEDS):
        policy = jax.tree.map(lambda leaf, seed=seed: jnp.asarray(leaf[seed]), found.policy)
        of_policy, of_reference = (
            np.exp(trajectory_feasibility(result().bound(seed), one)) for one in (policy, result().reference)
        )
        np.testing.assert_allclose(found.delta_policy[seed], of_policy, rtol=1e-3)
        np.testing.assert_allclose(found.delta_reference[seed], of_reference, rtol=1e-3)
        order = np.argsort(found.delta_policy[seed], kind="stable")[::-1]
        by_delta = found.delta_policy[seed][order]
        drawn = jax.tree.map(lambda leaf, seed=seed: jnp.asarray(leaf[seed]), found.sampled)
        of_drawn = np.exp(trajectory_feasibility(result().bound(seed), drawn))
        np.testing.assert_allclose(of_drawn, by_delta, rtol=1e-3)


def test_many_seeds_share_the_episodes_that_are_shown(monkeypatch):
    monkeypatch.setattr(episodes, "MOST_EPISODES", 2 * SEEDS + 1)
    assert episodes.gather(result()).policy.mask.shape[:2] == (SEEDS, 2)


def test_a_change_is_counted_as_often_as_the_demonstrations_have_it_before_their_end():
    seen, expert = np.zeros((9, 4), int), result().expert
    for n in range(5):
        for t in range(int(expert.mask[0, n].sum())):
            seen[int(expert.obs[0, n, t].argmax()), int(expert.action[0, n, t])] += 1
    np.testing.assert_array_equal(recover(result(), table_of(result().spec.env)).seen, seen)


def test_recovered_rewards_are_zero_on_average_over_the_demonstrations():
    found = recover(result(), table_of(result().spec.env))
    np.testing.assert_allclose((found.reward * found.seen).sum(axis=(1, 2)), 0.0, atol=1e-3)
    np.testing.assert_allclose(found.reward - found.reward[:, :1, :1], maps().reward - maps().reward[:, :1, :1], atol=1e-4)


@cache
def straight() -> Any:
    """The grid without slip, whose expert hardly errs."""
    given: Any = {"seeds": 3, "first_seed": 5, "iterations": 1, "demonstrations": "default", "contrast_prior": "method"}
    world = GRID | {"slip": 0.0, "temperature": 0.5}
    return make_spec("gridworld", "airl", env_settings=world, config=CONFIG | {"num_demonstrations": 40}, **given)


def test_demonstrations_of_a_grid_are_clean_and_each_seeds_own():
    expert, reference = demonstrations(straight().env, straight().seeds, straight().config)
    assert expert.mask.shape == (3, 40, 4)
    assert expert.cost.sum() == 0.0
    assert len({np.asarray(one).tobytes() for one in expert.action}) == 3
    assert len(reference.mask) == 500


def test_half_a_reference_set_knows_no_constraint_and_a_tenth_of_the_others_actions_are_uniform():
    env = straight().env
    table = table_of(env)
    expert, free = (soft_value_iteration(table, table.reward, 4, 0.5, forbid=forbid) for forbid in (True, False))
    reference = tabular_reference(env, SoftOptimalExpert(table, 0.5), expert.log_policy)
    first, second = (np.asarray(reference.cost)[half].mean() for half in (slice(0, 250), slice(250, 500)))
    inside = mean_visits(table, np.asarray(free.log_policy))[4]
    np.testing.assert_allclose(first, inside, atol=0.03)
    assert second < 0.5 * first
    cells, actions = np.asarray(reference.obs[250:]).argmax(axis=-1), np.asarray(reference.action[250:])
    policy = np.exp(np.asarray(expert.log_policy))
    never = policy[np.arange(4), cells] < 1e-6  # [N, T, A]: what the expert itself would not do
    done = np.take_along_axis(never, actions[..., None], axis=-1).mean()
    np.testing.assert_allclose(done, 0.1 * never.mean(axis=-1).mean(), atol=0.012)
