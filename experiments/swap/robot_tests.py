"""The swap tests of the robots: which world each acts in, and which parts of (reward, constraint) are the learned ones."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Source = Literal["learned", "world"]


@dataclass(frozen=True)
class Test:
    """A recombination: fresh policies in a world of these settings, judged by its true reward and cost."""

    name: str  # S0 and S1 are scored against each other: experiments.swap.scores
    about: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    reward: Source = "learned"
    constraint: Literal["learned", "world", "none"] = "learned"

    @property
    def constrained(self) -> bool:
        return self.constraint != "none"


SELF = Test("S0", "f + δ, the same world")
ALONE = Test("S1", "f alone, the same world", constraint="none")

TESTS: dict[str, tuple[Test, ...]] = {
    "swimmer": (
        SELF,
        ALONE,
        Test("S2", "backwards + δ", {"reward": "backwards"}, reward="world"),
        Test("S3", "f + a torque limit of 0.3", {"limit": 0.3}, constraint="world"),
        Test("S4 mirror", "f + δ, front motor mirrored", {"body": {"gears": {"front": -1.0}}}),
        Test("S4 weak", "f + δ, rear motor × 0.4", {"body": {"gears": {"rear": 0.4}}}),
        Test("S4 shape", "f + δ, masses × 1.5, lengths × 1.2", {"body": {"mass": 1.5, "length": 1.2}}),
        Test("S4 viscosity", "f + δ, viscosity × 2", {"body": {"viscosity": 2.0}}),
    ),
    "pendulum": (
        SELF,
        ALONE,
        Test("S2", "balance at x = 10 mm + δ", {"reward": "target", "target": 0.01}, reward="world"),
        Test("S4 pole", "f + δ, pole × 1.5", {"body": {"pole": 1.5}}),
    ),
    "walker": (
        SELF,
        ALONE,
        Test("S2 stand", "stand + δ", {"reward": "stand"}, reward="world"),
        Test("S2 back", "backwards + δ", {"reward": "backwards"}, reward="world"),
        Test("S3", "f + a torque limit of 0.3", {"limit": 0.3}, constraint="world"),
        Test("S4 shape", "f + δ, masses × 1.2", {"body": {"mass": 1.2}}),
    ),
}
