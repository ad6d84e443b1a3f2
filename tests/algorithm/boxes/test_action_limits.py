"""The limits of actions: n against M by hand."""

from dataclasses import replace
from statistics import NormalDist

import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.boxes.action_limits import BINS, EDGES, Made, actions_made, limits, share_expected
from aircl_jax.methods import get_method
from aircl_jax.model.feasibility import log_step_feasibility
from aircl_jax.model.features import UNLIMITED
from aircl_jax.settings.train_config import Coefficients
from aircl_jax.types import FeasibilityScores, Thresholds
from envs import make_env
from tests.worlds import TINY, tiny_networks, unit_stats

COEFFICIENTS = Coefficients(threshold=0.05, pseudo_count=0.5, least_expected=500.0)


def demonstrated(number=4000, limit=0.5, lapses=0.0):
    """Actions of one motor, evenly spread within ±limit; a share of them over the whole box."""
    random = np.random.default_rng(0)
    within = random.uniform(-limit, limit, number)
    return np.where(random.uniform(size=number) < lapses, random.uniform(-1, 1, number), within)[:, None]


def drawn(action, share, **changed):
    made = actions_made(jnp.asarray(action, jnp.float32), jnp.ones(len(action)))
    lower, upper = limits(made, jnp.asarray(share, jnp.float32), replace(COEFFICIENTS, **changed))
    return float(lower[0]), float(upper[0])


EVENLY = np.full((1, BINS), 1.0 / BINS)  # a twin that does everything equally often


def test_actions_are_counted_in_bins_with_the_outermost_of_each():
    action = jnp.array([[-1.0], [0.005], [0.007], [1.0], [0.9]])
    made = actions_made(action, jnp.array([1.0, 1.0, 1.0, 1.0, 0.0]))
    assert float(made.steps) == 4
    assert {place: int(n) for place, n in enumerate(made.number[0]) if n} == {0: 1, 90: 2, 179: 1}
    assert (float(made.least[0, 90]), float(made.greatest[0, 90])) == (pytest.approx(0.005), pytest.approx(0.007))
    assert float(made.greatest[0, 171]) == -UNLIMITED  # masked


def test_expected_shares_are_those_of_the_clipped_gaussian_where_the_demonstrated_action_is_on_the_same_side():
    mean, std = np.array([[0.3, -0.2], [0.9, 0.0], [0.4, 0.1]]), np.array([0.2, 0.5])
    action, mask = np.array([[0.1, -0.7], [0.5, 0.5], [-0.2, 0.0]]), np.array([1.0, 0.0, 1.0])
    share = np.asarray(share_expected(*(jnp.asarray(given) for given in (mean, std, action, mask))))
    edges = np.asarray(EDGES, float)
    for motor in range(2):
        expected = np.zeros(BINS)
        for state in (0, 2):  # not the masked one
            below = [NormalDist(mean[state, motor], std[motor]).cdf(edge) for edge in edges[1:-1]]
            inside = np.diff([0.0, *below, 1.0])
            taken = action[state, motor]
            expected += np.where(edges[:-1] >= -1e-9, inside * (taken > 0), inside * (taken < 0)) / 2
        np.testing.assert_allclose(share[motor], expected, atol=1e-5)
    assert share.sum() < 2.0


def test_what_a_tempted_policy_does_where_demonstrations_go_the_other_way_draws_no_limit():
    random = np.random.default_rng(1)
    state = random.uniform(-1, 1, 4000)
    action = np.where(state > 0, 0.5, -0.2) * random.uniform(size=4000)  # limited above; of its own will below
    made = actions_made(jnp.asarray(action[:, None], jnp.float32), jnp.ones(4000))
    for twin, below in ((np.where(state > 0, 0.9, -0.15), -UNLIMITED), (np.where(state > 0, -0.6, 0.9), -UNLIMITED)):
        share = share_expected(jnp.asarray(twin[:, None]), jnp.asarray([0.05]), jnp.asarray(action[:, None]), jnp.ones(4000))
        lower, upper = limits(made, share, COEFFICIENTS)
        assert float(lower[0]) == below
        assert float(upper[0]) == (pytest.approx(action.max()) if twin[state > 0][0] > 0 else UNLIMITED)


def test_the_limit_is_the_outermost_action_where_a_tempted_policy_would_go_beyond():
    action = demonstrated()
    lower, upper = drawn(action, EVENLY)
    assert (lower, upper) == (pytest.approx(action.min()), pytest.approx(action.max()))


@pytest.mark.parametrize(("at", "limit"), [(0.54, 0.54), (0.6, 0.5)])
def test_the_few_actions_next_to_what_is_done_often_still_say_where_the_limit_is(at, limit):
    action = np.concatenate([demonstrated(40_000), [[at]]])
    assert drawn(action, EVENLY)[1] == pytest.approx(limit, abs=2e-3)


