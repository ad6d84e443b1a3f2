"""The card of a row with a twin, on a robot whose θ, limits, n and M are known."""

import json
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.boxes.action_limits import BINS, Made
from aircl_jax.algorithm.boxes.moments import Weights
from aircl_jax.algorithm.boxes.state_limits import Met
from aircl_jax.algorithm.boxes.twins import Contrast
from aircl_jax.analysis.recovered_limits import measures_of_limits, recovered_limits
from aircl_jax.model.features import UNLIMITED
from aircl_jax.model.networks import make_networks
from aircl_jax.reports.card import as_json, as_markdown, card_of, closing, is_card
from tests.finished_runs import untrained_robot

RUN = untrained_robot("aircl_contrast")


def outermost(number: np.ndarray, elsewhere: float) -> Any:
    """Where something was done in a bin, it was done in its middle."""
    middle = np.linspace(-1, 1, BINS + 1)[:-1] + 1 / BINS
    return jnp.asarray(np.where(number > 0, middle, elsewhere), jnp.float32)


def known(upper=((0.48, UNLIMITED), (0.5, UNLIMITED)), theta=((3, 0.5), (8, 0.02))) -> Any:
    """Two seeds: f is 0.5 a standard deviation of the fourth coordinate; the front motor stops at .48 and at .5."""
    weights = np.zeros((2, 16))
    for index, value in theta:
        weights[:, index] = value
    ends = {"lower": jnp.full((2, 2), -UNLIMITED), "upper": jnp.asarray(upper, jnp.float32)}
    number = np.zeros((2, 2, BINS))
    number[:, :, BINS // 2] = 100.0
    number[:, 0, 150] = 1.0  # at .67
    expected = np.full((2, 2, BINS), 1.0 / BINS)
    counts = jnp.asarray(number, jnp.float32)
    made = Made(counts, outermost(number, UNLIMITED), outermost(number, -UNLIMITED), jnp.full(2, 1000.0))
    nothing: Any = None
    unused = Weights(*[nothing] * 5)
    contrast = Contrast(unused, made, jnp.asarray(expected), *[nothing] * 6)
    params = RUN.states.params._replace(
        reward={"params": {"weights": jnp.asarray(weights)}}, feasibility={"step": {"params": ends}}
    )
    expert = RUN.expert._replace(action=jnp.clip(RUN.expert.action, -0.9, 0.9))
    return replace(RUN, expert=expert, states=RUN.states._replace(params=params, adversary_opt=contrast))


def test_what_is_wanted_is_named_with_its_weight_and_trifles_are_left_out():
    (wanted, squared) = card_of(known())["wants"]
    assert (wanted["what"], wanted["weight"], wanted["spread"]) == ("velocity of x", pytest.approx(0.5), 0.0)
    assert squared["what"] == "(heading)², less what is usual"
    assert len(card_of(known(theta=((3, 0.5), (8, 0.004))))["wants"]) == 1


def test_a_limit_is_listed_with_its_spread_what_was_expected_beyond_it_and_what_was_done():
    (never,) = card_of(known())["never"]
    assert never["what"] == "motor front above"
    assert (never["limit"], never["spread"]) == (pytest.approx(0.49), pytest.approx(0.01))
    outside = [int((np.linspace(-1, 1, BINS + 1)[:-1] >= limit).sum()) for limit in (0.48, 0.5)]  # each seed's own
    assert never["tempted"] == pytest.approx(1000.0 * np.mean(outside) / BINS, rel=1e-4)
    assert never["done"] == 1.0
    assert never["how"] == "n against M, in 2 of 2 seeds"


@pytest.mark.parametrize(("limit", "at"), [(0.5, 135), (-0.3, 62)])
def test_what_is_done_up_to_the_limit_and_no_further_is_not_beyond_it_wherever_bins_begin(limit, at):
    """A motor that saturates where a bin begins or ends; in float32 the edge at −.3 is a little above it."""
    run, above = known(), limit > 0
    contrast, side = run.states.adversary_opt, "upper" if limit > 0 else "lower"
    number, none = np.zeros((2, 2, BINS)), UNLIMITED if above else -UNLIMITED
    number[:, 0, at], number[:, 0, 150 if above else 20] = 700.0, 1.0
    ends = {"upper": jnp.full((2, 2), UNLIMITED), "lower": jnp.full((2, 2), -UNLIMITED)}
    ends[side] = jnp.asarray([[limit, none]] * 2, jnp.float32)
    furthest = outermost(number, -none).at[:, 0, at].set(limit)
    made = contrast.made._replace(number=jnp.asarray(number), **{"greatest" if above else "least": furthest})
    params = run.states.params._replace(feasibility={"step": {"params": ends}})
    states = run.states._replace(params=params, adversary_opt=contrast._replace(made=made))
    (never,) = card_of(replace(run, states=states))["never"]
    assert never["done"] == 1.0
    assert never["tempted"] == pytest.approx(1000.0 * (BINS - 135 if above else 63) / BINS, rel=1e-4)


def test_a_limit_of_half_of_the_seeds_is_not_listed():
    card = card_of(known(upper=((0.48, UNLIMITED), (UNLIMITED, UNLIMITED))))
    assert card["never"] == []
    assert "motor front above" in card["cannot_tell"][0]


def test_what_was_never_tested_is_said_with_how_often_it_would_have_been_done():
    (untested, *_) = card_of(known())["cannot_tell"]
    assert untested.startswith("Not tested: motor front below")
    assert "motor rear above" in untested
    assert "motor front above" not in untested


def test_a_side_that_is_used_to_its_end_is_neither_limited_nor_untested_and_a_lapse_is_no_use():
    run = known()
    expert = jax.tree.map(lambda leaf: jnp.repeat(leaf, 100, axis=1), run.expert)
    action = np.asarray(expert.action).copy()
    steps = np.argwhere(np.asarray(expert.mask[0]) > 0)
    used = len(steps) // 50  # 2 %
    for episode, t in steps[:used]:
        action[:, episode, t] = (1.0, -1.3)  # of the second the world takes -1; of the first it is beyond what is drawn
    action[:, steps[used][0], steps[used][1], 1] = 1.0  # once
    card = card_of(replace(run, expert=expert._replace(action=jnp.asarray(action))))
    untested, told, *_ = card["cannot_tell"]
    assert used >= 1 and 1 / len(steps) < 0.01
    assert "motor front above" in [entry["what"] for entry in card["never"]]
    assert told == "Done to the end of what is possible: motor rear below. No limit can lie beyond."
    assert "motor rear below" not in untested and "motor rear above 1 " in untested


def test_limits_are_read_where_the_row_has_them():
    limits = recovered_limits(known())
    assert limits is not None
    assert limits.names == ("motor front", "motor rear")
    np.testing.assert_allclose(limits.upper, [[0.48, np.nan], [0.5, np.nan]], rtol=1e-6)
    assert np.isnan(limits.lower).all()


def test_the_card_is_one_that_can_be_written_and_read():
    card = card_of(known())
    assert is_card(json.loads(as_json(card)))
    assert "velocity of x" in as_markdown(card, "a run")
    assert closing(card).startswith("What it wants: velocity of x (+0.5), (heading)²")
    assert "motor front above 0.49 ± 0.01" in closing(card)


def test_the_limits_are_measures_of_every_seed_with_none_where_there_is_none():
    run = known()
    measures = measures_of_limits(run.networks, run.states)
    found = recovered_limits(run)
    assert found is not None
    np.testing.assert_array_equal(measures["untested"], np.isnan([found.upper, found.lower]).sum(axis=(0, 2)) / 4)
    assert (measures["untested"] > 0).all() and (measures["untested"] < 1).all()
    assert list(measures)[1:3] == ["recovered_limit/motor front/upper", "recovered_limit/motor front/lower"]
    for index, name in enumerate(found.names):
        np.testing.assert_array_equal(measures[f"recovered_limit/{name}/upper"], found.upper[:, index])
        np.testing.assert_array_equal(measures[f"recovered_limit/{name}/lower"], found.lower[:, index])
    assert np.isfinite(measures["recovered_limit/motor front/upper"]).all()
    assert np.isnan(measures["recovered_limit/motor rear/lower"]).any()
    assert measures_of_limits(untrained_robot("aircl_corrected").networks, run.states) == {}


def test_a_limit_of_a_state_is_listed_by_its_coordinate_with_the_m_by_which_it_was_drawn():
    run = known()
    env = replace(run.spec.env, constraint_input="state")
    held = {"lower": jnp.full((2, 8), -2.0), "upper": jnp.full((2, 8), 2.0)}  # until the limits are settled: no limits
    reach, none = (jnp.full((2, 8), -0.8), jnp.full((2, 8), 0.8)), jnp.full((2, 8), UNLIMITED)
    number = np.zeros((2, 8, BINS))
    number[:, :, BINS // 2] = 100.0
    number[:, 2, 150] = 3.0  # at 1.6 of the practice world's ±2.4
    counts = jnp.asarray(number, jnp.float32)
    tempted = jnp.zeros((2, 2, 8)).at[:, 1, 2].set(jnp.array([600.0, 800.0]))
    share = jnp.asarray(np.full((2, 8, BINS), 1.0 / BINS), jnp.float32)
    made, unread = Made(counts, outermost(number, UNLIMITED), outermost(number, -UNLIMITED), jnp.full(2, 1000.0)), jnp.zeros(2)
    met = Met(made, share, unread, -none, none.at[:, 2].set(1 / 3), tempted, unread)  # a third of 2.4
    params = run.states.params._replace(feasibility={"step": {"params": held}})
    contrast = run.states.adversary_opt._replace(met=met, reach=reach)
    states = run.states._replace(params=params, adversary_opt=contrast)
    nets = make_networks(env, run.spec.method, run.spec.config)
    run = replace(run, spec=replace(run.spec, env=env), networks=nets, states=states)
    card = card_of(run)
    (never,) = card["never"]
    assert (never["what"], never["limit"]) == ("rear above", pytest.approx(0.8))
    assert (never["tempted"], never["done"]) == (700.0, 3.0)
    assert any("Limits of actions were not looked for" in told for told in card["cannot_tell"])
    (untested,) = [told for told in card["cannot_tell"] if told.startswith("Not tested")]
    said = untested.removeprefix("Not tested: ").split(", ")
    assert [part for part in said if part.startswith("rear ")] == [part for part in said if part.startswith("rear below")] != []
    measures = measures_of_limits(nets, states)
    np.testing.assert_allclose(measures["recovered_limit/rear/upper"], [0.8, 0.8], rtol=1e-5)
    assert np.isnan(measures["recovered_limit/rear/lower"]).all()
