"""The meerkats' world: the action is the next state, the simulated mob keeps its constraint, folds, the place state."""

import os
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax import train
from aircl_jax.algorithm.measures import feasible_return, infeasible, violation_rate
from aircl_jax.algorithm.rollout import rollouts
from aircl_jax.reports import run_report
from envs import Discrete, make_env
from envs.animals import simulated_meerkats
from envs.animals.columns import load_mapping
from envs.animals.meerkat import demonstrations, held_out_recordings, load, reference_set
from envs.animals.rows.labels import Labels
from envs.animals.tracks import Tracks, read_folder
from envs.animals.windows import code_rows
from envs.options import MeerkatOptions
from tests.worlds import TINY, UNOPTIMISED, tiny_networks, unit_stats

SIMULATED = MeerkatOptions(data="simulated")
DATA = os.environ.get("AIRCL_DATA", "")
needs_data = pytest.mark.skipif(
    not (Path(DATA or "absent") / "meerkat").is_dir(), reason="AIRCL_DATA names no folder with meerkat/ in it"
)


@pytest.fixture(scope="module")
def env():
    return make_env("meerkat", data="simulated")


def test_the_simulated_mob_is_called_simulated(env):
    assert env.title == "meerkat (simulated)"
    assert env.has_reward
    assert env.action_space == Discrete(25)
    assert env.constraint_input == "state_action"


def test_the_action_is_the_next_state_and_a_forbidden_one_costs_at_once(env):
    truth = simulated_meerkats.truth()
    _, obs = env.reset(jax.random.key(0))
    assert obs.sum() == 1
    source, target = np.argwhere(truth.forbidden)[0]
    after, step = env.step(jax.random.key(1), jnp.int32(source), jnp.int32(target))
    assert step.obs.argmax() == target
    assert step.cost == 1
    assert step.reward == pytest.approx(truth.reward[source, target])
    assert env.tabular.cost[after] == 1
    _, following = env.step(jax.random.key(1), after, jnp.int32(target))
    assert following.cost == 0


def test_the_table_is_the_world(env):
    table, key = env.tabular, jax.random.key(0)
    np.testing.assert_allclose(table.transition.sum(axis=-1), 1)
    assert table.start.sum() == pytest.approx(1)
    states, actions = jnp.divmod(jnp.arange(50 * 25), 25)
    after, step = jax.vmap(env.step, in_axes=(None, 0, 0))(key, states, actions)
    np.testing.assert_array_equal(table.transition[states, actions].argmax(axis=-1), after)
    np.testing.assert_allclose(table.reward[states, actions], step.reward)
    np.testing.assert_array_equal(table.cost[after], step.cost)
    np.testing.assert_array_equal(table.obs[after], step.obs)


def test_demonstrations_are_windows_of_the_world_without_a_violation(env):
    arrays = demonstrations(SIMULATED)
    assert arrays["obs"].shape[1:] == (env.horizon, env.obs_size)
    np.testing.assert_array_equal(arrays["obs"][:, 1:].argmax(axis=-1), arrays["action"][:, :-1])
    assert arrays["mask"].all()
    assert not arrays["cost"].any()
    assert set(arrays) == {"obs", "action", "mask", "reward", "cost"}


def test_the_reference_set_has_both_labels_and_no_structural_zero():
    arrays = reference_set(SIMULATED)
    infeasible = arrays["cost"].any(axis=1).mean()
    assert 0.2 <= infeasible <= 0.8
    assert not simulated_meerkats.truth().structural[arrays["obs"].argmax(axis=-1), arrays["action"]].any()


@pytest.mark.parametrize("data", ["default", "simulated"])
def test_a_mapping_without_tables_to_read_by_it_is_refused(data, monkeypatch):
    monkeypatch.delenv("AIRCL_DATA", raising=False)
    with pytest.raises(ValueError, match=r"env\.mapping=goats\.yaml has no tables to read; give env\.data=DIR"):
        make_env("meerkat", data=data, mapping="goats.yaml")


def test_the_frequencies_of_the_simulated_mob_carry_its_reward():
    """What a method could recover: log π_E(c'|c) correlates with r on the feasible pairs seen (0.94 with seed 0)."""
    arrays, truth = demonstrations(SIMULATED), simulated_meerkats.truth()
    counts = np.zeros((25, 25))
    np.add.at(counts, (arrays["obs"].argmax(axis=-1), arrays["action"]), 1.0)
    seen = counts > 0
    log_policy = np.log((counts / np.maximum(counts.sum(axis=1, keepdims=True), 1))[seen])
    assert np.corrcoef(log_policy, truth.reward[seen])[0, 1] > 0.9
    assert not (seen & truth.forbidden).any()


