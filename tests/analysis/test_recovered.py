"""What a run recovered in ranks and words, on numbers worked by hand; and its figures."""

import numpy as np
import pytest

from aircl_jax.analysis.recovered import Recovered, avoided, beginning, expected, rank_agreement, rewarding
from aircl_jax.figures.grids import codes, maze
from aircl_jax.reports.recovered_words import in_words
from envs import Codes, Maze

# Three activities: sleep goes on or becomes eat; eat becomes sleep or play; play never follows sleep.
SEEN = np.array([[50, 20, 0], [10, 30, 10], [10, 0, 20]])
REWARD = np.array([[1.0, 2.0, -3.0], [0.5, 1.0, -1.0], [1.5, 0.0, 1.0]])
DELTA = np.array([[1.0, 1.0, 0.1], [1.0, 1.0, 1.0], [1.0, 0.2, 1.0]])
CODES = Codes(("sleep", "eat", "play"), np.zeros((3, 3), dtype=bool))


def recovered(seeds: int = 3) -> Recovered:
    def repeated(values: np.ndarray) -> np.ndarray:
        return np.repeat(values[None], seeds, axis=0)

    return Recovered(repeated(REWARD), repeated(DELTA), repeated(np.log(np.full((3, 3), 1 / 3))), SEEN)


def test_chance_is_how_often_a_code_ends_times_how_often_the_others_begin():
    found = expected(SEEN, CODES.impossible)
    # 20 ends of sleep; eat begins 20 times and play 10: 20 · 20/30 and 20 · 10/30.
    np.testing.assert_allclose(found[0], [0, 40 / 3, 20 / 3])
    impossible = np.array([[False, False, True], [False] * 3, [False] * 3])
    np.testing.assert_allclose(expected(SEEN, impossible)[0], [0, 20, 0])


def test_beginning_is_the_mean_over_the_changes_that_were_made():
    np.testing.assert_allclose(beginning(recovered())[0], [(0.5 * 10 + 1.5 * 10) / 20, 2.0, -1.0])


def test_changes_are_ranked_by_reward_where_they_were_seen():
    assert rewarding(recovered()) == [(0, 1), (2, 0), (1, 0), (1, 2)]


def test_avoided_is_infeasible_although_chance_would_have_shown_it():
    assert avoided(recovered(), CODES) == [(0, 2), (2, 1)]
    ruled_out = Codes(CODES.names, np.array([[False, False, True], [False] * 3, [False] * 3]))
    assert avoided(recovered(), ruled_out) == [(2, 1)]


def test_rank_agreement_is_spearmans_for_every_pair_of_seeds():
    values = np.array([[1.0, 2.0, 3.0, 4.0], [10.0, 20.0, 30.0, 40.0], [4.0, 3.0, 2.0, 1.0]])
    np.testing.assert_allclose(rank_agreement(values), [1.0, -1.0, -1.0])
    assert len(rank_agreement(values[:1])) == 0
    curved = np.array([[1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 300.0, 20.0]])  # ranks 1, 2, 4, 3
    np.testing.assert_allclose(rank_agreement(curved), [0.8])


def test_the_words_name_what_is_sought_and_what_is_avoided():
    text = in_words(recovered(), CODES)
    assert "| 1 | eat | 2.00 ± 0.00 | 1.00 ± 0.00 | 20 |" in text
    assert "| sleep | eat | 2.00 ± 0.00 | 20 of 20 |" in text
    assert "| sleep | play | 0.10 ± 0.00 | 0 | 7 |" in text
    assert "rank correlation of 1.00 on average" in text
    assert "One seed alone" in in_words(recovered(1), CODES)


def test_the_words_count_leaving_by_what_came_before_and_spread_over_the_seeds_of_a_sample():
    seen = np.array([[50, 30, 6], [10, 30, 10], [10, 0, 20]])
    shifted = recovered().reward + np.array([-1.0, 0.0, 1.0])[:, None, None]
    text = in_words(recovered()._replace(reward=shifted, seen=seen), CODES)
    assert "| sleep | eat | 2.00 ± 1.00 | 30 of 36 |" in text
    assert "| play | sleep | 1.50 ± 1.00 | 10 of 10 |" in text


def test_the_words_tell_the_least_agreement_of_two_seeds_beside_the_mean():
    reward = recovered().reward
    reward[2] = -reward[2]  # the third seed ranks the other way round
    text = in_words(recovered()._replace(reward=reward), CODES)
    assert "these 4 changes agrees by a rank correlation of -0.33 on average, -1.00 at worst" in text


def test_what_is_avoided_begins_with_the_least_feasible():
    delta = np.repeat(DELTA[None], 3, axis=0)
    delta[:, 2, 1] = 0.05
    assert avoided(recovered()._replace(delta=delta), CODES) == [(2, 1), (0, 2)]


def test_what_a_method_does_not_learn_is_not_put_in_words():
    unknown = np.full((3, 3, 3), np.nan)
    assert "avoid" not in in_words(recovered()._replace(delta=unknown), CODES)
    assert in_words(recovered()._replace(delta=unknown, reward=unknown), CODES) == ""


@pytest.mark.parametrize("seeds", [1, 3])
def test_every_figure_of_codes_is_drawn_with_a_caption(seeds):
    drawings = list(codes.draw(recovered(seeds), CODES, "three activities"))
    assert [drawing.name for drawing in drawings] == ["activities", "reward_by_change", "feasibility_by_change"]
    assert all("three activities" in drawing.caption for drawing in drawings)


def test_reward_of_arriving_is_over_the_moves_to_a_node_and_not_over_staying():
    world = Maze(np.zeros((2, 2)), np.array([[1, 0], [0, 1]]), {"home": 0})  # action 0 changes the node, 1 stays
    values = np.array([[[5.0, 9.0], [7.0, 9.0]]])
    np.testing.assert_allclose(maze.arriving(values, world, np.array([[1, 1], [1, 1]])), [[7.0, 5.0]])
    assert np.isnan(maze.arriving(values, world, np.array([[0, 1], [1, 1]]))[0, 1])


def test_nothing_that_was_seen_too_rarely_is_ranked_in_words_or_figures():
    rarely = recovered()._replace(seen=np.array([[50, 2, 0], [1, 30, 1], [1, 0, 20]]))
    words = in_words(rarely, CODES)
    assert "No activity begins 5 times or more" in words
    assert "No change was seen 5 times or more" in words
    assert [drawing.name for drawing in codes.draw(rarely, CODES, "")] == ["reward_by_change", "feasibility_by_change"]
    never = rarely._replace(seen=np.diag([50, 30, 20]))
    assert [drawing.name for drawing in codes.draw(never, CODES, "")] == ["feasibility_by_change"]
