"""What packages that add solvers and file formats may rely on (`docs/examples/extension`)."""

from twilight.atmosphere.medium import observer_at
from twilight.base.errors import TwilightError
from twilight.base.progress import Progress
from twilight.base.sections import option, settings
from twilight.base.whole_files import whole_file
from twilight.io.rendered import Options, Rendered
from twilight.solvers.base import (
    BareField,
    Capabilities,
    Convergence,
    Cost,
    Field,
    PolarisedField,
    SegmentField,
    Solver,
    StochasticField,
)

__all__ = [
    "BareField",
    "Capabilities",
    "Convergence",
    "Cost",
    "Field",
    "Options",
    "PolarisedField",
    "Progress",
    "Rendered",
    "SegmentField",
    "Solver",
    "StochasticField",
    "TwilightError",
    "observer_at",
    "option",
    "settings",
    "whole_file",
]
