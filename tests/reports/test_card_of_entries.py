"""The card of a row that counts entries, on a grid whose g, h, δ₁, n and M are known."""

import json
from typing import Any

import numpy as np
import pytest

from aircl_jax.analysis.entries import Entries
from aircl_jax.analysis.episodes import LearnedTables
from aircl_jax.reports import card_of_entries as cards
from aircl_jax.reports.card import as_json, as_markdown, card_of, closing
from tests.finished_runs import untrained
from tests.worlds import table_of

RUN = untrained("aircl_contrast")
WORLD = table_of(RUN.spec.env)


@pytest.fixture
def known(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Make the card of two seeds whose g is 1 in the goal (and 2 in the second seed), with these cells forbidden."""

    def card(*forbidden: int, alone: float = 0.2, slope: Any = ((0.5, -0.1), (0.7, 0.1))) -> dict[str, Any]:
        delta = np.ones((2, 9, 4))
        delta[:, list(forbidden)] = 0.1
        g = np.zeros((2, 9))
        g[:, 8] = 0.9, 1.8
        tables = LearnedTables(np.zeros((2, 9, 4)), delta, np.zeros((2, 5, 9, 4)), g, np.zeros((2, 9)))
        expected = np.arange(9.0) + np.array([[0.0], [1.0]])
        made = np.where(np.isin(np.arange(9), [4, 6]), 0.0, 3.0) * np.ones((2, 1))
        monkeypatch.setattr(cards, "learned_tables", lambda *_: tables)
        monkeypatch.setattr(cards, "entries_of", lambda *_: Entries(made, expected))
        monkeypatch.setattr(cards, "slopes", lambda _: np.array(slope))
        monkeypatch.setattr(cards, "tempted_share", lambda *_: alone)
        return card_of(RUN)

    return card


def test_what_is_wanted_is_ranked_with_its_spread_and_trifles_are_left_out(known):
    wants = known(4)["wants"]
    assert [entry["what"] for entry in wants] == ["a step in cell [2, 2]", "one row further down"]
    goal, down = wants
    assert goal["weight"] == pytest.approx(np.mean([0.9, 1.8]) * 8 / 9)  # less the mean over nine cells
    assert goal["spread"] == pytest.approx(0.45 * 8 / 9)
    assert (down["weight"], down["spread"]) == (pytest.approx(0.6), pytest.approx(0.1))


def test_what_is_disliked_is_listed_by_its_size(known):
    wants = known(4, slope=((-3.0, 0.0), (-3.0, 0.0)))["wants"]
    assert (wants[0]["what"], wants[0]["weight"]) == ("one row further down", -3.0)


def test_forbidden_cells_are_listed_most_tempted_first_with_entries_made_and_expected(known):
    never = known(4, 6)["never"]
    assert [entry["what"] for entry in never] == ["entering cell [2, 0]", "entering cell [1, 1]"]
    assert [(entry["tempted"], entry["spread"], entry["done"]) for entry in never] == [(6.5, 0.5, 0.0), (4.5, 0.5, 0.0)]
    assert never[0]["how"] == "δ₁ 0.10, below ½ in 100% of seeds"


def test_cells_that_nobody_entered_and_nobody_forbids_were_not_tested(known):
    assert any(line.startswith("Not tested: [2, 0] (6.5).") for line in known(4)["cannot_tell"])
    assert not any(line.startswith("Not tested") for line in known(4, 6)["cannot_tell"])


def test_a_reward_that_keeps_clear_by_itself_is_not_separable(known):
    assert known(4)["separable"] and not known(4, alone=0.001)["separable"]
    assert any("not separable" in line for line in known(4, alone=0.001)["cannot_tell"])
    assert known(alone=0.0)["separable"]  # nothing is forbidden, so nothing can be wanted of it


def test_the_rate_of_lapses_that_is_assumed_is_said(known):
    assert any("entered less than 40% as often" in line for line in known(4)["cannot_tell"])  # ϑ of these settings


def test_the_closing_lines_and_the_files_hold_it(known):
    card = known(4)
    assert json.loads(as_json(card)) == card
    assert closing(card).splitlines()[0] == "What it wants: a step in cell [2, 2] (+1.2), one row further down (+0.6)."
    assert "| entering cell [1, 1] |" in as_markdown(card, "A run")


def test_the_share_of_a_plan_in_what_is_forbidden_is_of_its_steps():
    towards = np.zeros((9, 4))
    towards[:, 2] = 50.0  # down
    share = cards.tempted_share(towards, WORLD, 4, np.isin(np.arange(9), [3]))
    slip = 0.01 * 3 / 4
    assert share == pytest.approx(0.25 * (1 - slip), abs=0.01)  # one step of four, from [0, 0] through [1, 0]


def test_an_untrained_run_has_a_card():
    card = card_of(RUN)
    assert set(card) == {"wants", "never", "cannot_tell", "separable"}
