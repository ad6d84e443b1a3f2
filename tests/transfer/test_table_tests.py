"""The swap tests of a grid: what the truth scores, what knows nothing scores, and each measure by hand or by loops."""

from dataclasses import replace

import numpy as np
import pytest

from aircl_jax.analysis import exact
from aircl_jax.analysis.changed_grids import changed_worlds, other_rewards
from aircl_jax.transfer.table_tests import Learned, by_world, case, measures, other_constraint, true_reward
from envs.layouts import LAYOUTS
from envs.options import GridOptions

UP, RIGHT, DOWN, LEFT = range(4)
DEFAULT = GridOptions()
SITES = GridOptions(reward="sites", start="any")
# The obstacle stands between start and goal: through it are 2 steps, around it 4.
DETOUR = GridOptions(size=4, goal=(0, 2), obstacles=((0, 1),), reward="goal", slip=0.0, horizon=12)
NAN_OF_A_CLONE = {
    "constraint_transfer_return",
    "constraint_transfer_violation",
    "reward_transfer_return",
    "lift",
    "lift_violation",
    "split",
    "reward_distance",
    "constraint_precision",
    "constraint_recall",
    "constraint_iou",
}


def always(action, horizon=10, cells=36):
    policy = np.zeros((horizon, cells, 4))
    policy[..., action] = 1.0
    return policy


NO_POLICY = np.zeros((1, 36, 4))  # for what has a reward: nobody acts by it


def truth(options):
    return Learned(true_reward, case(options).world.forbidden, NO_POLICY)


def flags(*places, cells=36):
    marked = np.zeros(cells, bool)
    marked[list(places)] = True
    return marked


@pytest.mark.parametrize("options", [DEFAULT, GridOptions(layout="wall", reward="goal"), SITES, replace(DEFAULT, lapse=0.05)])
def test_the_truth_scores_1_wherever_it_is_tried_and_violates_as_its_plan_does(options):
    found = measures(options, truth(options))
    for name in ("self_return", "transfer_return", "transfer_return_worst", "constraint_transfer_return"):
        assert found[name] == pytest.approx(1.0, abs=1e-9), name
    for name in ("self_violation", "transfer_violation", "constraint_transfer_violation", "reward_distance"):
        assert found[name] == pytest.approx(0.0, abs=1e-6), name
    for name in ("split", "lift_violation", "constraint_precision", "constraint_recall", "constraint_iou"):
        assert found[name] == 1.0, name
    if not np.isnan(found["reward_transfer_return"]):
        assert found["reward_transfer_return"] == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(list(by_world(options, truth(options)).values()), [(1.0, 0.0)] * 8, atol=1e-9)


def test_the_uniform_policy_as_it_is_scores_0_everywhere_and_has_nothing_to_recombine():
    uniform = Learned(None, None, exact.uniform_policy(10, 36, 4))
    found = measures(DEFAULT, uniform)
    np.testing.assert_allclose([score for score, _ in by_world(DEFAULT, uniform).values()], np.zeros(8), atol=1e-9)
    np.testing.assert_allclose([found[name] for name in ("self_return", "transfer_return")], [0.0, 0.0], atol=1e-9)
    assert {name for name, value in found.items() if np.isnan(value)} == NAN_OF_A_CLONE


def test_a_score_is_the_share_of_what_the_plan_gains_on_the_uniform_policy():
    # Down for ten steps from the corner: five cells nearer, 25 of the plan's 50.
    down = Learned(None, None, always(DOWN))
    at = case(replace(DEFAULT, slip=0.0))
    assert at.best.expected_return == pytest.approx(50.0)
    base = at.uniform.expected_return
    assert measures(replace(DEFAULT, slip=0.0), down)["self_return"] == pytest.approx((25.0 - base) / (50.0 - base))


def test_a_policy_that_is_used_as_it_is_repeats_its_last_step_in_a_longer_world():
    steps = np.concatenate([always(DOWN, 9), always(RIGHT, 1)])
    longer = case(changed_worlds(DEFAULT)["horizon"])
    expected = exact.evaluate(*longer.world, np.concatenate([steps, always(RIGHT, 10)]))
    score, excess = by_world(DEFAULT, Learned(None, None, steps))["horizon"]
    assert expected.expected_return > 45.0  # down, then right along the last row
    assert (score, excess) == (longer.score(expected), longer.excess(expected))


def test_violations_are_shares_of_episodes_less_those_of_the_plan():
    options = replace(DEFAULT, slip=0.3)
    at = case(options)
    assert at.best.violating_episodes > 0.05  # slip leads there, too
    entered = exact.evaluate(*at.world, always(RIGHT))  # [0, 4] stands in the way
    found = measures(options, Learned(None, None, always(RIGHT)))
    assert entered.violating_episodes > entered.violating_steps + 0.1
    assert found["self_violation"] == entered.violating_episodes - at.best.violating_episodes


def test_measures_of_changed_worlds_are_their_mean_and_their_worst_score():
    down = Learned(None, None, always(DOWN))
    worlds, found = np.array(list(by_world(DEFAULT, down).values())), measures(DEFAULT, down)
    assert len(worlds) == 8 and worlds.std(axis=0).min() > 0.1
    assert found["transfer_return"] == pytest.approx(worlds[:, 0].mean())
    assert found["transfer_return_worst"] == worlds[:, 0].min()
    assert found["transfer_violation"] == pytest.approx(worlds[:, 1].mean())


