"""Player and film strip of a scene that is made up: what is drawn and packed is what happened, step by step."""

import base64
import json
import re
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.collections import FillBetweenPolyCollection, PolyCollection
from matplotlib.colors import to_hex

from aircl_jax.analysis.robot_poses import Stage, make_body
from aircl_jax.analysis.robot_scene import Scene, Side, _quantity
from aircl_jax.figures.robots import film_strip, player
from aircl_jax.figures.style import BLACK, BLUE, GREEN, GREY, ORANGE, STYLE
from envs import Limit

STEPS = 24


def side(name: str, start: float, violating: list[int]) -> Side:
    """Two episodes of one link that goes 0.1 m a step; the second is the one to look at, and is two steps shorter."""
    across = start + 0.1 * np.tile(np.arange(STEPS), (2, 1))
    ends = np.stack([np.stack([across - 0.5, across + 0.5], axis=-1), np.full((2, STEPS, 2), 0.25)], axis=-1)
    wrong = np.zeros((2, STEPS), bool)
    wrong[1, violating] = True
    return Side(
        name=name,
        links=ends[:, :, None],
        across=across,
        violating=wrong,
        level=np.stack([np.zeros(STEPS), across[1]]),
        delta=np.stack([np.zeros(STEPS), np.linspace(0, 1, STEPS)]),
        feasibility=np.array([0.1, 0.75]),
        returns=np.array([1.0, start * 10]),
        violation_rate=np.array([0.0, len(violating) / (STEPS - 2)]),
        length=np.array([STEPS, STEPS - 2]),
    )


STAGE = Stage(dt=0.5, axes=("x", "z"), radius=np.array([0.1]), branch=np.array([0]), floor=0.0, rail=None)
SCENE = Scene(
    title="a row on a body, seed 3, iteration 7",
    stage=STAGE,
    expert=side("expert", 5.0, []),
    learned=side("learned", 2.0, [3, 4, 12]),
    quantity="x (m)",
    limits=(2.25,),
    wall=None,
    note="",
)


def strip() -> Any:
    with mpl.rc_context(STYLE):
        return film_strip.film_strip(SCENE, episode=1)


def points(line: Any) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)


def test_the_instants_are_the_middles_of_equal_spans():
    assert film_strip.instants(24, frames=4).tolist() == [3, 9, 15, 21]
    assert film_strip.instants(22, frames=12)[[0, -1]].tolist() == [0, 21]


def test_the_demonstration_is_above_in_black_and_the_policy_below_in_blue():
    expert, _, _, learned, *_ = strip().figure.axes
    assert expert.get_title(loc="left") == "demonstration: violates in 0.0 % of its steps, return 50.0"
    assert learned.get_title(loc="left") == r"policy $\pi$: violates in 13.6 % of its steps, return 20.0"  # 3 of 22
    assert {to_hex(patch.get_facecolor()) for patch in expert.patches} == {BLACK}


def test_the_poses_that_violate_are_orange_and_each_has_its_x_below():
    learned = strip().figure.axes[3]
    shown = film_strip.instants(STEPS - 2)  # 0, 2, 4, 6, 8, 10, 11, 13, 15, 17, 19, 21
    colours = [to_hex(patch.get_facecolor()).lower() for patch in learned.patches]
    assert colours == [(ORANGE if step in (3, 4, 12) else BLUE).lower() for step in shown]
    assert colours.count(ORANGE.lower()) == 1
    assert [text.get_text() for text in learned.texts] == [f"+{2 + 0.1 * step:.2f} m" for step in shown]


def test_an_x_within_centimetres_is_in_millimetres_with_its_sign():
    assert film_strip._place(-0.0123, millimetres=True, unit=True) == "−12 mm"
    assert film_strip._place(0.0123, millimetres=True, unit=False) == "12"
    assert film_strip._place(-0.001, millimetres=False, unit=True) == "+0.00 m"


@pytest.mark.parametrize(("chart", "start", "colour"), [(1, 5.0, BLACK), (4, 2.0, BLUE)])
def test_a_chart_has_the_quantity_at_the_middle_of_each_step_in_seconds(chart, start, colour):
    axis = strip().figure.axes[chart]
    level, limit, frames = axis.lines
    time, height = points(level)
    np.testing.assert_allclose(time, 0.25 + 0.5 * np.arange(STEPS - 2))
    np.testing.assert_allclose(height, start + 0.1 * np.arange(STEPS - 2))
    assert to_hex(str(level.get_color())) == colour.lower()
    assert points(limit)[1].tolist() == [2.25, 2.25]
    np.testing.assert_allclose(points(frames)[0], 0.25 + 0.5 * film_strip.instants(STEPS - 2))
    assert to_hex(str(frames.get_color())) == GREY
    assert axis.get_xlim() == (0, 12)
    assert axis.get_ylabel() == "x (m)"


