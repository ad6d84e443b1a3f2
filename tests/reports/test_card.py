"""The card of a run: its keys, what it lists as not done and how often that was shown, and its closing lines."""

import json
from dataclasses import replace

import numpy as np
import pytest

from aircl_jax.analysis.episodes import GridEvidence
from aircl_jax.analysis.recovered_limits import Limits
from aircl_jax.reports import card as cards
from aircl_jax.reports.card import as_json, as_markdown, card_of, closing
from tests.finished_runs import untrained, untrained_robot

TEMPTING = {"what", "limit", "spread", "tempted", "done", "how"}
ROBOT = untrained_robot("aircl_corrected")


def known(monkeypatch, *forbidden, method="aircl_corrected"):
    """A card where δ₁ of each seed is 0.1 in these cells (row, column) and 0.9 elsewhere."""
    delta = np.full((len(forbidden), 9, 4), 0.9)
    for seed, cells in enumerate(forbidden):
        for row, column in cells:
            delta[seed, 3 * row + column] = 0.1
    return of_tables(monkeypatch, delta, method)


def of_tables(monkeypatch, delta, method="aircl_corrected"):
    evidence = GridEvidence(np.zeros_like(delta), delta, np.zeros(delta.shape[:2]), np.zeros(9))
    monkeypatch.setattr(cards, "gather_grid", lambda result, table: evidence)
    return card_of(ended(method))


def ended(method="aircl_corrected"):
    """A run whose first seed's demonstrations end after two steps."""
    result = untrained(method)
    return replace(result, expert=result.expert._replace(mask=result.expert.mask.at[0, :, 2:].set(0.0)))


def visits(row, column):
    """Demonstrated steps in a cell, of one seed on average, by loops."""
    expert, number = ended().expert, 0.0
    for seed in range(2):
        for obs, mask in zip(np.asarray(expert.obs[seed]), np.asarray(expert.mask[seed]), strict=True):
            number += sum(float(keep) for step, keep in zip(obs, mask, strict=True) if step.argmax() == 3 * row + column)
    return number / 2


def listed(card):
    return [entry["what"] for entry in card["never"]]


@pytest.mark.parametrize("method", ["aircl_corrected", "aircl", "icrl", "airl_centred", "bc"])
def test_the_card_of_a_grid_has_the_same_keys_and_can_be_written(method):
    card = card_of(untrained(method))
    assert {name: type(value) for name, value in card.items()} == {
        "wants": list,
        "never": list,
        "cannot_tell": list,
        "separable": bool,
    }
    assert all(set(entry) == TEMPTING for entry in card["never"])
    assert json.loads(as_json(card)) == card
    assert "NaN" not in as_json(card)
    assert all(isinstance(line, str) for line in card["cannot_tell"])


def test_exactly_the_forbidden_cells_are_listed_least_feasible_first_with_how_often_they_were_entered(monkeypatch):
    delta = np.full((2, 9, 4), 0.9)
    delta[:, 4], delta[:, 0], delta[0, 2] = [[0.3], [0.1]], 0.4, 0.1  # [0, 2] in one seed of two
    delta[:, 7, 1:] = 0.0  # one action of [2, 1] remains
    card = of_tables(monkeypatch, delta)
    assert listed(card) == ["entering cell [1, 1]", "entering cell [0, 0]"]
    middle, start = card["never"]
    assert (middle["spread"], middle["limit"], middle["tempted"]) == (pytest.approx(0.1), None, None)
    assert middle["how"] == "δ₁ 0.20, below ½ in 100% of seeds"
    assert (middle["done"], start["done"]) == (visits(1, 1), visits(0, 0))
    assert start["done"] >= 5.0  # each of five demonstrations begins there


def test_steps_after_an_episodes_end_are_not_counted(monkeypatch):
    [goal] = known(monkeypatch, [(2, 2)], [(2, 2)])["never"]
    every = np.asarray(ended().expert.obs)[..., 8].sum() / 2
    assert 0.0 < goal["done"] == visits(2, 2) < every


def test_cells_of_which_nothing_is_known_are_counted(monkeypatch):
    unseen = {(row, column) for row in range(3) for column in range(3) if visits(row, column) == 0}
    assert (1, 1) in unseen
    told = f"{len(unseen)} cells are in no demonstration"
    assert any(line.startswith(told) for line in known(monkeypatch, [], [])["cannot_tell"])
    left = known(monkeypatch, unseen, unseen)["cannot_tell"]
    assert not any("are in no demonstration" in line for line in left)
    assert any("cannot tell the forbidden from what was merely never wanted" in line for line in left)


