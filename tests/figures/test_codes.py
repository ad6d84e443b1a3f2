"""The drawn data of codes, causal links and the maze: rows are where one comes from, columns where one goes."""

from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle

from aircl_jax.analysis.recovered import Recovered
from aircl_jax.figures.animals import causal_links
from aircl_jax.figures.grids import codes, maze
from aircl_jax.figures.style import BLACK, BLUE, GREEN, GREY, ORANGE, STYLE
from envs import Codes, Maze

SEEN = np.array([[50, 20, 0], [12, 30, 10], [10, 1, 20]])
REWARD = np.array([[[1.0, 2.0, -3.0], [0.5, 1.0, -1.0], [1.5, 0.0, 1.0]]] * 2)
REWARD[1, 0, 1] = 4.0
DELTA = np.array([[[1.0, 1.0, 0.1], [1.0, 1.0, 1.0], [1.0, 0.2, 1.0]]] * 2)
DELTA[1, 2, 0] = 0.6
CODES = Codes(("sleep", "eat", "play"), np.array([[False] * 3, [False] * 3, [False, True, False]]))
RECOVERED = Recovered(REWARD, DELTA, np.zeros((2, 3, 3)), SEEN)


@pytest.fixture(autouse=True)
def style():
    with mpl.rc_context(STYLE):
        yield


def shown(axis: Axes) -> np.ndarray:
    return np.ma.filled(np.ma.masked_invalid(np.ma.asarray(axis.images[0].get_array())), -9.0)


def boxes(axis: Axes) -> list[Any]:
    return [patch.get_xy() for patch in axis.patches if isinstance(patch, Rectangle)]


def points(line: Any) -> tuple[list[float], list[float]]:
    return np.asarray(line.get_xdata(), float).tolist(), np.asarray(line.get_ydata(), float).tolist()


def test_the_activities_stand_in_the_order_of_their_mean_reward_with_how_often_they_begin():
    axis = codes.ranked_activities(RECOVERED, CODES, "").figure.axes[0]
    # sleep begins 12 times with 0.5 and 10 with 1.5; eat 20 times with 2 (or 4) and once with 0; play 10 times with −1.
    assert [label.get_text() for label in axis.get_yticklabels()] == ["play (10)", "sleep (22)", "eat (21)"]
    *seeds, mean = [line for line in axis.lines if line.get_marker() == "o"]
    sleep, eat = (0.5 * 12 + 1.5 * 10) / 22, np.array([40 / 21, 80 / 21])
    assert points(mean)[0] == pytest.approx([-1.0, sleep, eat.mean()])
    assert points(mean)[1] == [0, 1, 2]
    assert to_hex(str(mean.get_color())) == BLACK
    for line, own in zip(seeds, eat, strict=True):
        assert points(line)[0] == pytest.approx([-1.0, sleep, own])


def test_an_activity_that_begins_less_than_five_times_is_left_out_and_the_others_keep_their_names():
    seen = np.array([[50, 20, 0], [1, 30, 10], [2, 1, 20]])
    axis = codes.ranked_activities(RECOVERED._replace(seen=seen), CODES, "").figure.axes[0]
    assert [label.get_text() for label in axis.get_yticklabels()] == ["play (10)", "eat (21)"]


def test_the_reward_of_a_change_is_its_mean_over_seeds_and_grey_where_it_was_never_seen():
    axis = codes.reward_map(RECOVERED, CODES, "").figure.axes[0]
    assert shown(axis).tolist() == [[1.0, 3.0, -9.0], [0.5, 1.0, -1.0], [1.5, 0.0, 1.0]]
    assert axis.images[0].get_clim() == (-1.0, 3.0)  # of changes that were seen


def test_the_feasibility_of_a_change_is_its_mean_with_the_avoided_boxed_and_the_impossible_hatched():
    axis = codes.feasibility_map(RECOVERED, CODES, "").figure.axes[0]
    np.testing.assert_allclose(shown(axis), [[1.0, 1.0, 0.1], [1.0, 1.0, 1.0], [0.8, 0.2, 1.0]])
    assert boxes(axis) == [(1.5, -0.5)]  # from sleep, row 0, to play, column 2
    (hatched,) = axis.collections
    assert (~np.ma.getmaskarray(np.ma.asarray(hatched.get_array())).reshape(3, 3)).tolist() == CODES.impossible.tolist()
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("to", "from")
    assert [label.get_text() for label in axis.get_yticklabels()] == ["sleep  0", "eat  1", "play  2"]


def test_the_links_of_the_recordings_keep_their_sign_and_the_others_are_sizes_with_their_mean():
    own, apart = np.array([[0.1, -0.2], [0.0, 0.05]]), {"airl": np.array([[0.0, 0.4], [0.0, 0.0]]), "bc": np.full((2, 2), 0.02)}
    axes = causal_links.link_maps(own, apart).axes
    assert shown(axes[0]).tolist() == own.tolist()
    assert [axes[place].get_title() or axes[place].get_title(loc="left") for place in (0, 1, 2)] == [
        *("recordings, V\n", "airl\nmean |ΔV| 0.1000", "bc\nmean |ΔV| 0.0200"),
    ]
    assert shown(axes[1]).tolist() == apart["airl"].tolist()
    assert shown(axes[2]).tolist() == apart["bc"].tolist()
    assert axes[1].images[0].norm is axes[2].images[0].norm


