"""`python -m tests.docs [PAGE …]`: does what pages say, with all that takes minutes.

Tells each block and how long it took. Ends with exit code 1 where one fails. With `--python` and
another version than ours, all packages are fetched first.
"""

import argparse
import subprocess
import sys
import time

from tests.docs.blocks import blocks_of
from tests.docs.running import installed_for_readers, reader, runnable
from tests.docs.test_pages import PAGES, SHOWN_ELSEWHERE
from tests.ordinary_user import OWN_VERSION


def main() -> int:
    pages = [one for one in PAGES if one not in SHOWN_ELSEWHERE]
    parser = argparse.ArgumentParser(description="do what the documentation says")
    parser.add_argument("pages", nargs="*", metavar="PAGE", help=f"of {', '.join(pages)}")
    parser.add_argument("--python", default=OWN_VERSION, metavar="VERSION")
    parser.add_argument("--short", action="store_true", help="without what takes minutes")
    asked = parser.parse_args()
    if unknown := set(asked.pages) - set(pages):
        parser.error(f"no page: {', '.join(sorted(unknown))}")
    failed = 0
    with installed_for_readers(asked.python) as installed:
        for page in asked.pages or pages:
            with reader(installed) as somebody:
                for block in runnable(blocks_of(page), long=not asked.short):
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
