"""Made-up herds whose truth is known, as rows of tables."""

from pathlib import Path

import numpy as np

from envs.animals.columns import ColumnMapping
from envs.animals.full.steps import Recordings, recordings_of
from envs.animals.rows.labels import Labels
from envs.animals.tracks import Tracks
from envs.animals.windows import code_rows

GOATS = ColumnMapping(
    name="goats",
    columns={"time": "t", "individual": "goat", "behaviour": "act", "place": "patch"},
    behaviours=("graze", "rest", "watch"),
    places=("hill", "shade"),
)
MAPPING = """columns: {time: t, individual: goat, behaviour: act, place: patch}
recording: day
"""
DRAW = {"hill": (1.5, 0.0, 0.5), "shade": (0.0, 1.5, 0.0)}  # r(place, activity)
FORBIDDEN = ("watch", "graze")  # never at once


def tracks_of(rows: list[tuple[str, str, float, str, str]]) -> Tracks:
    """Rows of (recording, individual, time, behaviour, place)."""
    recording, individual, time, behaviour, place = (list(column) for column in zip(*rows, strict=True))
    size = len(rows)
    return Tracks(
        recording=Labels.of(recording),
        site=Labels.same("", size),
        individual=Labels.of(individual),
        group=Labels.same("", size),
        time=np.array(time, float),
        behaviour=Labels.of(behaviour),
        place=Labels.of(place),
        position=np.full((size, 3), np.nan),
        close=np.zeros(size, dtype=np.int64),
        distant=np.zeros(size, dtype=np.int64),
    )


def goats(recordings: int = 6, animals: int = 4, rows: int = 400, seed: int = 0) -> list[tuple[str, str, float, str, str]]:
    """Goats leave with a chance of .4 in the first row of a bout and .1 later, and begin what DRAW says, never FORBIDDEN."""
    generator, acts = np.random.default_rng(seed), GOATS.behaviours
    made = []
    for recording in range(recordings):
        for animal in range(animals):
            place = GOATS.places[(recording + animal) % 2]
            act, age = 0, 0
            for time in range(rows):
                age += 1
                made.append((f"day{recording}", f"g{animal}", float(time), acts[act], place))
                if generator.random() < (0.4 if age == 1 else 0.1):
                    weight = np.exp(np.array(DRAW[place]))
                    weight[act] = 0.0
                    if acts[act] == FORBIDDEN[0]:
                        weight[acts.index(FORBIDDEN[1])] = 0.0
                    act, age = int(generator.choice(len(acts), p=weight / weight.sum())), 0
    return made


def written_goats(folder: Path, **settings: int) -> dict[str, str]:
    """Write the goats as a table of another format with its mapping; return the settings that read it."""
    lines = ["day,goat,t,act,patch"]
    lines += [f"{day},{goat},{time},{act},{place}" for day, goat, time, act, place in goats(**settings)]
    (folder / "goats.csv").write_text("\n".join(lines) + "\n")
    (folder / "goats.yaml").write_text(MAPPING)
    return {"data": str(folder), "mapping": str(folder / "goats.yaml")}


def goat_recordings(**settings: int) -> Recordings:
    return recordings_of(code_rows(tracks_of(goats(**settings)), GOATS), GOATS)
