"""Describe walks in a labyrinth by heading: states are directed edges, moves are the nodes in reach, habits are turns.

Nodes are numbered as a binary tree: n has the children 2n + 1 and 2n + 2, so that a deeper node has a higher number.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

HABITS = ("turn back", "alternate the turns on the way in", "go on outwards on the way out")
DEPTHS = 7


class Walks(NamedTuple):
    """Recordings from their second step on, as states and moves; V options at most for each state."""

    state: Int[np.ndarray, "R T"]
    move: Int[np.ndarray, "R T"]  # which of the state's options was taken
    node: Int[np.ndarray, "R T"]  # where the animal is
    path: Int[np.ndarray, "R L"]  # all nodes, the first step's too


class Ways(NamedTuple):
    """The maze by heading: X states (previous node, node), at most V options each."""

    previous: Int[np.ndarray, " X"]
    node: Int[np.ndarray, " X"]
    target: Int[np.ndarray, "X V"]  # node of each option; 0 where there is none
    exists: Bool[np.ndarray, "X V"]
    habits: Float[np.ndarray, "X V F"]  # HABITS, then each at each depth
    habit_names: tuple[str, ...]
    num_nodes: int


def depth(node: Int[np.ndarray, "*s"]) -> Int[np.ndarray, "*s"]:
    return np.floor(np.log2(node + 1)).astype(np.int64)


def ways_and_walks(
    path: Int[np.ndarray, "R L"],
    action: Int[np.ndarray, "R L"],
    successor: Int[np.ndarray, "N A"],
    least_depth: int = 0,
) -> tuple[Ways, Walks]:
    """Describe recorded paths. `least_depth` leaves out the habits by depth above it.

    An option is a node that some action leads to; staying is one only where it was recorded.
    """
    after = successor[np.arange(len(successor))[path], action]
    stays = np.unique(path[after == path])
    options = [
        sorted({int(node) for node in successor[here] if node != here} | ({here} if here in stays else set()))
        for here in range(len(successor))
    ]
    widest = max(map(len, options))
    option_of = np.full((len(successor), len(successor)), -1)
    for here, nodes in enumerate(options):
        option_of[here, nodes] = np.arange(len(nodes))
    edges = np.array([(here, node) for here, nodes in enumerate(options) for node in nodes])
    edge_of = np.full((len(successor), len(successor)), -1)
    edge_of[edges[:, 0], edges[:, 1]] = np.arange(len(edges))
    target, exists = np.zeros((len(edges), widest), dtype=np.int64), np.zeros((len(edges), widest), dtype=bool)
    for state, here in enumerate(edges[:, 1]):
        target[state, : len(options[here])], exists[state, : len(options[here])] = options[here], True
    habits, names = _habits(edges[:, 0], edges[:, 1], target, exists, least_depth)
    ways = Ways(edges[:, 0], edges[:, 1], target, exists, habits, names, len(successor))
    state = edge_of[path[:, :-1], path[:, 1:]]
    return ways, Walks(state, option_of[path, after][:, 1:], path[:, 1:], path)


def _habits(
    previous: Int[np.ndarray, " X"],
    node: Int[np.ndarray, " X"],
    target: Int[np.ndarray, "X V"],
    exists: Bool[np.ndarray, "X V"],
    least_depth: int,
) -> tuple[Float[np.ndarray, "X V F"], tuple[str, ...]]:
    """Compute the turns of every option: back, alternating on the way in, outwards on the way out; then by depth."""
    came, here = previous[:, None], node[:, None]
    choice = exists.sum(axis=1, keepdims=True) > 1
    back = (target == came) & (came != here) & choice
    inwards = (came < here) & (target > here)
    alternate = inwards & (_side(target) != _side(here))
    outwards = (came > here) & (target != came) & (target < here)
    turns = np.stack([back, alternate, outwards], axis=-1) * exists[:, :, None].astype(np.float64)
    level = depth(node)
    by_depth = [turns * (level == one)[:, None, None] for one in range(least_depth, DEPTHS)]
    names = [*HABITS, *(f"{habit}, depth {one}" for one in range(least_depth, DEPTHS) for habit in HABITS)]
    return np.concatenate([turns, *by_depth], axis=-1), tuple(names)


def _side(node: Int[np.ndarray, "*s"]) -> Int[np.ndarray, "*s"]:
    """Return which child of its parent a node is: 1, or 0; 2 for the root."""
    return np.where(node == 0, 2, node % 2)
