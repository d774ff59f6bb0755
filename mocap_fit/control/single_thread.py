"""One thread for linear algebra, so that its sums do not depend on the number of cores."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from typing import Any

_lock = threading.Lock()
# Libraries, and the numbers of threads to restore when the last context is left.
_former: list[tuple[Any, int]] = []
_contexts = 0


@contextlib.contextmanager
def limit_to_one_thread() -> Iterator[None]:
    """Limit BLAS to one thread while any thread of the program is in such a context.

    Yields
    ------
    None
        The former numbers of threads return when the last context is left.
    """
    import scipy.linalg  # noqa: F401  # Its BLAS is limited only once it is loaded.
    from threadpoolctl import ThreadpoolController

    global _contexts
    libraries = ThreadpoolController().select(user_api="blas").lib_controllers
    with _lock:
        if not _contexts:
            _former[:] = [(library, library.num_threads) for library in libraries]
        _contexts += 1
        for library in libraries:
            _set_threads(library, 1)
    try:
        yield
    finally:
        with _lock:
            _contexts -= 1
            if not _contexts:
                for library, count in _former:
                    _set_threads(library, count)


def _set_threads(library: Any, count: int) -> None:
    # `set_num_threads` of threadpoolctl 3.7 and later obeys only the first thread that called it.
    getattr(library, "_real_set_num_threads", library.set_num_threads)(count)
