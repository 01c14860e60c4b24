"""The one way from a scene to light: `solve` for any question, `frames` and `run` for whole skies with their record."""

from twilight.engine.answer import Answer
from twilight.engine.block import Block
from twilight.engine.frames import Frame, frames, run
from twilight.engine.memory import check_size
from twilight.engine.solve import Field, Problem, solve
from twilight.engine.sunbeam import Direct, Sunbeam

__all__ = ["Answer", "Block", "Direct", "Field", "Frame", "Problem", "Sunbeam", "check_size", "frames", "run", "solve"]
