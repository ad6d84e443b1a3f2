"""Write the report of Figure 2: the tables that were read, the tests of the inflexion, and the figures."""

import numpy as np

from aircl_jax.analysis.transition_distances import RiseTest
from aircl_jax.reports import markdown
from experiments.figure2.analysis import NICE, Numbers, Study

LEVEL = 0.05  # significance level of the verdict


def report(study: Study, numbers: Numbers, command: str) -> str:
    """Return the text of report.md, with the command that made its numbers."""
    title = f"# Figure 2: how far animals move from one behaviour to the next ({study.mapping.name})"
    parts = [
        title + (": SIMULATED, no animal was observed" if study.simulated else ""),
        f"Made by `{command}`. Distances are in {study.mapping.coordinate_unit}.",
        "## The inflexion\n\n" + verdict(study, numbers),
        "## Its tests\n\n" + rise_table(numbers),
        "## Long transitions\n\n" + long_pairs(study, numbers),
        "## What was read\n\n" + markdown.bullets(study.account),
        "## Codes\n\n" + code_table(study),
        "## Figures\n\n" + FIGURES,
    ]
    return markdown.paragraphs(*parts)


FIGURES = """\
- `figure2b_places.png`: places as regions of the ground, by the majority of the rows of a cell, for each camera.
- `figure2c_distances.png`: histogram of the distances, with trend, bootstrap intervals, null model, cumulative share.
- `figure2d_mean_distance.png`, `figure2e_frequency.png`: by pair of codes; the two long transitions boxed.
- `figure2f_long_transitions.png`: every case of these two on the ground.
- `figure2g_codes.png`: the codes and their shares of the rows.
- `figure7_activity.png`: rows on the ground. `figure8_places_rows.png`: the places with the rows on them.

A distance is that of the positions at the first rows of two successive behaviours of a gap-free track, in all three
coordinates. The cameras are drawn apart, because the source does not say that their coordinates share an origin."""


def verdict(study: Study, numbers: Numbers) -> str:
    """State whether the data support an inflexion, and the size of their tail."""
    located_only, filled = numbers.rises["without"][NICE], numbers.rises["with_missing"][NICE]
    tail, (low, high) = numbers.tail, numbers.tail.ratio_band
    lacking = int(np.isnan(study.moves.start + study.moves.end).any(axis=1).sum())
    null = float(numbers.without.shuffled[numbers.without.edges[:-1] >= tail.high].sum())
    supports = "supports" if located_only.p_monotone < LEVEL else "does not support"
    weight = "heavier than" if low > 1 else "lighter than" if high < 1 else "not distinguishable from"
    rarer = "rarer" if tail.observed < null else "more frequent"
    located = int(numbers.without.counts.sum())
    return f"""The histogram of the {located:,} transitions with both positions known **{supports}** an inflexion,
that is, a distance beyond which transitions become more frequent again:
{_words(located_only)}.

- With the {lacking:,} transitions whose position is missing counted at {point(numbers)}:
  {_words(filled)}.
  These distances are artefacts: they measure the way to that point.
- The tail: {tail.observed} transitions at {tail.high:g} or more, where an exponential fitted from {tail.low:g} to
  {tail.high:g} leads to expect {tail.expected:.1f} (ratio, 95 % over resampled recordings: {low:.2f} to {high:.2f}):
  {weight} exponential. A heavy tail is no inflexion.
- The null model (ends shuffled within a recording) has {null:.0f} transitions there: long transitions are {rarer}
  than if an animal's place did not depend on its place at the last behaviour.
- None of this measures a reward. The contrast prior of the paper's Section 6 assumes that high rewards drive long
  transitions. These histograms neither show nor exclude it."""


def point(numbers: Numbers) -> str:
    """Format the point at which missing coordinates are counted."""
    return f"({', '.join(f'{coordinate:g}' for coordinate in numbers.missing_at)})"


def _words(test: RiseTest) -> str:
    low, high = test.counts
    return (
        f"the largest rise is from {low} transitions at {test.low:g} to {high} at {test.high:g}"
        f" (z = {test.z:.1f}), and a trend that only falls gives as large a one with p = {test.p_monotone:.3f}"
    )


def rise_table(numbers: Numbers) -> str:
    """Tabulate the largest rise at three bin widths, with and without the rows at missing coordinates."""
    head = ("missing coordinates", "bin", "rise", "z", "p under a falling trend", "still rises in resampled recordings")
    rows = []
    for name, words in (("with_missing", f"counted as {point(numbers)}"), ("without", "left out")):
        for test in numbers.rises[name]:
            rise = f"{test.counts[0]} at {test.low:g} → {test.counts[1]} at {test.high:g}"
            share = f"{100 * test.bootstrap_share:.0f} %"
            rows.append((words, f"{test.bin_width:g}", rise, f"{test.z:.2f}", f"{test.p_monotone:.3f}", share))
    caution = "The p-values treat transitions as independent. Those of one track are not, so the true p are larger."
    return "\n\n".join([markdown.table(head, rows), caution])


def long_pairs(study: Study, numbers: Numbers) -> str:
    """Tabulate the two boxed pairs."""
    pairs, names = numbers.pairs, study.coded.names
    rows = [
        (
            names[pair[0]],
            names[pair[1]],
            pairs.seen[pair],
            f"{100 * pairs.frequency[pair]:.0f} %",
            f"{pairs.mean_distance[pair]:.3g}",
        )
        for pair in numbers.long_pairs
    ]
    return "\n".join(
        [
            "Boxed: the two most frequent pairs, by share of their start, with at least ten located cases and a mean",
            f"distance beyond {numbers.long_distance:.3g}. 95 % of all transitions are shorter.",
            "",
            markdown.table(("from", "to", "transitions", "share of the start's", "mean distance"), rows),
        ]
    )


def code_table(study: Study) -> str:
    """Tabulate the codes of Figure 2(g) with their rows."""
    rows = np.bincount(study.coded.code, minlength=len(study.coded.names))
    return markdown.table(
        ("code", "state", "rows"), [(code, name, f"{rows[code]:,}") for code, name in enumerate(study.coded.names)]
    )
