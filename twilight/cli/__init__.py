"""The command line; `main` is the `twilight` command.

Commands import what they call inside functions, so that help and refusals need not wait half a second for numba.
"""

import os
import sys


def main() -> None:
    """Entry point of the `twilight` command.

    An interrupt during its imports gives no traceback either, nor does an output that cannot be written (exit code 2,
    and 1 where its reader has left) or a working directory that is gone (2).
    """
    # numpy's matrix products are small here: a second thread of theirs only waits, which takes processor time
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        _check_surroundings()
        from twilight.cli.app import app
        from twilight.cli.words import as_meant

        sys.argv[1:] = as_meant(sys.argv[1:])
        try:
            app()
        except SystemExit as left:
            if left.code in (130, 143):
                _flush()
                sys.stderr.flush()
                os._exit(left.code)  # threads inside kernels are not waited for
            raise
        finally:
            _flush()
    except OSError as error:
        _leave(str(error.strerror or error))
    except KeyboardInterrupt:
        print("twilight: interrupted", file=sys.stderr)
        raise SystemExit(130) from None


def _check_surroundings() -> None:
    """Leave with a sentence where the standard output or the working directory is not there."""
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")
    if sys.stdout is None:
        _leave("the standard output is closed; send it to /dev/null where it is not wanted")
    for stream in (sys.stdout, sys.stderr):
        # a letter that the locale does not have is no reason to lose what was computed
        stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]
    try:
        os.getcwd()
    except OSError:
        _leave("the working directory is gone; change into one that is there")


def _flush() -> None:
    """Write what is printed but still held: a full device shows here at the latest."""
    try:
        sys.stdout.flush()
    except OSError as error:
        # the interpreter would try once more when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            raise SystemExit(1) from None
        _leave(f"the standard output cannot be written: {error.strerror}")


def _leave(sentence: str) -> None:
    print(f"twilight: {sentence}", file=sys.stderr)
    raise SystemExit(2)
