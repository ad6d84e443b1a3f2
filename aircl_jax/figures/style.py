"""Define what all figures share: colours for colour-blind readers (Okabe & Ito 2008), sizes, a figure with its caption."""

import io
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.typing import RcKeyType

from aircl_jax.runs.result import Result

BLUE, ORANGE, GREEN, PURPLE, BLACK, GREY = "#0072B2", "#D55E00", "#009E73", "#AA4499", "#222222", "#8a8a8a"
DPI = 200
NOTEBOOK_DPI = 110
OPEN: dict[RcKeyType, Any] = {"axes.spines.top": False, "axes.spines.right": False}
LARGER: dict[RcKeyType, Any] = {**OPEN, "font.size": 8}  # Figures 2, 7 and 8, whose panels are twice as wide as a run's
STYLE: dict[RcKeyType, Any] = {
    **OPEN,
    "font.size": 7,
    "axes.titlesize": 7.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
}


class Drawing(NamedTuple):
    """A figure, the name of its file, and one or two sentences on what it shows."""

    name: str
    figure: Figure
    caption: str

    def _repr_png_(self) -> bytes:
        """Show the figure in a notebook."""
        picture = io.BytesIO()
        with mpl.rc_context(STYLE):
            self.figure.savefig(picture, dpi=NOTEBOOK_DPI, format="png")
        return picture.getvalue()


def literal(label: str) -> str:
    """Write a label of the user's data so that matplotlib reads no formula in it."""
    return label.replace("$", r"\$")


def over_seeds(result: Result) -> str:
    """Name the run, as in `aircl_corrected on gridworld, 10 seeds`."""
    number = len(result.summary["seeds"])
    return f"{result.summary['method']} on {result.summary['env']}, {number} seed{'s' if number > 1 else ''}"


def final(result: Result, name: str, percent: bool = False) -> str:
    """Format a metric at the end of training, or say that it is undefined."""
    row = result.summary["metrics"][name]
    return "undefined" if row["mean"] is None else in_words(row["mean"], row["std"], percent)


def in_words(mean: float, std: float | None, percent: bool) -> str:
    """Format mean ± std, in percent if asked."""
    scale, form, unit = (100.0, ".2f", " %") if percent else (1.0, ".3g", "")
    return f"{scale * mean:{form}}" + ("" if std is None else f" ± {scale * std:{'.2f' if percent else '.2g'}}") + unit