def test_a_lapse_next_to_a_limit_is_no_limit():
    beyond = np.linspace(0.5, 1.0, 91)[1:, None]  # two in each bin
    assert drawn(np.concatenate([demonstrated(40_000), beyond]), EVENLY)[1] == pytest.approx(0.5, abs=0.012)


def test_bins_of_which_little_is_expected_hide_no_limit():
    places = (np.asarray(EDGES)[1:] + np.asarray(EDGES)[:-1]) / 2
    narrow = np.exp(-0.5 * (places / 0.25) ** 2)[None]  # hardly ever beyond .8
    assert drawn(demonstrated(40_000, limit=0.4), narrow / narrow.sum())[1] == pytest.approx(0.4, abs=2e-3)


def test_each_side_has_its_own_limit():
    action = demonstrated() * 0.5 + 0.2  # between −.05 and .45
    lower, upper = drawn(action, EVENLY)
    assert (lower, upper) == (pytest.approx(action.min(), rel=1e-5), pytest.approx(action.max(), rel=1e-5))


def test_nothing_is_said_where_a_tempted_policy_would_not_have_gone():
    within = np.where(np.abs(EDGES[1:] + EDGES[:-1]) / 2 < 0.5, 1.0, 0.0)[None]
    assert drawn(demonstrated(), within / within.sum()) == (-UNLIMITED, UNLIMITED)


@pytest.mark.parametrize(("least", "found"), [(990.0, True), (1010.0, False)])
def test_a_limit_needs_so_many_expected_actions_beyond_it(least, found):
    limit = drawn(demonstrated(), EVENLY, least_expected=least)[1]  # a quarter of 4,000 beyond it
    assert (limit < UNLIMITED) == found


@pytest.mark.parametrize(("lapses", "found"), [(0.01, True), (0.2, False)])
def test_rare_lapses_hide_no_limit_and_frequent_ones_do(lapses, found):
    lower, upper = drawn(demonstrated(40_000, lapses=lapses), EVENLY)
    assert (abs(upper - 0.5) < 0.01) == found == (abs(lower + 0.5) < 0.01)


@pytest.mark.parametrize("lapses", [0.01, 0.05])
def test_lapses_hide_no_limit_where_a_tempted_policy_goes_to_the_end_of_its_box(lapses):
    """In a bin between there are as many lapses as the twin would be there, but far fewer than it would be beyond."""
    to_the_ends = np.full((1, BINS), 0.06 / BINS)
    to_the_ends[0, [0, -1]] = 0.4
    action = demonstrated(25_000, lapses=lapses)
    lower, upper = drawn(action, to_the_ends)
    assert (lower, upper) == (pytest.approx(-0.5, abs=0.012), pytest.approx(0.5, abs=0.012))
    often = np.concatenate([action, np.random.default_rng(1).uniform(0.7, 0.72, (400, 1))])  # done here, if seldom
    assert drawn(often, to_the_ends)[1] == pytest.approx(0.72, abs=0.012)


def test_what_is_done_freely_has_no_limit():
    lower, upper = drawn(demonstrated(limit=1.0), EVENLY)
    assert (lower, upper) == (-UNLIMITED, UNLIMITED)


def test_motors_are_counted_apart():
    action = np.concatenate([demonstrated(limit=0.3), demonstrated(limit=0.6)], axis=1)
    made = actions_made(jnp.asarray(action, jnp.float32), jnp.ones(len(action)))
    lower, upper = limits(made, jnp.asarray(np.repeat(EVENLY, 2, axis=0), jnp.float32), COEFFICIENTS)
    np.testing.assert_allclose(upper, action.max(axis=0), rtol=1e-5)
    np.testing.assert_allclose(lower, action.min(axis=0), rtol=1e-5)
    assert isinstance(made, Made)


@pytest.mark.parametrize(
    ("action", "allowed"),
    [
        ((0.0, 0.0), True),
        ((0.49, -0.39), True),
        ((0.51, 0.0), False),
        ((0.0, -0.41), False),
        ((5.0, 0.0), False),
        ((0.0, 5.0), True),
    ],
)
def test_a_step_is_feasible_within_the_limits_of_every_motor(action, allowed):
    env = make_env("swimmer", horizon=8)
    method = get_method("aircl_contrast", of_box=True)
    nets, params = tiny_networks(env, method, replace(TINY, coefficients=COEFFICIENTS))
    ends = {"lower": jnp.array([-0.5, -0.4]), "upper": jnp.array([0.5, UNLIMITED])}
    bound = nets.bind(params, unit_stats(env)).with_params(feasibility={"step": {"params": ends}})
    logit = bound.step_logit(jnp.zeros(8), jnp.array(action))
    scores = FeasibilityScores(logit[None], jnp.zeros(()), jnp.ones(1), Thresholds(jnp.zeros(()), jnp.zeros(())))
    delta = float(jnp.exp(log_step_feasibility(method, COEFFICIENTS, scores)[0]))
    assert (delta > 0.9) == allowed
    assert (delta < 0.1) == (not allowed)
