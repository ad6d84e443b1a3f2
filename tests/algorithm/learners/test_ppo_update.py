"""One PPO update by hand: advantages, targets, losses and what is reported of them."""

from dataclasses import replace
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.learners import ppo
from aircl_jax.settings.train_config import PPOConfig
from aircl_jax.types import Metrics, Params
from envs import Box
from tests.worlds import KNOWN_REWARD, TINY, one_state_env, random_trajectories, tiny_grid, tiny_networks, unit_stats

GRID, NUMBER = tiny_grid(), 6
STATS = unit_stats(GRID)
CONFIG = PPOConfig(
    learning_rate=0.01, clip_eps=0.2, num_epochs=1, minibatch_size=10_000, discount=0.8, gae_lambda=0.6, value_coef=0.3
)
RANDOM = np.random.default_rng(5)
POLICY = random_trajectories(GRID, 1, NUMBER)._replace(
    value=jnp.asarray(RANDOM.normal(size=(NUMBER, 4))), bootstrap=jnp.asarray(RANDOM.normal(size=NUMBER))
)
REWARD, BONUS = jnp.asarray(RANDOM.normal(size=(NUMBER, 4))), jnp.asarray(3.0 * RANDOM.normal(size=NUMBER))
NETS, PARAMS = tiny_networks(GRID, KNOWN_REWARD)
LENGTHS = [int(length) for length in POLICY.mask.sum(axis=1)]


@cache
def updated(epochs: int) -> tuple[Params, Metrics]:
    config = replace(CONFIG, num_epochs=epochs)
    start = ppo.make_optimiser(config).init((PARAMS.policy, PARAMS.value))

    def run(params: Params) -> tuple[Params, Any, Metrics]:
        return ppo.update(NETS.bind(params, STATS), start, POLICY, REWARD, BONUS, jax.random.key(0), config)

    after, _, metrics = jax.jit(run)(PARAMS)
    return after, metrics


def advantages() -> list[np.ndarray]:
    """Â of the unmasked steps by the double sum; V after the end is 0, unless the horizon cut the episode."""
    found = []
    for n, length in enumerate(LENGTHS):
        value = [float(v) for v in POLICY.value[n, :length]] + [float(POLICY.bootstrap[n]) if length == 4 else 0.0]
        delta = [float(REWARD[n, t]) + 0.8 * value[t + 1] - value[t] for t in range(length)]
        found.append(np.array([sum(0.48 ** (u - t) * delta[u] for u in range(t, length)) for t in range(length)]))
    return found


def by_hand(params: Params) -> Metrics:
    """What an update on all episodes at once reports of these parameters."""
    plain, nets = advantages(), NETS.bind(params, STATS)
    rewarded = np.concatenate([gain + float(BONUS[n]) for n, gain in enumerate(plain)])
    gain = (rewarded - rewarded.mean()) / rewarded.std()
    steps = [(n, t) for n, length in enumerate(LENGTHS) for t in range(length)]
    see = [(POLICY.obs[n, t], jnp.asarray(t)) for n, t in steps]
    new = np.array([nets.policy(*seen).log_prob(POLICY.action[at]) for seen, at in zip(see, steps, strict=True)])
    old = np.array([POLICY.log_prob[at] for at in steps])
    ratio = np.exp(new - old)
    value = np.array([nets.value(*seen) for seen in see])
    target = np.concatenate([gain + np.asarray(POLICY.value[n, : len(gain)]) for n, gain in enumerate(plain)])
    assert 0 < (abs(ratio - 1) > 0.2).mean() < 1
    return {
        "policy_loss": -np.minimum(ratio * gain, np.clip(ratio, 0.8, 1.2) * gain).mean(),
        "value_loss": ((value - target) ** 2).mean() / 2,
        "approx_kl": (old - new).mean(),
        "clip_share": (abs(ratio - 1) > 0.2).mean(),
    }


@pytest.mark.parametrize("name", ["policy_loss", "value_loss", "approx_kl", "clip_share"])
def test_what_ppo_reports_is_worked_out_over_the_steps_before_each_episodes_end(name):
    np.testing.assert_allclose(updated(1)[1][name], by_hand(PARAMS)[name], rtol=1e-4)


@pytest.mark.parametrize("name", ["policy_loss", "value_loss", "approx_kl", "clip_share"])
def test_what_ppo_reports_is_that_of_the_last_epoch(name):
    np.testing.assert_allclose(updated(2)[1][name], by_hand(updated(1)[0])[name], rtol=1e-3)


def test_an_update_makes_what_paid_likelier_and_the_value_truer():
    before, after = by_hand(PARAMS), by_hand(updated(1)[0])
    assert after["policy_loss"] < before["policy_loss"]
    assert after["value_loss"] < before["value_loss"]


def test_the_loss_is_that_of_the_policy_and_the_weighted_one_of_the_critic():
    batch = ppo.Batch(POLICY, advantage=REWARD, target=REWARD)
    total, metrics = ppo.loss(NETS.bind(PARAMS, STATS), batch, CONFIG)
    np.testing.assert_allclose(total, metrics["policy_loss"] + 0.3 * metrics["value_loss"], rtol=1e-5)


def test_an_epoch_has_an_order_of_its_own(monkeypatch):
    orders = []
    drawn = ppo.epoch_order

    def noted(key: Any, *sizes: int) -> Any:
        order = drawn(key, *sizes)
        jax.debug.callback(lambda order: orders.append(tuple(order.ravel().tolist())), order)
        return order

    monkeypatch.setattr(ppo, "epoch_order", noted)
    config = replace(CONFIG, num_epochs=3, minibatch_size=4)
    start = ppo.make_optimiser(config).init((PARAMS.policy, PARAMS.value))
    ppo.update(NETS.bind(PARAMS, STATS), start, POLICY, REWARD, BONUS, jax.random.key(0), config)
    jax.effects_barrier()
    assert len(set(orders)) == 3


def test_log_std_of_an_updated_policy_is_kept_in_its_bounds():
    env = one_state_env(lambda t, action: action.sum(), action_space=Box(1))
    config = replace(CONFIG, log_std_init=-0.5, log_std_max=-0.5)
    nets, params = tiny_networks(env, KNOWN_REWARD, replace(TINY, ppo=config))
    far = random_trajectories(env, 0, 2)._replace(action=jnp.asarray([[[0.0]], [[2.0]]]), log_prob=jnp.full((2, 1), -2.0))
    start = ppo.make_optimiser(config).init((params.policy, params.value))
    paid = jnp.asarray([[0.0], [1.0]])  # for what lies far out: σ would rise
    after, _, _ = ppo.update(nets.bind(params, unit_stats(env)), start, far, paid, jnp.zeros(2), jax.random.key(0), config)
    assert after.policy["params"]["log_std"] == -0.5
