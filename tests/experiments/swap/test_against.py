"""Which differences between the contrast row and others the seeds show, against scipy's tests."""

import numpy as np
import pytest
from scipy import stats

from experiments.shared.paired_tests import holm, unpaired_p
from experiments.swap import against

RANDOM = np.random.default_rng(0)
TEN, THREE = list(range(1000, 1010)), [0, 1, 2]


def cell(seeds, **measures):
    return {"seeds": seeds, "metrics": {name: [None] * len(seeds) for name in against.COLUMNS.values()} | measures}


OURS = {world: RANDOM.uniform(0.9, 1.0, 10).tolist() for world in ("default", "second")}
THEIRS = RANDOM.uniform(0.5, 0.9, 10).tolist()
CELLS = {
    **{("gridworld", f"{world}, goal", "aircl_contrast"): cell(TEN, transfer_return=OURS[world]) for world in OURS},
    ("gridworld", "default, goal", "bc"): cell(TEN, transfer_return=THEIRS),
    ("gridworld", "default, goal", "oracle"): cell([0], transfer_return=[1.0]),
    **{("gridworld", f"{world}, goal", "airl_centred"): cell(THREE, transfer_return=[0.1, 0.2, 0.3]) for world in OURS},
}


def test_rows_with_our_seeds_are_compared_pair_by_pair_and_others_by_exchange():
    found = {one.row: one for row in ("bc", "oracle", "airl_centred") if (one := against._difference(CELLS, "goal", row, "S4"))}
    ours, both = np.array(OURS["default"]), np.mean(list(OURS.values()), axis=0)
    assert found["bc"].paired and found["bc"].layouts == ("default",)
    assert found["bc"].p == stats.wilcoxon(ours - THEIRS)[1]
    assert found["bc"].mean == pytest.approx(np.mean(ours - THEIRS))
    assert found["oracle"].p == stats.wilcoxon(ours - 1.0)[1]
    assert not found["airl_centred"].paired and found["airl_centred"].layouts == ("default", "second")
    assert found["airl_centred"].p == pytest.approx(2 / 286)  # of C(13, 3) exchanges, none is as far apart, on either side
    assert found["airl_centred"].mean == pytest.approx(both.mean() - 0.2)


def test_lines_are_of_rows_that_have_the_column_with_holms_correction_over_them():
    made = against.lines(CELLS, ["oracle", "aircl_contrast", "aircl_contrast planned", "bc", "airl_centred", "random"])
    assert [line[:4] for line in made] == [
        ("goal", "oracle", "default", "1"),
        ("goal", "bc", "default", "the same 10"),
        ("goal", "airl_centred", "default, second", "3"),
    ]
    assert all(line[4:7] == ("—", "—", "—") for line in made)
    raw = [one.p for row in ("oracle", "bc", "airl_centred") if (one := against._difference(CELLS, "goal", row, "S4"))]
    for line, p in zip(made, holm(raw), strict=True):
        assert line[7].startswith("**") == (p < 0.05) and line[7].endswith(f"(p {p:.3f})")


def test_seeds_that_are_exchanged_give_one_where_nothing_differs():
    assert unpaired_p([1.0, 1.0, 1.0], [1.0, 1.0]) == 1.0
