"""Slices of work on threads: kernels release the lock, and each writes rows of its own.

Small matrix products on one thread.
"""

import functools
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

SLICES_PER_THREAD = 8
"""More slices than threads, so that no thread waits long for the last one."""


def in_slices(work: Callable[[int, int], None], n: int) -> None:
    """Call `work(first, end)` for slices that cover range(n), on as many threads as numba is set to use."""
    threads = 1
    if n > 1:
        with suppress(ImportError):  # kernels are Python, one at a time
            import numba  # start-up

            threads = numba.get_num_threads()
    if threads == 1:
        work(0, n)
        return
    from concurrent.futures import ThreadPoolExecutor  # start-up

    n_slices = min(n, threads * SLICES_PER_THREAD)
    edges = [n * i // n_slices for i in range(n_slices + 1)]
    pool = ThreadPoolExecutor(threads)
    try:
        # list() raises what a slice raised
        list(pool.map(work, edges[:-1], edges[1:]))
    except BaseException as error:
        # an interrupt does not wait for the slices that are being worked on
        pool.shutdown(wait=isinstance(error, Exception), cancel_futures=True)
        raise
    pool.shutdown()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Keep numpy's matrix products on one thread: many small ones on several threads wait for each other, on a busy
    machine twenty times as long as one thread takes, and sums may depend on their number.  Also a decorator: of what
    people call (`base.arguments.in_units`, `resolve`, `solve`, the command), so that nothing below needs it."""
    with _controller(len(sys.modules)).limit(limits=1, user_api="blas"):
        yield


@functools.lru_cache(maxsize=1)
def _controller(modules: int) -> Any:
    """Of the libraries that are loaded: scipy brings one of its own with some of its modules; modules: how many are."""
    from threadpoolctl import ThreadpoolController  # start-up

    return ThreadpoolController()
