"""Write what is known of an animal at a row as one vector, and read it back; what the tables lack has no place in it.

Parts, in their order: the code, the place, the site and the code before, each one-hot; log age of the bout, whether its
beginning is unseen, tempo; log (1 + number) of close and of distant neighbours, then of those that show each behaviour.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from envs.animals.full.steps import NONE, Recordings, Steps

OLDEST = 120  # rows; older bouts count as this old


class Part(NamedTuple):
    """A part of the observation and how many numbers it has."""

    name: str
    coordinates: tuple[str, ...]


def parts(recordings: Recordings) -> list[Part]:
    """List the parts that these tables have columns for."""
    names, lacks = recordings.names, recordings.lacks
    behaviours = (*names[: recordings.num_behaviours], "anything else")
    possible = (
        (Part("code", tuple(f"in {name}" for name in names)), ()),
        (Part("place", tuple(f"at {name}" for name in recordings.places)), ("places",)),
        (Part("site", tuple(f"site {name}" for name in recordings.sites)), ("sites",)),
        (Part("previous", tuple(f"after {name}" for name in names)), ()),
        (Part("age", ("log age",)), ()),
        (Part("unseen", ("beginning unseen",)), ()),
        (Part("tempo", ("tempo so far",)), ()),
        (Part("close", ("log number close",)), ("neighbours",)),
        (Part("distant", ("log number distant",)), ("neighbours",)),
        (Part("close_doing", tuple(f"close, {name}" for name in behaviours)), ("names",)),
        (Part("distant_doing", tuple(f"distant, {name}" for name in behaviours)), ("names",)),
    )
    return [part for part, needs in possible if not set(needs) & set(lacks)]


def coordinates(recordings: Recordings) -> tuple[str, ...]:
    """Name every number of an observation."""
    return tuple(name for part in parts(recordings) for name in part.coordinates)


def observe(recordings: Recordings, tempo: Float[Any, " N"]) -> Float[Any, "N O"]:
    """Write the observation of every step; the steps are of NumPy or of JAX."""
    steps = recordings.steps
    xp = steps.code.__array_namespace__()
    sizes = {"code": len(recordings.names), "previous": len(recordings.names)}
    sizes |= {"place": len(recordings.places), "site": len(recordings.sites)}
    columns: list[Any] = []
    for part in parts(recordings):
        if part.name in sizes:
            columns.append((getattr(steps, part.name)[:, None] == np.arange(sizes[part.name])) * 1.0)
        elif part.name == "tempo":
            columns.append(tempo[:, None])
        elif part.name == "age":
            columns.append(xp.log(xp.minimum(steps.age, OLDEST))[:, None])
        elif part.name == "unseen":
            columns.append(steps.unseen[:, None] * 1.0)
        else:
            counts = xp.log1p(getattr(steps, part.name) * 1.0)
            columns.append(counts if counts.ndim == 2 else counts[:, None])
    return xp.concat(columns, axis=1)


def read(obs: Float[Any, "N O"], recordings: Recordings) -> tuple[Recordings, Float[Any, " N"]]:
    """Read the steps that these observations are of, and their tempo; what an observation does not hold is 0 or NONE.

    The steps know neither what follows nor the position, and all are of the first recording and track.
    """
    xp, size, at, found = obs.__array_namespace__(), len(obs), 0, {}
    for part in parts(recordings):
        found[part.name] = obs[:, at : at + len(part.coordinates)]
        at += len(part.coordinates)
    nothing, nowhere = xp.zeros(size, dtype=int), xp.full(size, NONE)

    def index(name: str) -> Any:
        part = found.get(name)
        if part is None:
            return nowhere
        return xp.where(part.sum(axis=1) > 0.5, part.argmax(axis=1), NONE)

    def counts(name: str) -> Any:
        part = found.get(name)
        return nothing[:, None] * 0.0 if part is None else xp.round(xp.expm1(part))

    nobody = xp.zeros((size, recordings.num_behaviours + 1))
    steps = Steps(
        code=index("code"),
        following=nowhere,
        age=xp.round(xp.exp(found["age"][:, 0])),
        unseen=found["unseen"][:, 0] > 0.5,
        previous=index("previous"),
        place=index("place"),
        position=xp.full((size, 2), xp.nan),
        close=counts("close")[:, 0],
        distant=counts("distant")[:, 0],
        close_doing=counts("close_doing") if "close_doing" in found else nobody,
        distant_doing=counts("distant_doing") if "distant_doing" in found else nobody,
        recording=nothing,
        site=index("site") if "site" in found else nothing,
        track=nothing,
        segment=nothing,
        window=nowhere,
    )
    return recordings._replace(steps=steps), found["tempo"][:, 0]
