"""Completion, by the shells themselves where they are here; and every word of the command line."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from daemon.commands.outcome.exit_codes import EXIT_OK, EXIT_USAGE
from daemon.commands.shell.completion import completion_script
from daemon.commands.terminal.command_line import COMMANDS, command_parser, leaves, main

SHELLS = ("bash", "zsh", "fish")

ASK = """
source "$1"
shift
COMP_WORDS=("$@")
COMP_CWORD=$(($# - 1))
COMP_LINE="$*"
COMP_POINT=${#COMP_LINE}
complete -p tentacled >/dev/null || exit 3
function=$(complete -p tentacled | sed -E 's/.*-F ([^ ]+).*/\\1/')
"$function" tentacled "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""
"""What bash does at a Tab."""


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("completion") / "tentacled.bash"
    path.write_text(completion_script("bash"))
    return path


def completed(script: Path, *words: str, folder: Path, runtime: Path | None = None) -> set[str]:
    done = subprocess.run(
        ["bash", "-c", ASK, "bash", str(script), *words],
        cwd=folder,
        env={"PATH": "/usr/bin:/bin", "XDG_RUNTIME_DIR": str(runtime or folder)},
        capture_output=True,
        text=True,
        check=True,
    )
    return {line.strip() for line in done.stdout.splitlines() if line.strip()}


def test_bash_completes_commands(script: Path, tmp_path: Path) -> None:
    assert completed(script, "tentacled", "", folder=tmp_path) >= set(COMMANDS)
    assert completed(script, "tentacled", "exp", folder=tmp_path) == {
        "explore",
        "experiment",
        "export",
    }
    assert completed(script, "tentacled", "mdn", "c", folder=tmp_path) == {"collect", "calibrate"}


def test_bash_completes_options_and_their_values(script: Path, tmp_path: Path) -> None:
    assert completed(script, "tentacled", "run", "--run", folder=tmp_path) == {
        "--runs",
        "--runtime-dir",
    }
    assert "--json" in completed(script, "tentacled", "status", "--", folder=tmp_path)
    words = ("tentacled", "export", "run", "--format", "")
    assert completed(script, *words, folder=tmp_path) == {"csv", "parquet"}


def test_bash_completes_files_and_robots_that_run(script: Path, tmp_path: Path) -> None:
    (tmp_path / "arm.yaml").write_text("")
    assert "arm.yaml" in completed(script, "tentacled", "check", "ar", folder=tmp_path)
    runtime = tmp_path / "runtime"
    (runtime / "tentacled" / "soft_arm").mkdir(parents=True)
    (runtime / "tentacled" / "tendon_arm").mkdir()
    found = completed(script, "tentacled", "status", "so", folder=tmp_path, runtime=runtime)
    assert found == {"soft_arm"}


@pytest.mark.parametrize("shell", SHELLS)
def test_every_command_and_option_is_in_the_script(shell: str) -> None:
    script = completion_script(shell)
    for name, leaf in leaves(command_parser()):
        assert name.split()[-1] in script
        for option in leaf._option_string_actions:
            if option.startswith("--"):
                assert option.removeprefix("--") in script, (shell, name, option)


@pytest.mark.parametrize("shell", SHELLS)
def test_the_shell_itself_takes_the_script(shell: str, tmp_path: Path) -> None:
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"{shell} is not here")
    path = tmp_path / "script"
    path.write_text(completion_script(shell))
    done = subprocess.run([program, "-n", str(path)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_command_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "bash"]) == EXIT_OK
    assert capsys.readouterr().out == completion_script("bash").rstrip("\n") + "\n"
    assert main(["completion", "fish", "--json"]) == EXIT_OK
    result = json.loads(capsys.readouterr().out)["result"]
    assert result["script"] == completion_script("fish")
    with pytest.raises(SystemExit) as ended:
        main(["completion", "csh"])
    assert ended.value.code == EXIT_USAGE
