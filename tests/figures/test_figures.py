"""Every figure of a run, drawn for each kind of world, and the arithmetic behind them worked by hand."""

import re
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest

from aircl_jax.analysis import episodes
from aircl_jax.figures import of_a_run, tasks
from aircl_jax.figures.curves import label_ends, small_multiples
from aircl_jax.figures.grids.cells import draw_layout
from aircl_jax.figures.grids.paths import cells_of, order_of_zones, visits
from aircl_jax.figures.robots import step_histograms
from aircl_jax.figures.style import STYLE, in_words
from aircl_jax.methods import METHODS, get_method
from aircl_jax.reports.run_report import report
from aircl_jax.runs.result import Result
from envs import Box, Grid, Limit, make_env
from tests.finished_runs import untrained
from tests.worlds import one_state_env, random_trajectories


def drawings(result: Result) -> dict[str, str]:
    with mpl.rc_context(STYLE):
        return {drawing.name: drawing.caption for drawing in of_a_run.draw(result)}


def test_a_grid_run_leaves_every_figure_with_a_caption_that_names_method_env_and_seeds(tmp_path):
    written = of_a_run.write_figures(untrained("aircl_corrected"), tmp_path / "figures")
    names = {"learning_curves", "reward", "feasibility", "occupancy", "paths", "feasibility_reference", "losses"}
    assert {path.stem for path, _ in written} == names
    for path, caption in written:
        assert path.read_bytes().startswith(b"\x89PNG")
        assert "aircl_corrected on gridworld" in caption
        assert re.search(r"2 seeds|seed 0", caption)


def test_a_notebook_shows_a_figure_as_a_picture():
    drawing = of_a_run.figures_of(untrained("aircl_corrected"))["occupancy"]
    assert drawing._repr_png_().startswith(b"\x89PNG")


def test_a_run_without_a_feasibility_draws_none(monkeypatch):
    full, airl = untrained("aircl_corrected"), get_method("airl")
    spec = replace(full.spec, method=airl)
    found = episodes.gather(full)
    monkeypatch.setattr(episodes, "gather", lambda result: found)
    assert drawings(replace(full, spec=spec)).keys() == {"learning_curves", "reward", "occupancy", "paths", "losses"}


def test_a_known_reward_and_a_clone_have_no_learned_reward_to_draw():
    assert [name for name, method in METHODS.items() if not method.learns_reward] == [
        "gacl",
        "icrl",
        "icrl_prior",
        "gacl_tuned",
        "icrl_tuned",
        "bc",
    ]


def test_the_report_shows_each_figure_by_a_relative_path():
    text = report(
        untrained("aircl_corrected").summary, ["x rings."], [(Path("/somewhere/figures/paths.png"), "Some paths.")], ""
    )
    assert "![paths](figures/paths.png)\n\nSome paths." in text
    assert "- X rings." in text
    assert "somewhere" not in text


def test_what_no_seed_measures_is_named_apart_and_not_tabled():
    text = report(untrained("aircl_corrected").summary, [], [], "")
    assert "Undefined here: log_std_at_bound." in text
    assert "null" not in text


def test_the_exact_occupancies_are_shares_of_the_timesteps():
    result = untrained("aircl_corrected")
    table = result.spec.env.tabular
    assert table is not None
    maps = episodes.gather_grid(result, table)
    np.testing.assert_allclose(maps.expert_occupancy.sum(), 1.0, rtol=1e-5)
    np.testing.assert_allclose(maps.occupancy.sum(axis=1), 1.0, rtol=1e-5)
    assert maps.occupancy[:, 0].min() >= 1 / 5 - 1e-6  # every episode spends at least its first step in the start


def test_the_maps_hold_the_learned_reward():
    result = untrained("aircl_corrected")
    table = result.spec.env.tabular
    assert table is not None
    maps = episodes.gather_grid(result, table)
    assert maps.reward[1, 3, 2] == pytest.approx(float(result.reward(table.obs[3], jnp.asarray(2), index=1)), abs=1e-6)


def test_delta_of_the_reference_set_is_the_results_own():
    result = untrained("aircl_corrected")
    first = type(result.reference)(*(leaf[0] for leaf in result.reference))
    found = episodes.gather(result)
    assert found.delta_reference[1, 0] == pytest.approx(float(result.feasibility(first, index=1)), abs=1e-6)


def test_trajectories_are_told_apart_by_the_order_of_two_zones():
    layout = Grid(3, (0, 0), (2, 2), {"A": ((0, 1),), "B": ((1, 2),)})
    paths = np.array([[0, 3, 6], [0, 1, 4], [0, 3, 5], [0, 5, 1], [1, 4, 5], [5, 1, 5]])
    found = visits(paths, layout)
    assert [next(name for name, chosen in found.items() if chosen[i]) for i in range(6)] == [
        "neither",
        "first",
        "second",
        "back",
        "order",
        "order",
    ]
    assert np.sum(list(found.values()), axis=0).tolist() == [1] * 6


