"""Tests beside each other compile each kernel once: one worker does, the others wait for its file.

Of a fresh clone nothing is compiled, and each of several workers would otherwise compile for itself
whatever the others are just compiling.
"""

import fcntl
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

_LOCKS: Final = Path(tempfile.gettempdir()) / f"tentacled-kernels-{os.getuid()}"


def compile_once() -> None:
    """From now on, in this process, kernels are compiled by nobody else at the same time."""
    dispatcher: Any = Dispatcher  # whose methods are not to be replaced, for a checker of types
    compiling = dispatcher.compile

    def compile_alone(kernel: Any, signature: Any) -> Any:
        # Threads first, in numba's own order; a kernel that calls others holds its own lock
        # meanwhile, which is safe because kernels do not call each other in circles.
        with global_compiler_lock, alone(kernel.py_func):
            return compiling(kernel, signature)

    dispatcher.compile = compile_alone


@contextmanager
def alone(function: Any) -> Iterator[None]:
    """No other process is in here for the same function."""
    _LOCKS.mkdir(exist_ok=True)
    name = f"{function.__code__.co_filename}:{function.__qualname__}"
    with (_LOCKS / hashlib.sha256(name.encode()).hexdigest()[:32]).open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
