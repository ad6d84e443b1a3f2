"""How far π is from the demonstrations at the end: mean features, and steps outside their range."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.evaluation import evaluate
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.settings.train_config import MomentConfig
from tests.algorithm.boxes.test_twins import CONFIG, METHOD, pushed_point, shown
from tests.worlds import UNOPTIMISED


def test_gap_and_strays_are_those_of_the_evaluated_episodes():
    env, expert = pushed_point(), shown(pushed_point())
    expert = expert._replace(mask=expert.mask.at[0, 3:].set(0.0), obs=(0.2 * expert.obs).at[0, 5].set(50.0))  # not seen: masked
    config = replace(CONFIG, num_evaluation=5, moments=MomentConfig(margin=0.5))
    trainer = make_trainer(env, METHOD, config)
    state = trainer.init(jax.random.key(3), expert)
    measured = jax.jit(lambda: evaluate(trainer.networks, state, expert, expert), compiler_options=UNOPTIMISED)()
    key = jax.random.split(jax.random.fold_in(state.key, state.step))[0]
    obs = np.asarray(rollouts(trainer.networks.bind(state.params, state.obs_stats), key, 5).obs, float).reshape(-1)
    seen = np.asarray(expert.obs, float)[..., 0][np.asarray(expert.mask) > 0]
    middle, half = (seen.max() + seen.min()) / 2, (seen.max() - seen.min()) / 2
    outside = np.abs(obs - middle) > half * 2.0  # half of the width, and half as much again on either side
    assert 0 < outside.mean() < 1
    assert float(measured["strayed"]) == pytest.approx(outside.mean(), abs=1e-6)

    def phi(values):
        x = np.clip((values - float(state.obs_stats.mean[0])) / float(state.obs_stats.std[0]), -8, 8)
        return np.array([x.mean(), (0.5 * np.minimum(x**2, 9.0)).mean()])

    gap = np.sqrt(((phi(seen) - phi(obs)) ** 2).mean())
    assert float(measured["moment_gap"]) == pytest.approx(gap, rel=1e-4)
    assert jnp.isfinite(measured["return"])
