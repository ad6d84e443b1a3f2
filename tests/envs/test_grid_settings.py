"""Layouts, rewards, starts, wind, walls, dislikes and lapses of the grid: numbers by hand, and what is refused."""

from dataclasses import asdict

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax import train
from aircl_jax.demonstrations.soft_optimal import lapsing, occupancy, plan_expert, soft_value_iteration
from aircl_jax.demonstrations.sources import demonstrations
from aircl_jax.settings.train_config import TrainConfig
from envs import Grid, SoftOptimalExpert, make_env
from envs.checks import check_env
from envs.layouts import LAYOUTS
from envs.options import GridOptions
from tests.worlds import table_of, tiny_grid

UP, RIGHT, DOWN, LEFT = range(4)


def grid(**settings):
    return make_env("gridworld", **settings)


def cell(row, column, size=6):
    return row * size + column


def step_reward(env, at, action):
    return float(env.step(jax.random.key(0), jnp.asarray(at), jnp.asarray(action))[1].reward)


def view_of(env) -> Grid:
    assert isinstance(env.view, Grid)
    return env.view


def test_what_a_run_of_before_names_is_the_world_of_today():
    before = {"size": 6, "start": [0, 0], "goal": [5, 5], "obstacles": [[1, 1], [0, 4], [2, 3], [4, 1], [4, 4]], "slip": 0.01}
    named = table_of(grid(**before, horizon=10, reward_scale=5.0, temperature=1.0))
    for one, other in zip(named, table_of(grid()), strict=True):
        np.testing.assert_array_equal(one, other)


def test_given_cells_replace_the_layouts_own():
    options = GridOptions(layout="wall", obstacles=((1, 1),)).resolved()
    assert (options.size, options.goal, options.obstacles, options.horizon) == (7, (6, 6), ((1, 1),), 12)


@pytest.mark.parametrize(("name", "size", "number"), [("default", 6, 5), ("second", 6, 5), ("third", 6, 5), ("wall", 7, 8)])
@pytest.mark.parametrize(("reward", "horizon"), [("distance", None), ("goal", 20), ("sites", 15)])
def test_every_layout_has_its_cells_and_every_reward_its_horizon(name, size, number, reward, horizon):
    env = grid(layout=name, reward=reward)
    check_env(env)
    assert env.obs_size == size**2
    assert env.horizon == (horizon or 2 * (size - 1))
    assert set(np.flatnonzero(table_of(env).forbidden)) == {cell(*one, size) for one in LAYOUTS[name].obstacles}
    assert number == len(LAYOUTS[name].obstacles)


@pytest.mark.parametrize(
    ("reward", "at", "action", "earned"),
    [
        ("goal", (2, 2), DOWN, -3.0),
        ("goal", (4, 5), DOWN, -3.0),  # the step that reaches the goal is one outside it
        ("goal", (5, 5), DOWN, 0.0),
        ("sites", (5, 5), UP, 2.5),
        ("sites", (0, 5), UP, 1.5),
        ("sites", (5, 0), UP, 1.0),
        ("sites", (4, 5), DOWN, 0.0),
        ("sites", (2, 1), UP, -1.5),
        ("sites", (3, 3), UP, -1.5),
    ],
)
def test_the_reward_of_the_goal_and_of_sites_is_that_of_the_state_one_is_in(reward, at, action, earned):
    env = grid(reward=reward)
    assert step_reward(env, cell(*at), action) == earned
    np.testing.assert_array_equal(table_of(env).reward[cell(*at)], np.full(4, earned))


def test_sites_absorb_and_mud_is_allowed():
    table = table_of(grid(reward="sites", slip=0.3))
    for corner in ((5, 5), (0, 5), (5, 0)):
        np.testing.assert_allclose(table.transition[cell(*corner), :, cell(*corner)], np.ones(4), rtol=1e-6)
    assert table.forbidden[cell(2, 1)] == table.cost[cell(3, 3)] == 0.0
    assert table.transition[cell(2, 1), RIGHT, cell(2, 2)] > 0.5
    assert table.goal.sum() == 0.0


