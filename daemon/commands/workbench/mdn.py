"""`tentacled mdn`: the mixture density network of a body: its data, its training, its trial."""

from typing import Final

from daemon.commands.terminal.command_line import CommandGroup

_GROUP: Final = CommandGroup(
    "body_model",
    "WHAT",
    {
        "collect": "see an emulated body at many configurations; or take over clouds of a real one",
        "train": "learn where a body is from such data",
        "sweep": "learn with 1, 2, … components, and say how many it needs",
        "evaluate": "put a learned model beside the data that were kept back",
        "calibrate": "put the contacts that it predicts beside those of an emulated body",
    },
)
add_arguments: Final = _GROUP.add_arguments
run: Final = _GROUP.run
