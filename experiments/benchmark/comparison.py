"""Compare with imitation, world by world: keep each as a cell, and write the page of all that are kept."""

import platform
from pathlib import Path
from typing import Any

from aircl_jax.messages import say
from aircl_jax.storage import write_whole
from experiments.benchmark import bare_physics, ours, report, theirs
from experiments.benchmark.settings import EFFORTS, PEER_PYTHON, WORLDS, Settings
from experiments.cli.words import smoke_budget
from experiments.shared.commits import current_commit
from experiments.shared.kept_files import keep, read_kept

METHODS = ("aircl_contrast", "aircl_corrected")
CELLS = Path("results/cells")  # of Table 1: the return and violations that count as reached
PARTS = ("seeds", "scale", "ours", "own", "equal", "physics", "targets", "commit", "machine")  # what a cell has


def make(settings: Settings, command: str) -> None:
    """Measure the worlds that are missing, one after the other, and write the page after each."""
    folder, worlds = settings.folder, settings.worlds
    if not PEER_PYTHON.exists():
        raise ValueError(f"peer=true: {PEER_PYTHON} is missing; make it with: make .venv-peer/.installed")
    targets = {world: targets_of(world) for world in worlds}
    for world in worlds:
        path = folder / f"{world}.json"
        if not path.exists():
            keep(path, {**measured(settings, world), "targets": targets[world]})
        kept(path, settings)
        page(settings, command)
    say(str(page(settings, command)))


def targets_of(world: str) -> dict[str, Any]:
    """Read what ten seeds earn and violate in the kept cells of Table 1. Raises ValueError where one is missing."""
    found = {}
    for method in METHODS:
        path = CELLS / world / f"{method}.json"
        if not path.exists():
            raise ValueError(f"{path} is missing; make it with: python -m experiments.table1")
        cell = read_kept(path, "commit", "metrics.return", "metrics.violation_rate_policy")
        chosen = {name: cell["metrics"][name] for name in ("return", "violation_rate_policy")}
        found[method] = {"commit": cell["commit"], "metrics": {name: pick(value) for name, value in chosen.items()}}
    return found


def pick(statistics: dict[str, Any]) -> dict[str, Any]:
    """Leave out the single seeds."""
    return {name: statistics[name] for name in ("mean", "std")}


def kept(path: Path, settings: Settings) -> dict[str, Any]:
    """Read a world's cell. Raises ValueError where it was measured otherwise than is asked."""
    cell = read_kept(path, *PARTS)
    for name, asked in (("seeds", settings.seeds_here), ("scale", settings.scale)):
        if cell[name] != asked:
            raise ValueError(f"{path} has {name}={cell[name]}, asked for is {asked}; give out=DIR, or remove the file")
    return cell


def measured(settings: Settings, world: str) -> dict[str, Any]:
    """Measure a world: ours, then imitation by its own settings and by each of ours, then physics."""
    import jax

    from aircl_jax.runtime import cores

    effort, training = EFFORTS[settings.scale], smoke_budget()["train"] if settings.scale == "smoke" else {}
    cell: dict[str, Any] = {"commit": current_commit(), "seeds": settings.seeds_here, "scale": settings.scale}
    words = {"seeds": settings.seeds_here, "train": training, "repeats": effort.repeats, "steps": effort.steps}
    cell["ours"] = {}
    for method in METHODS:
        say(f"{world}: {settings.seeds_here} seeds of {method} …")
        cell["ours"][method] = ours.in_a_process(world, method, **words)
    specs = {method: ours.spec_of(world, method, settings.seeds_here, training) for method in METHODS}
    say(f"{world}: imitation by its own settings, {cores()} processes …")
    cell["own"] = theirs.trained(specs[METHODS[0]], theirs.own_settings(world), effort, cores(), judge=True)
    cell["equal"] = {}
    for method, spec in specs.items():
        say(f"{world}: imitation by the settings of {method} …")
        cell["equal"][method] = theirs.trained(spec, theirs.equal_settings(spec), effort, cores(), judge=False)
    say(f"{world}: physics …")
    cell["physics"] = bare_physics.measured(world, effort, cores())
    cell["machine"] = f"{cores()} cores, {platform.machine()}, Python {platform.python_version()}, jax {jax.__version__}"
    return cell


def page(settings: Settings, command: str) -> Path:
    """Write the page of all kept worlds beside their folder; return its path."""
    folder = settings.folder
    paths = {world: folder / f"{world}.json" for world in WORLDS}
    cells = {world: kept(path, settings) for world, path in paths.items() if path.exists()}
    path = folder.parent / f"{folder.name}.md"
    write_whole(path, report.page(cells, command))
    return path
