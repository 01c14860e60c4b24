"""`twilight cache`: what is cached on disk between runs."""

from typing import Annotated

from twilight.cli.options import flag


def cache(clear: Annotated[bool, flag("--clear", "Remove all that is cached.")] = False) -> None:
    """Show or clear the cache: a scene that was solved before is shown at once.

    So are the skies that `twilight validate estimate` has computed.

    The folder is TWILIGHT_CACHE_DIR, the limit of fields and skies TWILIGHT_CACHE_GB [2]; 0 caches none.
    """
    from twilight.base import cache as caches
    from twilight.cli.terminal import print_table

    limit, files = caches.limit_bytes(), list(caches.cached_files())
    if clear:
        caches.clear()
    rows = []
    for kind in caches.KINDS:
        sizes = [file.size_bytes for file in files if file.kind is kind]
        if sizes:
            rows.append([kind.label, f"{len(sizes)}", f"{sum(sizes) / 1e6:.3g}"])
    if rows:
        print_table(["removed" if clear else "cached", "files", "size [MB]"], rows, right=(1, 2))
    else:
        print("nothing is cached")
    print(
        f"in {caches.cache_folder()}; "
        + (f"the limit is {limit / 1e9:g} GB" if limit else f"no fields are cached ({caches.LIMIT_VARIABLE} is 0)")
    )
