"""The command line; `main` is the `twilight` command."""

from __future__ import annotations

import sys


def main() -> None:
    """Entry point of the `twilight` command; an interrupt during its imports gives no traceback either."""
    try:
        from twilight.cli.app import app

        app()
    except KeyboardInterrupt:
        print("twilight: interrupted", file=sys.stderr)
        raise SystemExit(130) from None
