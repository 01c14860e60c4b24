"""Small matrix products on one thread."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Keep numpy's matrix products on one thread: many small ones on several threads wait for each other, on a busy
    machine twenty times as long as one thread takes, and sums may depend on their number.  Also a decorator."""
    with _controller().limit(limits=1, user_api="blas"):
        yield


@functools.cache
def _controller() -> Any:
    from threadpoolctl import ThreadpoolController  # start-up

    return ThreadpoolController()
