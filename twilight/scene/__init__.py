"""From a validated configuration to a `Scene`: medium, suns, plan, and the record of what was asked."""

from twilight.scene.scene import Scene, resolve
from twilight.scene.suns import SceneSun, count_suns, suns_of

__all__ = ["Scene", "SceneSun", "count_suns", "resolve", "suns_of"]
