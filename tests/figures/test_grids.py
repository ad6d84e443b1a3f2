"""The maps and paths of a grid, the histograms: what is drawn is what was found, cell by cell and side by side."""

from dataclasses import replace
from functools import cache
from typing import Any

import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from matplotlib.patches import Rectangle

from aircl_jax.analysis import episodes
from aircl_jax.analysis.episodes import Evidence, GridEvidence
from aircl_jax.figures import of_a_run
from aircl_jax.figures.grids import cells, paths
from aircl_jax.figures.robots import step_histograms
from aircl_jax.figures.style import BLACK, BLUE, ORANGE, STYLE, Drawing
from envs import Box, Grid, Limit
from tests.finished_runs import drawn, untrained
from tests.worlds import one_state_env, random_trajectories, table_of

CELLS = 9
LAYOUT = Grid(3, (0, 0), (2, 2), {"A": ((0, 1),), "B": ((1, 2),)})


@cache
def found() -> Evidence:
    return episodes.gather(untrained("aircl_corrected"))


def maps() -> GridEvidence:
    """Two seeds with numbers of their own in every cell; the last cell is visited by nobody."""
    random = np.random.default_rng(0)
    occupancy = random.uniform(0.5, 1.0, size=(3, CELLS))
    occupancy[:, -1] = 0.0
    occupancy /= occupancy.sum(axis=1, keepdims=True)
    reward, delta = random.normal(size=(2, CELLS, 4)), random.uniform(size=(2, CELLS, 4))
    return GridEvidence(reward, delta, occupancy[:2], occupancy[2])


def titles(drawing: Drawing) -> list[str]:
    return [axis.get_title(loc="left") for axis in drawing.figure.axes]


def image_of(axis: Axes) -> np.ndarray:
    return np.ma.filled(np.ma.asarray(axis.images[0].get_array()), np.nan).ravel()


def test_the_occupancies_are_in_percent_with_the_policys_less_the_experts():
    drawing = drawn(cells.occupancy_maps, untrained("aircl_corrected"), LAYOUT, maps())
    expert, policy, difference = drawing.figure.axes[:3]
    assert titles(drawing)[:3] == ["expert", r"policy $\pi$", "policy − expert"]
    mean = maps().occupancy.mean(axis=0)
    np.testing.assert_allclose(image_of(expert), 100 * maps().expert_occupancy)
    np.testing.assert_allclose(image_of(policy), 100 * mean)
    np.testing.assert_allclose(image_of(difference), 100 * (mean - maps().expert_occupancy), atol=1e-12)


def test_the_total_variation_is_half_the_sum_of_differences_of_each_seed():
    one, half = np.eye(CELLS)[0], (np.eye(CELLS)[0] + np.eye(CELLS)[1]) / 2
    given = maps()._replace(occupancy=np.stack([half, np.eye(CELLS)[3]]), expert_occupancy=one)
    caption = drawn(cells.occupancy_maps, untrained("aircl_corrected"), LAYOUT, given).caption
    assert "Total variation between the two: 0.750, of the farthest seed 1.000." in caption  # ½ and 1


def test_a_cells_number_stands_in_its_row_and_column():
    values = np.arange(CELLS) / 10
    axis = drawn(cells.occupancy_maps, untrained("aircl_corrected"), LAYOUT, maps()).figure.axes[0]
    axis.clear()
    cells._cell_map(axis, LAYOUT, cells.Map("", values, "", doubtful=np.arange(CELLS) == 5))
    places = {text.get_text(): text.get_position() for text in axis.texts}
    assert places["0.10"] == (1, pytest.approx(0.08))  # cell 1: row 0, column 1; rows go down
    assert places["(0.50)"] == (2, pytest.approx(1.08))
    assert axis.get_ylim() == (2.5, -0.5)


def test_the_rewards_are_centred_on_what_is_visited_and_the_learned_ones_are_means_over_seeds():
    result, given = untrained("aircl_corrected"), maps()
    drawing = drawn(cells.reward_maps, result, LAYOUT, table_of(result.spec.env), given)
    weight = (given.expert_occupancy + given.occupancy.mean(axis=0)) / 2
    true = np.asarray(table_of(result.spec.env).reward)[:CELLS]
    true_map, learned_map = [
        next(one for one in axis.collections if isinstance(one, PolyCollection)) for axis in drawing.figure.axes[:2]
    ]
    for drawn_map, reward in ((true_map, true), (learned_map, given.reward.mean(axis=0))):
        shown = np.asarray(drawn_map.get_array()).reshape(CELLS, 4)
        assert (weight[:, None] * shown).sum() == pytest.approx(0.0, abs=1e-6)
        np.testing.assert_allclose(np.diff(shown, axis=1), np.diff(reward, axis=1), atol=1e-6)
    hidden = [patch.get_xy() for patch in drawing.figure.axes[0].patches if isinstance(patch, Rectangle) and patch.get_hatch()]
    assert hidden == [(1.5, 1.5)]  # row 2, column 2


