"""Predict moves in a maze by counting: chains of the last k nodes, each backing off to the chain before it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from aircl_jax.animals.maze import Walks, Ways

HIGHEST = 7  # order
STRENGTHS = (1.0, 3.0, 10.0, 30.0, 100.0)
SECOND_ORDER = 10.0  # pseudo-count of the second-order chain
PARTS = 5  # of the training recordings, each left out once to choose order and pseudo-count


class Contexts(NamedTuple):
    """Each step's last k nodes as one number, for every order k."""

    by_order: tuple[Int[np.ndarray, "R T"], ...]


def contexts_of(walks: Walks, num_nodes: int, most: int = HIGHEST) -> Contexts:
    """Number the last k nodes of every step, k = 1 … most; nodes before the beginning are one more node."""
    found, code = [], walks.path.astype(np.int64)
    for order in range(1, most + 1):
        if order > 1:
            earlier = np.pad(walks.path[:, : 1 - order], ((0, 0), (order - 1, 0)), constant_values=num_nodes)
            code = np.unique(code * (num_nodes + 1) + earlier, return_inverse=True)[1].reshape(code.shape)
        found.append(code[:, 1:])
    return Contexts(tuple(found))


def chains(
    ways: Ways,
    walks: Walks,
    contexts: Contexts,
    train: Int[np.ndarray, " M"],
    test: Int[np.ndarray, " K"],
    strength: float,
) -> Float[np.ndarray, "O K T"]:
    """Compute log P(move | last k nodes), k = 1, 2, …, of the test recordings.

    P_k = (n + a P_{k−1}) / (Σ n + a), and P_0 is uniform over the nodes in reach.
    """
    exists = ways.exists[walks.state[test]]
    share = exists / exists.sum(axis=-1, keepdims=True)
    taken = walks.move[test][:, :, None]
    nats = []
    for context in contexts.by_order:
        counts = np.zeros((int(context.max()) + 1, ways.exists.shape[1]))
        np.add.at(counts, (context[train], walks.move[train]), 1.0)
        seen = counts[context[test]]
        share = (seen + strength * share) / (seen.sum(axis=-1, keepdims=True) + strength)
        nats.append(np.log(np.take_along_axis(share, taken, axis=-1)[:, :, 0]))
    return np.stack(nats)


def tuned_chain(
    ways: Ways, walks: Walks, contexts: Contexts, train: Int[np.ndarray, " M"], test: Int[np.ndarray, " K"]
) -> tuple[Float[np.ndarray, "K T"], int, float]:
    """Choose order and pseudo-count by leaving out a fifth of the training recordings in turn; predict the test's.

    Return the log-probability of every move, the order, and the pseudo-count.
    """
    part = np.arange(len(train)) % PARTS
    parts = range(min(PARTS, len(train)))

    def scores(strength: float) -> Float[np.ndarray, " O"]:
        kept = [
            chains(ways, walks, contexts, train[part != one], train[part == one], strength).mean(axis=(1, 2)) for one in parts
        ]
        return np.mean(kept, axis=0)

    score = np.stack([scores(strength) for strength in STRENGTHS])
    best, order = np.unravel_index(score.argmax(), score.shape)
    found = chains(ways, walks, contexts, train, test, STRENGTHS[best])[order]
    return found, int(order) + 1, STRENGTHS[best]
