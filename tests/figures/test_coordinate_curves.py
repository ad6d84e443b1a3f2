"""What a curve of the additive δ₁ shows is what its coordinate adds to the logit."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.analysis.coordinate_contributions import curves_of
from aircl_jax.methods import METHODS
from aircl_jax.model.networks import make_networks
from envs import Box
from tests.worlds import TINY, UNOPTIMISED, one_state_env, random_trajectories


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
    logit = jax.vmap(lambda *one: nets.step_logit(state.params.feasibility, state.obs_stats, *one))(obs, action)
    points = {"state": obs, "action": action, "state_action": jnp.concatenate([obs, action], axis=1)}[sees]
    curves = curves_of(nets, state, points)
    assert curves.shape == points.shape
    np.testing.assert_allclose((curves[0] - curves[1]).sum(), logit[0] - logit[1], rtol=1e-4, atol=1e-5)
