"""The ladder of body models: how much of the physics a body is given."""

from typing import Literal

# What a scene may ask for, and what "auto" picks for every body.
Fidelity = Literal["auto", "quasi_steady"]
Level = Literal["quasi_steady"]


def resolve(asked: Fidelity) -> Level:
    """The level a body is simulated at."""
    return "quasi_steady" if asked == "auto" else asked
