"""`python -m tests.docs [PAGE …]`: does what pages say, with all that takes minutes.

Tells each block and how long it took. Ends with exit code 1 where one fails.
"""

import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.docs.blocks import blocks_of
from tests.docs.running import reader, runnable
from tests.docs.test_pages import PAGES, SHOWN_ELSEWHERE
from tests.installed_wheel import installed_wheel


def main() -> int:
    failed = 0
    with TemporaryDirectory() as folder:
        programs = installed_wheel(Path(folder)) / "bin"
        for page in sys.argv[1:] or [one for one in PAGES if one not in SHOWN_ELSEWHERE]:
            with reader(programs) as somebody:
                for block in runnable(blocks_of(page), long=True):
                    began_s = time.monotonic()
                    try:
                        somebody.reads(block)
                        told = "done"
                    except (AssertionError, subprocess.TimeoutExpired) as error:
                        failed, told = failed + 1, f"FAILED: {error}"
                    took_s = time.monotonic() - began_s
                    print(f"{block.page}:{block.line}: {took_s:.1f} s, {told}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
