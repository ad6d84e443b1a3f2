"""Let several processes train one run: they share its seeds, and the first alone reads, writes and prints.

In a process alone each function here does nothing beside calling or returning what it is given. In a world of processes all
of them must call these functions in the same order, because each waits for the others.
"""

import os
import pickle
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import NamedSharding, PartitionSpec

from aircl_jax.defects import described

T = TypeVar("T")

ADDRESS, NUMBER, INDEX = "JAX_COORDINATOR_ADDRESS", "JAX_NUM_PROCESSES", "JAX_PROCESS_ID"
STARTED_BY = {"SLURM_STEP_NUM_TASKS": "Slurm", "OMPI_COMM_WORLD_SIZE": "Open MPI", NUMBER: "this environment"}
WAIT = 300  # seconds for which a process waits for the others to begin
PATIENCE = 24 * 3600  # seconds for which a process that is done waits for the first, which draws and writes


def join() -> None:
    """Join the world of processes that Slurm, Open MPI or the three variables of the environment describe, once a process.

    Call it before anything is computed. Raises ValueError where there is none, or where the others do not come.
    """
    if jax.distributed.is_initialized():
        return
    try:
        by_hand = NUMBER in os.environ
        jax.distributed.initialize(
            num_processes=int(os.environ[NUMBER]) if by_hand else None,
            process_id=int(os.environ[INDEX]) if by_hand else None,
            shutdown_timeout_seconds=PATIENCE,
        )
        _meet()
    except (ValueError, RuntimeError, KeyError, OSError) as error:
        how = f"start the processes by srun or mpirun, or set {ADDRESS}, {NUMBER} and {INDEX} in each"
        raise ValueError(f"distributed=true: {described(error)}; {how}") from error


def _meet() -> None:
    """Wait for the other processes, and connect to each by the address from which this process reaches the first.

    JAX takes the address that the host's own name means, which is often 127.0.0.1, where no other host finds it. It
    connects at the first exchange, and then waits less long for a process that is late.
    """
    from jax._src.distributed import global_state
    from jax._src.lib import _jax

    host, _, port = str(global_state.coordinator_address).rpartition(":")
    family, _, _, _, first = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_DGRAM)[0]
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        probe.connect(first)
        own = probe.getsockname()[0]
    _jax.make_gloo_tcp_collectives = partial(_jax.make_gloo_tcp_collectives, hostname=own)
    jax.devices()
    global_state.client.wait_at_barrier("met", 1000 * WAIT)  # pyright: ignore[reportOptionalMemberAccess]
    most(0)


def strangers() -> str:
    """Say that this process is one of several that know nothing of each other; empty where it is not."""
    for variable, starter in STARTED_BY.items():
        number = os.environ.get(variable, "")
        if number.isdigit() and int(number) > 1:
            return f"this is one of {number} processes of {starter} ({variable}), each of which trains all seeds"
    return ""


def is_first() -> bool:
    """Say whether this process is the first, or alone."""
    return not jax.distributed.is_initialized() or jax.process_index() == 0


def in_first(make: Callable[[], T]) -> T | None:
    """Return what `make` returns in the first process, None in the others; all raise what it raises there."""
    if jax.process_count() == 1:
        return make()
    made, raised = None, None
    try:
        made = make() if is_first() else None
    except BaseException as error:  # signals too: the others wait for an answer
        raised = error
    told = from_first(_portable(raised))
    if raised is not None:
        raise raised
    if told is not None:
        raise told
    return made


def from_first(value: T) -> T:
    """Return the value of the first process, which can be pickled, in all of them."""
    if jax.process_count() == 1:
        return value
    sent = pickle.dumps(value) if is_first() else b""
    with _losses_said():
        size = int(multihost_utils.broadcast_one_to_all(np.int32(len(sent))))
        room = np.zeros(1 << (size - 1).bit_length(), np.uint8)  # a power of two, because each size is compiled
        room[: len(sent)] = np.frombuffer(sent, np.uint8)
        told = multihost_utils.broadcast_one_to_all(room)[:size].tobytes()
    return value if is_first() else pickle.loads(told)  # noqa: S301  # of the same run


def by_first(make: Callable[[], T]) -> T:
    """Return what `make` returns in the first process, which can be pickled, in all of them; all raise what it raises there."""
    return cast(T, from_first(in_first(make)))


def tree_of_first(make: Callable[[], T], like: T) -> T:
    """Return the arrays which `make` returns in the first process, in all of them; `like` has their types."""
    if jax.process_count() == 1:
        return make()
    arrays = by_first(lambda: [np.asarray(_raw(leaf)) for leaf in jax.tree.leaves(make())])
    leaves, structure = jax.tree.flatten(like)
    return jax.tree.unflatten(structure, [_typed(array, leaf.dtype) for array, leaf in zip(arrays, leaves, strict=True)])


def most(number: int) -> int:
    """Return the greatest of all processes' numbers."""
    if jax.process_count() == 1:
        return number
    with _losses_said():
        return int(multihost_utils.process_allgather(np.int32(number)).max())


def placed(tree: T, sharding: NamedSharding) -> T:
    """Place arrays, of which every process has the whole, over the devices of all processes."""
    if jax.process_count() == 1:
        return jax.device_put(tree, sharding)

    def place(leaf: Any) -> jax.Array:
        if isinstance(leaf, jax.Array) and not leaf.is_fully_addressable:
            return leaf
        whole = np.asarray(_raw(leaf))
        there = jax.make_array_from_callback(whole.shape, sharding, lambda part: whole[part])
        return jax.jit(jax.random.wrap_key_data)(there) if _is_key(leaf) else there

    return jax.tree.map(place, tree)


def gathered(tree: T) -> T:
    """Bring arrays that are spread over the devices of all processes to every process, whole."""
    leaves, structure = jax.tree.flatten(tree)
    spread = [leaf for leaf in leaves if isinstance(leaf, jax.Array) and not leaf.is_fully_addressable]
    if not spread:
        return tree
    everywhere = NamedSharding(spread[0].sharding.mesh, PartitionSpec())  # pyright: ignore[reportAttributeAccessIssue]
    with _losses_said():
        whole = jax.jit(lambda leaves: [_raw(leaf) for leaf in leaves], out_shardings=everywhere)(leaves)
        here = [np.asarray(leaf.addressable_data(0)) for leaf in whole]
    return jax.tree.unflatten(structure, [_typed(array, leaf.dtype) for array, leaf in zip(here, leaves, strict=True)])


@contextmanager
def _losses_said() -> Iterator[None]:
    """Raise ConnectionError in one line where another process no longer answers."""
    try:
        yield
    except (ValueError, RuntimeError) as error:  # XLA's are either
        then = "the same command in all of them with resume=true goes on"
        raise ConnectionError(f"another process of this run has ended ({described(error)[:120]}); {then}") from error


def _raw(leaf: Any) -> Any:
    """Return the integers of typed keys, and any other array as it is."""
    return jax.random.key_data(leaf) if _is_key(leaf) else leaf


def _is_key(leaf: Any) -> bool:
    return jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _typed(array: Any, dtype: Any) -> jax.Array:
    leaf = jnp.asarray(array)
    return jax.random.wrap_key_data(leaf) if jax.dtypes.issubdtype(dtype, jax.dtypes.prng_key) else leaf


def _portable(error: BaseException | None) -> BaseException | None:
    """Return an error that can be sent to other processes."""
    try:
        pickle.loads(pickle.dumps(error))  # noqa: S301
    except Exception:
        return RuntimeError(described(error)) if error else None
    return error
