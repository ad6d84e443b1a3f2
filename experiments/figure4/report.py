"""Write the report of Figure 4: mean |ΔV| beside its yardsticks, held-out likelihood, the contrast prior and recovery."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from aircl_jax.reports import markdown
from aircl_jax.reports.recovered_words import in_words
from envs import Codes
from experiments.figure4.cells import Settings, Study, from_json
from experiments.figure4.truth import against_truth
from experiments.shared.paired_tests import effect, spread

SHOWN = "aircl_corrected"  # method whose learned functions are described, and which the others are compared with
YARDSTICKS = {"halves": "two halves", "noise_floor": "noise floor", "markov_chain": "Markov chain", "uniform": "uniform random"}
PRIOR = (("aircl", "aircl_no_prior"), ("aircl_corrected_prior", "aircl_corrected"), ("icrl_prior", "icrl"))  # (with, without)
MAPS = """\
The links V of the recordings (left colour bar), then |ΔV| of each method (windows of q, mean over seeds) and yardstick on one
scale, with its mean. Chain and chance are of one draw here, and the mean of ten in the table. Codes are those of the table of
`experiments.figure2`."""
TARGET = 1.25  # target of mean |ΔV|, in noise floors


class Finished(NamedTuple):
    """The finished cells: yardsticks, methods by name, held-out folds by method."""

    yardsticks: dict[str, Any]
    methods: dict[str, dict[str, Any]]
    held_out: dict[str, list[dict[str, Any]]]


def named_yardsticks(cell: Mapping[str, Any], lag: str) -> dict[str, list[float]]:
    return {words: cell[lag]["per_seed"][name] for name, words in YARDSTICKS.items()}


def fold_scores(finished: Finished) -> dict[str, list[float]]:
    """Return mean log P by fold of the Markov chain and of every method, over the folds that all have."""
    number = min(map(len, finished.held_out.values()))
    chain = next(iter(finished.held_out.values()))[:number]
    scores = {"Markov chain": [cell["chain"] for cell in chain]}
    return scores | {name: [cell["policy"] for cell in folds[:number]] for name, folds in finished.held_out.items()}


def report(settings: Settings, study: Study, finished: Finished, command: str, captions: Mapping[str, str]) -> str:
    """Return the text of report.md, with the command that made its numbers."""
    lag = str(settings.tau_max)
    mob = "the simulated mob (SIMULATED: no animal was observed)" if study.simulated else "the recorded windows"
    parts = [
        f"# Figure 4: causal links on {mob}",
        f"Made by `{command}`; {len(study.codes):,} windows of {study.codes.shape[1]} steps, {_lags(lag)}.",
        "## Mean |ΔV|\n\n" + difference_table(finished, lag) + "\n\n" + target(finished, lag),
        f"![maps](figure4_links_tau{lag}.png)\n\n{MAPS}",
        f"![means](figure4_differences_tau{lag}.png)\n\nMean |ΔV| by seed.",
        "## Recordings held out\n\n" + held_out(finished),
        "## The contrast prior\n\n" + prior(finished, lag),
    ]
    if study.simulated:
        parts.append("## Against the known truth\n\n" + against_truth(study, finished.methods))
    if SHOWN in finished.methods:
        recovered = from_json(finished.methods[SHOWN]["recovered"])
        codes = Codes(study.herd.windows.names, study.herd.impossible)
        parts.append(f"## What drives and what binds them, by {SHOWN}\n\n" + in_words(recovered, codes))
        parts += [f"![{name}]({name}.png)\n\n{caption}" for name, caption in captions.items()]
    parts.append("## Settled?\n\n" + settled(finished))
    parts.append("## What the cells were made with\n\n" + made_with(finished))
    alarms = [f"{name}: {line}" for name, cell in finished.methods.items() for line in cell["alarms"]]
    parts.append("## Alarms\n\n" + markdown.bullets(alarms))
    return markdown.paragraphs(*parts)


def made_with(finished: Finished) -> str:
    """Tabulate each method's commit, iterations, time and command."""
    rows = [
        (name, cell["commit"], cell["iterations"], f"{cell['wall_s']:.0f}", f"`{cell['command']}`")
        for name, cell in finished.methods.items()
    ]
    made = markdown.table(("", "commit", "iterations", "seconds", "trained as by"), rows)
    return made + "\n\nA method's settings are those of `aircl_jax/settings/env_defaults.py` at its commit."


def _lags(lag: str) -> str:
    return "τ = 1" if lag == "1" else f"the strongest of τ = 1 to {lag}"


def difference_table(finished: Finished, lag: str) -> str:
    """Tabulate methods and yardsticks: mean ± std over seeds, in noise floors, and paired with the corrected row."""
    floor = float(np.mean(finished.yardsticks[lag]["per_seed"]["noise_floor"]))
    ours = finished.methods[SHOWN]["difference"]["sampled"][lag] if SHOWN in finished.methods else None
    rows = []
    for name, cell in finished.methods.items():
        sampled, policy = (cell["difference"][of][lag] for of in ("sampled", "policy"))
        against = ("", "") if ours is None or name == SHOWN else _against(sampled, ours)
        rows.append((name, spread(sampled), spread(policy), f"{np.mean(sampled) / floor:.2f}", *against))
    for name, values in named_yardsticks(finished.yardsticks, lag).items():
        against = ("", "") if ours is None or name in ("two halves", "noise floor") else _against(values, ours)
        rows.append((f"*{name}*", spread(values), "", f"{np.mean(values) / floor:.2f}", *against))
    real = finished.yardsticks[lag]["per_seed"]["real_strength"][0]
    seeds = sorted({len(cell["seeds"]) for cell in finished.methods.values()})
    return "\n".join(
        [
            markdown.table(("", "q", "π", "q, in noise floors", f"q less {SHOWN}'s [95 %]", "p"), rows),
            "",
            f"Mean ± std over {' or '.join(map(str, seeds))} seeds; mean |V| of the recordings {real:.4f}. p: Wilcoxon's",
            "signed ranks of the seeds' differences. Noise floor: two halves / √2, what a perfect model of as many windows",
            "would score.",
        ]
    )


