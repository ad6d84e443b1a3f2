"""The card and the words of the fitted row, and what a run on codes says of the other command."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.analysis.activities import found_of, maps_of_activities
from aircl_jax.demonstrations.files import from_arrays
from aircl_jax.reports.card import card_of, is_card
from aircl_jax.reports.card_of_activities import activities_in_words, beside_counting
from aircl_jax.runs.result import Result
from aircl_jax.runs.spec import make_spec
from tests.animals.herds import written_goats

SAMPLES = 4


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A run of four samples whose numbers are set by hand: nothing is fitted."""
    table = written_goats(tmp_path_factory.mktemp("goats"), animals=2, rows=100)
    shared = {"contrast_prior": "method", "seeds": SAMPLES, "first_seed": 0, "iterations": "default"}
    spec = make_spec("meerkat", "behaviour", env_settings=table, config={}, demonstrations="default", **shared)
    trainer = make_trainer(spec.env, spec.method, spec.config)
    env: Any = spec.env
    names, places = env.view.recordings.names, env.view.recordings.places
    expert = from_arrays(env.recorded.demonstrations(), env)
    state = trainer.init(jax.random.key(0), expert)
    params = jax.tree.map(lambda leaf: np.stack([np.asarray(leaf)] * SAMPLES), state.params)
    reward = params.reward["params"]["reward"].copy()
    reward[:, places.index("hill"), names.index("graze")] = [1.0, 2.0, 3.0, 2.0]
    logit = np.full_like(params.feasibility["step"]["params"]["logit"], 4.0)
    logit[:3, names.index("watch"), names.index("graze")] = -4.0  # in three samples of four
    logit[:2, names.index("rest"), names.index("graze")] = -4.0  # in half of them, which is not most
    expected = np.zeros_like(logit)
    expected[:, names.index("watch"), names.index("graze")] = [8.0, 9.0, 11.0, 90.0]
    test = {"logit": logit, "made": np.zeros_like(logit), "expected": expected}
    params = params._replace(reward={"params": {"reward": reward}}, feasibility={"step": {"params": test}})
    per_seed = {"per_seed": [0.1, 0.3, None, 0.2]}
    summary = {"seeds": list(range(SAMPLES)), "metrics": {f"held_out_{name}_gain": per_seed for name in ("chain", "where")}}
    states = state._replace(params=jax.tree.map(jnp.asarray, params))
    return Result(summary, [], {}, spec, trainer.networks, states, expert, expert, None)


def test_the_card_lists_what_most_samples_flag_with_the_median_of_what_was_expected(result):
    card = card_of(result)
    assert is_card(card)
    (entry,) = card["never"]
    assert entry["what"] == "watch, then graze"
    assert entry["tempted"] == 10.0
    assert entry["done"] == 0.0
    assert entry["how"].startswith("flagged in 3 of 4 bootstrap samples")


def test_a_reward_has_its_spread_over_samples(result):
    entries = {entry["what"].partition(" (")[0]: entry for entry in card_of(result)["wants"]}
    assert set(entries) == {"graze at hill"}
    assert entries["graze at hill"]["weight"] == pytest.approx(2.0)
    assert entries["graze at hill"]["spread"] == pytest.approx(np.std([1, 2, 3, 2]))


def test_card_and_words_say_that_seeds_are_bootstrap_samples(result):
    line = "The 4 seeds are bootstrap samples of the 6 recordings"
    assert any(one.startswith(line) for one in card_of(result)["cannot_tell"])
    words = activities_in_words(result)
    assert line in words
    assert "gains +0.2000 ± 0.1000 nats a step" in words  # of the three seeds that left a recording out


def test_what_was_found_counts_every_change_of_the_recordings(result):
    steps = result.spec.env.view.recordings.steps
    found, maps = found_of(result), maps_of_activities(result.spec.env.view, result.states)
    for one in range(3):
        for other in range(3):
            made = sum(1 for now, after in zip(steps.code, steps.following, strict=True) if (now, after) == (one, other))
            assert found.made[one, other] == (0 if one == other else made)
    assert found.begun.sum() == found.made.sum()
    assert maps["reward"].shape == (SAMPLES, 2, 3)
    assert maps["delta"].shape == (SAMPLES, 3, 3)


def test_a_run_on_codes_says_its_gain_and_the_other_command(result):
    of_codes = replace(result, summary={"metrics": {"chain_gain": {"per_seed": [-0.01, -0.03]}}})
    line = beside_counting(of_codes)
    assert "gains -0.0200 ± 0.0141 nats a step over a first-order chain" in line
    assert "`python -m experiments.behaviour` or method=behaviour" in line
