"""The baselines with the contrast row's learner: what one fused step moves and reads, and what π is paid and charged."""

from dataclasses import replace
from functools import cache
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.interpreters.partial_eval import dce_jaxpr

from aircl_jax.algorithm.boxes import baselines, twins
from aircl_jax.algorithm.measures import FINITE
from aircl_jax.algorithm.trainer import make_trainer, observation_stats
from aircl_jax.methods import METHODS, get_method
from aircl_jax.settings.env_defaults import config_of, default_config
from aircl_jax.settings.train_config import AdversaryConfig
from aircl_jax.types import TrainState
from envs import make_env
from tests.algorithm.boxes.test_twins import CONFIG as OF_TWINS
from tests.algorithm.boxes.test_twins import pushed_point, same, shown
from tests.worlds import UNOPTIMISED, poisoned, tiny_grid, tiny_networks

ROWS = [name for name, row in METHODS.items() if row.practises]
KNOWING = [name for name in ROWS if METHODS[name].needs_true_reward]
CONFIG = replace(
    OF_TWINS, temperature=0.5, step_network="additive", additive_hidden=(3,), adversary=AdversaryConfig(num_steps=2)
)


@cache
def stepped(name, prior: Literal["method", "on"] = "method"):
    """The first state, the next one and its metrics."""
    expert = shown(pushed_point())
    trainer = make_trainer(pushed_point(), get_method(name, prior), CONFIG)

    def run(key):
        first = trainer.init(key, expert)
        return first, *trainer.step(first, expert)

    return jax.jit(run, compiler_options=UNOPTIMISED)(jax.random.key(0))


def test_the_tuned_rows_are_the_papers_baselines_with_another_learner():
    assert sorted(ROWS) == ["airl_tuned", "gacl_tuned", "icrl_tuned"]
    for name in ROWS:
        row, papers = METHODS[name], METHODS[name.removesuffix("_tuned")]
        assert (row.terms, row.reward, row.discriminator_of) == (papers.terms, papers.reward, papers.discriminator_of)
    assert METHODS["airl_tuned"].state_reward


@pytest.mark.slow
@pytest.mark.parametrize("name", ROWS)
def test_a_step_moves_what_the_row_learns_and_nothing_else(name):
    row, (first, last, metrics) = METHODS[name], stepped(name)
    assert last.step == 1
    assert not same(first.params.policy, last.params.policy)
    assert not same(first.params.value, last.params.value)
    assert same(first.params.reward, last.params.reward) != row.learns_reward
    assert same(first.params.feasibility, last.params.feasibility) != row.learns_feasibility
    assert same((last.params.policy, last.params.value), (last.ppo_opt.trained.policy, last.ppo_opt.trained.value))
    assert metrics[FINITE] == 1
    assert {f"loss_{term}" for term in row.terms} <= set(metrics)
    assert jax.tree.structure(first) == jax.tree.structure(last)


@pytest.mark.slow
def test_the_prior_of_icrl_is_an_option():
    assert "loss_contrast" in stepped("icrl_tuned", "on")[2]
    assert "loss_contrast" not in stepped("icrl_tuned")[2]


def reads(name, field):
    """Whether what a fused step keeps depends on the true reward or cost of the world, or of the demonstrations."""
    base, expert = pushed_point(), shown(pushed_point())
    state = jax.eval_shape(make_trainer(base, METHODS[name], CONFIG).init, jax.random.key(0), expert)

    def step(true: tuple, state: TrainState):
        of_world, of_expert = true
        zero = jnp.zeros(())
        env = poisoned(base, of_world if field == "reward" else zero, of_world if field == "cost" else zero)
        new, _ = make_trainer(env, METHODS[name], CONFIG).step(state, expert._replace(**{field: of_expert}))
        return new.params, new.ppo_opt, new.adversary_opt

    closed = jax.make_jaxpr(step)((jnp.zeros(()), getattr(expert, field)), state)
    return dce_jaxpr(closed.jaxpr, [True] * len(closed.jaxpr.outvars))[1][:2]