def test_the_triangles_of_a_cell_are_its_moves_up_right_down_and_left():
    result = untrained("aircl_corrected")
    drawing = drawn(cells.reward_maps, result, LAYOUT, table_of(result.spec.env), maps())
    triangles = next(one for one in drawing.figure.axes[0].collections if isinstance(one, PolyCollection)).get_paths()
    middles = np.array([np.asarray(path.vertices)[:3].mean(axis=0) for path in triangles[4 * 5 : 4 * 6]]) - [2, 1]  # cell 5
    np.testing.assert_allclose(middles, np.array([[0, -1], [1, 0], [0, 1], [-1, 0]]) / 3, atol=1e-9)  # y goes down


def test_the_constraint_is_1_where_it_allows_and_the_learned_one_its_mean():
    result, given = untrained("aircl_corrected"), maps()
    table = table_of(result.spec.env)
    drawing = drawn(cells.feasibility_maps, result, LAYOUT, table, given, found())
    true, learned = drawing.figure.axes[:2]
    assert "δ₁ of each cell" in drawing.caption
    np.testing.assert_allclose(image_of(true), 1 - np.eye(CELLS)[4])  # the obstacle, row 1 and column 1
    np.testing.assert_allclose(image_of(learned), given.step_delta.mean(axis=(0, 2)))


def test_where_paths_are_judged_a_cell_has_the_mean_of_those_through_it():
    paths = random_trajectories(one_state_env(lambda t, action: 0.0 * t, horizon=2), 0, 3)
    obs = np.eye(3)[np.array([[0, 1], [0, 0], [1, 1]])]
    found = cells._mean_through(np.array([1.0, 0.0, 0.5]), paths._replace(obs=jnp.asarray(obs)))
    np.testing.assert_allclose(found, [0.5, 0.75, np.nan])  # (1 + 0) / 2, (1 + ½) / 2, nobody


def test_a_path_goes_through_the_middles_of_its_cells_and_violations_are_orange():
    axis = drawn(cells.occupancy_maps, untrained("aircl_corrected"), LAYOUT, maps()).figure.axes[0]
    axis.clear()
    visited = np.array([[0, 1, 5], [0, 3, 6]])
    paths.draw_paths(axis, LAYOUT, visited, np.array([True, False]))
    feasible, infeasible = axis.lines  # those that violate are drawn last
    assert [to_hex(str(line.get_color())) for line in axis.lines] == [BLUE.lower(), ORANGE.lower()]
    for line, column, row in ((infeasible, [0, 1, 2], [0, 0, 1]), (feasible, [0, 0, 0], [0, 1, 2])):
        across, down = np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)
        assert np.abs(across - column).max() <= 0.3 and np.abs(down - row).max() <= 0.3
        np.testing.assert_allclose(np.diff(across), np.diff(column))


def is_path(line: Any, colour: str) -> bool:
    """And not an entry of the legend, which has no points."""
    return to_hex(str(line.get_color())) == colour.lower() and len(line.get_xdata()) > 0


def test_the_paths_are_those_of_the_demonstrations_the_policy_and_the_sampler():
    result = untrained("aircl_corrected")
    cost = np.zeros((2, 12, 5))
    policy, sampled = (found().policy._replace(cost=cost.copy()) for _ in range(2))
    policy.cost[0, :3], sampled.cost[0, :6] = 1.0, 1.0
    policy, sampled = (one._replace(mask=np.ones_like(cost)) for one in (policy, sampled))
    drawing = drawn(paths.paths, result, LAYOUT, found()._replace(policy=policy, sampled=sampled))
    assert "Infeasible: D_E 0.0 %, π 25.0 %, q 50.0 %." in drawing.caption
    assert [sum(is_path(line, ORANGE) for line in axis.lines) for axis in drawing.figure.axes] == [0, 3, 6]
    assert titles(drawing) == ["demonstrations $D_E$", r"policy $\pi$", "samples of $q$"]


