"""Changed grids follow their rules: which cells start, are walled or become goals, and that every world can be made."""

from dataclasses import replace

import numpy as np
import pytest

from aircl_jax.analysis import exact
from aircl_jax.analysis.changed_grids import changed_worlds, other_rewards
from envs.gridworld import make_gridworld
from envs.layouts import LAYOUTS
from envs.options import GridOptions
from tests.worlds import table_of

CHANGES = ["start 1", "start 2", "start 3", "wind", "slip", "walls", "horizon", "start 1, walls, horizon"]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("reward", ["distance", "goal", "sites"])
@pytest.mark.parametrize("start", [(0, 0), "any"])
def test_every_layout_and_reward_has_its_eight_changed_worlds_and_three_other_tasks(layout, reward, start):
    options = GridOptions(layout=layout, reward=reward, start=start)
    changed, others = changed_worlds(options), other_rewards(options)
    assert list(changed) == CHANGES
    assert len(others) == 3
    for one in (*changed.values(), *others.values()):
        assert make_gridworld(one).horizon == one.horizon
        assert (one.layout, one.obstacles) == (layout, LAYOUTS[layout].obstacles)
    assert len({one.start for one in changed.values()} - {start}) == 3


def test_the_default_grid_starts_in_its_other_corners_and_the_middle():
    changed = changed_worlds(GridOptions())
    assert [changed[f"start {number}"].start for number in (1, 2, 3)] == [(5, 0), (0, 5), (3, 2)]
    assert (changed["wind"].wind, changed["slip"].slip, changed["horizon"].horizon) == (0.2, 0.2, 20)
    together = changed["start 1, walls, horizon"]
    assert (together.start, together.walls, together.horizon) == ((5, 0), changed["walls"].walls, 20)


def test_where_starts_are_any_the_others_are_far_from_what_absorbs():
    changed = changed_worlds(GridOptions(reward="goal", start="any"))
    assert changed["start 1"].start == (0, 0)  # ten steps from the goal
    sites = changed_worlds(GridOptions(reward="sites", start="any"))
    for number in (1, 2, 3):
        row, column = np.array(sites[f"start {number}"].start)
        assert min(5 - row + 5 - column, row + 5 - column, 5 - row + column) >= 4


def test_walls_stand_where_the_expert_would_be_and_leave_it_a_clean_path():
    options = GridOptions(reward="goal")
    walls = changed_worlds(options)["walls"].walls
    before, after = (exact.world_of(table_of(make_gridworld(one))) for one in (options, replace(options, walls=walls)))
    plan = exact.soft_plan(before.transition, before.reward, 20, before.barred)
    visits = exact.occupancy(before.transition, before.start, plan)[:-1].sum(axis=0)
    # Beside the start the expert is once in one of two cells; the one it prefers becomes a wall, the other is its way.
    assert max(walls, key=lambda cell: visits[cell[0] * 6 + cell[1]]) == walls[0]
    assert not set(walls) & {(0, 0), (5, 5), *LAYOUTS["default"].obstacles}
    found = exact.evaluate(*after, exact.hard_plan(after.transition, after.reward, 20, after.barred))
    assert found.expected_return > -3 * 15
    assert found.violating_episodes < 0.05


def test_new_walls_stand_beside_those_that_are_there():
    walls = changed_worlds(GridOptions(reward="goal", walls=((5, 0),)))["walls"].walls
    assert walls[0] == (5, 0)
    assert len(set(walls)) == 3


def test_other_tasks_have_other_goals_and_none_of_the_tastes():
    others = other_rewards(GridOptions(dislikes=((1, 0),), reward_scale=2.0))
    assert {name: (one.reward, one.start, one.goal, one.horizon) for name, one in others.items()} == {
        "right": ("distance", (0, 0), (2, 5), 12),
        "back": ("distance", (5, 5), (0, 0), 12),
        "across": ("goal", (5, 0), (0, 5), 20),
    }
    assert {(one.dislikes, one.reward_scale) for one in others.values()} == {((), 5.0)}


def test_a_task_that_obstacles_cover_or_that_is_the_grids_own_gives_way_to_the_next():
    corner = other_rewards(GridOptions(obstacles=((0, 5),)))
    assert list(corner) == ["right", "back", "along"]
    own = other_rewards(GridOptions(reward="goal", start=(5, 0), goal=(0, 5)))
    assert list(own) == ["right", "back", "down"]


def test_a_grid_without_room_is_refused_in_one_line():
    tiny = GridOptions(size=2, goal=(1, 1), obstacles=(), horizon=4)
    with pytest.raises(ValueError, match=r"its cells leave 2 other starts; choose one that leaves 3") as error:
        changed_worlds(tiny)
    assert "\n" not in str(error.value)
