"""How near π came, and is in the end, to the demonstrations' mean features, and how often it is outside their range."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.boxes.moments import LATER_GAPS
from aircl_jax.algorithm.evaluation import evaluate
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.settings.train_config import MomentConfig
from tests.algorithm.boxes.test_twins import CONFIG, METHOD, pushed_point, shown
from tests.worlds import UNOPTIMISED


def test_strays_are_those_of_the_evaluated_episodes():
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

    assert jnp.isfinite(measured["return"])
    stats = state.obs_stats
    seen_by = [np.clip((values - float(stats.mean[0])) / float(stats.std[0]), -8.0, 8.0) for values in (seen, obs)]
    demonstrated, done = (np.array([values.mean(), np.minimum(values**2, 9.0).mean() / 2]) for values in seen_by)
    gap = demonstrated - done
    assert float(measured["gap_at_end"]) == pytest.approx(np.sqrt((gap**2).mean()), rel=1e-4)


def test_the_gap_is_the_least_on_the_way_and_not_that_of_a_later_policy():
    env, expert = pushed_point(), shown(pushed_point())
    trainer = make_trainer(env, METHOD, replace(CONFIG, feasibility_delay=3))
    state = trainer.init(jax.random.key(3), expert)
    weights = state.adversary_opt.weights
    assert weights.gaps.shape[0] == 4 + LATER_GAPS
    gaps = weights.gaps.at[0].set(jnp.array([0.9, -0.7])).at[1].set(jnp.array([-0.3, 0.4])).at[-1].set(0.1)
    state = state._replace(adversary_opt=state.adversary_opt._replace(weights=weights._replace(gaps=gaps)))
    measured = jax.jit(lambda: evaluate(trainer.networks, state, expert, expert), compiler_options=UNOPTIMISED)()
    assert float(measured["moment_gap"]) == pytest.approx(np.sqrt((0.3**2 + 0.4**2) / 2), rel=1e-6)
