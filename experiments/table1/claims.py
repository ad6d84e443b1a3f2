"""List the paper's claims and ours, each with the rules that judge it from the cells of Table 1."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from aircl_jax.methods import METHODS
from experiments.shared.paired_tests import SIGNIFICANCE, against_best, mean, spread
from experiments.shared.paper import PAPER
from experiments.table1.cells import COLUMNS, ROWS, Study
from experiments.table1.claim_rules import Bound, Contrast, Finding, Harder, Rule, Verdict, missing, of_enough_seeds

EVEN = math.log(0.6 / 0.4)  # |logit| below which D is between 0.4 and 0.6
FEWEST_ROWS = 5  # least number of rows of a rank correlation
BALANCED = 0.05  # distance from ½ within which balanced accuracy counts as chance
ROBOTS = COLUMNS[1:]
ELSEWHERE = ("gridworld", "swimmer", "pendulum")  # environments on which the paper says that the prior helps


class Claim(NamedTuple):
    """Sentence of the paper or of this project, and the rules that judge it."""

    text: str
    where: str
    rules: tuple[Rule, ...]


def _everywhere(limit: float) -> dict[str, float]:
    return dict.fromkeys(COLUMNS, limit)


CLAIMS = (
    Claim("AIRCL outperforms AIRL", "Sections 7.1 and 7.2", (Contrast("aircl", "airl"),)),
    Claim("AIRCL outperforms GACL", "Sections 7.1 and 7.2", (Contrast("aircl", "gacl"),)),
    Claim(
        "On the grid, both ICRL* variants, which have the true reward, outperform AIRCL",
        "Section 7.1",
        tuple(Contrast(row, "aircl", ("violation_rate",), ("gridworld",)) for row in ("icrl", "icrl_prior")),
    ),
    Claim(
        "The contrast prior helps AIRCL: without it, both measures decline",
        "Sections 7.1 and 8",
        (Contrast("aircl", "aircl_no_prior", envs=ELSEWHERE),),
    ),
    Claim(
        "On the walker, AIRCL without the prior is better",
        "Section 7.2",
        (Contrast("aircl_no_prior", "aircl", envs=("walker",)),),
    ),
    Claim("The contrast prior helps ICRL*", "Section 7.2", (Contrast("icrl_prior", "icrl", ("violation_rate",)),)),
    Claim("Feasibility of trajectories beats that of state-action pairs", "Section 7.2", (Contrast("aircl", "aircl_sa"),)),
    Claim("Non-linear reward and constraint beat linear ones", "Section 7.2", (Contrast("aircl", "aircl_linear"),)),
    Claim(
        "All methods do worse on the robots than on the grid",
        "Section 7.2",
        tuple(Harder(env, "gridworld") for env in ROBOTS),
    ),
    Claim(
        "On the walker all methods do worse than on the other tasks",
        "Section 7.2",
        tuple(Harder("walker", env) for env in ELSEWHERE),
    ),
    Claim(
        "At optimality D converges to ½",
        "Section 5.2",
        tuple(Bound(row, "logit_size", _everywhere(EVEN), True, "D within 0.4 and 0.6") for row in ("aircl", "airl")),
    ),
    Claim(
        "AIRCL recovers the constraint accurately",
        "Abstract",
        (
            Bound("aircl", "feasibility_auroc", _everywhere(0.9), False),
            Bound("aircl", "feasibility_gap", _everywhere(0.5), False),
        ),
    ),
    Claim("AIRCL recovers the reward accurately", "Abstract", (Bound("aircl", "reward_correlation", _everywhere(0.7), False),)),
    Claim(
        "AIRCL's behaviour matches the demonstrations, with a low rate of violations",
        "Abstract",
        (Bound("aircl", "return_ratio", _everywhere(0.9), False), Bound("aircl", "violation_rate", _everywhere(0.05), True)),
    ),
)

TARGETS = {"gridworld": 0.005, "swimmer": 0.05, "walker": 0.05, "pendulum": 0.02}  # limits of the violation rate of q
TARGETS_POLICY = TARGETS | {"pendulum": 0.05}  # limits of the violation rate of π
LEAST_OF_THE_PAPER = {env: min(row["violation_rate"][0] for row in PAPER[env].values()) for env in COLUMNS}
OURS = (
    Claim(
        "`aircl_corrected` stays below the project's limits on violations, q and π",
        "ours",
        (
            Bound("aircl_corrected", "violation_rate", TARGETS, True),
            Bound("aircl_corrected", "violation_rate_policy", TARGETS_POLICY, True),
        ),
    ),
    Claim(
        "`aircl_corrected` violates less than any row of the paper's table",
        "ours",
        (Bound("aircl_corrected", "violation_rate", LEAST_OF_THE_PAPER, True, "the least of the paper's column"),),
    ),
    Claim("`aircl_corrected` does the task", "ours", (Bound("aircl_corrected", "return_ratio", _everywhere(0.9), False),)),
    Claim(
        "`aircl_corrected` finds the constraint",
        "ours",
        (
            Bound("aircl_corrected", "feasibility_auroc", _everywhere(0.9), False),
            Bound("aircl_corrected", "feasibility_gap", _everywhere(0.5), False),
        ),
    ),
    Claim(
        "`aircl_corrected` recovers the true reward, step by step",
        "ours",
        (Bound("aircl_corrected", "reward_correlation", _everywhere(0.7), False),),
    ),
    Claim(
        "The constraint adds something to centring alone",
        "ours",
        (Contrast("aircl_corrected", "airl_centred", ("violation_rate", "violation_rate_policy")),),
    ),
)

ClaimWithEvidence = tuple[str, str, list[Finding]]  # text, where, evidence


def with_evidence(study: Study, claim: Claim) -> ClaimWithEvidence:
    """Apply the claim's rules to the cells."""
    return claim.text, claim.where, [finding for rule in claim.rules for finding in rule.findings(study)]