def test_a_start_anywhere_is_uniform_over_clean_cells_that_do_not_absorb():
    env = grid(reward="sites", start="any", walls=[[3, 4]])
    start = np.asarray(table_of(env).start)
    closed = {(1, 1), (0, 4), (2, 3), (4, 1), (4, 4), (3, 4), (5, 5), (0, 5), (5, 0)}
    assert set(np.flatnonzero(start == 0)) == {cell(*one) for one in closed}
    np.testing.assert_allclose(start[start > 0], 1 / 27, rtol=1e-6)
    drawn = np.asarray(jax.vmap(lambda key: env.reset(key)[0])(jax.random.split(jax.random.key(0), 27_000)))
    np.testing.assert_allclose(np.bincount(drawn, minlength=36) / 27_000, start, atol=0.005)  # 4 σ


def test_wind_replaces_the_move_by_the_one_down():
    row = table_of(grid(slip=0.2, wind=0.5)).transition[cell(2, 2), UP]
    expected = {(1, 2): 0.425, (2, 3): 0.025, (3, 2): 0.5 + 0.025, (2, 1): 0.025}  # half of .85 and of .05
    np.testing.assert_allclose([row[cell(*end)] for end in expected], list(expected.values()), rtol=1e-6)
    np.testing.assert_allclose(row.sum(), 1.0, rtol=1e-6)


def test_the_expected_reward_counts_the_wind():
    # Up from [2, 2] is a unit lost in half of the steps and a unit won in the other half.
    np.testing.assert_allclose(table_of(grid(slip=0.0, wind=0.5)).reward[cell(2, 2), UP], 0.0, atol=1e-6)
    np.testing.assert_allclose(table_of(grid(slip=0.0, wind=0.25)).reward[cell(2, 2), UP], -2.5, rtol=1e-6)


def test_who_moves_into_a_wall_stays_and_gains_no_distance():
    env = grid(slip=0.0, walls=[[3, 4]])
    state, step = env.step(jax.random.key(0), jnp.asarray(cell(3, 3)), jnp.asarray(RIGHT))
    assert (int(state), float(step.reward), float(step.cost)) == (cell(3, 3), 0.0, 0.0)
    into = np.asarray(table_of(env).transition)[:, :, cell(3, 4)]
    assert into[np.arange(36) != cell(3, 4)].sum() == 0.0


def test_a_dislike_lowers_the_reward_of_a_step_in_its_cell_and_forbids_nothing():
    plain, env = grid(obstacles=[]), grid(obstacles=[], dislikes=[[1, 1], [2, 3]])
    lower = np.zeros((36, 4))
    lower[[cell(1, 1), cell(2, 3)]] = 3.0
    np.testing.assert_allclose(table_of(env).reward, table_of(plain).reward - lower, atol=1e-5)
    assert table_of(env).forbidden.sum() == table_of(env).cost.sum() == 0.0
    assert step_reward(grid(slip=0.0, dislikes=[[1, 0]], dislike=0.5), cell(1, 0), DOWN) == 4.5


def test_a_lapsing_expert_acts_uniformly_in_that_share_of_its_actions():
    log_policy = jnp.log(jnp.asarray([[[0.7, 0.1, 0.2, 0.0]]]))
    np.testing.assert_allclose(jnp.exp(lapsing(log_policy, 0.2)), [[[0.61, 0.13, 0.21, 0.05]]], rtol=1e-5)


def test_lapses_are_the_experts_alone():
    env, lapsed = tiny_grid(), tiny_grid(lapse=0.05)
    for one, other in zip(table_of(env), table_of(lapsed), strict=True):
        np.testing.assert_array_equal(one, other)
    planner = lapsed.expert
    assert isinstance(planner, SoftOptimalExpert)
    assert planner.lapse == 0.05
    best = soft_value_iteration(planner.table, planner.table.reward, 4, 1.0, forbid=True).log_policy
    np.testing.assert_allclose(plan_expert(lapsed, planner), lapsing(best, 0.05), rtol=1e-6)
    rate = (occupancy(planner.table, plan_expert(lapsed, planner)) @ planner.table.cost).mean()
    shown, _ = demonstrations(lapsed, [0], TrainConfig(num_demonstrations=3000))
    np.testing.assert_allclose(shown.cost.mean(), rate, atol=0.002)
    assert rate > 0.05 / 4 / 4  # beside the obstacle once in four steps, where one move in four enters


