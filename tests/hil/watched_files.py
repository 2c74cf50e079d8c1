"""`python -m tests.hil.watched_files OUT ...`: the daemon, and every file that its loop opens.

Writes a line per file opened by the main thread into OUT: when (monotonic, ns), and which.
"""

import os
import sys
import threading
import time
from typing import Any


def main() -> int:
    out = os.open(sys.argv[1], os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
    main_thread = threading.get_ident()

    def heard(event: str, arguments: tuple[Any, ...]) -> None:
        # An integer is a descriptor that is open already: the ends of a process' pipes.
        opens = event == "open" and not isinstance(arguments[0], int)
        if opens and threading.get_ident() == main_thread:
            os.write(out, f"{time.monotonic_ns()} {arguments[0]!r}\n".encode())

    sys.addaudithook(heard)
    from daemon.commands.terminal.command_line import main as tentacled

    return tentacled(sys.argv[2:])


if __name__ == "__main__":
    sys.exit(main())
