from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.methods import METHODS
from aircl_jax.model.modules import ENCODERS, running_sum, smooth_minimum
from aircl_jax.model.networks import OBS_CLIP, make_networks
from aircl_jax.types import ObsStats
from envs import Box, Coordinates, make_env
from tests.worlds import TINY, UNOPTIMISED, one_state_env, random_trajectories, tiny_grid, tiny_networks, unit_stats


def sequence_logit(encoder, obs, mask=None, method="aircl"):
    env = tiny_grid()
    nets, params = tiny_networks(env, method, replace(TINY, encoder=encoder))
    mask = jnp.ones(len(obs)) if mask is None else mask
    actions = jnp.zeros(len(obs), jnp.int32)
    return float(nets.bind(params, unit_stats(env)).sequence_logit(jnp.asarray(obs, jnp.float32), actions, mask))


@pytest.mark.parametrize("encoder", ENCODERS)
def test_trajectory_level_feasibility_sees_order(encoder):
    visits = np.eye(9)[[0, 1, 2, 3]]
    assert abs(sequence_logit(encoder, visits) - sequence_logit(encoder, visits[[0, 2, 1, 3]])) > 1e-4


def test_linear_feasibility_is_blind_to_order():
    visits = np.eye(9)[[0, 1, 2, 3]]
    one, other = (sequence_logit("attention", x, method="aircl_linear") for x in (visits, visits[[0, 2, 1, 3]]))
    np.testing.assert_allclose(one, other, rtol=1e-6)


@pytest.mark.parametrize("length", [1, 19, 20, 50, 500])
def test_the_running_sum_is_numpys(length):
    x = np.random.default_rng(0).lognormal(sigma=3.0, size=(length, 3))
    np.testing.assert_allclose(running_sum(jnp.float32(x)), x.cumsum(axis=0), rtol=1e-5)


@pytest.mark.parametrize("encoder", ENCODERS)
def test_trajectory_level_feasibility_does_not_see_masked_steps(encoder):
    mask = jnp.asarray([1.0, 1.0, 0.0, 0.0])
    one, other = (sequence_logit(encoder, np.eye(9)[cells], mask) for cells in ([0, 1, 2, 3], [0, 1, 8, 7]))
    assert one == other


def test_smooth_minimum_is_minus_log_mean_exp_of_minus_the_unmasked_scores():
    score, mask = np.array([1.0, -2.0, 0.5, -90.0]), np.array([1.0, 1.0, 1.0, 0.0])
    expected = -np.log(np.mean(np.exp(-score[:3])))
    np.testing.assert_allclose(smooth_minimum(jnp.asarray(score), jnp.asarray(mask)), expected, rtol=1e-6)


def test_observations_are_normalised_by_the_experts_and_clipped():
    env = tiny_grid()
    nets, params = tiny_networks(env, "airl")
    stats = ObsStats(jnp.full(9, 2.0), jnp.asarray([0.5] * 8 + [0.0]))
    obs = jnp.asarray([3.0, 1.0, 200.0] + [2.0] * 6)
    np.testing.assert_allclose(nets.bind(params, stats).normalise(obs), [2.0, -2.0, OBS_CLIP] + [0.0] * 6)


def test_reward_is_blind_to_time_and_policy_is_not():
    env = tiny_grid()
    nets, params = tiny_networks(env, "airl")
    obs, stats = jnp.eye(9)[3], unit_stats(env)
    first, last = (nets.bind(params, stats).policy(obs, jnp.asarray(t)).log_prob(jnp.asarray(1)) for t in (0, 3))
    assert first != last
    assert nets.bind(params, stats).acting_input(obs, jnp.asarray(2))[-1] == 2 / env.horizon


def test_log_pi_is_the_log_probability_of_each_step():
    env = tiny_grid()
    nets, params = tiny_networks(env, "airl")
    one = jax.tree.map(lambda leaf: leaf[0], random_trajectories(env, 0, 1))
    expected = [nets.bind(params, unit_stats(env)).policy(one.obs[t], jnp.asarray(t)).log_prob(one.action[t]) for t in range(4)]
    np.testing.assert_allclose(nets.bind(params, unit_stats(env)).log_pi(one), expected, rtol=1e-6)


@pytest.mark.parametrize(("name", "settings"), [("meerkat", {"data": "simulated"}), ("labyrinth", {"data": "simulated"})])
def test_tables_of_an_enumerated_world_give_what_the_networks_give_step_by_step(name, settings):
    world = make_env(name, **settings)
    plain = replace(world, view=Coordinates())
    assert world.enumerated
    assert not plain.enumerated
    one = jax.tree.map(lambda leaf: leaf[0], random_trajectories(world, 0, 1))
    _, params = tiny_networks(world, "aircl_corrected")
    stats = ObsStats(jnp.full(world.obs_size, 0.1), jnp.full(world.obs_size, 0.3))

    def along(env):
        nets = make_networks(env, METHODS["aircl_corrected"], TINY)

        def total(params):
            scores = nets.bind(params, stats).scores(one, nets.bind(params, stats).log_pi(one))
            values = nets.bind(params, stats).values(one)
            return (scores.f * scores.log_pi + values * scores.step_logit + scores.sequence_logit).sum(), (scores, values)

        return jax.jit(jax.grad(total, has_aux=True), compiler_options=UNOPTIMISED)(params)

    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-4, atol=1e-5), along(world), along(plain))


def test_a_world_whose_policy_sees_time_has_no_tables_of_pairs():
    world = make_env("labyrinth", data="simulated")
    assert not replace(world, finite_horizon=True).enumerated