def test_the_violating_stretches_are_shaded_from_their_first_steps_beginning_to_their_last_ones_end():
    boxes = next(one for one in strip().figure.axes[4].collections if isinstance(one, PolyCollection)).get_paths()
    spans = [(np.asarray(box.vertices)[:, 0].min(), np.asarray(box.vertices)[:, 0].max()) for box in boxes]
    assert spans == [(1.5, 2.5), (6.0, 6.5)]  # steps 3 and 4, and 12, of half a second each


def test_the_feasibility_of_each_step_is_drawn_as_it_is():
    axis = strip().figure.axes[5]
    time, height = points(axis.lines[0])
    np.testing.assert_allclose(height, np.linspace(0, 1, STEPS)[:-2])
    np.testing.assert_allclose(time, 0.25 + 0.5 * np.arange(STEPS - 2))
    area = next(one for one in axis.collections if isinstance(one, FillBetweenPolyCollection))
    corners = np.round(np.asarray(area.get_paths()[0].vertices), 6)
    assert corners[corners[:, 0] == 0.25][:, 1].max() == 0.0
    assert corners[corners[:, 0] == 10.75][:, 1].max() == pytest.approx(21 / 23)
    assert to_hex(str(axis.lines[0].get_color())) == GREEN.lower()


def test_the_caption_says_what_each_side_does_and_what_the_curves_are():
    caption = strip().caption
    assert "A demonstration: violates in 0.0 % of its steps, return 50.0." in caption
    assert "seed 3, iteration 7: the policy violates in 13.6 % of its steps, return 20.0." in caption
    assert "Curves: x (m) with the constraint's limit (dashed)." in caption


def test_a_constraint_bounds_the_largest_action_or_the_place_across():
    qpos, action = np.array([[[0.25, 9.0]]]), np.array([[[0.5, -0.75]]])
    body = make_body("pendulum", {"constraint": "position", "limit": "default", "integrator": "euler"})
    torque, place = _quantity(Limit("torque", 0.5, "actions"), body), _quantity(Limit("position", -0.015, 0), body)
    assert torque is not None and place is not None
    assert torque.value(qpos, action).tolist() == [[0.75]]
    assert place.value(qpos, action).tolist() == [[0.25]]
    assert not torque.wall and place.wall
    assert (torque.limits, place.limits) == ((0.5,), (-0.015,))


def packed() -> Any:
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', player.page(SCENE), re.DOTALL)
    assert found is not None
    return json.loads(found.group(1))


def unpacked(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def test_the_player_holds_both_sides_in_their_units():
    data = packed()
    assert (data["dt"], data["limits"], data["wall"], data["floor"]) == (0.5, [2.25], None, 0.0)
    assert data["title"] == "a row on a body, seed 3, iteration 7"
    expert, learned = data["sides"]
    assert [one["name"] for one in data["sides"]] == ["expert", "learned"]
    assert [expert["episodes"][1][name] for name in ("return", "violation", "feasibility")] == ["50.0", "0.0%", "0.75"]
    second = learned["episodes"][1]
    assert [second[name] for name in ("label", "length", "return", "violation")] == ["episode 2", 22, "20.0", "13.6%"]
    np.testing.assert_allclose(unpacked(second["level"], "<i2") * data["level_unit"], 2 + 0.1 * np.arange(STEPS), atol=1e-3)
    np.testing.assert_allclose(unpacked(second["links"], "<i2") * data["unit"], SCENE.learned.links[1].ravel(), atol=1e-3)
    np.testing.assert_allclose(unpacked(second["delta"], "u1") / 255, np.linspace(0, 1, STEPS), atol=1 / 255)
    assert np.flatnonzero(unpacked(second["violating"], "u1")).tolist() == [3, 4, 12]


def test_the_view_follows_a_body_that_goes_farther_than_three_of_its_widths():
    assert not packed()["follow"]  # 2.3 m, of a body of 1 m
    far = SCENE.learned._replace(links=SCENE.learned.links * np.array([1.0, 1.0]) + 0.1 * np.arange(STEPS)[:, None, None, None])
    assert player._is_followed((SCENE.expert, far))  # 4.6 m


def test_a_title_that_looks_like_a_script_leaves_the_page_whole():
    title = "<!--<script> {{DATA}} </script>"
    found = re.search(r'type="application/json">(.*?)</script>\s*<script>', player.page(SCENE._replace(title=title)), re.DOTALL)
    assert found is not None
    assert json.loads(found[1])["title"] == title
    assert "<" not in found[1]
