"""Make up a herd as a large table: `python -m experiments.herd rows=20000000 out=FOLDER` writes herd.parquet and herd.yaml.

Each animal leaves its activity with a chance of .4 in the first row of a bout and of .1 later, begins another by a reward of
the activity at its place, and walks to another place at one change in ten. It never goes from watching to grazing at once.

rows         of all animals together
recordings   days
animals      of each recording
out          folder
seed         of the draws
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from aircl_jax.messages import say
from aircl_jax.storage import write_whole
from envs.settings import at_least
from experiments.cli.command import run_command

ACTIVITIES = ("graze", "rest", "watch", "groom", "walk")
PLACES = ("hill", "pond", "shade")
REWARD = np.array([[1.5, 0.0, 0.5, -0.5, 0.0], [0.5, 0.0, 0.5, 0.5, 1.0], [0.0, 1.5, 0.0, 1.0, -0.5]])  # [place, activity]
NEVER = ("watch", "graze")
FIRST, LATER, WALKS = 0.4, 0.1, 0.1  # chances: of leaving in the first row of a bout, later; of another place at a change

MAPPING = """columns: {time: second, individual: animal, behaviour: activity, place: place}
recording: day
"""


@dataclass(frozen=True)
class Settings:
    rows: int = 20_000_000
    recordings: int = 20
    animals: int = 20
    out: str = "runs/herd"
    seed: int = 0

    def __post_init__(self) -> None:
        at_least("recordings", self.recordings, 2)
        at_least("animals", self.animals, 1)
        at_least("rows", self.rows, 2 * self.recordings * self.animals)


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make, argv, Settings(), __doc__)


def make(settings: Settings, _: Sequence[str]) -> None:
    """Write the table, a row group for each recording, and its mapping."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise ValueError("pyarrow is not installed; install aircl-jax[animals]") from error
    folder = Path(settings.out)
    folder.mkdir(parents=True, exist_ok=True)
    label = pa.dictionary(pa.int32(), pa.string())
    schema = pa.schema(
        {"day": label, "animal": label, "second": pa.int64(), "activity": label, "place": label}  # pyright: ignore[reportArgumentType]
    )
    with pq.ParquetWriter(folder / "herd.parquet", schema) as writer:
        for day, (activity, place) in enumerate(recordings(settings)):
            number, length = activity.shape
            columns = {
                "day": (np.full(number * length, 0), [f"day{day:03}"]),
                "animal": (np.repeat(np.arange(number), length), [f"g{animal:03}" for animal in range(number)]),
                "activity": (activity.ravel(), list(ACTIVITIES)),
                "place": (place.ravel(), list(PLACES)),
            }
            arrays = {
                name: pa.DictionaryArray.from_arrays(pa.array(of, pa.int32()), names) for name, (of, names) in columns.items()
            }
            arrays["second"] = pa.array(np.tile(np.arange(length), number))
            writer.write_table(pa.table({name: arrays[name] for name in schema.names}, schema), row_group_size=number * length)
    write_whole(folder / "herd.yaml", MAPPING)
    say(f"wrote {folder}/herd.parquet; fit it with python -m experiments.behaviour mapping={folder}/herd.yaml data={folder}")


def recordings(settings: Settings) -> Iterator[tuple[Int[np.ndarray, "A T"], Int[np.ndarray, "A T"]]]:
    """Draw activity and place of every animal in each row of each recording."""
    length = settings.rows // (settings.recordings * settings.animals)
    draws, share = np.random.default_rng(settings.seed), np.cumsum(chances(), axis=-1)
    share /= share[..., -1:]
    for _ in range(settings.recordings):
        every = np.arange(settings.animals)
        place, act, age = every % len(PLACES), every % len(ACTIVITIES), np.ones(settings.animals, int)
        acts, places = np.empty((2, settings.animals, length), np.int8)
        for row in range(length):
            acts[:, row], places[:, row] = act, place
            leaves = draws.random(len(every)) < np.where(age == 1, FIRST, LATER)
            begun = (draws.random((len(every), 1)) > share[place, act]).sum(axis=1)
            act, age = np.where(leaves, begun, act), np.where(leaves, 1, age + 1)
            walks = leaves & (draws.random(len(every)) < WALKS)
            place = np.where(walks, (place + 1 + draws.integers(len(PLACES) - 1, size=len(every))) % len(PLACES), place)
        yield acts, places


def chances() -> Float[np.ndarray, "P C C"]:
    """P(next activity | place, activity, a change)."""
    weight = np.exp(REWARD)[:, None] * (1.0 - np.eye(len(ACTIVITIES)))
    weight[:, ACTIVITIES.index(NEVER[0]), ACTIVITIES.index(NEVER[1])] = 0.0
    return weight / weight.sum(axis=-1, keepdims=True)


if __name__ == "__main__":
    sys.exit(main())