def test_a_constraint_that_forbids_nothing_is_violated_under_other_rewards():
    found = measures(DEFAULT, truth(DEFAULT)._replace(forbids=flags()))
    excesses, scores = [], []
    for other in other_rewards(DEFAULT).values():
        at = case(other)
        free = exact.evaluate(*at.world, exact.hard_plan(at.world.transition, at.world.reward, at.horizon))
        scores.append(at.score(free))
        excesses.append(free.violating_episodes - at.best.violating_episodes)
    assert found["constraint_transfer_violation"] == pytest.approx(np.mean(excesses)) and np.mean(excesses) > 0.2
    assert found["constraint_transfer_return"] == pytest.approx(np.mean(scores))
    assert (found["constraint_recall"], found["constraint_iou"]) == (0.0, 0.0)
    assert np.isnan(found["constraint_precision"])


def test_the_constraint_is_tried_under_known_rewards_whatever_the_learned_one_is():
    opposite = truth(DEFAULT)._replace(reward=lambda world: -world.reward)
    found = measures(DEFAULT, opposite)
    assert found["constraint_transfer_return"] == pytest.approx(1.0)
    assert found["self_return"] < 0.0 and found["transfer_return"] < 0.0 and found["reward_transfer_return"] < 0.0
    without = measures(DEFAULT, opposite._replace(reward=None))
    assert without["constraint_transfer_return"] == pytest.approx(1.0) and np.isnan(without["reward_transfer_return"])


def test_the_reward_is_tried_under_the_known_constraint_whatever_the_learned_one_is():
    found = measures(DEFAULT, truth(DEFAULT)._replace(forbids=flags(*range(1, 35))))
    assert found["reward_transfer_return"] == pytest.approx(1.0)
    assert found["self_return"] < 0.9


def test_cells_are_counted_one_by_one():
    # The layout's five are 7, 4, 15, 25, 28; of the six flagged 7 and 15 are right; start 0 and goal 35 do not count.
    found = measures(DEFAULT, truth(DEFAULT)._replace(forbids=flags(0, 7, 15, 20, 21, 22, 35)))
    assert found["constraint_precision"] == 2 / 5
    assert found["constraint_recall"] == 2 / 5
    assert found["constraint_iou"] == 2 / 8
    four = measures(DEFAULT, truth(DEFAULT)._replace(forbids=flags(7, 4, 15, 20)))
    assert (four["constraint_precision"], four["constraint_recall"], four["constraint_iou"]) == (3 / 4, 3 / 5, 3 / 6)


def test_where_any_cell_is_a_start_each_of_them_counts():
    found = measures(SITES, truth(SITES)._replace(forbids=flags(7, 4, 15, 25, 28, 6)))
    assert found["constraint_precision"] == 5 / 6


def test_a_reward_alone_is_planned_without_the_bar_and_lifts_what_the_truth_would():
    found = measures(DETOUR, truth(DETOUR))
    assert case(DETOUR).best.violating_episodes == 0.0
    assert (found["lift"], found["lift_violation"], found["split"]) == (1.0, 1.0, 1.0)
    assert found["self_violation"] == 0.0


def test_a_reward_that_holds_the_constraint_lifts_nothing_and_is_not_split():
    def joined(world):
        return world.reward - 100.0 * world.transition @ world.forbidden

    found = measures(DETOUR, truth(DETOUR)._replace(reward=joined, forbids=flags(cells=16)))
    assert found["lift"] == pytest.approx(0.0, abs=1e-9)
    assert found["lift_violation"] == 0.0
    assert found["split"] == pytest.approx(0.0, abs=1e-9)
    assert (found["self_return"], found["self_violation"]) == (pytest.approx(1.0), 0.0)


def test_the_split_is_the_ratio_of_the_steps_in_violation_of_two_soft_plans():
    options = replace(DEFAULT, temperature=2.0)
    at = case(options)

    def half(world):
        return 0.5 * world.reward

    steps = [
        exact.evaluate(*at.world, exact.soft_plan(at.world.transition, paid, 10, None, 2.0)).violating_steps
        for paid in (half(at.world), at.world.reward)
    ]
    found = measures(options, truth(options)._replace(reward=half))["split"]
    assert found == pytest.approx(steps[0] / steps[1]) and abs(found - 1.0) > 0.05


def test_the_lift_is_undefined_where_going_through_gains_nothing():
    assert np.isnan(measures(DEFAULT, truth(DEFAULT))["lift"])  # a shortest way is clean


def test_a_reward_is_asked_for_in_every_world_that_it_is_planned_in():
    asked = []

    def reward(world):
        asked.append(id(world))
        return world.reward

    measures(DEFAULT, truth(DEFAULT)._replace(reward=reward))
    worlds = [DEFAULT, other_constraint(DEFAULT), *changed_worlds(DEFAULT).values()]
    assert set(asked) == {id(case(one).world) for one in worlds}
    assert len(set(asked)) == 10


def test_other_constraints_are_those_of_another_layout_or_the_mirrored_ones():
    assert other_constraint(DEFAULT) == replace(DEFAULT.resolved(), obstacles=LAYOUTS["second"].obstacles)
    assert other_constraint(GridOptions(layout="third")).obstacles == LAYOUTS["second"].obstacles
    assert other_constraint(GridOptions(layout="second")).obstacles == LAYOUTS["default"].obstacles
    mirrored = {(column, row) for row, column in LAYOUTS["wall"].obstacles}
    assert set(other_constraint(GridOptions(layout="wall")).obstacles) == mirrored


def test_what_is_forbidden_may_be_stayed_in_but_not_entered():
    # Every cell flagged: all moves are barred alike but those against a wall, which stay.
    at = case(replace(DEFAULT, slip=0.0))
    found = measures(replace(DEFAULT, slip=0.0), truth(DEFAULT)._replace(forbids=flags(*range(36))))
    assert found["self_return"] == pytest.approx(at.score(exact.Outcome(0.0, 0.0, 0.0)))
