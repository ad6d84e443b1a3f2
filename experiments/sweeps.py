"""Measure how the results depend on φ, m, the number of demonstrations and the noise: `python -m experiments.sweeps`.

A finished sweep is kept as results/sweeps/NAME.json with its command and commit, and the next call skips it. The report
and the figures are written anew. φ and m are coefficients, so that all their values train in one program. Settings:

sweep       a comma list of names, or all
seeds       number of seeds
iterations  number of iterations; 0 takes the environment's own
out         folder of the results
"""

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np

from aircl_jax import train
from aircl_jax.figures import sweep as sweep_figure
from aircl_jax.figures.style import DPI, STYLE
from aircl_jax.messages import say
from aircl_jax.reports import markdown
from aircl_jax.runs.spec import make_spec
from aircl_jax.runs.sweep import sweep
from experiments.cli.command import run_command
from experiments.cli.words import SEEDS, listed, refuse_short_runs
from experiments.shared.commits import current_commit
from experiments.shared.fresh_seeds import ON_GRIDS, first_seed_of
from experiments.shared.kept_files import keep, read_kept
from experiments.shared.paired_tests import spread

RESULTS = "results/sweeps"
OF_THE_EXPERT = ("violation_rate_expert", "expert_goal_rate")  # the expert's rates, shown for comparison


@dataclass(frozen=True)
class Sweep:
    """One setting, its values and the method that is trained with them on the grid; `of` says what `name` is a setting of."""

    title: str
    method: str
    name: str
    values: tuple[float, ...]
    of: Literal["coefficient", "config", "env"] = "coefficient"


PHI = (0.0, 0.0001, 0.001, 0.003, 0.01, 0.03, 0.1)
SWEEPS = {
    "phi_literal": Sweep("φ of the contrast prior, as printed", "aircl", "contrast_coef", PHI),
    "phi_corrected": Sweep("φ of the contrast prior, corrected", "aircl_corrected_prior", "contrast_coef", PHI),
    "m": Sweep("m, weight of q's samples as feasible", "aircl_corrected", "sampled_coef", (0.0, 0.1, 0.25, 0.5, 0.75, 1.0)),
    "demonstrations": Sweep(
        "number of demonstrations", "aircl_corrected", "num_demonstrations", (5, 10, 20, 50, 100, 200), "config"
    ),
    "demonstrations_contrast": Sweep(
        "number of demonstrations, contrast row",
        "aircl_contrast",
        "num_demonstrations",
        (5, 10, 20, 50, 100, 200),
        "config",
    ),
    "threshold_contrast": Sweep(
        "ϑ, ratio below which an entry is flagged, contrast row",
        "aircl_contrast",
        "threshold",
        (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5),
    ),
    "noise": Sweep(
        "share of random moves (slip), in demonstrations and world",
        "aircl_corrected",
        "slip",
        (0.0, 0.01, 0.05, 0.1, 0.2),
        "env",
    ),
}


@dataclass(frozen=True)
class Settings:
    sweep: str = "all"
    seeds: int = SEEDS
    iterations: int = 0
    out: str = RESULTS


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make, argv, Settings(), __doc__, then="the same command continues with the missing sweeps")


def make(settings: Settings, words: Sequence[str]) -> None:
    """Train the missing sweeps and write the report."""
    chosen = listed("sweep", settings.sweep, tuple(SWEEPS))
    refuse_short_runs(settings.seeds, settings.iterations, settings.out, RESULTS)
    commit = current_commit()  # of the code that this process has loaded
    for name in chosen:
        path = Path(settings.out) / f"{name}.json"
        if not path.exists():
            say(f"training {name}: {SWEEPS[name].method}, {SWEEPS[name].name} of {SWEEPS[name].values}")
            command = shlex.join(["python", "-m", "experiments.sweeps", *_other_words(words), f"sweep={name}"])
            keep(path, {"command": command, "commit": commit, **run(SWEEPS[name], settings)})
    say(f"wrote {write(Path(settings.out))}")


def _other_words(words: Sequence[str]) -> list[str]:
    return [word for word in words if not word.startswith("sweep=")]


def run(varied: Sweep, settings: Settings) -> dict[str, Any]:
    """Train one sweep; return {…, "metrics": {NAME: [V, S]}}."""
    iterations, first = settings.iterations or "default", first_seed_of("gridworld", varied.method)
    if varied.of == "coefficient":
        spec = make_spec(
            "gridworld",
            varied.method,
            seeds=settings.seeds,
            iterations=iterations,
            contrast_prior="method",
            first_seed=first,
            demonstrations="default",
            env_settings={},
            config={},
        )
        by_name = sweep(spec, varied.name, varied.values)
        metrics = {name: values.tolist() for name, values in by_name.items()}
    else:
        changes = [{varied.name: value} for value in varied.values]
        runs = [
            train(
                "gridworld",
                varied.method,
                seeds=settings.seeds,
                first_seed=first,
                iterations=iterations,
                env_settings=change if varied.of == "env" else {},
                config=change if varied.of == "config" else {},
            )
            for change in changes
        ]
        names = runs[0].summary["metrics"]
        metrics = {name: [run.summary["metrics"][name]["per_seed"] for run in runs] for name in names}
    finite = {name: [[_finite(x) for x in row] for row in rows] for name, rows in metrics.items()}
    return {
        "method": varied.method,
        "setting": varied.name,
        "values": varied.values,
        "seeds": settings.seeds,
        "metrics": finite,
    }


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else round(value, 6)


def write(out: Path) -> Path:
    """Write report.md and the figures of the finished sweeps."""
    about = (
        f"mean ± std over seeds, — where undefined. Seeds are 0 and on, of `aircl_contrast` {ON_GRIDS} and on, which are fresh."
    )
    lines = ["# Sensitivity on the grid", "", f"`python -m experiments.sweeps`; {about}", ""]
    for name, varied in SWEEPS.items():
        path = out / f"{name}.json"
        lines += [f"## {varied.title}", ""]
        if not path.exists():
            lines += [f"Not trained yet: `python -m experiments.sweeps sweep={name}`.", ""]
            continue
        cell = read_kept(path, "command", "commit", "metrics")
        with mpl.rc_context(STYLE):
            drawing = sweep_figure.draw(name, varied.title, cell)
            drawing.figure.savefig(out / f"{name}.png", dpi=DPI)
        lines += [
            f"`{cell['command']}`, commit {cell['commit']}",
            "",
            f"![{varied.title}]({name}.png)",
            "",
            drawing.caption,
            "",
        ]
        lines += [table(cell), ""]
    written = out / "report.md"
    written.write_text("\n".join(lines), encoding="utf-8")
    return written


def table(cell: Mapping[str, Any]) -> str:
    """Tabulate the measures, one row per value."""
    names = [name for name in (*sweep_figure.SHOWN, *OF_THE_EXPERT) if name in cell["metrics"]]
    rows = [
        (f"{value:g}", *(spread(cell["metrics"][name][place], 3) for name in names))
        for place, value in enumerate(cell["values"])
    ]
    return markdown.table((cell["setting"], *names), rows)


if __name__ == "__main__":
    sys.exit(main())
