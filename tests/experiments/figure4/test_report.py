"""The words of Figure 4 on two seeds and folds that are worked by hand: every number is its own method's and measure's."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from envs.animals.simulated_meerkats import Truth
from experiments.figure4 import report as words
from experiments.figure4.cells import Study
from experiments.figure4.report import Finished
from experiments.figure4.truth import against_truth

YARDSTICKS = {
    "real_strength": [0.0456, 0.0456],
    "halves": [0.028, 0.030],
    "noise_floor": [0.018, 0.022],
    "markov_chain": [0.03, 0.03],
    "uniform": [0.2, 0.2],
}


def cell(sampled: list[float], policy: list[float], **metrics: list[float | None]) -> dict[str, Any]:
    names = ("feasibility_auroc", "feasibility_gap", "violation_rate", "reward_correlation")
    return {
        "seeds": [0, 1],
        "difference": {"sampled": {"1": sampled}, "policy": {"1": policy}},
        "metrics": {name: {"per_seed": metrics.get(name, [None, None])} for name in names},
        "curves": {"entropy": np.arange(40.0).tolist()},
        "wall_s": 61.7,
        "commit": "abc1234",
        "iterations": 500,
        "command": "c",
        "alarms": [],
    }


def found(**methods: dict[str, Any]) -> Finished:
    ours = {"aircl_corrected": cell([0.022, 0.026], [0.04, 0.06])}
    return Finished({"1": {"per_seed": YARDSTICKS}}, ours | methods, {})


AIRL = cell([0.05, 0.07], [0.08, 0.08])


def rows(text: str) -> dict[str, list[str]]:
    lines = [[part.strip() for part in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
    return {row[0]: row[1:] for row in lines}


def test_the_table_has_q_and_the_policy_in_noise_floors_and_less_the_corrected_rows():
    table = rows(words.difference_table(found(airl=AIRL), "1"))
    # Differences 0.028 and 0.044: t(1) at 97.5 % is 12.706, times 0.0113 / √2; 1 of 2² sign patterns on either side.
    assert table["airl"] == ["0.0600 ± 0.0141", "0.0800 ± 0.0000", "3.00", "+0.0360 [-0.0656, +0.1376]", "0.500"]
    assert table["aircl_corrected"] == ["0.0240 ± 0.0028", "0.0500 ± 0.0141", "1.20", "", ""]


def test_the_yardsticks_stand_below_by_their_names():
    text = words.difference_table(found(), "1")
    table = rows(text)
    assert table["*two halves*"] == ["0.0290 ± 0.0014", "", "1.45", "", ""]
    assert table["*noise floor*"][0] == "0.0200 ± 0.0028"
    assert table["*Markov chain*"][:4] == ["0.0300 ± 0.0000", "", "1.50", "+0.0060 [-0.0194, +0.0314]"]
    assert table["*uniform random*"][2] == "10.00"
    assert "over 2 seeds; mean |V| of the recordings 0.0456." in text


@pytest.mark.parametrize(("sampled", "within"), [([0.024, 0.024], "within"), ([0.026, 0.026], "**not** within")])
def test_the_target_is_a_noise_floor_and_a_quarter(sampled, within):
    text = words.target(found(aircl_corrected=cell(sampled, sampled), airl=AIRL, gacl=cell([0.01, 0.01], [0.5, 0.5])), "1")
    assert f"aircl_corrected is {within} 1.25 noise floors ({sampled[0] / 0.02:.2f}; the fitted Markov chain 1.50)." in text
    assert "It is below airl (3.00)." in text
    assert "It is **not** below gacl (0.50)." in text


def folds(**scores: list[float]) -> dict[str, list[dict[str, Any]]]:
    chain = [-2.0, -2.2, -2.4]
    return {
        name: [
            {"policy": one, "chain": own, "smoothing": smoothing}
            for one, own, smoothing in zip(values, chain, (0.1, 0.03, 0.1), strict=False)
        ]
        for name, values in scores.items()
    }


def test_held_out_recordings_are_judged_fold_by_fold_against_the_chain():
    text = words.held_out(found()._replace(held_out=folds(airl=[-1.9, -2.3, -2.1], bc=[-3.0, -3.2, -3.4])))
    table = rows(text)
    assert table["*first-order Markov chain*"][0] == "-2.2000 ± 0.2000"
    # Differences 0.1, −0.1 and 0.3: 0.1 ± 4.303 · 0.2 / √3.
    assert table["airl"] == ["-2.1000 ± 0.2000", "+0.1000 [-0.3968, +0.5968]", "2 of 3"]
    assert table["bc"][1:] == ["-1.0000 [-1.0000, -1.0000]", "0 of 3"]
    assert "3 folds" in text and "(0.03, 0.1)" in text


def test_folds_are_compared_as_far_as_every_method_has_them():
    scores = words.fold_scores(found()._replace(held_out=folds(airl=[-1.9, -2.3, -2.1], bc=[-3.0, -3.2])))
    assert scores == {"Markov chain": [-2.0, -2.2], "airl": [-1.9, -2.3], "bc": [-3.0, -3.2]}


def test_the_prior_is_with_it_less_without_it_measure_by_measure():
    given = found(
        aircl=cell([0.05, 0.07], [0.9, 0.9], feasibility_auroc=[0.8, 0.9], violation_rate=[0.1, None]),
        aircl_no_prior=cell([0.02, 0.03], [0.1, 0.1], feasibility_auroc=[0.6, 0.5], violation_rate=[0.3, 0.3]),
    )
    text = words.prior(given, "1").replace("\\|", "¦")
    table = rows(text)
    line = table["AUROC of δ̄: aircl − aircl_no_prior"]
    assert line[:2] == ["0.8500 ± 0.0707", "0.5500 ± 0.0707"]
    assert line[2].startswith("+0.3000 [") and line[3:] == ["+2.12", "0.500"]  # of 0.2 and 0.4: 0.3 / 0.1414
    assert table["mean ¦ΔV¦: aircl − aircl_no_prior"][:2] == ["0.0600 ± 0.0141", "0.0250 ± 0.0071"]
    assert not any(name.startswith("violations") for name in table)  # undefined for a seed
    assert "ICRL needs the true reward" in text


@pytest.mark.parametrize(("with_it", "without"), [("aircl_corrected_prior", "aircl_corrected"), ("icrl_prior", "icrl")])
def test_the_other_pairs_of_rows_are_with_and_without_the_prior_too(with_it, without):
    given = found(**{with_it: cell([0.05, 0.05], [0, 0]), without: cell([0.02, 0.02], [0, 0])})
    assert f": {with_it} − {without} | 0.0500 ± 0.0000 | 0.0200 ± 0.0000 | +0.0300" in words.prior(given, "1")


def test_settled_is_a_tenth_of_the_curve_from_three_quarters_on_and_the_last_tenth():
    line = rows(words.settled(found()))["aircl_corrected"]
    assert line == ["31.500", "37.500", "62"]  # means of 30 to 33 and of 36 to 39; seconds


def test_a_cell_is_listed_with_what_made_it():
    assert "| aircl_corrected | abc1234 | 500 | 62 | `c` |" in words.made_with(found())


REWARD = np.log([[0.2, 0.8, 1.0], [0.5, 1.0, 0.5], [1.0, 1.0, 1.0]])  # of a pair: log of its share, where it is seen
COUNTS = np.array([[20, 80, 0], [50, 0, 50], [100, 0, 0]])
FORBIDDEN = np.array([[False, False, True], [False] * 3, [False] * 3])


def mob(reward: np.ndarray = REWARD) -> Study:
    pairs = [pair for pair in np.ndindex(3, 3) for _ in range(COUNTS[pair])]
    truth = Truth(reward, FORBIDDEN, np.zeros((3, 3), bool))
    return cast(Study, SimpleNamespace(herd=SimpleNamespace(truth=truth, windows=SimpleNamespace(code=np.array(pairs)))))


def learned() -> dict[str, Any]:
    """Seen as in tests/analysis/test_recovered.py: chance would have shown every change five times or more."""
    reward = np.array([[10.0, 1.0, 9.0], [2.0, 10.0, 3.0], [4.0, 9.0, 10.0]])
    delta = np.array([[0.0, 0.9, 0.1], [0.9, 0.0, 0.3], [0.9, 0.5, 0.0]])
    recovered = {"reward": [reward], "delta": [delta], "log_policy": [delta], "seen": [[50, 20, 0], [10, 30, 10], [10, 0, 20]]}
    measures = {"reward_correlation": 0.11, "feasibility_auroc": 0.22, "feasibility_gap": 0.33}
    measures |= {"violation_rate": 0.44, "violation_rate_policy": 0.55}
    return {"recovered": recovered, "metrics": {name: {"per_seed": [value]} for name, value in measures.items()}}


def test_what_was_recovered_stands_beside_the_mobs_own_reward_and_constraint():
    true = np.where(np.eye(3), 0.0, np.array([[0.0, 1.0, 9.0], [2.0, 0.0, 3.0], [4.0, 9.0, 0.0]]))
    line = rows(against_truth(mob(true), {"aircl": learned()}))["aircl"]
    # Of seen pairs, 1 2 3 4 10 10 10 with 1 2 3 4 0 0 0: −27.14 / √(101.43 · 15.71). Of changes alone all agree.
    assert line[:3] == ["0.110", "-0.68", "1.00"]
    # 0.9 0.9 0.3 0.9 0.5 are allowed and 0.1 is not.
    assert line[3:] == ["0.220", "0.330", "1.00", "0.440", "0.550"]
    forbidden = [[False, False, True], [False] * 3, [False, True, False]]
    truth = Truth(true, np.array(forbidden), np.zeros((3, 3), bool))
    study = mob()
    study.herd.truth = truth  # pyright: ignore[reportAttributeAccessIssue]
    assert rows(against_truth(study, {"aircl": learned()}))["aircl"][5] == "0.88"  # 0.1 and 0.5 are not: 7 of 8 pairs


def test_counting_ranks_a_change_by_how_often_chance_would_have_shown_it():
    line = rows(against_truth(mob(), {}))["*counting*"]
    assert line[:3] == ["1.000", "1.00", "1.00"]
    assert line[5] == "0.90"  # of the five allowed changes four were shown, and one as little as the forbidden one


def test_counting_is_over_steps_first_and_then_over_pairs():
    reward = REWARD + np.diag([2.0, 0.0, 0.0])
    allowed = [(0, 0), (0, 1), (1, 0), (1, 2), (2, 0)]
    by_pair = np.corrcoef([REWARD[pair] for pair in allowed], [reward[pair] for pair in allowed])[0, 1]
    steps = [pair for pair in allowed for _ in range(COUNTS[pair])]
    by_step = np.corrcoef([REWARD[pair] for pair in steps], [reward[pair] for pair in steps])[0, 1]
    line = rows(against_truth(mob(reward), {}))["*counting*"]
    assert line[:3] == [f"{by_step:.3f}", f"{by_pair:.2f}", "1.00"]
    assert f"{by_step:.2f}" != f"{by_pair:.2f}"