def _against(values: Sequence[float], ours: Sequence[float]) -> tuple[str, str]:
    if len(values) != len(ours):
        return "", ""
    gap = effect(values, ours)
    return f"{gap.mean:+.4f} [{gap.low:+.4f}, {gap.high:+.4f}]", f"{gap.p:.3f}"


def target(finished: Finished, lag: str) -> str:
    """Say whether the corrected row is within 1.25 noise floors and below AIRL and GACL."""
    if SHOWN not in finished.methods:
        return ""
    ours = float(np.mean(finished.methods[SHOWN]["difference"]["sampled"][lag]))
    floor = float(np.mean(finished.yardsticks[lag]["per_seed"]["noise_floor"]))
    chain = float(np.mean(finished.yardsticks[lag]["per_seed"]["markov_chain"]))
    within = "within" if ours <= TARGET * floor else "**not** within"
    lines = [f"{SHOWN} is {within} {TARGET} noise floors ({ours / floor:.2f}; the fitted Markov chain {chain / floor:.2f})."]
    for name in ("airl", "gacl"):
        if name in finished.methods:
            theirs = float(np.mean(finished.methods[name]["difference"]["sampled"][lag]))
            lines.append(f"It is {'below' if ours < theirs else '**not** below'} {name} ({theirs / floor:.2f}).")
    return " ".join(lines)


def held_out(finished: Finished) -> str:
    """Tabulate the next-code log-likelihood of policies and of the smoothed chain on recordings that neither saw."""
    if not finished.held_out:
        return "Not made: `folds=9` does it."
    scores = fold_scores(finished)
    chain, folds = scores["Markov chain"], len(scores["Markov chain"])
    rows = []
    for name, values in scores.items():
        if name == "Markov chain":
            rows.append(("*first-order Markov chain*", spread(values, 4), "", ""))
            continue
        gain = effect(values, chain)
        won = int(np.sum(np.array(values) > chain))
        interval = f"{gain.mean:+.4f} [{gain.low:+.4f}, {gain.high:+.4f}]"
        rows.append((name, spread(values, 4), interval, f"{won} of {folds}"))
    smoothing = sorted({cell["smoothing"] for cell in next(iter(finished.held_out.values()))})
    return "\n".join(
        [
            markdown.table(("", "mean log P of the next code", "less the chain's [95 % over folds]", "folds won"), rows),
            "",
            f"{folds} folds, each leaves out two recordings; one seed of a method a fold. The chain's pseudo-count is chosen",
            f"by leaving out one training recording at a time ({', '.join(f'{s:g}' for s in smoothing)}).",
            "![held out](held_out.png)",
        ]
    )


def prior(finished: Finished, lag: str) -> str:
    """Tabulate the effects of Eq. 13, the contrast prior, with intervals."""
    rows, made = [], False
    for with_it, without in PRIOR:
        if with_it not in finished.methods or without not in finished.methods:
            continue
        made = True
        for name, values in _measures(finished, lag, with_it, without).items():
            if any(value is None for side in values for value in side):
                continue
            change = effect(*values)
            rows.append(
                (
                    f"{name}: {with_it} − {without}",
                    *map(spread, values),
                    f"{change.mean:+.4f} [{change.low:+.4f}, {change.high:+.4f}]",
                    f"{change.size:+.2f}",
                    f"{change.p:.3f}",
                )
            )
    known = "" if "icrl" in finished.methods else " ICRL needs the true reward, which is unknown here; see the simulated mob."
    note = f"d: mean difference in standard deviations of the differences. For |ΔV| less is better.{known}"
    head = ("measure", "with", "without", "difference [95 %]", "d", "p")
    return "\n\n".join([markdown.table(head, rows), note]) if made else f"No pair is finished yet.{known}"


def _measures(finished: Finished, lag: str, *names: str) -> dict[str, list[list[float]]]:
    cells = [finished.methods[name] for name in names]
    measured = {"mean |ΔV|": [cell["difference"]["sampled"][lag] for cell in cells]}
    for metric, words in (
        ("feasibility_auroc", "AUROC of δ̄"),
        ("feasibility_gap", "gap of δ̄"),
        ("violation_rate", "violations, q"),
        ("reward_correlation", "correlation of f with r"),
    ):
        measured[words] = [cell["metrics"][metric]["per_seed"] for cell in cells]
    return measured


def settled(finished: Finished) -> str:
    """Tabulate means over the seeds at three quarters of the training and at its end."""
    rows = []
    for name, cell in finished.methods.items():
        curve = np.array(cell["curves"]["entropy"], float)
        fifth = max(1, len(curve) // 10)
        at = int(len(curve) * 0.75)
        ends = (curve[at : at + fifth], curve[-fifth:])
        rows.append((name, *(f"{part.mean():.3f}" for part in ends), f"{cell['wall_s']:.0f}"))
    return markdown.table(("", "entropy of π at ¾", "at the end", "wall time (s)"), rows)
