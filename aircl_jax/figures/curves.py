"""Draw learning curves: small multiples over iterations with the band over seeds, and a caption of where they end."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from aircl_jax.figures.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, Drawing, final, in_words, over_seeds
from aircl_jax.runs.result import Result


class Curve(NamedTuple):
    metric: str
    label: str
    colour: str


class Panel(NamedTuple):
    """One small multiple; `expert` names the metric of the demonstrations' level."""

    title: str
    unit: str
    curves: tuple[Curve, ...]
    expert: str | None = None
    scale: float = 1.0
    limits: tuple[float | None, float | None] = (None, None)
    chance: float | None = None  # value of a guess
    of: str = "all"  # methods that have the panel: all, or those with a feasibility or a discriminator


PERCENT, SHARE = 100.0, (-0.03, 1.05)
POLICY, SAMPLES = r"$\pi$", "$q$"
PANELS = (
    Panel(
        "violations",
        "timesteps (%)",
        (Curve("violation_rate", SAMPLES, ORANGE), Curve("violation_rate_policy", POLICY, BLUE)),
        expert="violation_rate_expert",
        scale=PERCENT,
        limits=(0, None),
    ),
    Panel(
        "infeasible trajectories",
        "trajectories (%)",
        (Curve("infeasible_share", SAMPLES, ORANGE), Curve("infeasible_share_policy", POLICY, BLUE)),
        scale=PERCENT,
        limits=(0, None),
    ),
    Panel(
        "true return",
        "sum of rewards",
        (Curve("return_sampled", SAMPLES, ORANGE), Curve("return", POLICY, BLUE)),
        expert="expert_return",
    ),
    Panel(
        "goal reached",
        "episodes (%)",
        (Curve("goal_rate", POLICY, BLUE),),
        expert="expert_goal_rate",
        scale=PERCENT,
        limits=(0, 102),
    ),
    Panel(
        "state occupancy",
        "TV to the expert's",
        (Curve("occupancy_tv", POLICY, BLUE),),
        limits=(0, None),
    ),
    Panel(
        r"feasibility $\bar\delta$ in training",
        r"mean $\bar\delta$",
        (Curve("feasibility_expert", "$D_E$", BLACK), Curve("feasibility_policy", "$D_P$", BLUE)),
        limits=SHARE,
        of="feasibility",
    ),
    Panel(
        r"$\bar\delta$ on the reference set",
        "AUROC, gap",
        (Curve("feasibility_auroc", "AUROC", GREEN), Curve("feasibility_gap", "gap", PURPLE)),
        limits=(None, 1.05),
        of="feasibility",
    ),
    Panel(
        "effective sample size",
        "share of the pool",
        (Curve("effective_sample_size", SAMPLES, ORANGE),),
        limits=SHARE,
        of="feasibility",
    ),
    Panel(
        "discriminator",
        "accuracy",
        (Curve("rc_acc", "RCAcc", GREEN), Curve("balanced_acc", "balanced", PURPLE)),
        limits=SHARE,
        chance=0.5,
        of="discriminator",
    ),
)
SAMPLER_METRICS = {"violation_rate", "infeasible_share", "return_sampled", "effective_sample_size"}
HEALTH = {
    "logit_size": ("size of the logit", "mean |logit|"),
    "entropy": (r"entropy of $\pi$", "nats per step"),
    "approx_kl": ("step of the policy", "approximate KL"),
    "policy_loss": ("policy loss", "surrogate"),
    "value_loss": ("value loss", "squared error"),
}
LOGARITHMIC = {"value_loss"}


class End(NamedTuple):
    """A sentence of the caption on where a metric ends, and the metric of the demonstrations' level."""

    metric: str
    sentence: str
    expert: str | None = None
    percent: bool = True


ENDS = (
    End("violation_rate", "q violates in {} of the timesteps"),
    End("violation_rate_policy", "π violates in {} of the timesteps", "violation_rate_expert"),
    End("goal_rate", "π reaches the goal in {} of the episodes", "expert_goal_rate"),
    End("return", "its true return is {}", "expert_return", percent=False),
    End("feasibility_auroc", "AUROC of δ̄ {}", percent=False),
    End("feasibility_gap", "gap of δ̄ {}", percent=False),
)


def learning_curves(result: Result) -> Drawing:
    """Draw the learning curves of the metrics that the run has."""
    panels = [panel for panel in (_relevant(panel, result) for panel in PANELS) if panel.curves]
    figure, axes = small_multiples(len(panels))
    for axis, panel in zip(axes, panels, strict=True):
        marks = [_curve(axis, result.history[curve.metric] * panel.scale, curve) for curve in panel.curves]
        if panel.chance is not None:
            axis.axhline(panel.chance, color=GREY, ls=(0, (1, 2)), lw=0.8, zorder=1)
        level = result.summary["metrics"].get(panel.expert, {}).get("mean") if panel.expert else None
        if level is not None:
            axis.axhline(level * panel.scale, color=BLACK, ls=(0, (4, 2)), lw=0.8, zorder=1)
            marks.append((level * panel.scale, "expert", BLACK))
        axis.set_ylim(*panel.limits)
        axis.set_title(panel.title)
        axis.set_ylabel(panel.unit)
        label_ends(axis, marks)
    caption = (
        f"Learning curves, {over_seeds(result)}: means, bands from the least to the greatest seed, single seeds "
        f"faint; dots are evaluations on fresh episodes. {_ends(result)}"
    )
    return Drawing("learning_curves", figure, caption)


