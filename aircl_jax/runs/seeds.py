"""Run many seeds as one program, sharded over devices: seed s is the integer s, alone or among others."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import AxisType, NamedSharding, PartitionSpec
from jaxtyping import Array, Key

from aircl_jax.algorithm.trainer import Trainer
from aircl_jax.runs import world
from aircl_jax.types import Metrics, TrainState

SEED = PartitionSpec("seed")
GROUP = 50  # seeds whose arrays are in memory at once where a finished run is measured and drawn
Expert = Any  # Trajectory [S, N, T, …]: D_E of each seed, or whatever else a trainer takes in its place


class Runner(NamedTuple):
    """`init(expert) -> states [S, …]`; `run_chunk(states, expert, length) -> (states, {metric: [length, S]})`."""

    init: Callable[[Expert], TrainState]
    run_chunk: Callable[[TrainState, Expert, int], tuple[TrainState, Metrics]]


def seed_keys(seeds: Sequence[int]) -> Key[Array, " S"]:
    """Make the key of each seed, [S]."""
    return jax.vmap(jax.random.key)(jnp.asarray(seeds, jnp.uint32))


def over_seeds(of: Callable[..., Any]) -> Callable[..., Any]:
    """Map `of`, a function of one seed, over the leading axis of all its arguments, by `vmap` on accelerators.

    On a CPU a device's seeds run one after another, because the arrays of one seed fit the cache and those of five do not.
    """
    if jax.default_backend() != "cpu":
        return jax.vmap(of)
    return lambda *batched: jax.lax.map(lambda arguments: of(*arguments), batched)


def in_groups(of: Callable[..., Any], *batched: Any) -> Any:
    """Call `of`, a function of seeds on the leading axis of all its arguments, on groups of them; up to GROUP are one call.

    What it returns is joined on the host.
    """
    number = len(jax.tree.leaves(batched)[0])
    if number <= GROUP:
        return jax.device_get(of(*batched))
    groups = [slice(first, first + GROUP) for first in range(0, number, GROUP)]
    parts = [jax.device_get(of(*jax.tree.map(lambda leaf, group=group: leaf[group], batched))) for group in groups]
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def make_runner(trainer: Trainer, seeds: Sequence[int]) -> Runner:
    """Run the trainer over all seeds: one jit, `lax.scan` over a chunk, map or `vmap` within, shards of seeds on every device.

    `expert` is [S, N, T, …]. Every seed has its own demonstrations, which are the same where they come from a file.
    """
    if not trainer.traced:
        return _on_the_host(trainer, seeds)
    shard, place = spread(len(seeds))
    init = jax.jit(shard(over_seeds(trainer.init), in_specs=(SEED, SEED)))

    @partial(jax.jit, static_argnums=2, donate_argnums=0)
    def run_chunk(states: TrainState, expert: Expert, length: int) -> tuple[TrainState, Metrics]:
        def on_device(states: TrainState, expert: Expert) -> tuple[TrainState, Metrics]:
            def iteration(states: TrainState, _: None) -> tuple[TrainState, Metrics]:
                over = jax.vmap if trainer.together else over_seeds
                return over(trainer.step)(states, expert)

            states, metrics = jax.lax.scan(iteration, states, length=length)
            return states, jax.tree.map(lambda leaf: leaf.swapaxes(0, 1), metrics)

        states, metrics = shard(on_device, in_specs=(SEED, SEED))(states, expert)
        return states, jax.tree.map(lambda leaf: leaf.swapaxes(0, 1), metrics)

    return Runner(
        init=lambda expert: init(place(seed_keys(seeds)), place(expert)),
        run_chunk=lambda states, expert, length: run_chunk(place(states), place(expert), length),
    )


def _on_the_host(trainer: Trainer, seeds: Sequence[int]) -> Runner:
    """Run a trainer that cannot be traced over one seed after another."""

    def run_chunk(states: TrainState, expert: Expert, length: int) -> tuple[TrainState, Metrics]:
        parts = [jax.tree.map(lambda leaf, place=place: leaf[place], (states, expert)) for place in range(len(seeds))]
        metrics = []
        for place, (state, of_seed) in enumerate(parts):
            rows, now = [], state
            for _ in range(length):
                now, row = trainer.step(now, of_seed)
                rows.append(row)
            parts[place] = (now, of_seed)
            metrics.append(jax.tree.map(lambda *leaves: jnp.stack(leaves), *rows))
        stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(state for state, _ in parts))
        return stacked, jax.tree.map(lambda *leaves: jnp.stack(leaves, axis=1), *metrics)

    return Runner(lambda expert: jax.vmap(trainer.init)(seed_keys(seeds), expert), run_chunk)


def make_evaluator(
    evaluate: Callable[[TrainState, Expert, Any], Metrics], num_seeds: int
) -> Callable[[TrainState, Expert, Any], Metrics]:
    """Map `evaluate(state, expert, shared)` over the seeds, [S, …], spread as in training; all seeds get the same `shared`."""
    shard, place = spread(num_seeds)

    def on_device(states: TrainState, expert: Expert, shared: Any) -> Metrics:
        return over_seeds(lambda state, of_seed: evaluate(state, of_seed, shared))(states, expert)

    run = jax.jit(shard(on_device, in_specs=(SEED, SEED, PartitionSpec())))
    return lambda states, expert, shared: run(place(states), place(expert), place(shared, PartitionSpec()))


def spread(num_seeds: int) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Spread seeds over the devices; return `jax.shard_map` over the leading axis of inputs and outputs, and a placer of trees.

    A call passes `out_specs=…` where an output has its seeds on another axis. Raises ValueError where processes cannot share
    the seeds evenly.
    """
    processes = jax.process_count()
    if num_seeds % processes:
        raise ValueError(f"seeds={num_seeds}: {processes} processes cannot share them evenly; choose a multiple of {processes}")
    each = _shards(num_seeds // processes)
    of_process = [[device for device in jax.devices() if device.process_index == index] for index in range(processes)]
    chosen = [device for devices in of_process for device in devices[:each]]
    mesh = jax.make_mesh((len(chosen),), ("seed",), axis_types=(AxisType.Auto,), devices=chosen)

    def place(tree: Any, spec: PartitionSpec = SEED) -> Any:
        return world.placed(tree, NamedSharding(mesh, spec))

    return partial(jax.shard_map, mesh=mesh, out_specs=SEED, check_vma=False), place


def relieve(share: float = 0.25) -> None:
    """Let JAX forget what it has compiled where this process holds that share of the memory maps which Linux allows it.

    A run leaves some 300, and about 200 runs in one process would end it; what is needed again comes from the cache on disk.
    """
    try:
        held = len(Path("/proc/self/maps").read_bytes().splitlines())
        most = int(Path("/proc/sys/vm/max_map_count").read_bytes())
    except (OSError, ValueError):  # another system
        return
    if held > share * most:
        jax.clear_caches()


def devices() -> str:
    """Say on how many devices of which kind this process computes, with all others of its world."""
    found = jax.devices()
    return f"{len(found)} × {found[0].device_kind}"


def _shards(num_seeds: int) -> int:
    """Return the largest number of a process's devices that share its seeds evenly."""
    return max(count for count in range(1, jax.local_device_count() + 1) if num_seeds % count == 0)