def test_delta_of_an_order_of_zones_is_that_of_its_trajectories_of_the_reference_set():
    result = untrained("aircl_corrected")
    classes = paths.visits(np.asarray(result.reference.obs).argmax(axis=-1), LAYOUT)
    delta = np.stack([np.select(list(classes.values()), [0.1, 0.2, 0.3, 0.4, 0.5]) + seed / 10 for seed in (0, 1)])
    policy = np.zeros((2, 12))
    drawing = drawn(paths.order_of_zones, result, LAYOUT, Evidence(result.expert, result.expert, policy, delta))
    axis = drawing.figure.axes[0]
    there = [place for place, chosen in enumerate(classes.values()) if chosen.any()]
    assert [patch.get_height() for patch in axis.patches if isinstance(patch, Rectangle)] == pytest.approx(
        [0.15 + place / 10 for place in there]
    )
    for line, place in zip(axis.lines, there, strict=True):
        assert np.asarray(line.get_ydata()) == pytest.approx([0.1 + place / 10, 0.2 + place / 10])


def test_the_histogram_of_delta_has_the_clean_in_blue_and_the_violating_in_orange_each_summing_to_100_percent():
    result = untrained("aircl_corrected")
    violating = episodes.infeasible(result.reference)
    delta = np.tile(np.where(violating, 0.01, 0.99), (2, 1))
    axis = drawn(of_a_run.reference_histogram, result, found()._replace(delta_reference=delta)).figure.axes[0]
    filled = [patch for patch in axis.patches if isinstance(patch, Rectangle) and patch.get_height() > 0]
    bars = {to_hex(patch.get_facecolor()): (patch.get_x(), patch.get_height()) for patch in filled}
    assert bars[BLUE.lower()] == (pytest.approx(0.96), pytest.approx(100.0))
    assert bars[ORANGE.lower()] == (pytest.approx(0.0), pytest.approx(100.0))
    said = [text.get_text() for text in axis.get_legend().get_texts()]  # pyright: ignore[reportOptionalMemberAccess]
    assert said == [f"clean ({(~violating).sum()})", f"violating ({violating.sum()})"]


def heights(axis: Axes, colour: str) -> np.ndarray:
    """Of the outlined histogram of that colour: the density of each bin."""
    outlines = [patch for patch in axis.patches if not isinstance(patch, Rectangle)]
    outline = next(patch for patch in outlines if to_hex(patch.get_edgecolor()) == colour.lower())
    return np.asarray(outline.get_path().vertices)[1:-1:2, 1]


def test_a_robots_histograms_are_of_unmasked_steps_the_demonstrations_black_and_the_policy_blue():
    full = untrained("aircl_corrected")
    world = one_state_env(lambda t, action: 0.0 * t, horizon=4, action_space=Box(2))
    robot = replace(world, limit=Limit("position", 0.5, 0))
    spec = replace(full.spec, env=robot)

    def episodes(first: float, second: float) -> Any:
        """Of two coordinates at these places; beyond the mask they are elsewhere."""
        one = random_trajectories(robot, 0, 6)
        mask = np.asarray(one.mask)[..., None]
        obs = np.where(mask > 0, np.array([first, second, *[0.0] * (robot.obs_size - 2)]), 9.0)
        return one._replace(obs=obs, action=np.zeros((6, 4, 2)), mask=np.asarray(one.mask))

    expert, policy = episodes(0.0, 0.2), episodes(1.0, 0.2)
    delta = np.ones((2, 3))
    given = replace(full, spec=spec, expert=expert), Evidence(policy, policy, delta, delta)
    with mpl.rc_context(STYLE):
        _, observations = step_histograms.draw(*given)
    first, second, *others = observations.figure.axes
    walls = [
        [np.asarray(line.get_xdata()).tolist() for line in axis.lines if is_path(line, ORANGE)] for axis in (first, second)
    ]
    assert walls == [[[0.5, 0.5]], []]  # x is observed first
    assert heights(first, BLACK).argmax() == 0
    assert heights(first, BLUE).argmax() == len(heights(first, BLUE)) - 1
    for axis in (second, *others):  # where both are at one place they are in one bin
        assert np.flatnonzero(heights(axis, BLACK)).tolist() == np.flatnonzero(heights(axis, BLUE)).tolist() == [0]
