"""Draw Figures 2, 7 and 8 of the paper and test its inflexion: `python -m experiments.figure2 data=DIR`.

Settings, as NAME=VALUE (bad input prints one line on standard error and exits with 2):

data     folder of tables, simulated, or default: the folder of the variable AIRCL_DATA
mapping  name or file of the column mapping
coding   bout or step
out      folder of the results
draws    number of draws of the bootstrap and the null models
seed     seed of these draws
"""

import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from aircl_jax.figures.animals import ground_maps, transitions
from aircl_jax.messages import say
from envs.animals.data_folder import command_prefix
from experiments.cli.command import run_command
from experiments.figure2.analysis import NICE, Numbers, Settings, Study, analyse, read
from experiments.figure2.report import point, report

CELLS = 60  # grid cells along the longer side of a map


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make, argv, Settings(), __doc__)


def make(settings: Settings, words: Sequence[str]) -> None:
    """Read the tables, analyse them, draw the figures and write the report."""
    study = read(settings)
    out = Path(settings.out)
    out.mkdir(parents=True, exist_ok=True)
    numbers = analyse(study, settings)
    draw(study, settings, numbers)
    command = command_prefix(settings.data, study.simulated) + shlex.join(["python", "-m", "experiments.figure2", *words])
    (out / "numbers.json").write_text(json.dumps({"command": command, **numbers.as_json()}, indent=1) + "\n", encoding="utf-8")
    (out / "report.md").write_text(report(study, numbers, command), encoding="utf-8")
    say(str(out / "report.md"))


def draw(study: Study, settings: Settings, numbers: Numbers) -> None:
    """Save every figure as a PNG in `out`."""
    coded, simulated, unit = study.coded, study.simulated, study.mapping.coordinate_unit
    ground = ground_of(study)
    cell = max(float(np.ptp(rows.position, axis=0).max()) for rows in ground.cameras.values()) / CELLS
    panels = {
        f"missing coordinates counted as {point(numbers)}": (numbers.with_missing, note(numbers, "with_missing")),
        "missing coordinates left out": (numbers.without, note(numbers, "without")),
    }
    distance_map, frequency_map = transitions.pair_maps(numbers.pairs, coded.names, numbers.long_pairs, unit, simulated)
    share = np.bincount(coded.code, minlength=len(coded.names))
    figures = {
        "figure2b_places": ground_maps.place_map(ground, coded.places, cell, points=False, simulated=simulated),
        "figure2c_distances": transitions.distance_histograms(panels, unit, simulated),
        "figure2d_mean_distance": distance_map,
        "figure2e_frequency": frequency_map,
        "figure2g_codes": transitions.code_table(coded.names, share, simulated),
        "figure7_activity": ground_maps.activity_map(ground, simulated),
        "figure8_places_rows": ground_maps.place_map(ground, coded.places, cell, points=True, simulated=simulated),
    }
    if numbers.long_pairs:
        cases = [arrows(study, numbers, source, target) for source, target in numbers.long_pairs]
        figures["figure2f_long_transitions"] = ground_maps.transition_map(ground, coded.places, cases, cell, simulated)
    for name, figure in figures.items():
        transitions.save(figure, Path(settings.out) / f"{name}.png")


def ground_of(study: Study) -> ground_maps.Ground:
    """Return the located rows of each camera on the two coordinates that the mapping names as the ground."""
    tracks = study.coded.tracks
    position = tracks.position[:, list(study.mapping.map_axes)]
    located = np.isfinite(position).all(axis=1)
    cameras = {}
    for site in tracks.site[located].counts():
        here = located & tracks.site.are(site)
        cameras[site] = ground_maps.Rows(position[here], study.coded.place[here])
    return ground_maps.Ground(cameras, study.mapping.coordinate_unit)


def arrows(study: Study, numbers: Numbers, source: int, target: int) -> ground_maps.Arrows:
    """Return the located cases of one pair of codes at the camera that saw most of them."""
    moves, pairs, names = study.moves, numbers.pairs, study.coded.names
    start, end = (at[:, list(study.mapping.map_axes)] for at in (moves.start, moves.end))
    cases = (moves.source == source) & (moves.target == target) & np.isfinite(start + end).all(axis=1)
    sites, seen = np.unique(moves.site[cases], return_counts=True)
    site = str(sites[seen.argmax()])
    here = cases & (moves.site == site)
    share, distance = pairs.frequency[source, target], pairs.mean_distance[source, target]
    words = f"{100 * share:.0f} % of its transitions, mean distance {distance:.3g}, n = {pairs.seen[source, target]}"
    return ground_maps.Arrows(f"{names[source]} → {names[target]}\n{words}", site, start[here], end[here])


def note(numbers: Numbers, name: str) -> str:
    """Describe the largest rise in the figure's bins in two lines."""
    test = numbers.rises[name][NICE]
    counts, between = test.counts, f"at {test.low:g} to {test.high:g}"
    falling = f"p = {test.p_monotone:.2f} under a falling trend"
    return f"largest rise: {counts[0]} to {counts[1]} transitions, {between}\n{falling}"


if __name__ == "__main__":
    sys.exit(main())