def test_delta_is_shown_by_the_order_of_the_zones():
    result = untrained("aircl_corrected")
    layout = Grid(3, (0, 0), (2, 2), {"A": ((0, 1),), "B": ((1, 2),)})
    delta = np.full((2, len(result.reference.mask)), 0.5)
    drawing = order_of_zones(result, layout, episodes.Evidence(result.expert, result.expert, delta, delta))
    assert "only A, then B is forbidden" in drawing.caption
    assert {text.get_text() for text in drawing.figure.axes[0].texts} == {"0.50"}


@pytest.mark.parametrize(
    ("settings", "bounds", "lines"),
    [
        ({"constraint": "torque"}, "actions", (-0.5, 0.5)),
        ({"constraint": "torque", "limit": 0.2}, "actions", (-0.2, 0.2)),
        ({"constraint": "position"}, 0, (0.5,)),
    ],
)
def test_a_robots_limit_is_drawn_across_what_it_constrains(settings, bounds, lines):
    limit = make_env("swimmer", **settings).limit
    assert limit is not None
    assert (limit.name, limit.bounds, limit.lines) == (settings["constraint"], bounds, lines)


def test_no_constraint_has_no_limit():
    assert make_env("swimmer", constraint="none").limit is None
    assert one_state_env(lambda t, action: 0.0 * t).limit is None


def test_a_robots_actions_are_drawn_as_clipped_with_the_limit():
    random = np.random.default_rng(0)
    full = untrained("aircl_corrected")
    robot = replace(
        one_state_env(lambda t, action: 0.0 * t, horizon=4, action_space=Box(2)), limit=Limit("torque", 0.5, "actions")
    )
    spec = replace(full.spec, env=robot)
    found = random_trajectories(robot, 0, 6)._replace(action=jnp.asarray(random.normal(size=(6, 4, 2)) * 3))
    actions, observations = step_histograms.draw(
        replace(full, spec=spec, expert=found), episodes.Evidence(found, found, np.ones((2, 3)), np.ones((2, 3)))
    )
    assert len(actions.figure.axes) == 2
    assert len(observations.figure.axes) == robot.obs_size
    assert "beyond the dashed lines" in actions.caption
    assert actions.figure.axes[0].get_xlim() == pytest.approx((-1.1, 1.1))


def test_names_of_lines_never_overlap():
    _, (axis,) = small_multiples(1)
    axis.set_ylim(0, 1)
    label_ends(axis, [(0.0, "a", "k"), (0.001, "b", "k"), (0.002, "c", "k"), (1.0, "d", "k")], gap=0.1)
    heights = [text.xy[1] for text in axis.texts]  # pyright: ignore[reportAttributeAccessIssue]
    assert np.diff(heights).min() >= 0.1 - 1e-6
    assert heights[0] >= 0
    assert heights[-1] <= 1


@pytest.mark.parametrize(("number", "shape"), [(1, (1, 3)), (7, (2, 4)), (8, (2, 4)), (9, (3, 3)), (10, (2, 5))])
def test_small_multiples_leave_few_places_empty(number, shape):
    figure, axes = small_multiples(number)
    spec = axes[0].get_subplotspec()
    assert spec is not None
    assert len(axes) == number == len(figure.axes)
    assert spec.get_gridspec().get_geometry() == shape


def test_start_and_goal_are_named_and_obstacles_are_not():
    _, (axis,) = small_multiples(1)
    draw_layout(axis, Grid(12, (0, 0), (11, 11), {"obstacle": ((5, 5),)}))
    assert [text.get_text() for text in axis.texts] == ["S", "G"]


def test_sites_are_named_by_what_they_earn_and_walls_and_tastes_have_a_patch_each():
    _, (axis,) = small_multiples(1)
    draw_layout(axis, Grid(3, None, None, {}, sites={(2, 2): 2.5, (0, 2): 1.0}, tastes=((1, 0),), walls=((1, 1), (2, 1))))
    assert [text.get_text() for text in axis.texts] == ["2.5", "1"]
    assert len(axis.patches) == 3


def test_the_last_move_of_a_path_ends_before_a_wall_and_within_a_site():
    layout = Grid(3, (0, 0), None, {}, sites={(2, 2): 2.5}, walls=((1, 1),))
    shown = untrained("aircl_corrected").expert
    obs = np.eye(9)[np.array([[0, 1], [5, 8], [1, 2]])]
    paths = shown._replace(obs=obs, action=np.array([[1, 2], [2, 0], [1, 2]]))
    assert cells_of(paths, layout)[:, -1].tolist() == [1, 8, 5]


def test_numbers_in_captions_carry_their_spread_and_unit():
    assert in_words(0.0123, 0.001, percent=True) == "1.23 ± 0.10 %"
    assert in_words(48.36, None, percent=False) == "48.4"


def test_figure_3_says_how_many_paths_of_a_grid_are_infeasible():
    result = untrained("aircl_corrected")
    with mpl.rc_context(STYLE):
        drawing = tasks.tasks({"gridworld": result})
    share = 100 * episodes.infeasible(tasks.first_seed(episodes.gather(result).policy)).mean()
    assert f"(a) gridworld: infeasible are 0.0 % of the demonstrations and {share:.1f} % of the policy's" in drawing.caption
    assert share > 0
