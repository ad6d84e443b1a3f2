"""Walks by heading are right, the passes of EM equal brute force over all sequences of modes, and two modes are found."""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.animals.maze import HABITS, depth, ways_and_walks
from aircl_jax.animals.maze_chains import chains, contexts_of, tuned_chain
from aircl_jax.animals.modes import _smooth, fit_modes, log_policy, modes_loss, predict
from envs.animals.labyrinth import HOME, WATER_PORT, load
from envs.options import LabyrinthOptions


@pytest.fixture(scope="module")
def mice():
    return load(LabyrinthOptions(data="simulated"))


@pytest.fixture(scope="module")
def maze(mice):
    return ways_and_walks(mice.node[:8, :60], mice.action[:8, :60], mice.successor)


def test_states_are_headings_and_moves_lead_to_the_next_node(mice, maze):
    ways, walks = maze
    np.testing.assert_array_equal(ways.node[walks.state], mice.node[:8, 1:60])
    np.testing.assert_array_equal(ways.previous[walks.state], mice.node[:8, :59])
    reached = ways.target[walks.state, walks.move]
    np.testing.assert_array_equal(reached[:, :-1], mice.node[:8, 2:60])
    assert ways.exists[walks.state, walks.move].all()


def test_the_habits_of_a_junction_are_those_worked_by_hand(maze):
    ways, _ = maze
    state = int(np.flatnonzero((ways.previous == 1) & (ways.node == 4))[0])  # inwards, by the second child of node 1
    turns = {
        int(node): ways.habits[state, option, :3].tolist()
        for option, node in enumerate(ways.target[state])
        if node in (1, 9, 10)
    }
    assert turns == {1: [1, 0, 0], 9: [0, 1, 0], 10: [0, 0, 0]}  # back; the first child alternates; the second does not
    out = int(np.flatnonzero((ways.previous == 9) & (ways.node == 4))[0])
    outwards = {int(node): ways.habits[out, option, 2] for option, node in enumerate(ways.target[out]) if node in (1, 9, 10)}
    assert outwards == {1: 1, 9: 0, 10: 0}
    assert len(ways.habit_names) == len(HABITS) * 8
    np.testing.assert_array_equal(depth(np.array([0, 1, 2, 3, 126])), [0, 1, 1, 2, 6])


def test_the_loss_of_the_modes_is_that_of_naive_numpy(maze):
    ways, _ = maze
    draws = np.random.default_rng(0)
    moves = draws.random((2, *ways.target.shape)) * ways.exists
    reward, habits = draws.normal(size=(2, 127)), draws.normal(size=(2, ways.habits.shape[-1]))
    ridge = draws.random(ways.habits.shape[-1])
    expected = 0.5 * (3.0 * (reward**2).sum() + (ridge * habits**2).sum())
    for mode, state in product(range(2), range(len(ways.node))):
        options = np.flatnonzero(ways.exists[state])
        utility = reward[mode, ways.target[state, options]] + ways.habits[state, options] @ habits[mode]
        expected -= moves[mode, state, options] @ (utility - np.log(np.exp(utility).sum()))
    data = {"target": ways.target, "exists": ways.exists, "features": ways.habits, "ridge": ridge, "moves": moves}
    with jax.enable_x64(True):
        weights, data = (jax.tree.map(jnp.asarray, part) for part in ({"reward": reward, "habits": habits}, data))
        assert float(modes_loss(weights, data)) == pytest.approx(expected, rel=1e-12)


def test_the_passes_of_em_equal_the_sum_over_all_sequences_of_modes(maze):
    ways, walks = maze
    draws, steps = np.random.default_rng(1), 5
    weights = {"reward": draws.normal(size=(2, 127)), "habits": draws.normal(size=(2, ways.habits.shape[-1]))}
    policy, first = log_policy(ways, weights), np.array([0.3, 0.7])
    switch = draws.dirichlet([1, 1], size=(127, 2))
    state, move, node = (part[:1, :steps] for part in (walks.state, walks.move, walks.node))
    with jax.enable_x64(True):
        nats, modes, switches = jax.device_get(_smooth(policy, first, switch, state, move, node))
    total, of_mode, of_switch = 0.0, np.zeros((steps, 2)), np.zeros((127, 2, 2))
    for sequence in product(range(2), repeat=steps):
        weight = first[sequence[0]]
        for t, mode in enumerate(sequence):
            weight *= np.exp(policy[mode, state[0, t], move[0, t]])
            weight *= switch[node[0, t], sequence[t - 1], mode] if t else 1.0
        total += weight
        for t, mode in enumerate(sequence):
            of_mode[t, mode] += weight
            if t:
                of_switch[node[0, t], sequence[t - 1], mode] += weight
    assert nats.sum() == pytest.approx(np.log(total))
    np.testing.assert_allclose(modes[0], of_mode / total, rtol=1e-9)
    np.testing.assert_allclose(switches, of_switch / total, atol=1e-12)


def test_em_raises_the_likelihood_and_predicts_as_it_fitted(mice):
    ways, walks = ways_and_walks(mice.node[:20], mice.action[:20], mice.successor)
    few, more = (fit_modes(ways, walks, 3, rounds, "named", aims=(WATER_PORT, HOME)) for rounds in (1, 6))
    assert more.nats > few.nats
    assert predict(ways, walks, more).mean() == pytest.approx(more.nats)
    np.testing.assert_allclose(more.switch.sum(axis=-1), 1)


def test_a_chain_of_order_two_is_worked_by_hand(maze):
    ways, walks = maze
    contexts = contexts_of(walks, 127, most=2)
    train, test = np.arange(6), np.array([7])
    found = chains(ways, walks, contexts, train, test, 10.0)
    t = 30
    here, before, move = walks.path[7, t + 1], walks.path[7, t], walks.move[7, t]
    one = (walks.path[:6, 1:] == here).astype(float)
    two = one * (walks.path[:6, :-1] == before)
    taken = walks.move[:6] == move
    share = 1 / ways.exists[walks.state[7, t]].sum()
    for known in (one, two):
        share = ((known * taken).sum() + 10 * share) / (known.sum() + 10)
    assert np.exp(found[1, 0, t]) == pytest.approx(share)


def test_the_tuned_chain_is_one_of_the_chains(maze):
    ways, walks = maze
    contexts, train, test = contexts_of(walks, 127), np.arange(6), np.array([6, 7])
    found, order, strength = tuned_chain(ways, walks, contexts, train, test)
    np.testing.assert_allclose(found, chains(ways, walks, contexts, train, test, strength)[order - 1])
