"""Write shield.md."""

from collections.abc import Mapping
from typing import Any

from aircl_jax.reports import markdown

HEAD = ("controller", "violating steps", "violating episodes", "return", "replaced", "none passes", "µs a step")


def as_markdown(found: Mapping[str, Any]) -> str:
    """Write what the shield costs and what it keeps away, a row a controller."""
    rows = [
        (
            name,
            f"{row['violating_steps']:.2%}",
            f"{row['violating_episodes']:.0%}",
            f"{row['mean_return']:.1f} ± {row['std_return']:.1f}",
            f"{row['replaced']:.1%}",
            f"{row['helpless']:.1%}",
            f"{row['microseconds']:.0f}",
        )
        for name, row in found["rows"].items()
    ]
    judged = sorted(set(found["judged_by"].values()))
    return markdown.paragraphs(
        f"# A shield of {found['method']} on {found['env']}",
        f"`{found['command']}`",
        f"The controller is {found['controller']}. Judged by {', '.join(judged)}. {found['episodes']} fresh episodes each, "
        "the same keys for all; ± is over episodes. µs: one step, compiled and called alone from Python.",
        markdown.table(HEAD, rows, aligned=True),
    )