def test_the_closing_lines_name_three_and_count_the_others(monkeypatch):
    cells = [(0, 1), (0, 2), (1, 0), (1, 1), (2, 0)]
    first, second = closing(known(monkeypatch, cells, cells)).splitlines()
    assert first == "What it wants: not separable from what it does (f = log π_E)."
    assert second == ("What it does not do: entering cell [0, 1]; entering cell [0, 2]; entering cell [1, 0]; and 2 more.")
    assert closing(known(monkeypatch, cells[:2], cells[:2])).endswith("cell [0, 1]; entering cell [0, 2].")
    assert closing(known(monkeypatch, [], [])).endswith("What it does not do: nothing was found.")


@pytest.mark.parametrize(("method", "said"), [("bc", "No reward was learned: cloning"), ("icrl", "The reward was given")])
def test_what_learns_no_reward_says_so(method, said):
    card = card_of(untrained(method))
    assert card["cannot_tell"][0].startswith(said)
    assert closing(card).startswith("What it wants: no reward was learned.\n")
    assert card["wants"] == [] and not card["separable"]


@pytest.mark.parametrize(
    ("method", "said"),
    [
        ("airl_centred", "No constraint was learned"),
        ("bc", "No constraint was learned"),
        ("aircl", "of whole trajectories alone"),
    ],
)
def test_what_tests_no_steps_lists_nothing_and_says_why(method, said):
    card = card_of(untrained(method))
    assert card["never"] == [] and sum(said in line for line in card["cannot_tell"]) == 1
    assert "Nothing was found that it does not do." in as_markdown(card, "a run")


def robot_card(monkeypatch, lower, upper):
    """A card of limits (seed, coordinate) on heading and front motor."""
    names = ("heading", "motor front")
    found = Limits(names, np.array(lower), np.array(upper), np.array([-1.0, -0.5]), np.array([1.0, 0.75]))
    monkeypatch.setattr(cards, "recovered_limits", lambda result: found)
    return card_of(ROBOT)


def test_a_limit_is_listed_where_most_seeds_draw_it_with_the_steps_beyond_it(monkeypatch):
    nan = np.nan
    card = robot_card(monkeypatch, [[-0.2, nan], [nan, -0.3]], [[nan, 0.2], [nan, 0.6]])
    assert listed(card) == ["motor front above"]  # the others are drawn by one seed of two
    [entry] = card["never"]
    assert (entry["limit"], entry["spread"]) == (pytest.approx(0.4), pytest.approx(0.2))
    kept = np.asarray(ROBOT.expert.mask[0]) > 0
    assert entry["done"] == (np.asarray(ROBOT.expert.action[0])[kept][:, 0] > 0.4).sum()
    assert entry["how"] == "δ₁ below ½ in 2 of 2 seeds; demonstrations reach 0.75"
    assert any(line.startswith("No limit was found of heading:") for line in card["cannot_tell"])
    assert "motor front above 0.4 ± 0.2" in closing(card)


def test_steps_below_a_lower_limit_are_counted_on_its_own_coordinate(monkeypatch):
    nan = np.nan
    card = robot_card(monkeypatch, [[-0.2, nan], [-0.2, nan]], [[nan, nan], [nan, nan]])
    [entry] = card["never"]
    kept = np.asarray(ROBOT.expert.mask[0]) > 0
    assert entry["what"] == "heading below" and entry["how"].endswith("demonstrations reach -1")
    assert entry["done"] == (np.asarray(ROBOT.expert.obs[0])[kept][:, 0] < -0.2).sum() > 0


def test_the_words_have_twelve_and_the_json_all():
    entry = {"what": "x above", "limit": 0.5, "spread": 0.012, "tempted": 3.4, "done": 2.0, "how": "known"}
    never = [{**entry, "what": f"x{number} above"} for number in range(14)]
    card = {
        "wants": [{"what": "the goal", "weight": 1.5, "spread": 0.25}],
        "never": never,
        "cannot_tell": [],
        "separable": True,
    }
    words = as_markdown(card, "A run")
    assert words.startswith("# A run")
    assert "| x11 above | 0.5 ± 0.012 | 3 times | 2 times | known |" in words
    assert "x12 above" not in words and "2 more are in card.json." in words
    assert "| the goal | 1.50 ± 0.25 |" in words and "Nothing is missing." in words
    assert len(json.loads(as_json(card))["never"]) == 14
    assert closing(card).startswith("What it wants: the goal (+1.5).\n")


def test_a_number_that_is_none_is_no_json():
    with pytest.raises(ValueError, match="Out of range float"):
        as_json({"wants": [], "never": [{"limit": float("nan")}], "cannot_tell": [], "separable": False})
