"""A shield leaves alone what passes, replaces what does not by the nearest that does, and says how often."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax import shield
from aircl_jax.methods import METHODS
from aircl_jax.model.networks import make_networks
from aircl_jax.runs.result import Result
from aircl_jax.transfer import judges
from aircl_jax.transfer.judges import ActionLimits, Judge, action_limits, judge_of, outermost
from aircl_jax.transfer.shield import Shielded
from envs import Box, Discrete
from tests.finished_runs import untrained, untrained_robot
from tests.worlds import UNOPTIMISED, table_of

OBS = jnp.zeros(8)


def constant(action):
    return lambda obs, key: jnp.asarray(action)


def below(limit: float) -> Judge:
    """δ₁ is 1 where every action is at most so great, and falls slowly above it."""

    def delta(obs, action):
        return jnp.where(action.max() <= limit, 1.0, 0.4 - 0.1 * action.max())

    return Judge(delta, None, "a limit")


@cache
def robot(constraint_input: str = "state_action", **settings) -> Result:
    result = untrained_robot("aircl_corrected")
    config = replace(result.networks.config, constraint_input=constraint_input, **settings)
    return replace(result, networks=replace(result.networks, config=config))


def test_what_passes_is_returned_as_it_is_and_what_does_not_by_the_nearest_of_draws():
    safe = Shielded(constant([3.0, -0.2]), below(0.3), Box(2))
    found = safe(OBS, jax.random.key(0))  # 3 counts as 1, as the world clips it
    assert 0.29 < found.max() <= 0.3
    assert abs(found[1] + 0.2) < 0.6
    free = Shielded(constant([-7.0, 0.2]), below(0.3), Box(2))
    np.testing.assert_array_equal(free(OBS, jax.random.key(0)), jnp.array([-7.0, 0.2]))
    assert str(free).startswith("0 of 1 actions replaced (0.0%), 0 of them by none that passes; judged by a limit")


def test_it_counts_what_it_replaces_and_where_nothing_passes():
    def both(obs, key):
        return jnp.where(obs[0] > 0, jnp.array([0.9, 0.0]), jnp.array([0.1, 0.0]))

    safe = Shielded(both, below(0.3), Box(2))
    for seen in (OBS, OBS + 1.0, OBS + 1.0):
        safe(seen, jax.random.key(0))
    assert (safe.steps, safe.replaced, safe.helpless) == (3, 2, 0)
    hopeless = Shielded(both, below(-2.0), Box(2))
    found = hopeless(OBS, jax.random.key(0))
    assert (hopeless.steps, hopeless.replaced, hopeless.helpless) == (1, 1, 1)
    assert found.max() < -0.2  # the least forbidden of the draws


def test_within_jit_it_decides_the_same_and_counts_nothing():
    safe = Shielded(constant([0.9, 0.0]), below(0.3), Box(2))
    keys = jax.random.split(jax.random.key(1), 4)
    together = jax.jit(jax.vmap(safe.decide, (None, 0)))(OBS, keys)
    assert safe.steps == 0
    np.testing.assert_allclose(together.action, [safe(OBS, key) for key in keys], rtol=1e-6)
    assert together.replaced.all() and together.feasible.all()


def test_of_numbered_actions_the_law_is_the_controllers_on_what_is_feasible():
    def controller(obs, key):
        return jax.random.choice(key, 4, p=jnp.array([0.5, 0.3, 0.2, 0.0]))

    judge = Judge(lambda obs, action: (action > 0).astype(jnp.float32), None, "above 0")
    safe = Shielded(controller, judge, Discrete(4))
    drawn = jax.jit(jax.vmap(safe, (None, 0)))(OBS, jax.random.split(jax.random.key(0), 4000))
    np.testing.assert_allclose(np.bincount(drawn, minlength=4) / 4000, [0.0, 0.6, 0.4, 0.0], atol=0.03)
    stubborn = Shielded(constant(0), Judge(lambda obs, action: 0.2 * action, None, ""), Discrete(4))
    assert stubborn(OBS, jax.random.key(0)) == 3  # it draws nothing else, so the best of all
    assert stubborn.helpless == 0


def test_a_controller_in_plain_python_can_be_shielded():
    safe = Shielded(lambda obs, key: np.array([0.9, float(obs[1])]), below(0.3), Box(2))
    assert np.asarray(safe(np.zeros(8), jax.random.key(0))).max() <= 0.3
    numbered = Shielded(lambda obs, key: 2, Judge(lambda obs, action: 1.0 - 0.5 * (action > 1), None, ""), Discrete(3))
    assert numbered(np.zeros(8), jax.random.key(0)) == 2


def test_the_limits_are_the_recovered_ones_within_what_was_demonstrated(monkeypatch):
    def walls(nets, state, grid, steps):
        """δ₁ is 0 outside ±0.6 of both motors, and of the rear one within ±0.1 too."""
        rear = jnp.arange(10) == 9
        return jnp.where((jnp.abs(grid) > 0.6) | (rear & (jnp.abs(grid) < 0.1)), 0.0, 1.0)

    monkeypatch.setattr(judges, "mean_delta", walls)
    monkeypatch.setattr("aircl_jax.analysis.recovered_limits.mean_delta", walls)
    result = robot()
    expert = result.expert._replace(action=jnp.clip(result.expert.action, -0.55, 0.7))
    found = action_limits(replace(result, expert=expert), 0)
    assert found is not None
    np.testing.assert_allclose(found.low, [-0.55, -0.55], atol=1e-6)
    np.testing.assert_allclose(found.high, [0.6, 0.6], atol=0.01)  # no limit is drawn beside a gap in the middle
    safe = shield(replace(result, expert=expert))(constant([0.9, -0.3]))
    np.testing.assert_allclose(safe(OBS, jax.random.key(0)), [found.high[0], -0.3], atol=1e-6)
    assert "recovered limits" in str(safe)


def test_the_outermost_value_that_passes_is_between_the_points_around_a_half(monkeypatch):
    slope = ActionLimits(np.array([-0.5, -0.5]), np.array([0.5, 0.5]))
    monkeypatch.setattr(judges, "mean_delta", lambda nets, state, grid, steps: 1.0 - jnp.abs(grid))
    for end, expected in zip(outermost(robot(), 1), slope, strict=True):
        np.testing.assert_allclose(end, expected, atol=1e-6)


def test_without_a_limit_the_projection_is_by_the_sum_and_else_by_draws(monkeypatch):
    monkeypatch.setattr(judges, "action_limits", lambda result, index: None)
    additive = untrained_robot("aircl_corrected")
    config = replace(additive.networks.config, step_network="additive", additive_hidden=(4,))
    assert judge_of(additive, 0, "default").words == "δ₁, nearest of draws"  # TINY has a joint network
    nets = make_networks(additive.spec.env, additive.networks.method, config)
    params = jax.jit(jax.vmap(nets.init), compiler_options=UNOPTIMISED)(jax.random.split(jax.random.key(0), 2))
    summed = replace(additive, networks=nets, states=additive.states._replace(params=params))
    judge = judge_of(summed, 1, "default")
    assert judge.nearest is not None
    bound = summed.bound(1)
    obs, wanted = jax.random.normal(jax.random.key(1), (8,)), jnp.array([0.9, -0.8])
    grid = jnp.linspace(-1, 1, 81)
    pairs = jnp.stack(jnp.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    logit = jax.jit(jax.vmap(bound.step_logit, (None, 0)))(obs, pairs)
    monkeypatch.setattr(judges, "least_logit", lambda nets: jnp.quantile(logit, 0.7))
    nearest = judge_of(summed, 1, "sum").nearest
    assert nearest is not None
    found = jax.jit(nearest)(obs, wanted)
    assert bound.step_logit(obs, found) >= jnp.quantile(logit, 0.7) - 1e-4
    exact = jnp.sqrt(((pairs - wanted) ** 2).sum(axis=1)[logit >= jnp.quantile(logit, 0.7)].min())
    assert jnp.sqrt(((found - wanted) ** 2).sum()) <= exact + 0.1


def test_on_a_grid_an_action_is_judged_by_where_it_leads():
    result = untrained("aircl_corrected")  # δ₁ is of states there
    table, nets = table_of(result.spec.env), result.bound(0)
    judge, coefficients = judge_of(result, 0, "default"), result.networks.config.coefficients
    every = jax.jit(jax.vmap(jax.vmap(judge.delta, (None, 0)), (0, None)), compiler_options=UNOPTIMISED)
    logit = jax.jit(jax.vmap(lambda seen: nets.step_logit(seen, jnp.asarray(0))))(table.obs)
    of_state = jnp.maximum(jax.nn.sigmoid(coefficients.sharpness * (logit - jnp.log(coefficients.threshold))), np.exp(-10))
    np.testing.assert_allclose(every(table.obs, jnp.arange(4)), table.transition @ of_state, rtol=1e-3)


def of_method(result: Result, name: str) -> Result:
    return replace(result, networks=replace(result.networks, method=METHODS[name]))


@pytest.mark.parametrize(
    ("result", "by", "says"),
    [
        (lambda: of_method(robot(), "airl_centred"), "default", "learns no constraint of single steps"),
        (lambda: untrained("aircl_corrected"), "sum", "actions of gridworld are numbered; choose draws"),
        (lambda: robot("state"), "default", "is of states alone, and no action can be judged"),
        (robot, "sum", "is no sum over coordinates; choose draws"),
    ],
)
def test_what_cannot_be_judged_is_refused_in_one_line(result, by, says):
    with pytest.raises(ValueError, match=says) as refused:
        shield(result(), by=by)
    assert "\n" not in str(refused.value)


def test_a_run_without_limits_refuses_to_shield_by_them(monkeypatch):
    monkeypatch.setattr(judges, "action_limits", lambda result, index: None)
    with pytest.raises(ValueError, match="by='limits': the run drew none"):
        shield(robot(), by="limits")
