"""Compute speeds, ratios and minutes from what was timed."""

import math
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any, NamedTuple

LAST = 5  # rounds over which return and violations of imitation's policies are averaged before they count as reached


class Spread(NamedTuple):
    """Median, least and greatest of the repeats."""

    median: float
    least: float
    greatest: float


class Target(NamedTuple):
    """Least return and greatest violation rate that count as ours: a standard deviation of ten seeds from their means."""

    at_least: float
    at_most: float


def spread(values: Sequence[float]) -> Spread:
    return Spread(median(values), min(values), max(values))


def ratio(ours: Spread, theirs: Spread) -> Spread:
    """Divide the medians; the bounds are those of the worst and the best case."""
    return Spread(ours.median / theirs.median, ours.least / theirs.greatest, ours.greatest / theirs.least)


def run_seconds(ours: Mapping[str, Any], twin: bool = True) -> list[float]:
    """Compute the seconds of a whole run without its start, of each repeat; a twin goes its own way in every iteration."""
    each = (twin and ours["twin_iteration_s"]) or ours["iteration_s"]
    return [
        ours["iterations"] * iteration + ours["checkpoints"] * (evaluation + checkpoint)
        for iteration, evaluation, checkpoint in zip(each, ours["evaluation_s"], ours["checkpoint_s"], strict=True)
    ]


def our_speed(ours: Mapping[str, Any], twin: bool = True) -> Spread:
    """Compute environment steps per second of the rollouts that update π, over a whole run without its start."""
    steps = ours["iterations"] * ours["steps_an_iteration"]
    return spread([steps / seconds for seconds in run_seconds(ours, twin)])


def their_speed(theirs: Mapping[str, Any]) -> Spread:
    """Sum environment steps per second over the processes, of each repeat."""
    return spread([sum(theirs["steps_a_round"] / each for each in rounds) for rounds in zip(*theirs["round_s"], strict=True)])


def our_minutes(ours: Mapping[str, Any]) -> float:
    """Compute the minutes from the command to the last evaluation of all seeds."""
    return (ours["start_s"] + median(run_seconds(ours))) / 60


def their_minutes(theirs: Mapping[str, Any], steps: float, seeds: int) -> float:
    """Extrapolate the minutes in which the processes train so many seeds in turn, each for so many steps."""
    a_seed = median(theirs["start_s"]) + steps * theirs["processes"] / their_speed(theirs).median
    return math.ceil(seeds / theirs["processes"]) * a_seed / 60


def target_of(metrics: Mapping[str, Any]) -> Target:
    """Read from a kept cell's metrics what counts as the same return and violations of π."""
    earned, violated = metrics["return"], metrics["violation_rate_policy"]
    return Target(earned["mean"] - (earned["std"] or 0.0), violated["mean"] + (violated["std"] or 0.0))


def steps_to(theirs: Mapping[str, Any], target: Target) -> int | None:
    """Return after how many steps of a seed the means of the last rounds are within the target; None where they never are."""
    earned, violated = theirs["return"], theirs["violation_rate"]
    for end in range(min(LAST, len(earned)), len(earned) + 1):
        last = slice(max(0, end - LAST), end)
        if end and mean(earned[last]) >= target.at_least and mean(violated[last]) <= target.at_most:
            return (1 + end) * theirs["steps_a_round"]
    return None


def mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
