"""Hears of the kernels that numba compiles, and does not fall over what was compiled before.

Kernels are compiled when they are first called, and then kept on disk: minutes once per machine, or
after a change of the file that they stand in. How many there will be is known only about: those of
the modules that are imported and that are not on disk yet, some of which may not be called.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from numba.core import event as numba_events
from numba.core.caching import IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

from daemon.host.progress import Progress

_OURS: Final = ("daemon", "safety", "sim_backends")
_SELDOM: Final = ("daemon.learning.lwpr.metric",)
"""Modules whose kernels are called where a model learns its fields' shapes, and nowhere else."""
_WHAT: Final = "compiling kernels (once per machine): {done} of about {total}"
_EVENT: Final = "numba:compile"


def forgive_caches() -> None:
    """What is on disk and cannot be read is compiled anew, from now on in this process.

    numba reads a kernel's index before it asks whether that is older than the source. In it stand
    the types of arguments: where one of them has another name or module since, or where the power
    went while the file was written, reading raises, and with it the first call of the kernel.
    """
    for name, forgiving in _FORGIVING.items():
        setattr(IndexDataCacheFile, name, forgiving)


_read_index, _read_data = (vars(IndexDataCacheFile)[name] for name in ("_load_index", "_load_data"))


def _index(file: Any) -> Any:
    try:
        return _read_index(file)
    except Exception:  # pickle raises whatever the classes that it meets raise
        return {}


def _data(file: Any, name: str) -> Any:
    try:
        return _read_data(file, name)
    except Exception as error:
        raise OSError(f"{name}: {error}") from None  # which numba takes for a file that is gone


_FORGIVING: Final = {"_load_index": _index, "_load_data": _data}


@contextmanager
def compilation_told(progress: Progress) -> Iterator[None]:
    """Tells of every kernel that is compiled while the context lasts. Nothing where none is."""
    forgive_caches()
    listener = _Listener(progress)
    numba_events.register(_EVENT, listener)  # type: ignore[no-untyped-call]
    try:
        yield
    finally:
        numba_events.unregister(_EVENT, listener)  # type: ignore[no-untyped-call]


@numba_events.Listener.register
class _Listener:
    """Of numba's events, which come in pairs, one in the other where a kernel calls another."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._done: dict[str, int] = {}
        """Kernels that were compiled, and how large they are."""
        self._wanted: dict[str, int] = {}
        self._modules = 0
        self._begun = False

    def notify(self, event: Any) -> None:
        """numba's own interface."""
        kernel = event.data["dispatcher"].py_func
        if kernel.__module__.split(".")[0] not in _OURS:
            return
        if event.is_start:
            self._tell()
        elif event.is_end:
            self._done[_name(kernel)] = _size(kernel)
            self._tell()

    def _tell(self) -> None:
        """Large kernels take longer: it goes by the size of their code."""
        if len(sys.modules) != self._modules:
            self._modules = len(sys.modules)
            self._wanted |= kernels_to_compile()
        wanted = {**self._wanted, **self._done}
        done, total = sum(self._done.values()), sum(wanted.values())
        what = _WHAT.format(done=len(self._done), total=len(wanted))
        if not self._begun:
            self._begun = True
            self._progress.begin(what, total)
        else:
            self._progress.reach(done, total, what)


def kernels_to_compile() -> dict[str, int]:
    """Those of the modules imported so far that are not kept on disk, and how large they are."""
    found = {}
    for name, module in list(sys.modules.items()):
        if name.split(".")[0] not in _OURS or name in _SELDOM:
            continue
        for kernel in list(vars(module).values()):
            if isinstance(kernel, Dispatcher) and not kernel.signatures and not _kept(kernel):
                found[_name(kernel.py_func)] = _size(kernel.py_func)
    return found


def _name(function: Any) -> str:
    return f"{function.__module__}.{function.__qualname__}"


def _size(function: Any) -> int:
    return len(function.__code__.co_code)


def _kept(kernel: Any) -> bool:
    """Whether numba's index file of this kernel is there, and newer than the source."""
    function, folder = kernel.py_func, kernel.stats.cache_path
    if not folder:
        return False
    source = Path(function.__code__.co_filename)
    name = f"{source.stem}.{function.__qualname__}-{function.__code__.co_firstlineno}"
    try:
        written = max(path.stat().st_mtime for path in Path(folder).glob(f"{name}.*.nbi"))
        return written >= source.stat().st_mtime
    except (OSError, ValueError):
        return False