def best_without_reward(study: Study) -> list[Finding]:
    """Judge whether `aircl_corrected` is best or tied in the violation rate of q among the rows that know no reward."""
    findings = []
    rows = [method for method in ROWS if not METHODS[method].needs_true_reward]
    for env in COLUMNS:
        absent = missing(study, env, rows)
        adjusted = {} if absent else against_best(study.column(env, "violation_rate", rows), lower=True)
        if not adjusted:
            findings.append(Finding(env, "violation_rate", "—", "cannot be told", absent or "too few seeds"))
            continue
        best = next(iter(adjusted))
        p = adjusted.get("aircl_corrected", 0.0)
        verdict: Verdict = "holds" if p >= SIGNIFICANCE else "does not hold"
        findings.append(Finding(env, "violation_rate", f"best mean: {best}; against it p = {p:.2g}", verdict))
    return findings


def ranks(study: Study) -> list[Finding]:
    """Correlate mean RCAcc with mean violation rate of q over the rows with a discriminator (Spearman)."""
    findings = []
    for env in COLUMNS:
        accuracies, rates = (study.column(env, metric) for metric in ("rc_acc", "violation_rate"))
        both = [(mean(accuracies[method]), mean(rates[method])) for method in accuracies]
        points = np.array([pair for pair in both if None not in pair], float).reshape(-1, 2)
        if len(points) < FEWEST_ROWS or (np.ptp(points, axis=0) == 0).any():
            findings.append(Finding(env, "rank correlation", f"{len(points)} rows", "cannot be told", "cells missing"))
            continue
        rho, p = map(float, stats.spearmanr(points[:, 0], points[:, 1]))  # pyright: ignore[reportArgumentType]
        verdict: Verdict = "does not hold" if rho >= 0 else "holds" if p < SIGNIFICANCE else "cannot be told"
        measured = f"ρ = {rho:+.2f}, p = {p:.2g}, {len(points)} rows"
        findings.append(of_enough_seeds(Finding(env, "rank correlation", measured, verdict), min(map(len, rates.values()))))
    return findings


def at_the_optimum(study: Study) -> str:
    """Describe RCAcc of the runs whose discriminator cannot tell the policy from the expert at the end."""
    ends = [
        end
        for cell in study.cells.values()
        for end in zip(*(cell["metrics"][name]["per_seed"] for name in ("rc_acc", "balanced_acc", "logit_size")), strict=True)
        if None not in end
    ]
    coins = [accuracy for accuracy, balanced, _ in ends if abs(balanced - 0.5) <= BALANCED]
    even = [accuracy for accuracy, _, logit in ends if logit <= EVEN]
    says = (
        "At the optimum D = ½ for every sample. Noise then decides whether D > ½, and any constant in f moves RCAcc to 0 or "
        "1. An RCAcc near 1 means that D still tells the expert from the policy, or that D calls everything expert."
    )
    return (
        f"{says}\n\nOf {len(ends)} runs (cells × seeds), {len(coins)} ended with a balanced accuracy within {BALANCED:g} of "
        f"½: {_range(coins)}. With a mean |log D/(1 − D)| of at most {EVEN:.3f}, D between 0.4 and 0.6, ended {len(even)}: "
        f"{_range(even)}."
    )


def _range(accuracies: Sequence[float]) -> str:
    if not accuracies:
        return "nothing to tell"
    return f"RCAcc {spread(accuracies, 3)}, from {min(accuracies):.3f} to {max(accuracies):.3f}"