def texts_of(tracks):
    """The columns with labels as texts."""
    return [column.texts() if isinstance(column, Labels) else column for column in tracks]


def write_tables(tracks: Tracks, folder: Path) -> None:
    """Simulated tracks as CSV files in the format of the published tables (neighbours by number alone)."""
    header = ",".join(
        simulated_meerkats.MAPPING.columns[name] for name in ("time", "individual", "behaviour", "place", "group")
    )
    header += "," + ",".join(simulated_meerkats.MAPPING.columns[name] for name in ("close", "distant", "coordinates"))
    for recording in tracks.recording.counts():
        part = texts_of(tracks.take(np.flatnonzero(tracks.recording.are(recording))))
        lines = [header]
        for row in zip(*part, strict=True):
            _, _, individual, group, time, behaviour, place, position, close, distant = row
            near, far = ("{" + ";".join(map(str, range(count))) + "}" for count in (close, distant))
            spot = ";".join(map(repr, np.nan_to_num(position).tolist()))
            lines.append(f"{time:.0f},{individual},{behaviour},{place},{group},{near},{far},[{spot}]")
        (folder / f"{recording}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def test_the_simulated_mob_written_as_tables_is_read_back_the_same(tmp_path):
    tracks = simulated_meerkats.simulated_tracks()
    one = tracks.take(np.flatnonzero(tracks.recording.are("simulated_C3_01")))
    write_tables(one, tmp_path)
    read = read_folder(tmp_path, load_mapping("meerkat")).tracks
    for written, found in zip(texts_of(one), texts_of(read), strict=True):
        np.testing.assert_array_equal(written, found)


def test_the_coding_finds_the_simulated_codes_but_for_moves_cut_by_the_end():
    generator = np.random.default_rng(0)
    policy = simulated_meerkats._policy(simulated_meerkats.truth(), constrained=True)
    places, codes = simulated_meerkats._walk(policy, np.array([1, 5, 8]), 400, generator)
    labels = np.array([*simulated_meerkats.MAPPING.behaviours, *[simulated_meerkats.MAPPING.moving] * 10])
    tracks = (
        simulated_meerkats.simulated_tracks()
        .take(np.arange(1200))
        ._replace(
            recording=Labels.same("a", 1200),
            group=Labels.same("Adult", 1200),
            individual=Labels.of(np.repeat(["0", "1", "2"], 400)),
            time=np.tile(np.arange(400.0), 3),
            behaviour=Labels.of(labels[codes].ravel()),
            place=Labels.of(np.array(simulated_meerkats.PLACE_NAMES)[places].ravel()),
        )
    )
    found = code_rows(tracks, simulated_meerkats.MAPPING).code.reshape(3, 400)
    wrong = found != codes
    assert (codes >= 15).any()
    for row, end in zip(wrong, codes[:, -1], strict=True):
        assert not row.any() or (end >= 15 and row[row.argmax() :].all())


def test_two_recordings_are_held_out_one_of_each_camera():
    train, held_out = (demonstrations(SIMULATED, split) for split in ("train", "held_out"))
    assert held_out_recordings(SIMULATED) == ("simulated_C2_00", "simulated_C3_00")
    assert len(train["obs"]) + len(held_out["obs"]) == len(demonstrations(SIMULATED)["obs"])
    with pytest.raises(ValueError, match=r"env\.fold=4: 8 recordings give folds 0 to 3"):
        demonstrations(MeerkatOptions(data="simulated", fold=4), "train")


def test_the_place_state_counts_neighbours_and_draws_from_the_frequencies():
    env = make_env("meerkat", data="simulated", state="place")
    arrays = demonstrations(MeerkatOptions(data="simulated", state="place"))
    assert env.obs_size == 12
    assert env.tabular is not None
    assert not env.has_reward
    np.testing.assert_allclose(env.tabular.transition.sum(axis=-1), 1, atol=1e-5)
    np.testing.assert_array_equal(arrays["obs"][..., :10].sum(axis=-1), 1)
    seen = (env.tabular.obs == arrays["obs"][0, 0]).all(axis=-1).argmax()
    _, step = env.step(jax.random.key(0), seen, jnp.int32(0))
    assert step.obs.shape == (12,)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"data": "nowhere"}, r"env\.data=nowhere: no such folder"),
        ({"data": "simulated", "horizon": 0}, r"env\.horizon=0"),
        ({"data": "simulated", "horizon": 480}, "the longest has 480: shorten the horizon"),
    ],
)
def test_bad_settings_are_refused_in_one_line(settings, words):
    with pytest.raises(ValueError, match=words):
        make_env("meerkat", **settings)


