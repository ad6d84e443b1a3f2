"""Folds are the project's, gains and their intervals are worked by hand, and a known truth is recovered."""

import numpy as np
import pytest

from aircl_jax.animals.behaviour import design, leaving_groups
from aircl_jax.animals.changes import ruled_out
from aircl_jax.animals.counting import back_off, counts_by_recording, smoothed_chain
from aircl_jax.animals.features import tempo
from aircl_jax.animals.going import fit_going
from aircl_jax.animals.held_out import evaluate, folds_of, jackknife, over_folds, over_recordings
from envs.animals.full.reading import read_recordings
from envs.animals.meerkat import held_out_recordings
from envs.options import MeerkatOptions
from tests.animals.herds import DRAW, FORBIDDEN, GOATS, goat_recordings


@pytest.fixture(scope="module")
def herd():
    return goat_recordings()


def test_the_folds_are_those_of_the_settings_of_a_run():
    recordings = read_recordings("simulated")
    folds = folds_of(recordings)
    for fold in range(4):
        held_out = np.array(recordings.recordings)[folds == fold]
        assert set(held_out.tolist()) == set(held_out_recordings(MeerkatOptions(data="simulated", fold=fold)))


def test_one_recording_is_held_out_animal_by_animal_and_one_animal_not_at_all():
    one = goat_recordings(recordings=1, animals=3, rows=50)
    assert "recordings" in one.lacks
    assert one.recordings == ("g0", "g1", "g2")
    with pytest.raises(ValueError, match="nothing to hold out"):
        folds_of(goat_recordings(recordings=1, animals=1, rows=50))


def test_a_mean_over_folds_has_the_t_interval_worked_by_hand():
    gain = over_folds(np.array([1.0, 3.0, 2.0, 6.0]), np.ones(4), np.array([0, 0, 1, 1]))
    assert (gain.mean, gain.won, gain.of) == (3.0, 2, 2)
    assert gain.high - gain.mean == pytest.approx(12.7062 * np.sqrt(2) / np.sqrt(2), rel=1e-4)  # shares 2 and 4, sd √2


def test_a_gain_over_recordings_weighs_by_their_steps():
    gain = over_recordings(np.array([1.0, 1.0, -1.0]), np.ones(3), np.array([0, 0, 1]))
    assert gain.mean == pytest.approx(1 / 3)
    assert (gain.won, gain.of) == (1, 2)
    assert gain.low == -1
    assert gain.high == 1


def test_the_jackknife_of_a_mean_is_its_standard_error():
    values = np.array([1.0, 2.0, 4.0, 9.0])
    left_out = np.array([np.delete(values, one).mean() for one in range(4)])
    assert float(jackknife(left_out)) == pytest.approx(values.std(ddof=1) / 2)


def test_the_chain_is_smoothed_by_the_count_that_predicts_left_out_recordings(herd):
    counts = counts_by_recording(herd, np.ones(len(herd.steps.code)))
    assert counts.sum() == len(herd.steps.code)
    log_chain, smoothing = smoothed_chain(counts, np.arange(6) < 5)
    smooth = counts[:5].sum(axis=0) + smoothing
    np.testing.assert_allclose(np.exp(log_chain), smooth / smooth.sum(axis=1, keepdims=True))


def test_back_off_is_worked_by_hand(herd):
    steps = herd.steps
    trained = np.arange(6) < 5
    found = back_off(herd, [[], [steps.place]], trained, np.ones(len(steps.code)), 10.0)
    one = int(np.flatnonzero(steps.recording == 5)[7])
    use = steps.recording < 5
    plain = use & (steps.code == steps.code[one])
    rich = plain & (steps.place == steps.place[one])
    hit = steps.following == steps.following[one]
    first = ((plain & hit).sum() + 2.5 / 3) / (plain.sum() + 2.5)
    assert np.exp(found[one]) == pytest.approx(((rich & hit).sum() + 10 * first) / (rich.sum() + 10))


def test_tempo_looks_back_only_and_leaves_its_own_recording_out():
    herd = goat_recordings(recordings=3, animals=1, rows=30)
    steps, found = herd.steps, tempo(herd, np.ones(3, dtype=bool)).values[:, 0]
    left = steps.code != steps.following
    here, other = steps.recording == 1, steps.recording != 1
    everywhere = left[other].mean()
    rate = [
        (left[other & (steps.code == c)].sum() + 10 * everywhere) / ((other & (steps.code == c)).sum() + 10) for c in range(3)
    ]
    seen, expected = 0.0, 0.0
    for row in np.flatnonzero(here):
        assert found[row] == pytest.approx(np.log((seen + 2) / (expected + 2)))
        seen, expected = seen + left[row], expected + rate[steps.code[row]]


def test_the_model_beats_the_chain_where_age_and_place_matter_and_is_calibrated(herd):
    held = evaluate(design(herd))
    assert over_recordings(held.model.both - held.chain.both, held.steps, np.arange(6)).won == 6
    assert sum(one.steps for one in held.ages) == (~herd.steps.unseen).sum()
    for one in held.ages:
        assert one.model == pytest.approx(one.observed, abs=0.04)
        if one.first == 1:
            assert one.model == pytest.approx(0.4, abs=0.03)  # the truth
            assert abs(one.chain - 0.4) > 0.1


def test_with_the_forbidden_change_ruled_out_the_reward_of_a_place_is_recovered_up_to_a_constant(herd):
    columns = design(herd)
    forbidden = np.array(herd.names)[:, None] == FORBIDDEN[0]
    forbidden = forbidden & (np.array(herd.names) == FORBIDDEN[1])
    going = fit_going(ruled_out(columns.choices, forbidden), columns.choices.times)
    for row, place in enumerate(GOATS.places):
        reward = going.table[0] + going.table[1 + row]
        for one, other in ((0, 1), (1, 2)):  # differences of two rewards are free of the constant
            assert reward[one] - reward[other] == pytest.approx(DRAW[place][one] - DRAW[place][other], abs=0.45)


def test_what_the_tables_lack_is_no_group_of_columns(herd):
    assert "neighbours" in herd.lacks
    assert leaving_groups(herd) == ("activity", "age", "age by activity", "previous activity", "place", "tempo")
