"""What a twin of another reward did is no evidence of a limit: where f is chosen anew, M begins anew."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.boxes.action_limits import BINS, Made
from aircl_jax.algorithm.boxes.state_limits import Met, anew
from aircl_jax.algorithm.pooling import TASKS, Pool
from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.model.features import UNLIMITED
from aircl_jax.settings.train_config import MomentConfig
from tests.algorithm.boxes.test_twins import CONFIG, METHOD, pushed_point, shown
from tests.worlds import UNOPTIMISED

BEGINS = 3  # the iteration in which f is chosen; two later π has been away twice


def contrasts(patience: int) -> list:
    """The evidence after each of the first steps, where π is always far from the demonstrations."""
    config = replace(CONFIG, feasibility_delay=BEGINS, moments=MomentConfig(near=0.0, far=0.0, patience=patience))
    trainer, expert = make_trainer(pushed_point(), METHOD, config), shown(pushed_point())
    step = jax.jit(trainer.step, compiler_options=UNOPTIMISED)
    state, seen = trainer.init(jax.random.key(0), expert), []
    for _ in range(BEGINS + 4):
        state, _ = step(state, expert)
        seen.append(state.adversary_opt)
    return seen


def test_expected_actions_are_those_since_the_reward_was_last_chosen_anew():
    kept, forgot = contrasts(100), contrasts(2)
    at = BEGINS + 2
    assert [bool(one.weights.again) for one in forgot] == [False] * at + [True] + [False]
    assert not any(one.weights.again for one in kept)
    assert [float(one.counted) for one in kept] == [1, 2, 3, 4, 5, 6, 7]
    assert [float(one.counted) for one in forgot] == [1, 2, 3, 4, 5, 1, 2]
    before, after = (np.asarray(one.expected, float) for one in kept[at - 1 : at + 1])
    np.testing.assert_array_equal(before, forgot[at - 1].expected)
    np.testing.assert_allclose(forgot[at].expected, (at + 1) * after - at * before, atol=1e-5)  # of this iteration alone
    assert np.abs(np.asarray(forgot[at].expected) - after).max() > 1e-3


def test_limits_of_states_are_looked_for_anew():
    number = jnp.ones((2, BINS))
    made = Made(number, -0.5 * number, 0.5 * number, jnp.asarray(9.0))
    ends = jnp.array([0.3, UNLIMITED])
    found = anew(Met(made, made.number, jnp.asarray(4.0), -ends, ends, jnp.ones((2, 2)), jnp.asarray(1.0)))
    assert found.made is made
    np.testing.assert_array_equal(found.lower, [-UNLIMITED] * 2)
    np.testing.assert_array_equal(found.upper, [UNLIMITED] * 2)
    for nothing in (found.share, found.iterations, found.tempted, found.settled):
        assert not np.asarray(nothing).any()


@pytest.mark.parametrize("again", [False, True])
def test_one_task_whose_reward_is_chosen_anew_makes_all_of_them_count_anew(again):
    pool = Pool(2)
    found = jax.vmap(lambda one: ~pool.every(~one), axis_name=TASKS)(jnp.array([False, again]))
    assert found.tolist() == [again, again]
