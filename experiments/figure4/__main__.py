"""Compare causal links of generated and real animal trajectories (Figure 4), and test the contrast prior.

`python -m experiments.figure4 data=DIR` trains the missing methods, keeps each as a cell under results/figure4/ and writes
report.md and the figures beside them. The next call skips finished cells. `data=simulated` does the same on the simulated
meerkats, whose reward and constraint are known. `scale=smoke out=DIR` is a quick pass elsewhere. Bad input prints one line
and exits with 2.
"""

import shlex
import sys
from collections.abc import Iterator, Sequence
from functools import partial

import matplotlib as mpl
import numpy as np

from aircl_jax.analysis.causal import strongest
from aircl_jax.figures.animals import causal_links
from aircl_jax.figures.grids import codes
from aircl_jax.figures.style import DPI, STYLE
from aircl_jax.messages import say
from envs import Codes
from envs.animals.data_folder import command_prefix
from experiments.cli.command import run_command
from experiments.figure4 import cells, held_out, report
from experiments.figure4.cells import Settings, Study


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make, argv, Settings(), __doc__, then="the same command continues")


def make(settings: Settings, words: Sequence[str]) -> None:
    """Make the missing cells and write the report."""
    study = cells.read(settings)
    methods = cells.methods(settings, study)
    command = command_prefix(settings.data, study.simulated) + shlex.join(["python", "-m", "experiments.figure4", *words])
    for finished in collect(settings, study, methods):  # a report after every cell, so that finished cells can be read
        write(settings, study, finished, command)
    say(str(study.folder / "report.md"))


def collect(settings: Settings, study: Study, methods: Sequence[str]) -> Iterator[report.Finished]:
    """Yield the finished cells after each new one: the yardsticks with every method, then the recordings held out."""
    of_these = {"windows": len(study.codes)}
    as_asked = of_these | {"seeds": list(range(settings.seeds))}
    yardsticks = cells.kept(study.folder / "yardsticks.json", of_these, partial(cells.yardstick_cell, settings, study))
    finished = report.Finished(yardsticks, {}, {})
    for method in methods:
        path = study.folder / f"{method}.json"
        finished.methods[method] = cells.kept(path, as_asked, partial(cells.method_cell, settings, study, method))
        yield finished
    folds = min(settings.folds, len(np.unique(study.herd.windows.recording)) // 2)
    for method in (method for method in held_out.METHODS if method in methods):
        for fold in range(folds):
            path = study.folder / "held_out" / f"{method}_{fold}.json"
            cell = cells.kept(path, {"fold": fold}, partial(held_out.held_out_cell, settings, study, method, fold))
            finished.held_out.setdefault(method, []).append(cell)
        yield finished


def write(settings: Settings, study: Study, finished: report.Finished, command: str) -> None:
    """Write report.md and the figures of the finished cells."""
    lag = str(settings.tau_max)
    apart = {name: np.array(cell["difference_map"][lag]) for name, cell in finished.methods.items()}
    apart |= {name: np.array(values) for name, values in finished.yardsticks[lag]["maps"].items()}
    by_seed = {name: cell["difference"]["sampled"][lag] for name, cell in finished.methods.items()}
    with mpl.rc_context(STYLE):
        figures = {
            f"figure4_links_tau{lag}": causal_links.link_maps(strongest(study.real[settings.tau_max]), apart),
            f"figure4_differences_tau{lag}": causal_links.differences(
                by_seed, report.named_yardsticks(finished.yardsticks, lag)
            ),
        }
        if finished.held_out:
            figures["held_out"] = causal_links.held_out(report.fold_scores(finished))
        captions = {}
        if report.SHOWN in finished.methods:
            recovered = cells.from_json(finished.methods[report.SHOWN]["recovered"])
            named = Codes(study.herd.windows.names, study.herd.impossible)
            title = f"{report.SHOWN} on {finished.methods[report.SHOWN]['env']}, {len(recovered.reward)} seeds"
            for drawing in codes.draw(recovered, named, title):
                figures[drawing.name], captions[drawing.name] = drawing.figure, drawing.caption
        for name, figure in figures.items():
            figure.savefig(study.folder / f"{name}.png", dpi=DPI)
    (study.folder / "report.md").write_text(report.report(settings, study, finished, command, captions), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
