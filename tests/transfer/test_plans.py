"""Plans on what was learned: each on its own part, with paths of the world's dynamics and exact shares."""

import json
from dataclasses import replace

import numpy as np
import pytest

from aircl_jax.analysis import exact
from aircl_jax.transfer import plans
from aircl_jax.transfer.grid import in_every_world
from aircl_jax.transfer.plans import plans_of
from aircl_jax.transfer.table_tests import Learned, case
from envs.options import GridOptions
from tests.finished_runs import untrained

DEFAULT = GridOptions().resolved()
WORLD = case(DEFAULT).world


def planned(options=DEFAULT, reward=True, constraint=True):
    """The plans of a seed that has learned the truth, or one part of it, by name."""
    world = case(options).world
    seed = Learned(in_every_world(world.reward) if reward else None, world.forbidden if constraint else None, np.zeros(()))
    return {part.name: plans._planned(part, case(part.options)) for part in plans._parts(seed, options)}


def test_who_learns_the_truth_keeps_out_by_both_and_not_by_the_reward_alone():
    found, best = planned(), case(DEFAULT).best
    assert found["both"]["violates"] == pytest.approx(best.violating_episodes)
    assert found["reward"]["violates"] > 0.9 and any(found["reward"]["violating"])
    assert found["constraint"]["violates"] < 0.02 and found["constraint"]["arrives"] < 0.1
    assert found["goal"]["violates"] < 0.02 and found["goal"]["arrives"] > 0.9
    assert found["goal"]["ends"] != found["both"]["ends"] and found["goal"]["start"] == found["both"]["start"]


def test_what_is_not_learned_has_no_plan():
    assert set(planned(constraint=False)) == {"reward"}
    assert set(planned(reward=False)) == {"constraint", "goal"}


def test_paths_begin_at_the_start_follow_moves_and_are_marked_where_they_violate():
    found = planned()["reward"]
    paths = np.array(found["paths"])
    assert paths.shape == (plans.PATHS, int(DEFAULT.horizon) + 1) and (paths[:, 0] == found["start"]).all()
    possible = WORLD.transition.max(axis=1) > 0
    assert possible[paths[:, :-1], paths[:, 1:]].all()
    assert found["violating"] == [any(cell in found["forbidden"] for cell in path) for path in found["paths"]]


def test_paths_are_drawn_as_the_plan_goes():
    policy = exact.hard_plan(WORLD.transition, WORLD.reward, int(DEFAULT.horizon), WORLD.barred)
    expected = exact.occupancy(WORLD.transition, WORLD.start, policy)
    paths = plans.draw_paths(WORLD, policy)
    for t in (1, 4):
        seen = np.bincount(paths[:, t], minlength=36) / plans.PATHS
        assert 0.5 * np.abs(seen - expected[t]).sum() < 0.35  # total variation of 24 draws over at most 5 cells


def test_flags_are_shown_where_the_plan_knows_them():
    found = planned()
    assert found["both"]["flagged"] == found["both"]["forbidden"] == np.flatnonzero(WORLD.forbidden).tolist()
    assert found["reward"]["flagged"] == [] and found["reward"]["forbidden"] == found["both"]["forbidden"]


def test_other_worlds_have_their_own_walls_sites_and_starts():
    found = planned(GridOptions(layout="wall", reward="sites", start="any").resolved())
    assert found["both"]["start"] is None and found["both"]["arrives"] is None
    assert len(found["both"]["ends"]) == 3


def test_a_run_has_the_plans_of_its_first_seed_and_other_worlds_none():
    result = untrained("aircl_contrast")
    found = plans_of(result)
    assert found is not None and found["seed"] == result.spec.seeds[0]
    assert [plan["name"] for plan in found["plans"]] == ["both", "reward", "constraint", "goal"][: len(found["plans"])]
    json.dumps(found, allow_nan=False)
    assert plans_of(replace(result, spec=replace(result.spec, named=False))) is None