def test_the_variable_must_name_a_folder_with_the_animal_in_it(tmp_path, monkeypatch):
    monkeypatch.setenv("AIRCL_DATA", str(tmp_path))
    with pytest.raises(ValueError, match="no folder meerkat in it; set"):
        make_env("meerkat")
    monkeypatch.delenv("AIRCL_DATA")
    assert make_env("meerkat").title == "meerkat (simulated)"


def test_a_truth_is_claimed_for_the_default_coding_alone():
    assert load(MeerkatOptions(data="simulated", coding="step")).truth is None
    with pytest.raises(ValueError, match="has a reference set only simulated"):
        reference_set(MeerkatOptions(data="simulated", coding="step"))


UNKNOWABLE = (
    *("violation_rate", "violation_rate_policy", "violation_rate_expert", "infeasible_share", "infeasible_share_policy"),
    *("return", "return_sampled", "expert_return", "feasible_return", "reward_correlation", "violation_reward_only"),
    *("feasibility_auroc", "feasibility_gap", "step_feasibility_auroc"),
)


@pytest.mark.parametrize(("method", "reward"), [("aircl", np.nan), ("gacl", 0.0)])
def test_an_unknown_reward_and_cost_are_nan_and_gacl_takes_the_reward_for_0(method, reward):
    env = make_env("meerkat", data="simulated", coding="step", horizon=3)
    nets, params = tiny_networks(env, method)
    nets = nets.bind(params, unit_stats(env))
    episodes = jax.jit(lambda key: rollouts(nets, key, 2), compiler_options=UNOPTIMISED)(jax.random.key(0))
    np.testing.assert_array_equal(episodes.reward, np.full((2, 3), reward))
    assert all(np.isnan(measure(episodes)).all() for measure in (violation_rate, infeasible, feasible_return))


@pytest.mark.slow
def test_what_no_truth_is_known_of_is_undefined_and_gacl_learns_with_no_reward():
    config = replace(TINY, num_evaluation=4)
    settings = {"data": "simulated", "coding": "step"}
    result = train("meerkat", "gacl", seeds=2, iterations=1, env_settings=settings, config=config)
    measured = result.summary["metrics"]
    assert {name for name in UNKNOWABLE if measured[name]["mean"] is not None} == set()
    assert measured["rc_acc"]["mean"] is not None
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(result.states.params))
    assert f"Undefined here: {', '.join(sorted(UNKNOWABLE[:2]))}" in run_report.closing(result.summary, [], "runs")


def test_the_contrast_prior_is_refused_a_reward_that_nobody_knows():
    settings = {"data": "simulated", "coding": "step"}
    with pytest.raises(ValueError, match="env=meerkat: reward is missing, which the contrast prior of gacl compares"):
        train("meerkat", "gacl", contrast_prior="on", env_settings=settings)


@pytest.mark.parametrize("coding", ["bout", "step"])
@pytest.mark.parametrize("data", ["simulated", pytest.param(DATA, marks=needs_data, id="real")])
def test_no_change_that_cameras_or_coding_rule_out_was_ever_recorded(data, coding):
    herd = load(MeerkatOptions(data=data, coding=coding))
    changes = herd.windows.code[:, :-1], herd.windows.code[:, 1:]
    assert herd.impossible.any()
    assert not herd.impossible[changes].any()


def test_the_split_of_the_settings_is_what_a_run_learns_from():
    for split in ("train", "held_out"):
        env = make_env("meerkat", data="simulated", split=split)
        assert env.recorded is not None
        np.testing.assert_array_equal(env.recorded.demonstrations()["obs"], demonstrations(SIMULATED, split)["obs"])


@needs_data
def test_the_real_windows_have_no_reward_and_both_cameras_in_every_fold():
    env, options = make_env("meerkat", data=DATA), MeerkatOptions(data=DATA)
    arrays = demonstrations(options)
    assert env.title == "meerkat"
    assert not env.has_reward
    assert arrays["obs"].shape == (1289, 30, 25)
    assert np.isnan(arrays["reward"]).all()
    assert np.isnan(arrays["cost"]).all()
    folds = [held_out_recordings(MeerkatOptions(data=DATA, fold=fold)) for fold in range(9)]
    assert len({recording for fold in folds for recording in fold}) == 18
    assert all("_C2_" in first and "_C3_" in second for first, second in folds)
