"""The exit codes of all commands. Numbers and their meaning are those of sysexits.h."""

from typing import Final

EXIT_OK: Final = 0
EXIT_FAILED: Final = 1
EXIT_USAGE: Final = 64
EXIT_DATA: Final = 65
EXIT_NO_INPUT: Final = 66
EXIT_UNAVAILABLE: Final = 69
EXIT_INTERNAL: Final = 70
EXIT_CANNOT_CREATE: Final = 73
EXIT_IO: Final = 74
EXIT_NO_ANSWER: Final = 75
EXIT_PROTOCOL: Final = 76
EXIT_REFUSED: Final = 77
EXIT_CONFIGURATION: Final = 78
EXIT_INTERRUPTED: Final = 130
"""128 and the number of SIGINT, as shells have it."""

MEANINGS: Final = {
    EXIT_OK: "done",
    EXIT_FAILED: "carried out, and it did not come out well: what is told says what",
    EXIT_USAGE: "wrong usage: an unknown word, or one that does not fit the others",
    EXIT_DATA: "a recording, model, mesh or table cannot be used",
    EXIT_NO_INPUT: "a file or folder that is to be read is not there",
    EXIT_UNAVAILABLE: "no daemon, lab, device or package, or somebody else has it",
    EXIT_INTERNAL: "an error of tentacled's own, with its traceback on stderr",
    EXIT_CANNOT_CREATE: "what is to be written is there already, or cannot be made",
    EXIT_IO: "the system could not read or write",
    EXIT_NO_ANSWER: "no answer in time; trying again may help",
    EXIT_PROTOCOL: "the other side speaks another version of the messages",
    EXIT_REFUSED: "refused: this user may not, or the robot must not now",
    EXIT_CONFIGURATION: "a configuration file is wrong; starting again does not help",
    EXIT_INTERRUPTED: "interrupted by Ctrl-C",
}
"""Of every code that there is."""


def exit_code_lines() -> list[str]:
    """The table, a line for each code."""
    return [f"{code:>3}  {meaning}" for code, meaning in MEANINGS.items()]
