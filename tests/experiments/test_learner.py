"""Brax's PPO beside the learner: it acts in our world, and both are judged alike."""

import sys
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.settings.learner_config import LearnerConfig
from envs import Box, Discrete, Env, Step
from experiments.learner import __main__ as command
from experiments.learner import beside, brax_ppo

TINY: dict[str, Any] = {**brax_ppo.NOTEBOOK, "num_envs": 32, "batch_size": 32, "num_minibatches": 4, "learning_rate": 3e-3}
WARNS = "ignore::DeprecationWarning"  # of Brax and of what it imports


def line(action_space: Any = None) -> Env:
    """A point that is paid for how far it moves to the right; the step's key is its noise."""

    def reset(key):
        at = jax.random.normal(key, (1,))
        return at, at

    def step(key, at, action):
        moved = at + 0.1 * jnp.clip(action, -1.0, 1.0) + 0.01 * jax.random.normal(key, (1,))
        return moved, Step(moved, (moved - at)[0], cost=jnp.ones(()), terminated=jnp.zeros(()))

    return Env("line", horizon=20, obs_size=1, action_space=action_space or Box(1), reset=reset, step=step)


def test_the_steps_of_all_are_those_of_both_candidates():
    assert beside.steps_of(LearnerConfig(iterations=10, num_trajectories=16, candidates=2, trial=0.5), 500) == 120_000
    assert beside.steps_of(LearnerConfig(iterations=10, num_trajectories=16, candidates=1), 500) == 80_000


def test_what_is_played_is_paid_the_true_reward_of_every_step():
    returns = brax_ppo.returns_of(line(), lambda seen, key: jnp.ones(1), 64, jax.random.key(0))
    np.testing.assert_allclose(np.asarray(returns).mean(), 2.0, atol=0.03)
    np.testing.assert_allclose(np.asarray(returns).std(), 0.01 * np.sqrt(20), rtol=0.4)


def test_the_table_has_a_line_a_cell_in_the_order_of_learners():
    cell = {"seeds": [0, 1], "commit": "abc", "env_steps_per_seed": 1000, "cpu_s_per_seed": 3.0}
    cells = [
        {**cell, "task": "hopper", "learner": "brax", "return": [10.0, 20.0]},
        {**cell, "task": "hopper", "learner": "ours", "return": [30.0, 50.0]},
    ]
    rows = [row for row in beside.table(cells, "command").splitlines() if row.startswith("| hopper")]
    assert rows[0].startswith("| hopper | ours (docs/learner.md) | 1,000 | 40 | 30 50 |")
    assert rows[1].startswith("| hopper | Brax's PPO, settings of its notebook | 1,000 | 15 | 10 20 |")


def test_fewer_seeds_and_other_bodies_are_refused_in_the_folder_of_the_results(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert command.main(["beside=brax", "seeds=1"]) == 2
    assert "seeds=1 iterations=0: choose out=DIR" in capsys.readouterr().err
    assert command.main(["beside=brax", "tasks=swimmer"]) == 2
    assert "unknown task 'swimmer'; choose from halfcheetah, hopper, or all" in capsys.readouterr().err
    assert command.main(["beside=brax", "unit=3"]) == 2
    assert "unit=3 is of our own tasks" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_brax_is_missed_before_anything_is_trained(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "brax.training.agents.ppo.train", None)
    monkeypatch.setattr(beside, "_cell", lambda *_: pytest.fail("was trained"))
    assert command.main(["beside=brax"]) == 2
    assert "needs the package brax, which is not installed" in capsys.readouterr().err


def test_another_learner_has_three_seeds_unless_more_are_asked_for(monkeypatch):
    asked = []
    monkeypatch.setattr(command, "compare", lambda tasks, budget, words: asked.append((len(budget.seeds), str(budget.out))))
    assert command.main(["beside=brax"]) == 0
    assert command.main(["beside=brax", "seeds=10", "out=there"]) == 0
    assert asked == [(3, "results/learner_brax"), (10, "there")]


@pytest.mark.filterwarnings(WARNS)
def test_brax_sees_our_world():
    pytest.importorskip("brax.envs", reason="brax is not installed")
    world = line()
    theirs = brax_ppo.wrapped(world)
    begun = jax.jit(theirs.reset)(jax.random.PRNGKey(3))
    after = jax.jit(theirs.step)(begun, jnp.array([0.5]))
    own, _ = jax.random.split(begun.info["key"])
    moved, result = world.step(own, begun.obs, jnp.array([0.5]))
    np.testing.assert_allclose(after.obs, moved, rtol=1e-6)
    np.testing.assert_allclose(after.reward, result.reward, rtol=1e-5)
    assert not np.array_equal(begun.info["key"], after.info["key"])  # noise of its own each step
    with pytest.raises(ValueError, match="choose a world of such a box"):
        brax_ppo.wrapped(line(Discrete(2)))


@pytest.mark.slow
@pytest.mark.filterwarnings(WARNS)
def test_braxs_ppo_learns_to_go_where_it_is_paid():
    pytest.importorskip("brax.training", reason="brax is not installed")
    act, taken = brax_ppo.train_ppo(line(), 50_000, 0, TINY)
    assert taken == 20 * 2560  # whole rounds of 32 × 20 × 4 steps
    assert brax_ppo.returns_of(line(), act, 64, jax.random.key(1)).mean() > 1.5