@pytest.mark.parametrize("name", ROWS)
def test_no_tuned_row_reads_the_true_cost(name):
    assert reads(name, "cost") == [False, False]


@pytest.mark.parametrize("name", ROWS)
def test_only_the_rows_that_know_the_reward_read_it_and_only_the_worlds(name):
    assert reads(name, "reward") == [name in KNOWING, False]


def bound(name):
    nets, params = tiny_networks(pushed_point(), METHODS[name], CONFIG)
    expert = shown(pushed_point())
    return nets.bind(params, observation_stats(expert)), expert


def test_what_is_paid_is_the_true_reward_or_that_of_the_state_and_the_entropy():
    nets, expert = bound("airl_tuned")
    drawn = expert._replace(log_prob=jnp.asarray(np.random.default_rng(1).normal(size=expert.mask.shape)))
    twice = drawn._replace(action=2.0 * drawn.action, reward=drawn.reward + 1.0)
    of_state = np.asarray(jax.vmap(jax.vmap(lambda obs: nets.reward(obs, jnp.zeros(1))))(drawn.obs))
    np.testing.assert_allclose(baselines.paid(nets, drawn), of_state - 0.5 * np.asarray(drawn.log_prob), rtol=1e-5)
    np.testing.assert_array_equal(baselines.paid(nets, drawn), baselines.paid(nets, twice))
    for name in KNOWING:
        np.testing.assert_array_equal(baselines.paid(bound(name)[0], drawn), drawn.reward)


def test_gacl_charges_minus_log_delta_everywhere_and_icrl_what_lies_beyond_one_half():
    for name in KNOWING:
        nets, expert = bound(name)
        of_step = nets.params.feasibility["step"]["params"]
        middle = jnp.median(jax.vmap(nets.feasibility_scores)(expert).step_logit)
        nets = nets.with_params(feasibility={"step": {"params": {**of_step, "bias": of_step["bias"] - middle}}})
        logit = np.asarray(jax.vmap(jax.vmap(nets.step_logit))(expert.obs, expert.action), float)
        assert 0 < (logit < 0).mean() < 1
        minus_log = np.log1p(np.exp(-logit))
        beyond = np.where(logit < 0, np.minimum(minus_log / np.log(2.0), twins.MOST_CHARGED), 0.0)
        expected = minus_log if name == "gacl_tuned" else beyond
        np.testing.assert_allclose(baselines.charged(nets, expert), expected, rtol=1e-4)
    assert not baselines.charged(*bound("airl_tuned")).any()


@pytest.mark.parametrize("name", ROWS)
def test_a_world_of_discrete_actions_or_a_finite_horizon_is_refused_in_a_line(name):
    for world in (tiny_grid(), replace(pushed_point(), finite_horizon=True)):
        with pytest.raises(ValueError, match=f"env={world.name} is no world of a bounded box .*; choose airl, gacl or icrl"):
            make_trainer(world, METHODS[name], CONFIG)


def test_all_worlds_share_one_row_of_settings_and_as_many_steps_an_iteration():
    rows = {
        name: default_config(name, "practice")
        for name in ("swimmer", "walker", "halfcheetah", "hopper", "pendulum", "gymnasium")
    }
    assert {name: row.num_trajectories for name, row in rows.items()} == {
        **dict.fromkeys(("swimmer", "walker", "halfcheetah", "hopper"), 16),
        "pendulum": 80,
        "gymnasium": 40,
    }
    contrast = {name: default_config(name, "contrast") for name in rows}
    own = {"feasibility_delay": 0, "step_network": "additive", "temperature": 0.1, "adversary": rows["swimmer"].adversary}
    assert rows == {name: replace(row, **own) for name, row in contrast.items()}
    assert config_of(pushed_point(horizon=6), "practice") == replace(rows["swimmer"], num_trajectories=1334)
    assert config_of(make_env("pendulum"), "practice") == rows["pendulum"]