def losses(result: Result) -> Drawing:
    """Draw the adversary's losses and the measures of the policy's update."""
    rows = {name: (name.removeprefix("loss_").replace("_", " "), "") for name in result.history if name[:5] == "loss_"}
    defined = {name: row for name, row in (rows | HEALTH).items() if _defined(result.history.get(name))}
    figure, axes = small_multiples(len(defined))
    for axis, (name, (title, unit)) in zip(axes, defined.items(), strict=True):
        _curve(axis, result.history[name], Curve(name, "", GREY if name in HEALTH else BLUE))
        axis.set_yscale("log" if name in LOGARITHMIC else "linear")
        axis.set_title(title)
        axis.set_ylabel(unit)
    caption = (
        f"Optimisation, {over_seeds(result)}: the adversary's terms (blue), each as it enters the minimised sum, "
        "and the policy's update (grey)."
    )
    return Drawing("losses", figure, caption)


def small_multiples(number: int) -> tuple[Figure, list[Axes]]:
    """Make a full-width figure of that many panels with iterations along x, in rows that leave few places empty."""
    columns = min((4, 3, 5), key=lambda columns: (-number % columns, abs(columns - 4)))
    rows = -(-number // columns)
    figure = Figure(figsize=(7.2, 0.35 + 1.5 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in grid[number:]:
        axis.remove()
    for axis in grid[:number]:
        axis.xaxis.set_major_locator(MaxNLocator(nbins=4, integer=True, steps=[1, 2, 2.5, 5, 10]))
    figure.supxlabel("iteration", fontsize=7)
    return figure, list(grid[:number])


def label_ends(axis: Axes, marks: Sequence[tuple[float, str, str]], gap: float = 0.11) -> None:
    """Name each line at its right end; move names apart that are closer than `gap` of the height."""
    bottom, top = axis.get_ylim()
    ordered = sorted(marks)
    wanted = np.array([(value - bottom) / (top - bottom) for value, _, _ in ordered])
    for place, (_, text, colour) in zip(_apart(wanted, gap), ordered, strict=True):
        axis.annotate(
            text, (1, place), xycoords="axes fraction", xytext=(3, 0), textcoords="offset points", va="center", color=colour
        )


def _apart(wanted: Float[np.ndarray, " K"], gap: float) -> Float[np.ndarray, " K"]:
    """Find the ascending places nearest to the wanted ones, `gap` apart and on the axis, by isotonic regression."""
    number, lowest = len(wanted), 0.04  # a name in the corner would touch the last tick
    slack = wanted - gap * np.arange(number)
    nearest = [
        max(min(slack[first : last + 1].mean() for last in range(i, number)) for first in range(i + 1)) for i in range(number)
    ]
    return np.clip(nearest, lowest, max(lowest, 1.0 - gap * (number - 1))) + gap * np.arange(number)


def _curve(axis: Axes, values: Float[np.ndarray, "I S"], curve: Curve) -> tuple[float, str, str]:
    """Draw mean, band and single seeds of one metric over the iterations that have it; return the place and name of its end."""
    measured = np.asarray(np.isfinite(values).any(axis=1))
    iteration, values = np.flatnonzero(measured) + 1, values[measured]
    mean = np.nanmean(values, axis=1)
    sparse = len(mean) <= len(measured) // 2 or len(mean) == 1
    if values.shape[1] > 1:
        axis.plot(iteration, values, color=curve.colour, lw=0.4, alpha=0.3)
        axis.fill_between(iteration, np.nanmin(values, 1), np.nanmax(values, 1), color=curve.colour, alpha=0.15, lw=0)
    axis.plot(iteration, mean, color=curve.colour, lw=1.2, marker="o" if sparse else "", ms=2.2)
    axis.set_xlim(0, len(measured) * 1.01)
    return float(mean[-1]), curve.label, curve.colour


def _relevant(panel: Panel, result: Result) -> Panel:
    """Keep the panel's curves that are measured and that do not repeat another."""
    method = result.spec.method
    absent = {"all": False, "feasibility": not method.learns_feasibility, "discriminator": not method.discriminates}[panel.of]
    untrue = panel.title == "true return" and not result.spec.env.has_reward
    doubles = set() if method.draws else SAMPLER_METRICS
    curves = [c for c in panel.curves if c.metric not in doubles and _defined(result.history.get(c.metric))]
    return panel._replace(curves=() if absent or untrue else tuple(curves))


def _defined(values: Float[np.ndarray, "I S"] | None) -> bool:
    return values is not None and bool(np.isfinite(values).any())


def _ends(result: Result) -> str:
    """Describe where the run ended."""
    metrics, sentences = result.summary["metrics"], []
    doubles = set() if result.spec.method.draws else SAMPLER_METRICS
    for end in ENDS:
        if metrics.get(end.metric, {}).get("mean") is None or end.metric in doubles:
            continue
        expert = metrics[end.expert]["mean"] if end.expert else None
        beside = "" if expert is None else f" (expert {in_words(expert, None, end.percent)})"
        sentences.append(end.sentence.format(final(result, end.metric, end.percent)) + beside)
    return f"At the end {'; '.join(sentences)}." if sentences else ""
