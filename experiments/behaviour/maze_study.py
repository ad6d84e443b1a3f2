"""Study the mice: hidden modes with places and habits beside chains, on blocks of recordings and on few recordings."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from aircl_jax.animals.held_out import Gain, over_folds
from aircl_jax.animals.maze import Walks, Ways, ways_and_walks
from aircl_jax.animals.maze_chains import SECOND_ORDER, Contexts, chains, contexts_of, tuned_chain
from aircl_jax.animals.modes import Modes, Start, fit_modes, predict
from envs.animals.labyrinth import FOLDS, HOME, WATER_PORT, Mice

NUMBER = 5  # modes
ROUNDS = 80
STARTS: tuple[tuple[Start, int], ...] = (("named", 0), ("random", 1), ("random", 2), ("random", 3))
LEAST_SHARE = 0.05  # of the steps: rarer modes are not ranked
SIZES = (2, 4, 8, 16, 48)  # recordings to learn from
SUBSETS = 3
JUDGED = 2  # tenths of the recordings that the small samples are judged on
ENTRANCE = 2  # habits at depths below this can do the work of a reward of home


class Started(NamedTuple):
    """One run of EM: where it began, its held-in nats a step, and the best rank of water port and home over its modes."""

    fold: int
    start: str
    seed: int
    nats: float
    water: int
    home: int
    held_out: float


class MazeStudy(NamedTuple):
    ways: Ways
    nats: dict[str, float]  # held-out nats a step, by model
    second: Gain  # the modes' gain over the second-order chain, over blocks
    tuned: Gain
    tuned_orders: list[int]
    starts: list[Started]
    kept: list[int]  # index into `starts` of the run with the best held-in likelihood, by block
    by_size: dict[int, Float[np.ndarray, "D M"]]  # {recordings: nats of [tuned chain, modes] by subset}
    home_ranks: list[tuple[int, int, float]]  # without habits at the entrance: (water, home, held-out nats) by number of modes
    modes: Modes  # of all recordings
    share_made: tuple[int, int]  # moves made, moves possible


def ranks(modes: Modes, node: int) -> int:
    """Return the best rank of a node by reward of arriving, over the modes of at least LEAST_SHARE of the steps."""
    used = modes.share >= LEAST_SHARE
    return int((modes.reward[used] > modes.reward[used][:, [node]]).sum(axis=1).min()) + 1


def study(mice: Mice, rounds: int = ROUNDS, sizes: tuple[int, ...] = SIZES) -> MazeStudy:
    """Judge modes and chains on consecutive blocks of recordings, then on few recordings."""
    ways, walks = ways_and_walks(mice.node, mice.action, mice.successor)
    contexts = contexts_of(walks, ways.num_nodes)
    number = len(walks.state)
    block = np.arange(number) * FOLDS // number
    nats = {name: np.zeros(walks.state.shape) for name in ("chain 1", "chain 2", "tuned chain", "modes")}
    starts: list[Started] = []
    kept: list[int] = []
    orders: list[int] = []
    for fold in range(FOLDS):
        train, test = np.flatnonzero(block != fold), np.flatnonzero(block == fold)
        by_order = chains(ways, walks, contexts, train, test, SECOND_ORDER)
        nats["chain 1"][test], nats["chain 2"][test] = by_order[0], by_order[1]
        nats["tuned chain"][test], order, _ = tuned_chain(ways, walks, contexts, train, test)
        orders.append(order)
        found = [_start(ways, walks, train, test, fold, start, seed, rounds) for start, seed in STARTS]
        best = max(range(len(found)), key=lambda one: found[one][0].nats)
        kept.append(len(starts) + best)
        starts += [one[0] for one in found]
        nats["modes"][test] = found[best][1]
        print(f"block {fold}: modes less chain 2 {(nats['modes'] - nats['chain 2'])[test].mean():+.4f}", flush=True)
    recording = np.arange(number)
    gains = {
        name: over_folds(
            (nats["modes"] - nats[name]).sum(axis=1), np.full(number, float(walks.state.shape[1])), block[recording]
        )
        for name in ("chain 2", "tuned chain")
    }
    made = np.zeros(ways.exists.shape, dtype=bool)
    made[walks.state, walks.move] = True
    every = np.arange(number)
    return MazeStudy(
        ways,
        {name: float(values.mean()) for name, values in nats.items()},
        gains["chain 2"],
        gains["tuned chain"],
        orders,
        starts,
        kept,
        _few(ways, walks, contexts, rounds, sizes),
        _without_entrance(mice, rounds),
        fit_modes(ways, _some(walks, every), NUMBER, rounds, "named", aims=(WATER_PORT, HOME)),
        (int((made & ways.exists).sum()), int(ways.exists.sum())),
    )


def _some(walks: Walks, recordings: Int[np.ndarray, " M"]) -> Walks:
    return Walks(*(part[recordings] for part in walks))


def _start(
    ways: Ways,
    walks: Walks,
    train: Int[np.ndarray, " M"],
    test: Int[np.ndarray, " K"],
    fold: int,
    start: Start,
    seed: int,
    rounds: int,
) -> tuple[Started, Float[np.ndarray, "K T"]]:
    modes = fit_modes(ways, _some(walks, train), NUMBER, rounds, start, seed, (WATER_PORT, HOME))
    held_out = predict(ways, _some(walks, test), modes)
    named = Started(fold, start, seed, modes.nats, ranks(modes, WATER_PORT), ranks(modes, HOME), float(held_out.mean()))
    return named, held_out


def _few(
    ways: Ways, walks: Walks, contexts: Contexts, rounds: int, sizes: tuple[int, ...]
) -> dict[int, Float[np.ndarray, "D M"]]:
    """Learn from random subsets of the recordings outside the first two tenths, and judge on these."""
    tenth = np.arange(len(walks.state)) % FOLDS
    test, pool = np.flatnonzero(tenth < JUDGED), np.flatnonzero(tenth >= JUDGED)
    found = {}
    for size in sizes:
        rows = []
        for seed in range(SUBSETS):
            train = np.sort(np.random.default_rng(seed).choice(pool, size, replace=False))
            modes = fit_modes(ways, _some(walks, train), NUMBER, rounds, "named", aims=(WATER_PORT, HOME))
            counted = tuned_chain(ways, walks, contexts, train, test)[0]
            rows.append((counted.mean(), predict(ways, _some(walks, test), modes).mean()))
        found[size] = np.array(rows).T
    return found


def _without_entrance(mice: Mice, rounds: int) -> list[tuple[int, int, float]]:
    """Rank water port and home with three, four and five modes, without habits at the entrance; judged on one tenth."""
    ways, walks = ways_and_walks(mice.node, mice.action, mice.successor, ENTRANCE)
    tenth = np.arange(len(walks.state)) % FOLDS
    train, test = (_some(walks, np.flatnonzero(chosen)) for chosen in (tenth != 0, tenth == 0))
    found = []
    for number in (3, 4, 5):
        modes = fit_modes(ways, train, number, rounds, "named", aims=(WATER_PORT, HOME))
        found.append((ranks(modes, WATER_PORT), ranks(modes, HOME), float(predict(ways, test, modes).mean())))
    return found
