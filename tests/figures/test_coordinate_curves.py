"""What a curve of the additive δ₁ shows is what its coordinate adds to the logit."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.analysis import coordinate_contributions
from aircl_jax.analysis.coordinate_contributions import contributions, curves_of
from aircl_jax.figures.robots.coordinate_curves import by_coordinate
from aircl_jax.figures.style import BLUE, GREEN, ORANGE
from aircl_jax.methods import METHODS
from aircl_jax.model.networks import make_networks
from envs import Box, Limit
from tests.finished_runs import untrained
from tests.worlds import TINY, UNOPTIMISED, one_state_env, random_trajectories

COLOURS = {"seeds": GREEN, "mean": BLUE, "limit": ORANGE}


@pytest.mark.parametrize("sees", ["state", "action", "state_action"])
def test_curves_sum_to_the_logit_up_to_a_constant(sees):
    env = one_state_env(lambda t, action: action.sum(), action_space=Box(3))
    config = replace(TINY, step_network="additive", constraint_input=sees)
    method = METHODS["aircl_corrected"]
    nets, trainer = make_networks(env, method, config), make_trainer(env, method, config)
    expert = random_trajectories(env, 0, TINY.num_demonstrations)
    state = jax.jit(trainer.init, compiler_options=UNOPTIMISED)(jax.random.key(0), expert)

    obs = jnp.array([[0.3, -1.2], [0.9, 0.4]])
    action = jnp.array([[0.5, -0.7, 0.1], [-0.2, 0.6, 0.9]])
    logit = jax.vmap(lambda *one: nets.bind(state.params, state.obs_stats).step_logit(*one))(obs, action)
    points = {"state": obs, "action": action, "state_action": jnp.concatenate([obs, action], axis=1)}[sees]
    curves = curves_of(nets, state, points)
    assert curves.shape == points.shape
    np.testing.assert_allclose((curves[0] - curves[1]).sum(), logit[0] - logit[1], rtol=1e-4, atol=1e-5)


def test_a_curve_is_drawn_less_its_mean_over_the_demonstrations_for_every_seed_and_their_mean(monkeypatch):
    world = one_state_env(lambda t, action: action.sum(), horizon=1, action_space=Box(2))
    env = replace(world, limit=Limit("torque", 0.25, "actions"))
    config = replace(TINY, step_network="additive", constraint_input="action", hidden=(4,))
    full, method = untrained("aircl_corrected"), METHODS["aircl_corrected"]
    nets = make_networks(env, method, config)
    one = random_trajectories(env, 0, 4)
    action = np.array([[[-1.0, 0.5]], [[0.0, 0.5]], [[1.0, 0.5]], [[4.0, 0.5]]])  # the last is clipped
    expert = one._replace(action=np.tile(action, (2, 1, 1, 1)), obs=np.tile(one.obs, (2, 1, 1, 1)), mask=np.ones((2, 4, 1)))
    spec = replace(full.spec, env=env, method=method)
    monkeypatch.setattr(coordinate_contributions, "curves_of", lambda nets, state, points: state.step * points)
    states = full.states._replace(step=jnp.array([1.0, 3.0]))
    result = replace(full, networks=nets, spec=spec, expert=expert, states=states)
    drawing = by_coordinate(result, contributions(result, expert))
    torque, other = drawing.figure.axes
    assert [axis.get_xlabel() for axis in drawing.figure.axes] == list(env.motor_names)
    lines = {name: [line for line in torque.lines if line.get_color() == colour] for name, colour in COLOURS.items()}
    across = np.linspace(-1, 1, 121)
    centred = across - 0.25  # D_E's mean of −1, 0, 1 and 1
    np.testing.assert_allclose([np.asarray(line.get_ydata()) for line in lines["seeds"]], [centred, 3 * centred], atol=1e-5)
    np.testing.assert_allclose(np.asarray(lines["mean"][0].get_ydata()), 2 * centred, atol=1e-5)
    assert [np.asarray(line.get_xdata()).tolist() for line in lines["limit"]] == [[-0.25, -0.25], [0.25, 0.25]]
    assert np.asarray(other.lines[2].get_ydata())[60] == pytest.approx(2 * (0.0 - 0.5), abs=1e-5)
