"""The file of a fit: a set of coefficients that the preetham solver takes, with what it was fitted to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from twilight.base.whole_files import whole_file
from twilight.solvers.analytic.coefficients import SkyCoefficients, parse_coefficients

HEAD = """\
# Coefficients of Perez's five-parameter sky in the form of Preetham, Shirley and Smits 1999, for
#     twilight render CLIMATE --solver preetham --set solver.coefficients=THIS_FILE
# Lists are polynomials in the turbidity T at 550 nm, highest power first.
# luminance, x and y (CIE 1931) in a direction at zenith angle theta and at the angle gamma from the sun are
#     zenith * F(theta, gamma) / F(0, z),  F = (1 + A exp(B / cos theta)) (1 + C exp(D gamma) + E cos^2 gamma)
# with z the zenith angle of the sun.  Zenith luminance: slope tan(chi (pi - 2 z)) + constant [kcd m^-2];
# zenith x and y: polynomials in z [rad] whose coefficients, z^3 first, are the four lists.
"""


def write_set(made: SkyCoefficients, facts: dict[str, Any], path: Path) -> None:
    """Write a set as YAML, whole or not at all, with the facts about its fit under `fit`.

    Raises TwilightError where it cannot be written, or what is written would not be accepted by the solver.
    """
    text = HEAD + yaml.safe_dump(
        made.as_document() | {"fit": facts}, sort_keys=False, default_flow_style=None, width=118
    )
    parse_coefficients(text, str(path))
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
