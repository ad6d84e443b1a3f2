"""Write the page of the comparison."""

from collections.abc import Mapping
from typing import Any

from aircl_jax.reports.markdown import bullets, paragraphs, table
from experiments.benchmark.arithmetic import (
    LAST,
    Spread,
    our_minutes,
    our_speed,
    ratio,
    spread,
    steps_to,
    target_of,
    their_minutes,
    their_speed,
)
from experiments.benchmark.settings import EFFORTS

Cells = Mapping[str, Mapping[str, Any]]  # by world

ENGINES = {"mujoco": "C MuJoCo, `rollout` on all cores", "mjx": "MJX", "planar": "ours"}
TARGET = (
    "a row's mean return of π in `results/cells` less a standard deviation over its ten seeds,"
    " and its mean share of violating steps plus one"
)
HOW_OURS = (
    "Ours is extrapolated: the start from the command with nothing compiled before, and all iterations, evaluations and"
    " checkpoints of a run by what each takes, without report and figures at its end. It is not judged anew."
)
HOW_THEIRS = (
    f"`imitation` is extrapolated from its own settings: seeds in turn, one on each core, each until the means over its last"
    f" {LAST} rounds, of all processes, are within the target. It is judged after each round, outside its time."
)
HOW_EQUAL = (
    "Own settings are each side's own. With equal settings `imitation` has our epochs, minibatches, steps of the adversary and"
    " steps a round; one step of the adversary where ours moves its reward once an iteration."
)
HOW_SPEEDS = (
    "Steps are those of rollouts that update π; a twin's do not count, and its time does, in every iteration.",
    "Ours is whole training with evaluations and checkpoints, without the start; `imitation` is the rounds of all processes.",
    HOW_EQUAL,
    "Demonstrations, network sizes and horizon are always the same.",
)
HOW_PHYSICS = (
    "Environment steps per second, Euler, the same bodies and solver settings, random actions, all cores,"
    f" {EFFORTS['full'].physics[0]} bodies at once."
)
SMOKE = "**A test of the machinery (scale=smoke): these numbers say nothing.**"
MINUTES = (
    *("world", "row", "ours, min", "return and violations of ours"),
    *("imitation to the same, min", "imitation for as many steps, min"),
)
SPEEDS = ("world", "row", "ours, env steps/s", "imitation, own settings", "ratio", "imitation, equal settings", "ratio, equal")
PHYSICS = ("world", *ENGINES.values())
SETTINGS = ("world", "commit", "machine", "settings", "epochs", "minibatch", "discriminator steps", "its size", "steps a round")


def page(cells: Cells, command: str) -> str:
    """Write the page; its first line is the minutes to targets."""
    smoke = [SMOKE] if any(cell["scale"] == "smoke" for cell in cells.values()) else []
    rows = [(world, method) for world, cell in cells.items() for method in cell["ours"]]
    robots = {world: cell["physics"] for world, cell in cells.items() if cell["physics"]}
    physics = [(world, *(speeds(spread(found[engine])) for engine in ENGINES)) for world, found in robots.items()]
    return paragraphs(
        first_line(cells),
        *smoke,
        f"Command: `{command}`. Medians, in brackets the least and the greatest of the repeats.",
        "# Speed against imitation",
        "## Minutes to the same return and violations",
        table(MINUTES, [minutes_row(world, method, cells[world]) for world, method in rows]),
        bullets(how_minutes(cells)),
        "## Environment steps per second",
        table(SPEEDS, [speed_row(world, method, cells[world]) for world, method in rows]),
        bullets([*HOW_SPEEDS, *before_twins(cells)]),
        *(["## Physics alone", table(PHYSICS, physics), bullets([HOW_PHYSICS])] if physics else []),
        "## What imitation ran with",
        table(SETTINGS, settings_rows(cells)),
    )


def first_line(cells: Cells) -> str:
    """Say for each world and row in how many minutes ours and imitation are there."""
    parts = []
    for world, cell in cells.items():
        rows = [f"{minutes(our_minutes(timed))} ({method})" for method, timed in cell["ours"].items()]
        reached = "; ".join(dict.fromkeys(of_theirs(cell, method) for method in cell["ours"]))
        parts.append(f"{world} {', '.join(rows)}, imitation {reached}")
    seeds = max((cell["seeds"] for cell in cells.values()), default=0)
    return f"Minutes until {seeds} seeds have their return and violations: {' · '.join(parts)}."


def of_theirs(cell: Mapping[str, Any], method: str) -> str:
    """Say in how many minutes imitation has the return and violations of a row of ours, or that it has not."""
    target, own = target_of(cell["targets"][method]["metrics"]), cell["own"]
    steps = steps_to(own, target)
    if steps is None:
        return f"not reached in {own['rounds'] * own['steps_a_round']:,} steps a seed"
    return minutes(their_minutes(own, steps, cell["seeds"]))


def minutes_row(world: str, method: str, cell: Mapping[str, Any]) -> tuple[str, ...]:
    timed, target = cell["ours"][method], target_of(cell["targets"][method]["metrics"])
    steps = timed["iterations"] * timed["steps_an_iteration"] / cell["seeds"]
    bounds = f"return ≥ {target.at_least:.4g}, violations ≤ {100 * target.at_most:.2f} %"
    as_many = minutes(their_minutes(cell["own"], steps, cell["seeds"]))
    return world, method, minutes(our_minutes(timed)), bounds, of_theirs(cell, method), as_many


def speed_row(world: str, method: str, cell: Mapping[str, Any]) -> tuple[str, ...]:
    ours, own, equal = our_speed(cell["ours"][method]), their_speed(cell["own"]), their_speed(cell["equal"][method])
    return world, method, speeds(ours), speeds(own), times(ratio(ours, own)), speeds(equal), times(ratio(ours, equal))


def settings_rows(cells: Cells) -> list[tuple[object, ...]]:
    rows = []
    for world, cell in cells.items():
        for name, run in {"own": cell["own"], **cell["equal"]}.items():
            chosen = [run["settings"][setting] for setting in ("epochs", "minibatch", "steps", "judged")]
            rows.append((world, cell["commit"], cell["machine"], name, *chosen, f"{run['steps_a_round']:,}"))
    return rows


def how_minutes(cells: Cells) -> list[str]:
    """Say how the minutes come about, and which of them are extrapolated."""
    commits = sorted({kept["commit"] for cell in cells.values() for kept in cell["targets"].values()})
    return [
        f"What is to be reached: {TARGET}; those cells are of commit {', '.join(commits)}.",
        HOW_OURS,
        HOW_THEIRS,
        "`imitation` has no constraint to learn. It sees the same demonstrations.",
    ]


def before_twins(cells: Cells) -> list[str]:
    """Say how fast a row with a twin is before that goes its own way."""
    return [
        f"{world}: `{method}` makes {speeds(our_speed(timed, twin=False))} until its twin goes its own way,"
        f" in iteration {timed['twin_from']} of {timed['iterations']} at the latest."
        for world, cell in cells.items()
        for method, timed in cell["ours"].items()
        if timed["twin_iteration_s"]
    ]


def speeds(found: Spread) -> str:
    return f"{found.median:,.0f} ({found.least:,.0f} to {found.greatest:,.0f})"


def times(found: Spread) -> str:
    return f"{found.median:.1f} × ({found.least:.1f} to {found.greatest:.1f})"


def minutes(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:,.0f}"