def test_log_pi_of_a_box_is_a_diagonal_gaussians():
    env = one_state_env(lambda t, action: action.sum(), action_space=Box(2))
    nets, params = tiny_networks(env, "airl")
    policy = nets.bind(params, unit_stats(env)).policy(jnp.eye(2)[0], jnp.asarray(0))
    action, mean, std = np.array([0.4, -3.0]), np.asarray(policy.mean()), np.exp(TINY.ppo.log_std_init)
    expected = (-0.5 * ((action - mean) / std) ** 2 - np.log(std) - 0.5 * np.log(2 * np.pi)).sum()
    np.testing.assert_allclose(policy.log_prob(jnp.asarray(action)), expected, rtol=1e-5)


def test_reward_sees_actions_as_the_box_clips_them():
    env = one_state_env(lambda t, action: action.sum(), action_space=Box(1, -1.0, 1.0))
    nets, params = tiny_networks(env, "airl")
    bound, obs = nets.bind(params, unit_stats(env)), jnp.eye(2)[0]
    assert bound.reward(obs, jnp.asarray([1.0])) == bound.reward(obs, jnp.asarray([7.0]))


def test_a_bounded_reward_is_the_same_near_zero_and_never_beyond_the_bound():
    env = tiny_grid()
    free, params = tiny_networks(env, "airl")
    bounded, _ = tiny_networks(env, "airl", replace(TINY, reward_bound=2.0))
    params = params._replace(reward=jax.tree.map(lambda leaf: 30.0 * leaf, params.reward))
    stats, along = unit_stats(env), (jnp.eye(9)[3], jnp.asarray(1))
    f = free.bind(params, stats).reward(*along)
    np.testing.assert_allclose(bounded.bind(params, stats).reward(*along), 2.0 * np.tanh(f / 2.0), rtol=1e-6)
    assert abs(f) > 2.0


@pytest.mark.parametrize("name", ["airl", "icrl", "aircl", "aircl_corrected"])
def test_scores_without_a_feasibility_have_zero_logits(name):
    env = tiny_grid()
    nets, params = tiny_networks(env, name)
    one = jax.tree.map(lambda leaf: leaf[0], random_trajectories(env, 0, 1))
    scores = nets.bind(params, unit_stats(env)).scores(one, one.log_prob)
    assert bool((scores.step_logit != 0).any()) == ("step" in nets.method.feasibility)
    assert bool(scores.sequence_logit != 0) == ("sequence" in nets.method.feasibility)


@pytest.mark.parametrize(("method", "sees"), [("aircl_sa", True), ("icrl", True), ("aircl_corrected", False)])
def test_step_feasibility_of_the_papers_rows_sees_actions_and_ours_where_the_world_constrains_them(method, sees):
    env = tiny_grid()
    assert make_networks(env, METHODS[method], TINY).feasibility_sees_action == sees
    torque = replace(env, constraint_input="state_action")
    assert make_networks(torque, METHODS[method], TINY).feasibility_sees_action


@pytest.mark.parametrize(
    ("sees", "moves"), [("state", (True, False)), ("action", (False, True)), ("state_action", (True, True))]
)
def test_feasibility_is_a_function_of_what_the_settings_say(sees, moves):
    env = one_state_env(lambda t, action: action.sum(), action_space=Box(2))
    nets, params = tiny_networks(env, "aircl_corrected", replace(TINY, constraint_input=sees))

    def logit(obs, action):
        return float(nets.bind(params, unit_stats(env)).step_logit(jnp.eye(2)[obs], jnp.full(2, action)))

    assert (logit(0, 0.1) != logit(1, 0.1), logit(0, 0.1) != logit(0, 0.9)) == moves


def test_figures_call_a_robots_coordinates_by_its_joints():
    env = make_env("walker")
    assert len(env.coordinate_names) == env.obs_size == 17
    assert env.coordinate_names[:3] == ("z", "pitch", "hip right") and env.coordinate_names[-1] == "velocity of ankle left"
    assert env.motor_names[0] == "motor hip right" and len(env.motor_names) == 6
    assert tiny_grid().coordinate_names[0] == "coordinate 0"


def test_additive_step_feasibility_is_a_sum_over_coordinates():
    env = one_state_env(lambda t, action: action.sum(), action_space=Box(2))
    env = replace(env, constraint_input="state_action")
    nets, params = tiny_networks(env, "aircl_corrected", replace(TINY, step_network="additive"))

    def logit(*action):
        return float(nets.bind(params, unit_stats(env)).step_logit(jnp.eye(2)[0], jnp.asarray(action)))

    np.testing.assert_allclose(logit(0.5, 0.7) - logit(0.5, -0.2), logit(-0.9, 0.7) - logit(-0.9, -0.2), rtol=1e-4)
    assert abs(logit(0.5, 0.7) - logit(0.5, -0.2)) > 1e-4


def test_linear_rows_have_a_linear_reward_and_feasibility_and_a_deep_policy():
    _, params = tiny_networks(tiny_grid(), "aircl_linear")
    assert set(params.reward["params"]) == {"Dense_0"}
    assert set(params.feasibility["sequence"]["params"]) == {"Dense_0"}
    assert len(params.policy["params"]["MLP_0"]) == len(TINY.hidden) + 1


def test_reward_and_feasibility_start_from_weights_of_their_own():
    _, params = tiny_networks(tiny_grid(), "aircl_sa", replace(TINY, reward_input="obs"))  # both see the same
    reward, feasibility = (one["params"]["Dense_0"]["kernel"] for one in (params.reward, params.feasibility["step"]))
    assert reward.shape == feasibility.shape
    assert (reward != feasibility).any()
