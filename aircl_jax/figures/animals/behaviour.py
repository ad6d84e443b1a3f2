"""Draw what the behaviour model says: rewards by place, leaving by age, and changes expected beside changes made."""

from collections.abc import Iterator, Sequence

import matplotlib as mpl
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FormatStrFormatter, NullLocator

from aircl_jax.analysis.activities import FORBIDDEN_BELOW, found_of
from aircl_jax.figures.style import BLACK, BLUE, GREY, ORANGE, Drawing, literal
from aircl_jax.runs.result import Result

SMALL = 5.5
PALE = "#f2f2f2"
MOST = 0.5  # share of the bootstrap samples that must flag a change
FEW = 5  # begun fewer times than this: drawn pale


def of_a_run(result: Result) -> Iterator[Drawing]:
    """Draw rewards by place, the mean over bootstrap samples, and n beside the median M; boxed: flagged in most samples."""
    found = found_of(result)
    recordings, names = found.recordings, found.recordings.names
    places = recordings.places if "places" not in recordings.lacks else ("anywhere",)
    shown = recordings.num_behaviours
    yield reward_map(found.reward.mean(axis=0)[:, :shown], found.begun[:, :shown], places, names[:shown])
    flagged = (found.delta < FORBIDDEN_BELOW).mean(axis=0) > MOST
    yield expected_changes(found.middle, found.made, flagged & found.possible, found.possible, names)


def reward_map(
    reward: Float[np.ndarray, "P B"], begun: Float[np.ndarray, "P B"], places: Sequence[str], behaviours: Sequence[str]
) -> Drawing:
    """Draw r(place, activity), each place less its mean, with how often each was begun there."""
    bound = float(np.abs(reward[begun >= FEW]).max()) if (begun >= FEW).any() else 1.0
    figure = Figure(figsize=(1.6 + 0.42 * len(behaviours), 1.5 + 0.22 * len(places)), layout="constrained")
    axis = figure.subplots()
    colours = mpl.colormaps["RdBu"].with_extremes(bad=PALE)
    image = axis.imshow(np.where(begun >= FEW, reward, np.nan), cmap=colours, norm=Normalize(-bound, bound), aspect="auto")
    for place, activity in np.argwhere(begun > 0):
        dark = begun[place, activity] >= FEW and abs(reward[place, activity]) > 0.6 * bound
        number = f"{begun[place, activity]:.0f}"
        axis.text(activity, place, number, ha="center", va="center", fontsize=SMALL, color="white" if dark else BLACK)
    figure.colorbar(image, label="reward of beginning it there (nats)", shrink=0.9)
    axis.set_xticks(
        range(len(behaviours)), list(map(literal, behaviours)), rotation=40, ha="right", rotation_mode="anchor", fontsize=SMALL
    )
    axis.set_yticks(range(len(places)), list(map(literal, places)), fontsize=SMALL)
    _framed(axis)
    return Drawing(
        "reward_by_place",
        figure,
        "Reward of beginning an activity, by the place where the animal is: r(place, activity) less its mean at that place, so "
        f"compare within a row. Numbers: how often it was begun there; pale: fewer than {FEW} times.",
    )


def leaving_by_age(
    labels: Sequence[str], observed: Sequence[float], chain: Sequence[float], model: Sequence[float], unit: str
) -> Drawing:
    """Draw the held-out chance of leaving by the age of the bout: observed, first-order chain, model."""
    figure = Figure(figsize=(3.6, 2.4), layout="constrained")
    axis = figure.subplots()
    at = np.arange(len(labels))
    axis.plot(at, chain, "s--", color=GREY, ms=3, lw=1, label="first-order chain")
    axis.plot(at, model, "o-", color=BLUE, ms=3.5, lw=1.2, label="behaviour model")
    axis.plot(at, observed, "x", color=ORANGE, ms=5, mew=1.4, label="observed")
    axis.set_yscale("log")
    axis.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_yticks([0.01, 0.02, 0.05, 0.1, 0.2])
    axis.yaxis.set_minor_locator(NullLocator())
    axis.set_xticks(at, labels)
    axis.set_xlabel(f"age of the bout ({unit})")
    axis.set_ylabel("chance of leaving in the next row")
    axis.legend(frameon=False, fontsize=6.5)
    return Drawing(
        "leaving_by_age",
        figure,
        "Chance of leaving an activity by how long it has lasted, in held-out recordings; bouts whose beginning was seen.",
    )


def expected_changes(
    expected: Float[np.ndarray, "C C"],
    made: Float[np.ndarray, "C C"],
    flagged: Bool[np.ndarray, "C C"],
    possible: Bool[np.ndarray, "C C"],
    names: Sequence[str],
    feasibility: Float[np.ndarray, "C C"] | None = None,
) -> Drawing:
    """Draw M, how often each change would be made were it ordinary, n beside it, and δ₁ of `aircl_corrected` where known."""
    panels = 2 if feasibility is None else 3
    figure = Figure(figsize=(2.0 + 2.6 * panels, 3.4), layout="constrained")
    axes = figure.subplots(1, panels, sharey=True)
    colours = mpl.colormaps["magma_r"].with_extremes(bad=PALE, under=PALE)
    norm = LogNorm(0.5, max(float(expected[possible].max(initial=1.0)), 1.0))
    for axis, values, title in ((axes[0], expected, "expected, M"), (axes[1], made, "made, n")):
        shown = np.where(possible & (values > 0), values, np.nan)
        image = axis.imshow(shown, cmap=colours, norm=norm, interpolation="nearest")
        axis.set_title(title)
    figure.colorbar(image, ax=list(axes[:2]), label="times", shrink=0.8, location="bottom", aspect=40)
    if feasibility is not None:
        image = axes[2].imshow(
            np.where(possible, feasibility, np.nan), cmap="viridis", norm=Normalize(0, 1), interpolation="nearest"
        )
        axes[2].set_title("feasibility δ₁ of aircl_corrected")
        figure.colorbar(image, ax=axes[2], label="δ₁", shrink=0.8, location="bottom", aspect=20)
    for axis in axes:
        for source, target in np.argwhere(flagged):
            axis.add_patch(Rectangle((target - 0.5, source - 0.5), 1, 1, fill=False, ec=BLUE, lw=1.1))
        axis.set_xticks(range(len(names)), [str(code) for code in range(len(names))], fontsize=4.5)
        axis.set_xlabel("to")
        _framed(axis)
    axes[0].set_yticks(range(len(names)), [f"{literal(name)}  {code}" for code, name in enumerate(names)], fontsize=SMALL)
    axes[0].set_ylabel("from")
    return Drawing(
        "expected_changes",
        figure,
        "How often every possible change would be made were the pair ordinary (M), and how often it was (n). Boxed: flagged as "
        "avoided, because n is too far below M."
        + ("" if feasibility is None else " Right: δ₁ of the adversarial row, which sees only how often changes are shown."),
    )


def _framed(axis: Axes) -> None:
    for side in ("top", "right"):
        axis.spines[side].set_visible(True)