def test_the_means_by_seed_stand_in_the_order_of_the_methods_over_their_yardsticks():
    methods, yardsticks = {"airl": [0.1, 0.2, 0.6]}, {"noise floor": [0.02, 0.06], "uniform": [0.5, 0.5]}
    axis = causal_links.differences(methods, yardsticks).axes[0]
    assert [label.get_text() for label in axis.get_yticklabels()] == ["airl", "noise floor", "uniform"]
    dots, means = ([line for line in axis.lines if line.get_marker() == marker] for marker in ("o", "|"))
    assert [points(line) for line in dots][:2] == [([0.1, 0.2, 0.6], [0, 0, 0]), ([0.02, 0.06], [1, 1])]
    assert [to_hex(str(line.get_color())) for line in dots] == [BLUE.lower(), GREY, GREY]
    assert [points(line)[0][0] for line in means] == pytest.approx([0.3, 0.04, 0.5])
    floors = [points(line)[0] for line in axis.lines if to_hex(str(line.get_color())) == GREEN.lower()]
    assert floors == [pytest.approx([0.04, 0.04]), pytest.approx([0.05, 0.05])]  # the floor, and a quarter more
    assert axis.get_ylim() == (2.6, -0.6)  # the first on top


def test_the_folds_held_out_are_joined_and_the_chain_is_orange():
    axis = causal_links.held_out({"Markov chain": [-2.0, -2.2], "airl": [-1.0, -3.0]}).axes[0]
    joined = [points(line) for line in axis.lines if line.get_marker() == "None"]
    assert joined == [([-2.0, -1.0], [0, 1]), ([-2.2, -3.0], [0, 1])]
    dots = [line for line in axis.lines if line.get_marker() == "o"]
    assert [(to_hex(str(line.get_color())), points(line)[0]) for line in dots] == [
        (ORANGE.lower(), [-2.0, -2.2]),
        (BLUE.lower(), [-1.0, -3.0]),
    ]
    assert [label.get_text() for label in axis.get_yticklabels()] == ["Markov chain", "airl"]


# A corridor of three nodes: action 0 goes left, action 1 right; at the ends one stays.
MAZE = Maze(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 1.0]]), np.array([[0, 1], [0, 2], [1, 2]]), {"home": 0, "water": 2})
GOING = np.array([[3, 8], [7, 9], [5, 2]])  # visits 11, 16 and 7
WORTH = np.array([[[9.0, 1.0], [-0.5, 2.0], [4.0, 9.0]]] * 2)


def nodes(axis: Axes) -> np.ndarray:
    found = next(one for one in axis.collections if isinstance(one, PathCollection))
    return np.ma.filled(np.ma.asarray(found.get_array()), -9.0)


def test_the_maze_has_reward_of_arriving_visits_and_feasibility_at_each_node():
    delta = np.array([[[0.9, 0.6], [0.3, 0.1], [0.2, 0.9]]] * 2)
    drawing = maze.maze_map(Recovered(WORTH, delta, WORTH, GOING), MAZE, "mice")
    reward, visits, feasibility = drawing.figure.axes[:3]
    assert nodes(reward) == pytest.approx([-0.5, (8 * 1.0 + 5 * 4.0) / 13, 2.0])
    assert nodes(visits).tolist() == [11, 16, 7]
    assert nodes(feasibility) == pytest.approx([0.3, (0.6 + 0.2) / 2, 0.1])
    assert "Of 3 nodes by reward home is rank 3; water is rank 2." in drawing.caption
    assert len(reward.collections[0].get_paths()) == 4  # corridors that are walked: two, each way


def test_a_maze_of_a_method_without_a_feasibility_has_two_panels():
    drawing = maze.maze_map(Recovered(WORTH, np.full(WORTH.shape, np.nan), WORTH, GOING), MAZE, "mice")
    labels = [axis.get_xlabel() for axis in drawing.figure.axes if axis.get_xlabel()]
    assert labels == ["reward of arriving", "steps recorded there"]


def test_labels_of_the_data_are_drawn_as_they_are_and_no_formula_is_read_in_them(tmp_path):
    names = (r"walk $\frac$", "rest | sleep", "a $ b")
    for drawing in codes.draw(RECOVERED, Codes(names, CODES.impossible), ""):
        drawing.figure.savefig(tmp_path / "it.png", dpi=20)
    axis = codes.ranked_activities(RECOVERED, Codes(names, CODES.impossible), "").figure.axes[0]
    assert [label.get_text() for label in axis.get_yticklabels()][1] == r"walk \$\frac\$ (22)"  # how a dollar is written
