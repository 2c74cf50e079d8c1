"""Coverage-guided fuzzing: `python -m tests.fuzz --inputs 1000000`.

Each target runs in a process of its own under atheris. Ends with exit code 1 and the input that
did it where a target fails; that input is also left in the folder `fuzz-findings`.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

from tests.fuzz.targets import ALL, SLOW, WHOLE_DEVICES

FINDINGS = Path("fuzz-findings")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=1_000_000, help="for each target")
    parser.add_argument("--only", metavar="NAME", help="targets whose name contains this")
    parser.add_argument("--worker", metavar="NAME", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        return _fuzz(arguments.worker, arguments.inputs)
    failed = 0
    for name in ALL:
        if arguments.only is None or arguments.only in name:
            inputs = arguments.inputs // (SLOW if name in WHOLE_DEVICES else 1)
            failed += _run_worker(name, inputs)
    return min(failed, 1)


def _run_worker(name: str, inputs: int) -> int:
    command = [sys.executable, "-m", "tests.fuzz", "--worker", name, "--inputs", str(inputs)]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False)
    log = done.stderr.decode(errors="replace")
    ran = re.findall(r"^#(\d+)", log, re.MULTILINE)
    covered = re.findall(r"\bft: (\d+)", log)
    result = "nothing found" if done.returncode == 0 else "FAILED"
    print(
        f"{name:<32} {int(ran[-1]) if ran else 0:>9} inputs, "
        f"{covered[-1] if covered else '?':>6} features: {result}",
        flush=True,
    )
    if done.returncode:
        print(log[-4000:], flush=True)
    return int(done.returncode != 0)


def _fuzz(name: str, inputs: int) -> int:
    import atheris

    FINDINGS.mkdir(exist_ok=True)
    atheris.instrument_all()
    options = [f"-runs={inputs}", "-max_len=512", f"-artifact_prefix={FINDINGS}/"]
    atheris.Setup([sys.argv[0], *options], ALL[name])
    atheris.Fuzz()
    return 0


if __name__ == "__main__":
    sys.exit(main())
