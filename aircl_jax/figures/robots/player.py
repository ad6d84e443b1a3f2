"""Write a page that plays a scene: one HTML file that needs no network and no other script."""

import base64
import html
import json
from importlib import resources
from typing import Any

import numpy as np
from jaxtyping import Float

from aircl_jax.analysis.robot_scene import Scene, Side

LARGEST = 32_000  # largest value of a 16-bit integer, rounded down
FOLLOWED = 3.0  # the view moves along on paths longer than this many widths of the body


def page(scene: Scene) -> str:
    """Write the HTML file's text."""
    template = (resources.files("aircl_jax.figures.robots") / "player.html").read_text(encoding="utf-8")
    data = json.dumps(_data(scene), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    data = data.replace("<", "\\u003c")  # so that no text of the scene ends the script or opens a comment
    before, after = template.split("{{DATA}}")
    return before.replace("{{TITLE}}", html.escape(scene.title)) + data + after


def _data(scene: Scene) -> dict[str, Any]:
    stage, sides = scene.stage, (scene.expert, scene.learned)
    levels = [side.level for side in sides if side.level is not None]
    unit, level_unit = _unit([side.links for side in sides]), _unit(levels)
    return {
        "title": scene.title,
        "note": scene.note,
        "dt": stage.dt,
        "radius": stage.radius.tolist(),
        "branch": stage.branch.tolist(),
        "floor": stage.floor,
        "rail": stage.rail,
        "wall": scene.wall,
        "quantity": scene.quantity,
        "limits": scene.limits,
        "unit": unit,
        "level_unit": level_unit,
        "follow": _is_followed(sides),
        "sides": [_side(side, unit, level_unit) for side in sides],
    }


def _side(side: Side, unit: float, level_unit: float) -> dict[str, Any]:
    return {
        "name": side.name,
        "episodes": [
            {
                "label": f"episode {index + 1}",
                "length": int(length),
                "links": _packed(side.links[index] / unit, "<i2"),
                "violating": _packed(side.violating[index], "u1"),
                "level": None if side.level is None else _packed(side.level[index] / level_unit, "<i2"),
                "delta": None if side.delta is None else _packed(255 * side.delta[index], "u1"),
                "return": _written(side.returns[index], ".1f"),
                "violation": _written(side.violation_rate[index], ".1%"),
                "feasibility": None if side.feasibility is None else _written(side.feasibility[index], ".2f"),
            }
            for index, length in enumerate(side.length)
        ],
    }


def _packed(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.rint(values).astype(kind).tobytes()).decode()


def _unit(arrays: list[np.ndarray]) -> float:
    """Choose the unit of an integer so that 16 bits hold all values."""
    return max((float(np.abs(array).max()) for array in arrays), default=1.0) / LARGEST


def _is_followed(sides: tuple[Side, Side]) -> bool:
    return any(_path(side.links) > FOLLOWED * _width(side.links) for side in sides)


def _path(links: Float[np.ndarray, "E T G 2 2"]) -> float:
    """Measure the longest way of the body's middle along x."""
    return float(np.ptp(links[..., 0].mean(axis=(-2, -1)), axis=1).max())


def _width(links: Float[np.ndarray, "E T G 2 2"]) -> float:
    """Measure the body's largest width."""
    return float(np.ptp(links[..., 0], axis=(-2, -1)).max())


def _written(value: np.floating, form: str) -> str | None:
    return f"{value:{form}}" if np.isfinite(value) else None
