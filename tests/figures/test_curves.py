"""The learning curves hold the numbers of the run: every line under its own title, in its unit, at its iteration."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.colors import to_hex

from aircl_jax.figures.curves import Curve, learning_curves, losses, small_multiples
from aircl_jax.figures.curves import _curve as drawn_curve
from aircl_jax.figures.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, Drawing
from tests.finished_runs import drawn, untrained


def panel(drawing: Drawing, title: str) -> Axes:
    return next(axis for axis in drawing.figure.axes if title in axis.get_title(loc="left"))


def values(line: Any) -> np.ndarray:
    return np.asarray(line.get_ydata(), float)


def lines(axis: Axes, colour: str) -> list[np.ndarray]:
    """Of that colour, in the order of drawing: the seeds, then their mean."""
    return [values(line) for line in axis.lines if to_hex(str(line.get_color())).lower() == colour.lower()]


def test_a_curve_is_mean_band_and_seeds_at_the_iterations_that_have_it():
    _, (axis,) = small_multiples(1)
    history = np.array([[np.nan] * 3, [0.1, 0.2, 0.9], [np.nan] * 3, [0.4, np.nan, 0.8]])
    end, label, _ = drawn_curve(axis, history, Curve("m", "name", "#ff0000"))
    assert (end, label) == (pytest.approx(0.6), "name")
    first, second, third, mean = axis.lines
    for line, expected in ((first, [0.1, 0.4]), (second, [0.2, np.nan]), (third, [0.9, 0.8]), (mean, [0.4, 0.6])):
        np.testing.assert_allclose(values(line), expected)
        assert np.asarray(line.get_xdata()).tolist() == [2, 4]  # the first iteration is 1
    (band,) = [one for one in axis.collections if isinstance(one, FillBetweenPolyCollection)]
    heights = {tuple(corner) for corner in np.round(np.asarray(band.get_paths()[0].vertices), 6).tolist()}
    assert {(2, 0.1), (2, 0.9), (4, 0.4), (4, 0.8)} <= heights
    assert axis.get_xlim()[0] == 0 and axis.get_xlim()[1] >= 4


@pytest.mark.parametrize(
    ("title", "colour", "metric", "scale"),
    [
        ("violations", ORANGE, "violation_rate", 100),
        ("violations", BLUE, "violation_rate_policy", 100),
        ("infeasible trajectories", ORANGE, "infeasible_share", 100),
        ("infeasible trajectories", BLUE, "infeasible_share_policy", 100),
        ("true return", ORANGE, "return_sampled", 1),
        ("true return", BLUE, "return", 1),
        ("goal reached", BLUE, "goal_rate", 100),
        ("state occupancy", BLUE, "occupancy_tv", 1),
        ("in training", BLACK, "feasibility_expert", 1),
        ("in training", BLUE, "feasibility_policy", 1),
        ("reference set", GREEN, "feasibility_auroc", 1),
        ("reference set", PURPLE, "feasibility_gap", 1),
        ("effective sample size", ORANGE, "effective_sample_size", 1),
        ("discriminator", GREEN, "rc_acc", 1),
        ("discriminator", PURPLE, "balanced_acc", 1),
    ],
)
def test_a_panel_has_the_run_s_own_numbers_in_its_unit(title, colour, metric, scale):
    result = untrained("aircl_corrected")
    first, second, mean = lines(panel(drawn(learning_curves, result), title), colour)[:3]
    np.testing.assert_allclose(np.stack([first, second], axis=1), scale * result.history[metric])
    np.testing.assert_allclose(mean, scale * result.history[metric].mean(axis=1))


@pytest.mark.parametrize(
    ("title", "metric", "scale"),
    [
        ("violations", "violation_rate_expert", 100),
        ("true return", "expert_return", 1),
        ("goal reached", "expert_goal_rate", 100),
    ],
)
def test_the_dashed_line_is_the_demonstrations_level(title, metric, scale):
    result = untrained("aircl_corrected")
    axis = panel(drawn(learning_curves, result), title)
    (level,) = lines(axis, BLACK)
    assert level == pytest.approx([scale * result.history[metric][-1].mean()] * 2)
    assert "expert" in [text.get_text() for text in axis.texts]


def test_the_lines_of_a_panel_are_named_by_what_they_are_of():
    axis = panel(drawn(learning_curves, untrained("aircl_corrected")), "violations")
    named = {text.get_text(): to_hex(str(text.get_color())).lower() for text in axis.texts}
    assert named == {"$q$": ORANGE.lower(), r"$\pi$": BLUE.lower(), "expert": BLACK}


def test_the_samplers_curves_are_left_out_where_it_is_the_policy():
    axis = panel(drawn(learning_curves, replace(untrained("aircl_corrected"), spec=untrained("airl").spec)), "violations")
    assert lines(axis, ORANGE) == []
    assert len(lines(axis, BLUE)) == 3


def test_the_caption_says_where_the_run_ends_each_measure_beside_its_experts():
    full = untrained("aircl_corrected")
    names = ("violation_rate", "violation_rate_policy", "violation_rate_expert", "goal_rate", "expert_goal_rate", "return")
    names += ("expert_return", "feasibility_auroc", "feasibility_gap")
    means = {name: (place + 1) / 100 for place, name in enumerate(names)}
    metrics = {name: {"mean": mean, "std": mean / 10, "per_seed": [mean]} for name, mean in means.items()}
    said = drawn(learning_curves, replace(full, summary={**full.summary, "metrics": metrics})).caption
    assert said.endswith(
        "At the end q violates in 1.00 ± 0.10 % of the timesteps; "
        "π violates in 2.00 ± 0.20 % of the timesteps (expert 3.00 %); "
        "π reaches the goal in 4.00 ± 0.40 % of the episodes (expert 5.00 %); its true return is 0.06 ± 0.006 (expert 0.07); "
        "AUROC of δ̄ 0.08 ± 0.008; gap of δ̄ 0.09 ± 0.009."
    )


def test_the_losses_are_those_of_the_run_the_adversarys_apart_from_the_policys():
    result = untrained("aircl_corrected")
    drawing = drawn(losses, result)
    for title, metric, colour in (
        ("discriminator", "loss_discriminator", BLUE),
        ("value loss", "value_loss", GREY),
        ("step of the policy", "approx_kl", GREY),
        ("size of the logit", "logit_size", GREY),
    ):
        np.testing.assert_allclose(lines(panel(drawing, title), colour)[-1], result.history[metric].mean(axis=1))
    assert [axis.get_title(loc="left") for axis in drawing.figure.axes if axis.get_yscale() == "log"] == ["value loss"]
