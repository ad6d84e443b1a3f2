"""What is said of cells that are only disliked, of lapses and of more demonstrations, by hand."""

from experiments.swap.controls import HEAD, lines
from experiments.swap.grid_cells import MORE


def cell(demonstrations, flags, found=(), dislikes=None):
    metrics = {
        "transfer_return": [0.9, 1.0],
        "transfer_violation": [0.02, 0.04],
        "constraint_transfer_return": [0.7, 0.8],
        "constraint_transfer_violation": [0.1, 0.0],
        "split": [None, 1.0],
        "reward_distance": [0.1, 0.2],
    }
    return {
        "demonstrations": demonstrations,
        "obstacles": {"true_tempted": [[7.0, 2.0]] * len(found), "found": list(found)},
        "false_flags": flags,
        "metrics": metrics,
        "changed_worlds": {"wind": [[0.8, 0.1], [0.9, 0.2]], "slip": [[0.7, 0.0], [1.1, 0.0]]},
        **({"dislikes": dislikes} if dislikes else {}),
    }


CELLS = {
    ("gridworld", "default, goal", "ours"): cell(70, [0, 1], [[True, False], [False, False]]),
    ("gridworld", "dislikes", "ours"): cell(
        70, [2, 1], dislikes={"entered": [[0, 0], [3, 1]], "flagged": [[True, True], [False, True]]}
    ),
    ("gridworld", "dislikes, 500 demonstrations", "ours"): cell(
        500, [1, 0], dislikes={"entered": [[9, 6], [5, 4]], "flagged": [[False, False], [False, False]]}
    ),
    ("gridworld", "lapses of 1 %", "bc"): {"metrics": {}},
}


def test_disliked_cells_that_are_flagged_are_counted_over_seeds_and_apart_from_other_false_flags():
    obstacles, few, many = lines(CELLS, ["ours", "bc"])
    assert all(len(line) == len(HEAD) for line in (obstacles, few, many))
    assert obstacles[:6] == ("default, goal", "70", "1 of 2", "—", "—", "0.50")
    assert few[:6] == ("dislikes", "70", "—", "3 of 4", "1.0 a cell", "0.00")
    assert many[:6] == ("dislikes", "500", "—", "0 of 4", "6.0 a cell", "0.50")


def test_scores_beside_are_means_over_seeds_and_undefined_ones_are_left_out():
    assert lines(CELLS, ["ours"])[0][6:] == ("0.950 (0.850); 3.0 %", "0.75; 5.0 %", "—", "0.15")


def test_more_demonstrations_are_of_every_reward_of_the_default_layout_and_of_every_control():
    assert {number for _, number in MORE.values()} == {200, 500}
    assert len(MORE) == 12 and all(world.startswith(base) for world, (base, _) in MORE.items())