@pytest.mark.parametrize(
    ("settings", "success"),
    [
        ({}, 50.0),
        ({"layout": "wall"}, 60.0),
        ({"reward": "goal"}, -57.0),  # 19 of 20 steps outside
        ({"reward": "goal", "start": "any", "horizon": 12}, -33.0),
        ({"start": "any"}, None),  # the whole distance depends on the start
        ({"reward": "sites"}, None),
        ({"dislikes": [[1, 0]]}, None),
    ],
)
def test_the_return_that_means_the_goal_is_known_or_absent(settings, success):
    assert grid(**settings).success_return == success


def test_the_view_shows_the_places_of_the_world():
    view = view_of(grid(reward="sites", start="any", walls=[[3, 4]], dislikes=[[1, 0]]))
    assert (view.start, view.goal, view.walls) == (None, None, ((3, 4),))
    assert view.sites == {(5, 5): 2.5, (0, 5): 1.5, (5, 0): 1.0}
    assert view.tastes == ((2, 1), (3, 3), (1, 0))
    assert view_of(grid(layout="wall")).absorbing == ((6, 6),)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"layout": "fifth"}, "env.layout 'fifth'; choose default, second, third, fourth, wall"),
        ({"reward": "gold"}, "env.reward 'gold'; choose distance, goal or sites"),
        ({"reward": "sites", "goal": [2, 2]}, r"env.goal=\[2, 2\]: reward=sites has three sites"),
        ({"reward": "goal", "reward_scale": 1.0}, "env.reward_scale=1.0 is of reward=distance"),
        ({"reward": "sites", "start": [0, 5]}, r"env.start=\[0, 5\] is a site"),
        ({"reward": "sites", "obstacles": [[5, 0]]}, r"covers the site \[5, 0\]"),
        ({"reward": "sites", "size": 3, "obstacles": []}, r"mud of layout=default: \[3, 3\] is not a cell of the 3×3"),
        ({"reward": "sites", "obstacles": [[0, 1], [1, 0]]}, r"no clean path from \[0, 0\] to \[\[5,5\],\[0,5\],\[5,0\]\]"),
        ({"start": "any", "obstacles": [[0, 1], [1, 0]]}, r"no clean path from \[0, 0\]"),
        ({"walls": [[0, 1], [1, 0]]}, r"env.walls=\[\[0,1\],\[1,0\]\] leaves no clean path"),
        ({"walls": [[0, 0]]}, r"env.walls=\[\[0,0\]\] covers the start"),
        ({"walls": [[1, 1]]}, r"env.walls and env.obstacles share \[\[1,1\]\]"),
        ({"walls": [[7, 0]]}, r"env.walls: \[7, 0\]"),
        ({"dislikes": [[7, 0]]}, r"env.dislikes: \[7, 0\]"),
        ({"dislike": -1.0}, "env.dislike=-1.0"),
        ({"wind": 1.5}, "env.wind=1.5 is not a probability"),
        ({"lapse": 2.0}, "env.lapse=2.0 is not a share"),
    ],
)
def test_settings_that_do_not_fit_are_refused_in_one_line(settings, named):
    with pytest.raises(ValueError, match=named) as error:
        grid(**settings)
    assert "\n" not in str(error.value)


def test_types_of_the_settings_are_checked_before_the_world_is_made():
    with pytest.raises(ValueError, match=r"env.start=.*some.* is not \[an integer, an integer\] or 'any'"):
        train("gridworld", env_settings={"start": "some"})


def test_resolving_twice_changes_nothing():
    for reward in ("distance", "goal", "sites"):
        options = GridOptions(layout="third", reward=reward).resolved()
        assert asdict(options.resolved()) == asdict(options)
