"""List what this project says of `aircl_contrast`, each with the rules that judge it from Table 1 and the swap test."""

from experiments.swap.robot_tests import TESTS
from experiments.table1.cells import COLUMNS
from experiments.table1.claim_rules import Bound
from experiments.table1.claims import TARGETS_POLICY, Claim
from experiments.table1.swap_rules import GRID, Transfer, Violation

ROW, SWAP = "aircl_contrast", "[swap.md](swap.md)"
STRICT = {GRID: 0.005, "swimmer": 0.001, "walker": 0.01, "pendulum": 0.01}  # limits of the violation rate of π, of this row
RETURNS = {GRID: 0.9, "swimmer": 0.95, "walker": 0.9, "pendulum": 1.0}
AUROCS = {GRID: 0.95, "swimmer": 0.995, "walker": 0.95, "pendulum": 0.95}
EVERYWHERE = (GRID, *TESTS)
WITH_A_LIMIT = tuple(env for env in EVERYWHERE if env == GRID or any(test.name == "S3" for test in TESTS[env]))
TESTED = 6.0  # true M of an obstacle that demonstrations tell of


def _where(limit: float, envs: tuple[str, ...] = EVERYWHERE, grid: float | None = None) -> dict[str, float]:
    return {env: grid if env == GRID and grid is not None else limit for env in envs}


CLAIMS = (
    Claim(
        "π stays below the project's limits on violations", "ours", (Bound(ROW, "violation_rate_policy", TARGETS_POLICY, True),)
    ),
    Claim("π stays below this row's own, stricter limits", "ours", (Bound(ROW, "violation_rate_policy", STRICT, True),)),
    Claim("π does the task", "ours", (Bound(ROW, "return_ratio", RETURNS, False),)),
    Claim("f is the reward, step by step", "ours", (Bound(ROW, "reward_correlation", dict.fromkeys(COLUMNS, 0.95), False),)),
    Claim("δ̄ tells what violates from what does not", "ours", (Bound(ROW, "feasibility_auroc", AUROCS, False),)),
    Claim("S0: a fresh policy on (f, δ) earns what one on the truth earns", SWAP, (Transfer(ROW, "S0", _where(0.95)),)),
    Claim("S1: f alone wants what the true reward alone wants", SWAP, (Transfer(ROW, "S1", _where(0.9, tuple(TESTS))),)),
    Claim("S2: δ serves other rewards", SWAP, (Transfer(ROW, "S2", _where(0.95)),)),
    Claim("S3: f serves other constraints", SWAP, (Transfer(ROW, "S3", _where(0.95, WITH_A_LIMIT)),)),
    Claim("S4: (f, δ) serves changed worlds, on average", SWAP, (Transfer(ROW, "S4", _where(0.95, grid=0.98)),)),
    Claim(
        "S4: (f, δ) serves each changed body",
        SWAP,
        tuple(Transfer(ROW, test.name, {env: 0.95}) for env in TESTS for test in TESTS[env] if test.name.startswith("S4")),
    ),
    Claim(
        "S0, S2, S3, S4: on robots fresh policies hardly ever violate",
        SWAP,
        (Violation(ROW, ("S0", "S2", "S3", "S4"), _where(0.001, tuple(TESTS))),),
    ),
    Claim("S0, S4: on grids plans violate hardly more than the truth's", SWAP, (Violation(ROW, ("S0", "S4"), {GRID: 0.03}),)),
    Claim("S2: on grids neither do plans for other rewards", SWAP, (Violation(ROW, ("S2",), {GRID: 0.03}),)),
    Claim(
        "S2 on grids where every obstacle was tempting: nearly the whole return, hardly a violation",
        SWAP,
        (Transfer(ROW, "S2", {GRID: 0.99}, TESTED), Violation(ROW, ("S2",), {GRID: 0.02}, TESTED)),
    ),
)
