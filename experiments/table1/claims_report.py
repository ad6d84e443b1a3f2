"""Write claims.md: the verdict on each claim, the number of lines behind it, and the lines themselves."""

from collections import Counter
from collections.abc import Sequence

from aircl_jax.reports import markdown as md
from experiments.shared.paired_tests import FEWEST_SEEDS
from experiments.table1 import claims, contrast_claims, convergence, swap_rules
from experiments.table1.cells import Study
from experiments.table1.claim_rules import LOWER_IS_BETTER, Bound, Contrast, Finding, Harder, overall
from experiments.table1.claims import ClaimWithEvidence
from experiments.table1.report import warning


def markdown(study: Study) -> str:
    """Return the text of claims.md."""
    paper = [claims.with_evidence(study, claim) for claim in claims.CLAIMS]
    best = "`aircl_corrected` is best or tied among rows that are not given the true reward"
    ours = [(best, "ours", claims.best_without_reward(study)), *(claims.with_evidence(study, claim) for claim in claims.OURS)]
    contrast = [claims.with_evidence(study, claim) for claim in contrast_claims.CLAIMS]
    measure: list[ClaimWithEvidence] = [
        ("Values like the paper's are those of runs stopped before convergence", "ours", convergence.findings(study)),
        ("A higher RCAcc goes with fewer violations", "Section 7.1", claims.ranks(study)),
    ]
    smoke = study.job.scale == "smoke"
    introduction = (
        f"`{study.command}`, at commit `{study.commit}`; computed from the cells of [table1.md](table1.md) and of "
        "[swap.md](swap.md), nothing by hand. A claim holds, or does not hold, if more than half of its lines do; a line whose "
        f"cells are missing cannot be told. With fewer than {FEWEST_SEEDS} seeds no line can be told."
    )
    animals = "Figures 2 and 4 of the paper, on animals, are not in these cells: see `results/figure2` and `results/figure4`."
    parts = [
        "# Smoke test of the claims' machinery" if smoke else "# The paper's claims beside what we measured",
        *([warning(study)] if smoke else []),
        introduction,
        _summary("What the paper says", paper),
        _summary("What this project says", ours),
        _summary("What this project says of `aircl_contrast`", contrast),
        _summary("What the measures say", measure),
        animals,
        f"## What RCAcc is at the optimum\n\n{claims.at_the_optimum(study)}",
        "# Evidence",
        *(_evidence(*claim) for claim in (*paper, *ours, *contrast, *measure)),
        "# Rules",
        md.bullets(_rules()),
    ]
    return md.paragraphs(*parts)


def _summary(title: str, claims_with_evidence: Sequence[ClaimWithEvidence]) -> str:
    rows = [(text, where, _counted(findings), f"**{_verdict(findings)}**") for text, where, findings in claims_with_evidence]
    return f"## {title}\n\n" + md.table(("claim", "where", "what we measured", "verdict"), rows)


def _verdict(findings: Sequence[Finding]) -> str:
    verdict = overall(findings)
    absent = verdict == "cannot be told" and any(finding.because.startswith("cells missing") for finding in findings)
    return f"{verdict}: cells missing" if absent else verdict


def _counted(findings: Sequence[Finding]) -> str:
    """Count the lines of each verdict and name their environments."""
    parts = []
    for verdict in ("holds", "does not hold", "cannot be told"):
        envs = Counter(finding.env for finding in findings if finding.verdict == verdict)
        named = ", ".join(env + (f" ×{count}" if count > 1 else "") for env, count in envs.items())
        if envs:
            parts.append(f"{verdict}: {envs.total()} of {len(findings)} ({named})")
    return "; ".join(parts)


def _evidence(text: str, where: str, findings: Sequence[Finding]) -> str:
    rows = []
    for finding in findings:
        verdict = finding.verdict + (f" ({finding.because})" if finding.because else "")
        rows.append((finding.env, finding.what, finding.measured, verdict))
    return f"## {text} ({where})\n\n" + md.table(("env", "line", "what we measured", "verdict"), rows)


def _rules() -> list[str]:
    better = f"lower is better in {', '.join(LOWER_IS_BETTER)}, higher in everything else"
    return [
        f"*One row before another.* {Contrast.rule} Gains are so signed that more is better ({better}).",
        f"*A limit.* {Bound.rule}",
        f"*A limit of the swap test.* {swap_rules.RULE}",
        f"*One environment harder than another.* {Harder.rule}",
        f"*Stopped before convergence.* {convergence.RULE}",
        "*Best or tied.* Not shown to be worse than the best mean (tested as one row before another, p ≥ 0.05).",
        "*Rank correlation.* Spearman's ρ of the rows' means. Holds: negative, p < 0.05. Does not hold: not negative.",
    ]
