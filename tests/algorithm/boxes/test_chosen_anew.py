"""What a twin of another reward did is no evidence of a limit: where f is chosen anew, M and the twins begin anew."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.boxes.action_limits import BINS, Made
from aircl_jax.algorithm.boxes.state_limits import Met, reset
from aircl_jax.algorithm.boxes.twins import STILL_LEARNS, learns
from aircl_jax.algorithm.tasks import make_task_trainer
from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.model.features import UNLIMITED
from aircl_jax.settings.train_config import MomentConfig, TrainConfig
from tests.algorithm.boxes.test_pooling import of_both_sides
from tests.algorithm.boxes.test_twins import CONFIG, METHOD, leaves, pushed_point, same, shown
from tests.worlds import UNOPTIMISED

BEGINS, PATIENCE = 3, 2  # the iteration in which f is chosen; two later π has been away twice
AT = BEGINS + PATIENCE


def config_of(patience: int) -> TrainConfig:
    """π is always far from the demonstrations."""
    return replace(CONFIG, feasibility_delay=BEGINS, moments=MomentConfig(near=0.0, far=0.0, patience=patience))


def ran(patience: int, constraint_input: Any = "action") -> list:
    """The states after each of the first steps."""
    env = replace(pushed_point(), constraint_input=constraint_input)
    trainer, expert = make_trainer(env, METHOD, config_of(patience)), shown(pushed_point())
    step = jax.jit(trainer.step, compiler_options=UNOPTIMISED)
    state, seen = trainer.init(jax.random.key(0), expert), []
    for _ in range(AT + 2):
        state, _ = step(state, expert)
        seen.append(state)
    return seen


def test_expected_actions_are_those_since_the_reward_was_last_chosen_anew():
    kept, forgot = ran(100), ran(PATIENCE)
    numbers = [[float(state.adversary_opt.num_averaged) for state in states] for states in (kept, forgot)]
    assert numbers == [[1, 2, 3, 4, 5, 6, 7], [1, 2, 3, 4, 5, 0, 1]]
    assert [float(state.adversary_opt.weights.rechosen) for state in forgot] == [0] * AT + [1, 1]
    assert same(kept[AT - 1].params, forgot[AT - 1].params)
    assert not np.asarray(forgot[AT].adversary_opt.expected).any()
    assert np.asarray(forgot[AT + 1].adversary_opt.expected).any()


def test_a_twin_begins_anew_from_the_policy():
    kept, forgot = ran(100), ran(PATIENCE)
    alike = [
        [same(state.adversary_opt.twin.trained.policy, state.ppo_opt.trained.policy) for state in states[AT:]]
        for states in (kept, forgot)
    ]
    assert alike == [[False, False], [True, False]]


def test_limits_of_states_are_looked_for_anew():
    kept, forgot = (ran(patience, "state") for patience in (100, PATIENCE))
    iterations = [[float(state.adversary_opt.met.iterations) for state in states] for states in (kept, forgot)]
    assert iterations == [[0, 0, 0, 0, 1, 2, 3], [0, 0, 0, 0, 1, 0, 1]]
    number = jnp.ones((2, BINS))
    made = Made(number, number, number, jnp.asarray(9.0))
    ends = jnp.array([0.3, UNLIMITED])
    found = reset(Met(made, made.number, jnp.asarray(4.0), -ends, ends, jnp.ones((2, 2)), jnp.asarray(1.0)))
    assert found.made is made
    np.testing.assert_array_equal(found.lower, [-UNLIMITED] * 2)
    np.testing.assert_array_equal(found.upper, [UNLIMITED] * 2)
    assert not any(np.asarray(none).any() for none in (found.share, found.iterations, found.tempted, found.settled))


def test_where_one_tasks_reward_is_chosen_anew_all_of_them_count_anew():
    trainer, experts = make_task_trainer([pushed_point()] * 2, METHOD, config_of(PATIENCE)), of_both_sides()

    def run(key):
        state = trainer.init(key, experts)
        state = jax.lax.scan(lambda now, _: trainer.step(now, experts), state, length=AT - 1)[0]
        weights = state.adversary_opt.weights
        weights = weights._replace(away=jnp.array([PATIENCE - 1.0, -5.0]))  # the second is not away for long
        return trainer.step(state._replace(adversary_opt=state.adversary_opt._replace(weights=weights)), experts)[0]

    contrast = jax.jit(run, compiler_options=UNOPTIMISED)(jax.random.key(0)).adversary_opt
    assert contrast.weights.rechosen.tolist() == [1.0, 0.0]
    assert contrast.num_averaged.tolist() == [0.0, 0.0]
    assert not any(leaf.any() for leaf in leaves(contrast.expected))


@pytest.mark.parametrize(("decay", "last"), [(0, 10**6), (100, 79)])
def test_nothing_is_chosen_anew_that_the_policy_could_not_learn(decay, last):
    config = replace(CONFIG, lr_decay_iterations=decay)
    assert STILL_LEARNS == 0.8
    assert learns(jnp.asarray(last), config)
    assert decay == 0 or not learns(jnp.asarray(last + 1), config)
