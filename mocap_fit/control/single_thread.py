"""One thread for linear algebra, so that its sums do not depend on the number of cores."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

_lock = threading.Lock()
_limits = contextlib.ExitStack()
_users = 0


@contextlib.contextmanager
def limit_to_one_thread() -> Iterator[None]:
    """Limit BLAS to one thread while the context is entered, by any thread of the program.

    Yields
    ------
    None
        The former number of threads returns when the last context is left.
    """
    import scipy.linalg  # noqa: F401  # Its BLAS is limited only once it is loaded.
    from threadpoolctl import threadpool_limits

    global _users
    with _lock:
        if not _users:
            _limits.enter_context(threadpool_limits(1, user_api="blas"))
        _users += 1
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if not _users:
                _limits.close()
