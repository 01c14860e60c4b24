"""`twilight validate`: computed skies against photographs, and cameras calibrated for it."""

from __future__ import annotations

from collections.abc import Callable

import typer

from twilight.cli import validate_estimate, validate_photo, validate_photometry, validate_spectra, validate_stars
from twilight.cli.terminal import with_errors_as_sentences

app = typer.Typer(
    name="validate", help="Compare computed skies with photographs; calibrate cameras.", no_args_is_help=True
)
commands: tuple[Callable[..., None], ...] = (
    validate_photo.photo,
    validate_photo.response,
    validate_estimate.estimate,
    validate_photometry.photometry,
    validate_spectra.spectra,
    validate_stars.stars,
)
for command in commands:
    app.command()(with_errors_as_sentences(command))
