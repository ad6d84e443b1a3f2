"""A cost of distance is found where there is one, and a fold has no part in the choice of what judges it."""

from dataclasses import replace

import numpy as np
import pytest

from aircl_jax.animals.nested import nested_selection
from aircl_jax.animals.trips import study_trips
from envs.animals.full.steps import Recordings, recordings_of
from envs.animals.windows import code_rows
from tests.animals.herds import GOATS, goat_recordings, tracks_of

SPOTS = {"hill": 0.0, "shade": 1.0, "pond": 3.0, "rock": 4.0}
COST = -1.5  # nats per unit


def travellers(seed: int = 0) -> Recordings:
    """Goats that rest three rows and walk one, to another place by its distance alone."""
    mapping = replace(
        GOATS,
        columns={**GOATS.columns, "coordinates": ["x", "y"]},
        behaviours=("rest", "walk"),
        places=tuple(SPOTS),
        moving="walk",
    )
    draws, names, spots = np.random.default_rng(seed), list(SPOTS), np.array(list(SPOTS.values()))
    rows, position = [], []
    for recording in range(4):
        here = 0
        for trip in range(120):
            for wait in range(4):
                time = 4.0 * trip + wait
                rows.append((f"day{recording}", "g", time, "walk" if wait == 3 else "rest", names[here]))
                position.append((spots[here] + draws.normal(scale=0.05), 0.0, 0.0))
            appeal = np.where(np.arange(4) == here, -np.inf, COST * np.abs(spots - spots[here]))
            here = int(draws.choice(4, p=np.exp(appeal) / np.exp(appeal).sum()))
    tracks = tracks_of(rows)._replace(position=np.array(position))
    return recordings_of(code_rows(tracks, mapping), mapping)


def test_a_cost_of_distance_is_found_and_pays_on_held_out_recordings():
    found = study_trips(travellers())
    assert found is not None
    assert found.number > 400
    assert found.cost == pytest.approx(COST, abs=4 * found.spread)
    assert found.spread < 0.5
    assert found.gain.low > 0


def test_tables_without_places_or_positions_have_no_trips():
    assert study_trips(goat_recordings(recordings=2, animals=1, rows=40)) is None


def test_each_fold_is_judged_by_what_the_others_chose():
    """`own` is best on fold 0 alone, so fold 0 must be judged by `others`, and the other folds by what is best without them."""
    recording, fold_of = np.array([0, 1, 2, 2]), np.array([0, 1, 2])
    nats = {"own": np.array([0.0, -9.0, -9.0, -9.0]), "others": np.array([-5.0, -1.0, -1.0, -1.0])}
    asked = []

    def predict(variant, trained):
        asked.append((variant, tuple(trained.tolist())))
        return nats[variant]

    found = nested_selection({name: name for name in nats}, predict, fold_of, recording)
    assert found.chosen == ("others", "others", "others")
    np.testing.assert_array_equal(found.nats, nats["others"])
    assert ("own", (True, False, False)) in asked  # the choice is made by fits without the judged fold and one more
    assert ("own", (True, False, True)) not in asked  # and the judged fold is fitted by the chosen variant alone
