"""`twilight cache`: what is kept on disk between runs."""

from __future__ import annotations

from typing import Annotated

import typer


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Remove all kept fields, skies and models.")] = False,
) -> None:
    """Show or clear the fields kept on disk: a scene that was solved before is looked at at once.

    So are the skies that `twilight validate estimate` has computed, and fitted models of the solver compact.

    The folder is TWILIGHT_CACHE_DIR, the limit TWILIGHT_CACHE_GB [2]; 0 keeps no fields.
    """
    from twilight.engine.kept import KeptFields, fields_folder, kept_fields

    kept = kept_fields()
    shown = kept or KeptFields(fields_folder(), 0.0)
    files = shown.files()
    if clear:
        shown.clear()
    size = sum(file.size_bytes for file in files) / 1e9
    limit = f"the limit is {kept.limit_bytes / 1e9:g} GB" if kept else "no more are kept (TWILIGHT_CACHE_GB is 0)"
    count = sum(file.is_field for file in files)
    models = sum(file.is_model for file in files)
    fields = f"{count} field{'' if count == 1 else 's'}"
    if count + models < len(files):
        fields += f" and skies of {len(files) - count - models} climates"
    if models:
        fields += f" and {models} compact model{'' if models == 1 else 's'}"
    fields += f" of {size:.3g} GB"
    print(f"{'removed ' if clear else ''}{fields} in {shown.folder}; {limit}")
