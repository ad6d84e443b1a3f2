"""The row that is fitted by likelihood: its policy, reward and feasibility, its bootstrap samples, and how it is judged."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit

from aircl_jax.algorithm.learners.likelihood import draw_recordings
from aircl_jax.algorithm.trainer import make_trainer
from aircl_jax.demonstrations.files import from_arrays
from aircl_jax.methods import METHODS, get_method
from aircl_jax.runs.seeds import make_runner
from aircl_jax.runs.spec import make_spec
from aircl_jax.settings.env_defaults import LIKELIHOOD
from envs import make_env
from tests.animals.herds import FORBIDDEN, written_goats

SEEDS = (3, 4)


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    return written_goats(tmp_path_factory.mktemp("goats"), animals=3, rows=250)


@pytest.fixture(scope="module")
def fitted(table):
    env: Any = make_env("meerkat", state="full", **table)
    trainer = make_trainer(env, METHODS["behaviour"], LIKELIHOOD)
    one = from_arrays(env.recorded.demonstrations(), env)
    expert = jax.tree.map(lambda leaf: jnp.stack([leaf] * len(SEEDS)), one)
    runner = make_runner(trainer, SEEDS)
    states, metrics = runner.run_chunk(runner.init(expert), expert, 2)
    return env, trainer, one, states, metrics


def of_seed(fitted: Any, place: int) -> Any:
    env, trainer, expert, states, _ = fitted
    state = jax.tree.map(lambda leaf: leaf[place], states)
    return env, expert, state, trainer.networks.bind(state.params, state.obs_stats)


def steps_of(expert):
    """The code before, the code after and the place of every step, from the one-hot columns."""
    here = np.asarray(expert.mask) > 0
    obs = np.asarray(expert.obs)[here]
    return here, obs, obs[:, :3].argmax(axis=1), np.asarray(expert.action)[here], obs[:, 3:5].argmax(axis=1)


def test_the_policy_is_a_hazard_times_a_choice_among_what_can_be_begun(fitted):
    _, expert, state, nets = of_seed(fitted, 0)
    _, obs, code, _, place = steps_of(expert)
    params = jax.tree.map(np.asarray, state.params.policy["params"])
    for row in (0, 11, 500, 3000):
        found = np.exp(np.asarray(nets.policy(jnp.asarray(obs[row]), jnp.asarray(0)).logits))
        np.testing.assert_allclose(found.sum(), 1.0, rtol=1e-5)
        previous, age = obs[row, 5:8], np.exp(obs[row, 8])
        draw = params["table"][0] + params["table"][1 + place[row]] + params["offset"][code[row]]
        back = params["shared"][1] + params["shared"][2] * (age < 3.5) + params["back"][code[row]]
        weight = np.exp(draw + previous * back)
        weight[code[row]] = 0.0
        going = found[np.arange(3) != code[row]]
        expected = weight[np.arange(3) != code[row]] / weight.sum()
        np.testing.assert_allclose(going / going.sum(), expected, rtol=2e-3)


def test_the_reward_is_of_the_place_and_what_is_begun_there_and_going_on_has_none(fitted):
    env, expert, state, nets = of_seed(fitted, 1)
    _, obs, code, _, place = steps_of(expert)
    table = np.asarray(state.params.reward["params"]["reward"])
    np.testing.assert_allclose(table.mean(axis=1), 0.0, atol=1e-5)
    for row in (0, 40, 700):
        for action in range(3):
            f = float(nets.reward(jnp.asarray(obs[row]), jnp.asarray(action)))
            np.testing.assert_allclose(f, 0.0 if action == code[row] else table[place[row], action], atol=1e-5)
    names, places = env.view.recordings.names, env.view.recordings.places
    assert names[table[places.index("hill")].argmax()] == "graze"
    assert names[table[places.index("shade")].argmax()] == "rest"


def test_what_the_goats_never_do_is_infeasible_and_nothing_else(fitted):
    for place in range(len(SEEDS)):
        env, _, state, _ = of_seed(fitted, place)
        names = env.view.recordings.names
        delta = expit(np.asarray(state.params.feasibility["step"]["params"]["logit"]))
        np.fill_diagonal(delta, 1.0)
        assert [(names[one], names[other]) for one, other in np.argwhere(delta < 0.5)] == [FORBIDDEN]


def test_a_seed_is_judged_on_the_recordings_that_it_did_not_draw(fitted):
    env, expert, state, nets = of_seed(fitted, 0)
    here, _, code, after, _ = steps_of(expert)
    group = np.broadcast_to(env.recorded.groups()[:, None], here.shape)[here]
    times = draw_recordings(jax.random.key(SEEDS[0]), 6)
    assert times.sum() == 6
    held = times[group] == 0
    log_pi = np.asarray(jax.jit(jax.vmap(nets.log_pi))(expert))[here]
    judged = state.adversary_opt
    np.testing.assert_allclose(judged.held_out_log_prob, log_pi[held].mean(), atol=2e-4)
    assert judged.held_out_recordings == (times == 0).sum()
    gains = []
    for smoothing in (0.01, 0.03, 0.1, 0.3, 1.0, 3.0):  # the chain's pseudo-count is one of these, of the sample alone
        counts = np.full((3, 3), smoothing)
        np.add.at(counts, (code, after), times[group])
        chain = np.log(counts / counts.sum(axis=1, keepdims=True))
        gains.append((log_pi - chain[code, after])[held].mean())
    assert np.abs(np.array(gains) - float(judged.held_out_chain_gain)).min() < 2e-4
    assert judged.held_out_chain_gain > 0


def test_a_seed_is_the_same_alone_and_among_others_and_a_second_iteration_changes_nothing(fitted):
    _, trainer, one, states, metrics = fitted
    runner = make_runner(trainer, SEEDS[1:])
    alone = jax.tree.map(lambda leaf: leaf[None], one)
    first, _ = runner.run_chunk(runner.init(alone), alone, 1)
    jax.tree.map(
        lambda few, many: np.testing.assert_array_equal(np.asarray(few)[0], np.asarray(many)[1]), first.params, states.params
    )
    for values in metrics.values():
        assert values.shape == (2, len(SEEDS))
        np.testing.assert_array_equal(values[0], values[1])


def test_recordings_are_drawn_with_replacement_by_the_seed():
    draws = [draw_recordings(jax.random.key(seed), 18) for seed in range(40)]
    assert all(draw.sum() == 18 for draw in draws)
    assert len({tuple(draw) for draw in draws}) == 40
    left_out = np.mean([(draw == 0).mean() for draw in draws])
    assert abs(left_out - (1 - 1 / 18) ** 18) < 0.05


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"env": "gridworld"}, "env=gridworld: method=behaviour is fitted to whole recordings of animals; choose env=meerkat"),
        ({"env_settings": {"data": "simulated", "state": "code"}}, "env=meerkat: method=behaviour is fitted to whole"),
        ({"demonstrations": "mine.npz"}, "demonstrations=mine.npz: method=behaviour reads whole recordings"),
        ({"contrast_prior": "on"}, "contrast_prior='on': behaviour is fitted by likelihood alone"),
    ],
)
def test_what_does_not_fit_the_row_is_refused_in_one_line(changes, line):
    settings = {"env": "meerkat", "env_settings": {"data": "simulated"}, "contrast_prior": "method", "seeds": 1}
    settings |= {"first_seed": 0, "iterations": "default", "demonstrations": "default", "config": {}} | changes
    if settings["env"] == "gridworld":
        settings["env_settings"] = {}
    with pytest.raises(ValueError) as refused:  # noqa: PT011
        make_spec(settings.pop("env"), "behaviour", **settings)
    assert str(refused.value).startswith(line)
    assert "\n" not in str(refused.value)


def test_the_row_sees_whole_recordings_by_default_and_others_the_code():
    shared = {"contrast_prior": "method", "seeds": 1, "first_seed": 0, "iterations": "default", "demonstrations": "default"}
    state = {}
    for method in ("behaviour", "bc"):
        spec = make_spec("meerkat", method, env_settings={"data": "simulated"}, config={}, **shared)
        state[method] = spec.settings["env"]["state"]
    assert state == {"behaviour": "full", "bc": "code"}
    assert get_method("behaviour").terms == ()
